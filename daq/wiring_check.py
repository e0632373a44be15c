"""What one tap tells of the wiring of the two accelerometers: alive, which way round, how alike, how noisy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.ndimage import shift

from daq.channel_relation import ChannelRelation, relate
from daq.quality import is_clipped, rotation_of

Real = NDArray[np.float64]

QUIET_S = 1.0
"""Before the tap, in which noise and mains lines are measured."""

BEFORE_S, AFTER_S = 0.01, 0.1
"""Around the tap, in which the channels are compared."""

FIRST_SWING_S = 5e-4
"""After the trigger, in which the first swing is over: half a period of the contact resonance at the smallest loads."""

FIRST_SHARE = 0.3
"""Of the largest departure in it, from which a sample belongs to the first swing: a converter's filter that rings
before the edge stays below."""

ALIVE_SIGMAS = 6.0
"""Standard deviations of its noise that a channel's peak has to pass: by noise alone one record in 10^5 does."""

ALIVE_SHARE = 0.03
"""Of the other channel's peak: what couples from cable to cable is a hundredth."""

MAINS_HZ = (50.0, 60.0)
HARMONICS = (1, 2, 3)
LINE_RATIO = 20.0
"""Power of a line over the median of its neighbours: noise alone passes it once in a million bins."""

NEIGHBOURS = (3, 20)
"""Bins on either side, from and to, that a line is held against."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the mains in one channel: fundamental, Hz, and rms with its harmonics, m/s2."""

    mains_hz: float
    rms_m_s2: float


@dataclass(frozen=True, slots=True)
class WiringCheck:
    """What was measured; pairs are of A and B.

    Attributes
    ----------
    noise_m_s2, peak_m_s2
        Standard deviation before the tap, and largest departure from rest after it.
    first_swing_m_s2
        Largest departure of the first swing, with its sign.
    onset_m_s2
        Mean departure on the first flank: whichever is nearer to the tap is ahead there.
    alive
        Whether the channel sees the tap.
    clipped
        Whether it reached the end of its scale.
    lines
        Mains lines, None where there is none.
    relation
        How B follows A; None unless both see the tap and neither is clipped.
    rotation
        rms(A - B) / rms(A + B) in the first milliseconds, B freed of its gain and delay against A; NaN without a
        relation.
    """

    noise_m_s2: tuple[float, float]
    peak_m_s2: tuple[float, float]
    first_swing_m_s2: tuple[float, float]
    onset_m_s2: tuple[float, float]
    alive: tuple[bool, bool]
    clipped: tuple[bool, bool]
    lines: tuple[Line | None, Line | None]
    relation: ChannelRelation | None
    rotation: float


def check_wiring(
    record: Real, trigger: int, sample_rate_hz: float, full_scale_m_s2: float, bits: int, rotation_window_ms: float
) -> WiringCheck:
    """Return what a tap tells of the wiring.

    Parameters
    ----------
    record
        (2, n) accelerations A and B, m/s2, with `QUIET_S` before the trigger and `AFTER_S` after it.
    trigger
        Index of the first sample of the tap.
    sample_rate_hz
        Sampling rate, Hz.
    full_scale_m_s2, bits
        Of the recorder.
    rotation_window_ms
        In which rotation is judged (section ``daq.quality``).
    """
    begin = trigger - round(BEFORE_S * sample_rate_hz)
    quiet = record[:, :begin]
    tapped = record[:, begin : trigger + round(AFTER_S * sample_rate_hz)]
    departure = tapped - quiet.mean(axis=1, keepdims=True)
    noise, peak = quiet.std(axis=1), np.abs(departure).max(axis=1)
    alive = (peak > ALIVE_SIGMAS * noise) & (peak > ALIVE_SHARE * peak.max())
    clipped = is_clipped(tapped, full_scale_m_s2, bits)
    relation, rotation = None, float("nan")
    first = departure[:, trigger - begin :]
    if alive.all() and not clipped.any():
        relation = relate(tapped, quiet, sample_rate_hz)
        alike = np.stack([first[0], shift(departure[1], -relation.delay_samples)[trigger - begin :] / relation.gain])
        rotation = rotation_of(alike, sample_rate_hz, rotation_window_ms)
    early = first[:, : round(FIRST_SWING_S * sample_rate_hz)]
    swings, onset = [_first_swing(row) for row in early], _onset(early)
    lines = [_mains_line(row, sample_rate_hz) for row in quiet]
    return WiringCheck(
        (float(noise[0]), float(noise[1])),
        (float(peak[0]), float(peak[1])),
        (swings[0], swings[1]),
        (float(onset[0]), float(onset[1])),
        (bool(alive[0]), bool(alive[1])),
        (bool(clipped[0]), bool(clipped[1])),
        (lines[0], lines[1]),
        relation,
        rotation,
    )


def _first_swing(samples: Real) -> float:
    """Return the largest departure before the sign turns, with its sign."""
    begun = int(np.argmax(np.abs(samples) >= FIRST_SHARE * np.abs(samples).max(initial=0.0)))
    sign = np.sign(samples[begun])
    turned = samples[begun:] * sign <= 0
    end = begun + int(np.argmax(turned)) if turned.any() else len(samples)
    return float(sign * np.abs(samples[begun:end]).max(initial=0.0))


def _onset(early: Real) -> Real:
    """Return the mean of each channel until the louder has reached its share of the loudest."""
    loudest = np.abs(early).max(axis=0)
    end = int(np.argmax(loudest >= FIRST_SHARE * loudest.max(initial=0.0)))
    return np.asarray(early[:, : end + 1].mean(axis=1), dtype=np.float64)


def _mains_line(quiet: Real, sample_rate_hz: float) -> Line | None:
    """Return the louder of the mains' lines that stand out of their neighbours."""
    frequency, power = signal.periodogram(quiet, sample_rate_hz, "hann", detrend="constant", scaling="spectrum")
    low, high = NEIGHBOURS
    found = []
    for mains_hz in MAINS_HZ:
        total = 0.0
        for harmonic in HARMONICS:
            at = int(np.argmin(np.abs(frequency - harmonic * mains_hz)))
            here = float(power[max(1, at - 1) : at + 2].max())
            around = np.concatenate([power[max(1, at - high) : at - low + 1], power[at + low : at + high + 1]])
            if here > LINE_RATIO * float(np.median(around)):
                total += here
        if total:
            found.append(Line(mains_hz, float(np.sqrt(total))))
    return max(found, key=lambda line: line.rms_m_s2, default=None)
