"""The pulses of a hammer in a force channel: where they are, and what speaks against using one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.frequency_response.estimators import ForceError

Real = NDArray[np.float64]

NOISE_MULTIPLE = 8.0
"""Standard deviations of the noise that a force has to pass to be a hit."""

HIT_SHARE = 0.1
"""Of the largest force of a record, from which a pulse is a hit of its own: hits of one hand differ by less than 10."""

SECOND_SHARE = 0.1
"""Of a hit's peak, from which what follows it within its record is a second one; a 10 kHz low-pass rings to 4 %."""

FOOT_SHARE = 0.1
"""Of the peak, above which a pulse's samples are counted."""

FEWEST_SAMPLES = 3
"""Samples of a pulse below which its spectrum is not known: the top may lie between two of them."""

FLAT_TOP = 3
"""Equal samples in a row at the very peak that tell an overloaded channel."""

LASTING_SHARE = 0.2
"""Of the samples, above a tenth of the largest force, from which a force counts as lasting (a shaker), no hammer's."""

GAUSSIAN_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class Hit:
    """One pulse: index of its first and its last sample above a tenth of the peak, and the peak (signed)."""

    first: int
    last: int
    peak: float

    @property
    def samples(self) -> int:
        """Samples above a tenth of the peak."""
        return self.last - self.first + 1


def is_lasting(force: Real) -> bool:
    """Return whether a force (n,) is there all the time, as a shaker's, rather than in pulses."""
    size = np.abs(force - np.median(force))
    return bool(np.mean(size > FOOT_SHARE * size.max()) > LASTING_SHARE) if size.max() > 0 else False


def noise_of(force: Real) -> float:
    """Return the standard deviation of what is between the pulses, from the median absolute deviation."""
    return GAUSSIAN_MAD * float(np.median(np.abs(force - np.median(force))))


def hits_in(force: Real, rate_hz: float, source: str = "the force channel", least: float = 0.0) -> list[Hit]:
    """Return all pulses of a force (n,), in time order, the way of the largest one.

    Parameters
    ----------
    rate_hz
        Sampling rate, Hz.
    source
        What the force is called in errors.
    least
        Of the largest pulse, from which another is one; `HIT_SHARE` where 0.

    Raises
    ------
    ForceError
        The channel is dead, or shows no pulse.
    """
    if not np.ptp(force) > 0:
        raise ForceError(
            f"{source} never changes (it reads {force[0] if force.size else 0.0:g} throughout): check that the hammer "
            "is plugged in and its supply is on"
        )
    f = force - np.median(force)
    noise = noise_of(force)
    sign = np.sign(f[np.argmax(np.abs(f))])
    f = sign * f
    peak = float(f.max())
    if peak < NOISE_MULTIPLE * noise:
        raise ForceError(
            f"{source} shows no hit: its largest value is {peak:.3g} N, its noise {noise:.3g} N; check the hammer's "
            "cable, its input and its sensitivity"
        )
    over = f > max((least or HIT_SHARE) * peak, NOISE_MULTIPLE * noise)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], over.astype(np.int8), [0]])))
    found: list[Hit] = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        top = int(first) + int(np.argmax(f[first : last + 1]))
        left, right = _foot(f, top, -1), _foot(f, top, 1)
        if found and left <= found[-1].last + 1:  # the same pulse, with a dent
            higher = f[top] > sign * found[-1].peak
            found[-1] = Hit(
                found[-1].first, max(right, found[-1].last), float(sign * f[top]) if higher else found[-1].peak
            )
        else:
            found.append(Hit(left, right, float(sign * f[top])))
    return found


def _foot(f: Real, top: int, step: int) -> int:
    """Return the last sample from ``top`` on, that way, that is above a tenth of it."""
    at = top
    while 0 <= at + step < f.size and f[at + step] > FOOT_SHARE * f[top]:
        at += step
    return at


def faults_of(force: Real, hits: list[Hit], largest: float = float("inf")) -> str:
    """Return what speaks against a record of one hit, in a few words; empty if nothing does.

    Parameters
    ----------
    force
        (n,) samples.
    hits
        Its pulses, from `hits_in` with ``least=SECOND_SHARE``.
    largest
        Force that the transducer, its tip, or the recorder's range can hold.
    """
    hit = max(hits, key=lambda h: abs(h.peak))
    if abs(hit.peak) >= largest:
        return f"the hammer's channel was overloaded ({abs(hit.peak):.3g} N, it holds {largest:.3g} N): tap more gently"
    pulse = force[hit.first : hit.last + 1]
    end = pulse.max() if hit.peak > np.median(force) else pulse.min()
    if np.convolve(pulse == end, np.ones(FLAT_TOP), "valid").max(initial=0) >= FLAT_TOP:
        return (
            f"the hammer's channel was overloaded (flat at {abs(hit.peak):.3g}): tap more gently, or set a wider range"
        )
    if hit.samples < FEWEST_SAMPLES:
        return (
            f"the force has only {hit.samples} sample{'' if hit.samples == 1 else 's'} of its pulse, too few to know "
            "it: sample faster, or use a softer tip"
        )
    others = [h for h in hits if h is not hit]
    if others:
        other = max(others, key=lambda h: abs(h.peak))
        return f"the force shows a second hit of {abs(other.peak / hit.peak):.0%} of the first: pull back faster"
    return ""
