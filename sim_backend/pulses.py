"""Force pulses of a tap on the upper mass.

Every pulse is a sum of segments F(t) = offset + linear tau + sin_ sin(omega tau) + cos_ cos(omega tau) with
tau = t - start, zero outside [start, end). The exact response and the inputs of an integration read the same table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

START, END, OFFSET, LINEAR, SIN, COS, OMEGA = range(7)  # columns of `Pulse.segments`


@dataclass(frozen=True, slots=True)
class Pulse:
    """A force in time, from its onset at t = 0.

    Attributes
    ----------
    segments
        (m, 7): start and end in s, offset (N), slope (N/s), sine and cosine amplitude (N), angular frequency (rad/s).
    """

    segments: NDArray[np.float64]

    @property
    def knots(self) -> NDArray[np.float64]:
        """Times, s, ascending, at which the force or a derivative of it jumps: onset and end among them."""
        return np.unique(self.segments[:, [START, END]])

    @property
    def duration_s(self) -> float:
        """Time from onset to the end of the last segment, s."""
        return float(self.segments[:, END].max())

    def active(self, t: float) -> NDArray[np.intp]:
        """Return the indices of the segments that act at ``t``."""
        return np.flatnonzero((self.segments[:, START] <= t) & (t < self.segments[:, END]))

    def __call__(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the force, N, at times ``t`` (any shape), s after the onset."""
        t = np.asarray(t, dtype=float)
        force = np.zeros(t.shape)
        for s in self.segments:
            tau = t - s[START]
            value = s[OFFSET] + s[LINEAR] * tau + s[SIN] * np.sin(s[OMEGA] * tau) + s[COS] * np.cos(s[OMEGA] * tau)
            force += np.where((t >= s[START]) & (t < s[END]), value, 0.0)
        return force

    def impulse_ns(self) -> float:
        """Return the integral of the force, N s."""
        total = 0.0
        for s in self.segments:
            length, omega = s[END] - s[START], s[OMEGA]
            total += s[OFFSET] * length + s[LINEAR] * length**2 / 2
            if omega > 0:
                total += (s[SIN] * (1 - math.cos(omega * length)) + s[COS] * math.sin(omega * length)) / omega
        return total

    def scaled(self, factor: float) -> Pulse:
        """Return the same pulse, ``factor`` times as strong."""
        segments = self.segments.copy()
        segments[:, [OFFSET, LINEAR, SIN, COS]] *= factor
        return Pulse(segments)

    def followed_by(self, other: Pulse, delay_s: float) -> Pulse:
        """Return this pulse and ``other``, whose onset is ``delay_s`` after this one's; they may overlap."""
        later = other.segments.copy()
        later[:, [START, END]] += delay_s
        return Pulse(np.vstack([self.segments, later]))


def half_sine(peak_n: float, duration_s: float) -> Pulse:
    """Return F0 sin(pi t / T)."""
    return Pulse(np.array([[0.0, duration_s, 0.0, 0.0, peak_n, 0.0, math.pi / duration_s]]))


def haversine(peak_n: float, duration_s: float) -> Pulse:
    """Return F0 (1 - cos(2 pi t / T)) / 2."""
    return Pulse(np.array([[0.0, duration_s, peak_n / 2, 0.0, 0.0, -peak_n / 2, 2 * math.pi / duration_s]]))


def triangle(peak_n: float, duration_s: float) -> Pulse:
    """Return a symmetric triangle."""
    return sampled([0.0, duration_s / 2, duration_s], [0.0, peak_n, 0.0])


def sampled(time_s: ArrayLike, force_n: ArrayLike) -> Pulse:
    """Return the straight lines between points: ``time_s`` (n,) growing from 0 on, ``force_n`` (n,)."""
    t, force = np.asarray(time_s, dtype=float), np.asarray(force_n, dtype=float)
    if t.ndim != 1 or len(t) < 2 or t.shape != force.shape:
        raise ValueError("a sampled pulse needs one-dimensional times and forces of one length, at least 2")
    if t[0] < 0 or np.any(np.diff(t) <= 0):
        raise ValueError("the times of a sampled pulse must grow, from 0 on")
    segments = np.zeros((len(t) - 1, 7))
    segments[:, START], segments[:, END] = t[:-1], t[1:]
    segments[:, OFFSET], segments[:, LINEAR] = force[:-1], np.diff(force) / np.diff(t)
    return Pulse(segments)


SHAPES = {"half_sine": half_sine, "haversine": haversine, "triangle": triangle}
