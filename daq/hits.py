"""Which of more taps than needed are used at a load: those whose ring-downs agree, pair by pair.

Two ring-downs of one rig are sums of the same decaying oscillations, whatever tapped it: in a narrow band about a mode
one is the other times a complex number. The coherence of two taps in a band is how nearly that is so: the magnitude of
the normalised cross-spectrum of both accelerometers over it, the largest over small shifts of the trigger and over
what a contact scatters in frequency and damping. Strength, phase, trigger, scatter and the share of each mode do not
count; a second impact, a mass that turned or noise in the ring-down do. In each band what two taps lack in coherence is
taken relative to the lower quartile of all pairs; the band in which they lack most counts. What all taps have in common
is not seen.

References
----------
Pairwise coherence as a criterion for hits: Simcenter Testlab, Smart Hit Selection.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.records import Impact

LEFT_OUT = "left out: "
"""How the reason of an impact begins that was sound by itself and is not among those chosen."""
COHERENCE, BY_HAND = "hit_coherence", "hand_reason"
"""Keys beside an impact: its mean coherence with the others kept, in the band where that is lowest, and a person's
reason, which no choice overrules."""

SKIPPED_S = 1e-3  # after the trigger, in which the tap still pushes
RISE_S = 2e-3  # of the window
LOWEST_HZ = 100.0  # of a mode: below are drift and the table
MOST_MODES = 4
OF_LARGEST = 1e-5  # power of a mode over that of the strongest, below which it is not looked at
OVER_FLOOR = 30.0  # power of a mode over the median of the spectrum, likewise
AROUND, OVER_AROUND = 2.0, 10.0  # half bands around a mode, and its power over the median there, likewise
HALF_BAND = 0.08  # of a mode's frequency, on either side of it
FEWEST_LINES = 3  # on either side
DRIFT, DECAY, STEPS = 4e-4, 4e-4, 7  # of a mode's frequency, and in its damping ratio, either way: a contact scatters
LARGEST_SHIFT_S, SHIFTS = 6e-5, 5  # of the trigger, that are tried on either side together
QUARTILE = 0.25  # of all pairs of a load, whose lack of coherence is that of good ones
SMALLEST, SMALLEST_RATIO = 1e-15, 1e-6  # lacks of coherence, and their ratios, below which there are none
GOOD = 0.35  # quantile of the taps' disagreement with the others that is a good tap's: two in three may be bad
STANDS_OUT = 1.0  # logarithm of the factor beyond that, from which on it disagrees (benchmarks/choosing_hits.py)


@dataclass(frozen=True, slots=True)
class Coherences:
    """Coherence of taps by pairs.

    Attributes
    ----------
    by_band
        (bands, n, n), 1 on the diagonal.
    apart
        (n, n) logarithm of what two taps lack in coherence over what good pairs lack, in the band where that is most; 0
        on the diagonal.
    modes_hz
        (bands,) their centres.
    """

    by_band: NDArray[np.float64]
    apart: NDArray[np.float64]
    modes_hz: NDArray[np.float64]


def coherences(taps: Sequence[NDArray[np.float64]], pretriggers: Sequence[int], rate_hz: float) -> Coherences:
    """Return how nearly taps of one load show the same ring-down.

    Parameters
    ----------
    taps
        Accelerations (2, n) of each, m/s2.
    pretriggers
        Samples before the trigger of each.
    rate_hz
        Of all of them.
    """
    skipped = round(SKIPPED_S * rate_hz)
    length = max(min(t.shape[1] - p for t, p in zip(taps, pretriggers, strict=True)) - skipped, 2)
    rows = []
    for tap, p in zip(taps, pretriggers, strict=True):
        at_rest = tap[:, :p].mean(axis=1, keepdims=True) if p else 0.0
        begin = min(p + skipped, tap.shape[1] - 2)
        ring = np.zeros((len(tap), length))
        part = (tap - at_rest)[:, begin : begin + length]
        ring[:, : part.shape[1]] = part
        rows.append(ring)
    # a mode that begins at once reaches into the bands of the others
    lines = np.fft.rfft(np.array(rows) * tukey_rise(length, round(RISE_S * rate_hz)), axis=2)  # (taps, channels, lines)
    frequency = np.asarray(np.fft.rfftfreq(length, 1 / rate_hz), np.float64)
    power = np.sum(np.abs(lines) ** 2, axis=1)
    # taps count alike, however strong
    modes = _modes(np.mean(power / np.maximum(power.sum(axis=1, keepdims=True), 1e-300), axis=0), frequency)
    found = np.array([_in_band(lines, frequency, at) for at in modes]) if modes else np.ones((1, len(taps), len(taps)))
    return Coherences(found, _apart(found), frequency[modes] if modes else np.array([math.nan]))


def tukey_rise(length: int, rise: int) -> NDArray[np.float64]:
    """Return (length,) a window that rises as a cosine over its first samples and falls likewise over its last."""
    window = np.ones(length)
    rise = min(rise, length // 2)
    if rise > 0:
        edge = 0.5 - 0.5 * np.cos(np.pi * (np.arange(rise) + 0.5) / rise)
        window[:rise], window[-rise:] = edge, edge[::-1]
    return window


def _apart(by_band: NDArray[np.float64]) -> NDArray[np.float64]:
    lacking = 1 - by_band
    pairs = np.triu_indices(lacking.shape[1], 1)
    good = np.quantile(lacking[:, pairs[0], pairs[1]], QUARTILE, axis=1) if pairs[0].size else np.ones(len(lacking))
    apart = np.log(np.max(lacking / np.maximum(good, SMALLEST)[:, None, None], axis=0) + SMALLEST_RATIO)
    np.fill_diagonal(apart, 0.0)
    return apart


def _modes(power: NDArray[np.float64], frequency: NDArray[np.float64]) -> list[int]:
    """Return the lines of the strongest modes of a mean spectrum, the strongest first."""
    floor = float(np.median(power[frequency > LOWEST_HZ])) if np.any(frequency > LOWEST_HZ) else 0.0
    peak = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:]) & (frequency[1:-1] > LOWEST_HZ)
    order = sorted(np.flatnonzero(peak) + 1, key=lambda i: -power[i])
    kept: list[int] = []
    for i in order:
        apart = all(abs(frequency[i] - frequency[k]) > 2 * _half_width(k, frequency) for k in kept)
        strong = power[i] > max(OVER_FLOOR * floor, OF_LARGEST * power[order[0]])
        around = np.abs(frequency - frequency[i]) <= AROUND * _half_width(int(i), frequency)
        stands_out = power[i] > OVER_AROUND * float(np.median(power[around]))
        if apart and strong and stands_out and len(kept) < MOST_MODES:
            kept.append(int(i))
    return kept


def _half_width(line: int, frequency: NDArray[np.float64]) -> float:
    return max(HALF_BAND * float(frequency[line]), FEWEST_LINES * float(frequency[1]))


def _in_band(lines: NDArray[np.complex128], frequency: NDArray[np.float64], at: int) -> NDArray[np.float64]:
    """Return (n, n) how nearly each tap's oscillation in a band is another's, but for trigger, frequency and decay."""
    band = np.abs(frequency - frequency[at]) <= _half_width(at, frequency)
    turns = np.exp(2j * np.pi * frequency[band] * np.linspace(-LARGEST_SHIFT_S, LARGEST_SHIFT_S, SHIFTS)[:, None])
    part = lines[:, :, band]
    envelope = np.fft.ifft(part, axis=2)  # one sample a line: all that the band holds
    time = np.arange(part.shape[2]) / part.shape[2] / float(frequency[1])
    pole = 2 * math.pi * float(frequency[at])
    drift = np.linspace(-DRIFT, DRIFT, STEPS) * pole
    decay = np.linspace(-DECAY, DECAY, STEPS) * pole
    best = np.zeros((len(part), len(part)))
    norm = _norm(part)
    for rate in [complex(-d, w) for d in decay for w in drift]:
        changed = envelope * np.exp(rate * time)
        other = np.fft.fft(changed, axis=2)
        size = _norm(other)
        for turn in turns:
            cross = np.abs(np.einsum("icf,jcf->ij", other * turn, part.conj())) / (size[:, None] * norm[None])
            best = np.maximum(best, cross)
    best = np.minimum(np.maximum(best, best.T), 1.0)
    np.fill_diagonal(best, 1.0)
    return best


def _norm(part: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.maximum(np.sum(np.abs(part) ** 2, axis=(1, 2)), 1e-300)), np.float64)


def agreeing(apart: NDArray[np.float64], wanted: int, fixed: Sequence[int] = ()) -> tuple[int, ...]:
    """Return ``wanted`` taps that agree (n, n) with the others, the earlier ones first; ``fixed`` are among them.

    A tap does not agree where its median to the others stands out of that of good taps. The rest is taken as it comes:
    the most alike would have less scatter than the contact has. Where too few agree, those that disagree least follow.

    Examples
    --------
    >>> agreeing(np.array([[0, 3.0, 3.1, 2.9], [3.0, 0, 0.1, 0.2], [3.1, 0.1, 0, 0.1], [2.9, 0.2, 0.1, 0]]), 2)
    (1, 2)
    """
    n = len(apart)
    own = np.array([np.median(np.delete(apart[i], i)) if n > 1 else 0.0 for i in range(n)])
    limit = float(np.quantile(own, GOOD)) + STANDS_OUT
    agree = [i for i in range(n) if own[i] <= limit and i not in fixed]
    others = sorted((i for i in range(n) if own[i] > limit and i not in fixed), key=lambda i: own[i])
    return tuple(sorted([*fixed, *(agree + others)[: max(wanted - len(fixed), 0)]]))


def with_chosen(impacts: Sequence[Impact], wanted: int) -> list[Impact]:
    """Return the impacts with at most ``wanted`` accepted ones at each load: those whose ring-downs agree.

    The others are left out with a reason. Rejected impacts stay as they are, and no verdict by hand is overruled; what
    an earlier choice left out takes part again.
    """
    open_again = [_reopened(i) for i in impacts]
    decided = {i.number: i for i in open_again}
    for load_set in sorted({i.load_set for i in open_again}):
        own = [i for i in open_again if i.load_set == load_set and i.accepted]
        rates = {i.sample_rate_hz for i in own}
        if len(own) <= max(wanted, 1) or len(rates) != 1:
            continue
        found = coherences([i.acceleration for i in own], [i.pretrigger for i in own], rates.pop())
        fixed = [k for k, i in enumerate(own) if BY_HAND in i.extra]
        kept = agreeing(found.apart, wanted, fixed)
        for k, impact in enumerate(own):
            decided[impact.number] = _decided(impact, k, kept, found)
    return [decided[i.number] for i in impacts]


def _decided(impact: Impact, k: int, kept: Sequence[int], found: Coherences) -> Impact:
    others = [i for i in kept if i != k]
    if not others:
        return impact
    own = found.by_band[:, k, :][:, others].mean(axis=1)
    extra = {**impact.extra, COHERENCE: float(own.min())}
    if k in kept:
        return replace(impact, extra=extra)
    among = found.by_band[:, kept, :][:, :, kept]
    pairs = np.triu_indices(len(kept), 1)
    theirs = among[:, pairs[0], pairs[1]].mean(axis=1) if pairs[0].size else np.ones(len(own))
    at = int(np.argmax((1 - own) / np.maximum(1 - theirs, SMALLEST)))
    lacks = (
        f"about {found.modes_hz[at]:.4g} Hz it lacks {1 - own[at]:.2g} in coherence with the {len(kept)} taps kept, "
        f"these lack {1 - theirs[at]:.2g} with one another"
    )
    median = [float(np.median(np.delete(found.apart[i], i))) for i in range(len(found.apart))]
    surplus = median[k] <= float(np.quantile(median, GOOD)) + STANDS_OUT
    what = f"not needed, it agrees with the others and came later ({lacks})" if surplus else lacks
    return replace(impact, accepted=False, reject_reason=f"{LEFT_OUT}{what}", extra=extra)


def _reopened(impact: Impact) -> Impact:
    """Return an impact as it was before any choice."""
    extra = {k: v for k, v in impact.extra.items() if k != COHERENCE}
    if is_left_out(impact):
        return replace(impact, accepted=True, reject_reason="", extra=extra)
    return replace(impact, extra=extra)


def is_left_out(impact: Impact) -> bool:
    """Whether an impact is not used because others were chosen, and for no other reason."""
    return not impact.accepted and impact.reject_reason.startswith(LEFT_OUT)
