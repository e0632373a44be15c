"""Whether a tap is fit to be analysed: rules with numbers, and sentences for the person who taps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.contact_force import contact_force, taper_samples
from daq.second_impact import find_second_impact
from daq.settings import Quality
from rig.settings import STANDARD_GRAVITY

__all__ = ["Verdict", "contact_force", "is_clipped", "judge", "rotation_of"]

FLAT_TOP = 4
"""Equal samples in a row at the very top of a record that tell a clipped amplifier."""

SMOOTH_TOP = 1000
"""Steps of the recorder below which the top of a slow swing is flat by rounding: 115 at 350 Hz and 25 kHz."""

SECOND_IMPACT_SIGNIFICANCE = 6.0
"""A second impact is reported where it exceeds what noise alone gives by this many standard deviations."""

SILENT_SHARE = 0.1
"""Rms of a channel over the other's, in the first milliseconds, below which it is not the tap but the channel.

Of the 2112 accepted taps of the practice sessions none is below 0.91; a channel without its sensor shows 0.002."""

WIRING_CHECK = "'mesotap console --scope' checks the wiring by one tap"

QUIETEST_PRETRIGGER = 16
"""Samples before the trigger below which the noise is not known."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was decided on a tap.

    Attributes
    ----------
    accepted
        Whether it is fit for use.
    reason
        Empty, or all reasons against it, the worst first, joined by ``"; "``.
    numbers
        ``peak_acceleration_m_s2`` (either channel), ``peak_contact_force_n`` (largest, either way),
        ``unloading_force_n`` (largest that relieves the contact), ``force_ratio`` (that over the preload),
        ``signal_to_noise``, ``rotation``, ``noise_rms_m_s2``, ``second_impact_ratio``, ``second_impact_ms``,
        ``load_change_mn``: NaN where unknown; and ``force_rule``: ``"applied"``, or why it was not.
    """

    accepted: bool
    reason: str
    numbers: dict[str, float | str]


def is_clipped(acceleration: NDArray[np.float64], full_scale_m_s2: float, bits: int) -> NDArray[np.bool_]:
    """Return for each channel (c, n) whether it reached the end of the recorder's scale, or has a flat top.

    An unknown full scale (NaN) leaves the flat top: four equal samples in a row at the channel's largest
    departure from its median, when that is larger than 1000 of the channel's smallest steps.
    """
    size = np.abs(acceleration)
    clipped = np.zeros(len(acceleration), dtype=np.bool_)
    if math.isfinite(full_scale_m_s2):
        step = 2 * full_scale_m_s2 / 2 ** (bits if bits > 0 else 16)
        clipped |= (size >= full_scale_m_s2 - 1.5 * step).any(axis=1)
    for channel, samples in enumerate(acceleration):
        for end in (samples.max(), samples.min()):
            at_end = samples == end
            run = np.convolve(at_end, np.ones(FLAT_TOP), "valid").max(initial=0) if samples.size >= FLAT_TOP else 0
            if run >= FLAT_TOP:
                steps = np.abs(np.diff(np.unique(samples)))
                clipped[channel] |= steps.size > 0 and abs(end - np.median(samples)) > SMOOTH_TOP * float(steps.min())
    return clipped


def judge(
    acceleration: NDArray[np.float64],
    sample_rate_hz: float,
    pretrigger: int,
    preload_mn: float,
    load_before_mn: float,
    load_after_mn: float,
    m2_kg: float,
    k2_n_per_m: float,
    full_scale_m_s2: float,
    bits: int,
    quality: Quality,
) -> Verdict:
    """Judge one tap.

    Parameters
    ----------
    acceleration
        (2, n) accelerations A and B, m/s2, pressing the contact where positive at first (x2 of Eq. 9).
    preload_mn
        Load on the contact, mN; NaN where unknown, and the contact force is then not judged.
    load_before_mn, load_after_mn
        Load read before and after the tap, mN; NaN where unknown.
    m2_kg, k2_n_per_m
        Lower mass and its spring; NaN where unknown.
    full_scale_m_s2, bits
        Of the recorder; NaN and 0 where unknown.
    """
    at_rest = acceleration[:, :pretrigger] if pretrigger else acceleration
    a = acceleration - at_rest.mean(axis=1, keepdims=True)
    mean = a.mean(axis=0)
    noise = float(mean[:pretrigger].std()) if pretrigger >= QUIETEST_PRETRIGGER else math.nan
    peak = float(np.abs(a).max())
    signal = float(np.abs(mean[pretrigger:]).max())
    rotation = rotation_of(a[:, pretrigger:], sample_rate_hz, quality.rotation_window_ms)
    second = find_second_impact(mean, sample_rate_hz, pretrigger)
    change = abs(load_after_mn - load_before_mn)
    numbers: dict[str, float | str] = {
        "peak_acceleration_m_s2": peak,
        "peak_contact_force_n": math.nan,
        "unloading_force_n": math.nan,
        "force_ratio": math.nan,
        "signal_to_noise": signal / noise if noise > 0 else math.nan if math.isnan(noise) else math.inf,
        "rotation": rotation,
        "noise_rms_m_s2": noise,
        "second_impact_ratio": second.ratio,
        "second_impact_ms": second.delay_s * 1e3,
        "load_change_mn": change,
    }
    reasons: list[tuple[float, str]] = []

    clipped = is_clipped(acceleration, full_scale_m_s2, bits)
    if clipped.any():
        which = " and ".join(name for name, over in zip("AB", clipped, strict=True) if over)
        reasons.append((math.inf, f"accelerometer {which} clipped at {peak:.3g} m/s2: tap more gently"))

    limit = quality.largest_acceleration_g * STANDARD_GRAVITY
    if peak > limit:
        text = f"peak acceleration {peak:.3g} m/s2 is over {quality.largest_acceleration_g:g} g ({limit:.3g} m/s2)"
        reasons.append((peak / limit, f"{text}: tap more gently"))

    reasons += _judge_force(mean, sample_rate_hz, pretrigger, preload_mn, m2_kg, k2_n_per_m, quality, numbers)

    second_limit = max(quality.second_impact_ratio, SECOND_IMPACT_SIGNIFICANCE * second.noise_ratio)
    if second.ratio > second_limit:
        text = f"a second impact of {second.ratio:.0%} of the first came {second.delay_s * 1e3:.2g} ms after it"
        reasons.append((second.ratio / max(quality.second_impact_ratio, 1e-3), f"{text}: pull back faster"))

    if rotation > quality.largest_rotation:
        text = _silent_channel(a[:, pretrigger:], sample_rate_hz, quality.rotation_window_ms)
        if not text:
            text = f"A and B differ by {rotation:.0%} of their sum in the first {quality.rotation_window_ms:g} ms"
            text += f" (limit {quality.largest_rotation:.0%}), the mass rotated: tap in the middle"
        reasons.append((rotation / quality.largest_rotation, text))

    load_limit = max(quality.largest_load_change_mn, quality.largest_load_change_percent / 100 * abs(load_before_mn))
    if change > load_limit:
        text = f"the load moved from {load_before_mn:.4g} to {load_after_mn:.4g} mN (limit {load_limit:.3g} mN)"
        reasons.append((change / load_limit, f"{text}: let it settle"))

    if signal < quality.smallest_signal_to_noise * noise:
        text = f"too weak: the peak of {signal:.3g} m/s2 is only {signal / noise:.3g} times the noise"
        text += f" (at least {quality.smallest_signal_to_noise:g}): tap harder"
        reasons.append((quality.smallest_signal_to_noise * noise / max(signal, 1e-12), text))

    if noise > quality.largest_noise_m_s2:
        text = f"noisy before the tap: {noise:.3g} m/s2 rms (limit {quality.largest_noise_m_s2:g} m/s2)"
        reasons.append((noise / quality.largest_noise_m_s2, f"{text}: keep off the table, check the cables"))

    reasons.sort(key=lambda reason: -reason[0])
    return Verdict(not reasons, "; ".join(text for _, text in reasons), numbers)


def rotation_of(a: NDArray[np.float64], sample_rate_hz: float, window_ms: float) -> float:
    """Return rms(A - B) / rms(A + B) over the first ``window_ms`` of a (2, n); infinite where the sum is zero."""
    first = _first(a, sample_rate_hz, window_ms)
    difference, total = (float(np.sqrt(np.mean((first[0] + sign * first[1]) ** 2))) for sign in (-1, 1))
    return difference / total if total > 0 else math.inf if difference > 0 else 0.0


def _first(a: NDArray[np.float64], sample_rate_hz: float, window_ms: float) -> NDArray[np.float64]:
    return a[:, : max(2, round(window_ms * 1e-3 * sample_rate_hz))]


def _silent_channel(a: NDArray[np.float64], sample_rate_hz: float, window_ms: float) -> str:
    """Return what is to be said where one channel shows hardly anything of what the other shows; else nothing."""
    rms = np.sqrt(np.mean(_first(a, sample_rate_hz, window_ms) ** 2, axis=1))
    quiet = int(np.argmin(rms))
    share = float(rms[quiet] / rms[1 - quiet]) if rms[1 - quiet] > 0 else 1.0
    if share >= SILENT_SHARE:
        return ""
    this, other = "AB"[quiet], "AB"[1 - quiet]
    return (
        f"{this} shows hardly anything of what {other} shows ({share:.1%}): check its cable, its input and its "
        f"sensitivity; {WIRING_CHECK}"
    )


def _judge_force(
    mean: NDArray[np.float64],
    sample_rate_hz: float,
    pretrigger: int,
    preload_mn: float,
    m2_kg: float,
    k2_n_per_m: float,
    quality: Quality,
    numbers: dict[str, float | str],
) -> list[tuple[float, str]]:
    """Hold the force that relieves the contact against the preload; fills in ``numbers``.

    The surfaces part when ``m2 a2 + k2 x2 = -P`` (Eq. 9b); at 100 mN that takes less than a tenth of 1 g.
    """
    if not (m2_kg > 0 and k2_n_per_m > 0):
        numbers["force_rule"] = "skipped: the mass or the spring is unknown"
        return []
    force = contact_force(mean, sample_rate_hz, m2_kg, k2_n_per_m, pretrigger)
    force = force[
        pretrigger : max(pretrigger + 1, mean.size - taper_samples(mean.size, sample_rate_hz, m2_kg, k2_n_per_m))
    ]
    unloading = max(0.0, -float(force.min()))
    numbers["peak_contact_force_n"] = float(np.abs(force).max())
    numbers["unloading_force_n"] = unloading
    if math.isnan(preload_mn):
        numbers["force_rule"] = "skipped: the preload is unknown"
        return []
    numbers["force_rule"] = "applied"
    preload = preload_mn * 1e-3
    ratio = unloading / preload if preload > 0 else math.inf
    numbers["force_ratio"] = ratio
    if ratio <= quality.largest_force_ratio:
        return []
    text = f"the contact was relieved by {unloading * 1e3:.3g} mN, {ratio:.0%} of the preload of {preload_mn:.4g} mN"
    return [(ratio / quality.largest_force_ratio, f"{text} (limit {quality.largest_force_ratio:.0%}): tap more gently")]
