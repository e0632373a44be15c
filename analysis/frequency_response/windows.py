"""What is done to the samples of a hit before their transform: offset, force window, exponential window.

The force is set to zero beyond its pulse (a force window), which takes its noise out and is no error, since a hammer
touches only during the pulse; a high-pass ahead of the recorder, which gives the pulse a tail, is undone first. Force
and response are then multiplied with exp(-sigma t) where the response has not died away at the record's end. Of a
linear rig that gives exactly H(j omega + sigma), so a model that is fitted is evaluated there, and nothing has to be
corrected afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.integrate import cumulative_trapezoid

from analysis.frequency_response.hits import Hit

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

LEAD_SAMPLES = 16
"""Samples before the pulse that a stretch begins with."""

GATE_SAMPLES = 8
"""Samples on either side of the pulse that still count as force: the skirt of a low-pass."""

FADED = 1e-3
"""Share of its first amplitude to which a response has to decay by the end of the stretch."""

END_SHARE = 0.1
"""Of the stretch, at its end, over which the response that is left is measured."""


@dataclass(frozen=True, slots=True)
class BandPass:
    """Butterworth band-pass ahead of the recorder; an order of 0 leaves that side out.

    ``on_force``: whether the hammer's signal passes the same one.
    """

    highpass_hz: float = 0.0
    highpass_order: int = 0
    lowpass_hz: float = 0.0
    lowpass_order: int = 0
    on_force: bool = True

    def of_response(self, s: Complex) -> Complex:
        """Return what has to be divided out of the response's transform at s, (k,), the force's high-pass undone."""
        gain = _butterworth(s, self.highpass_hz, self.highpass_order, "highpass")
        if not self.on_force:
            gain = gain * _butterworth(s, self.lowpass_hz, self.lowpass_order, "lowpass")
        return gain

    def without_highpass(self, force: Real, rate_hz: float) -> Real:
        """Return a force (n,) that begins at rest as it was before the high-pass: its inverse is 1 + a1/s + ..."""
        if not (self.on_force and self.highpass_order):
            return force
        _, a = signal.butter(self.highpass_order, 2 * math.pi * self.highpass_hz, "highpass", analog=True)
        whole, integral = force.copy(), force
        for coefficient in a[1:]:
            integral = np.asarray(cumulative_trapezoid(integral, dx=1 / rate_hz, initial=0), np.float64)
            whole = whole + coefficient * integral
        return whole


def _butterworth(s: Complex, corner_hz: float, order: int, kind: Literal["highpass", "lowpass"]) -> Complex:
    if not order:
        return np.ones_like(s)
    b, a = signal.butter(order, 2 * math.pi * corner_hz, kind, analog=True)
    return np.asarray(np.polyval(b, s) / np.polyval(a, s), np.complex128)


def gated(force: Real, hit: Hit, rate_hz: float, band: BandPass | None = None) -> Real:
    """Return a force (n,) with nothing but its pulse: its offset taken off, its high-pass undone, zero elsewhere."""
    first, last = max(0, hit.first - GATE_SAMPLES), min(force.size, hit.last + GATE_SAMPLES + 1)
    offset = float(np.mean(force[:first])) if first > 1 else float(np.median(force))
    pulse = force[first:last] - offset
    out = np.zeros_like(force)
    out[first:last] = pulse if band is None else band.without_highpass(pulse, rate_hz)
    return out


def decay_needed(response: Real, rate_hz: float) -> float:
    """Return the rate, 1/s, of the exponential window that has (d, c, n) responses die away; 0 where they have."""
    n = response.shape[-1]
    part = max(2, round(END_SHARE * n))
    left = np.sqrt(np.mean(response[..., -part:] ** 2, axis=(0, 2)))
    begun = np.sqrt(np.mean(response[..., :part] ** 2, axis=(0, 2)))
    share = float(np.max(left / np.maximum(begun, np.finfo(float).tiny)))
    return 0.0 if share <= FADED else math.log(min(share, 1.0) / FADED) * rate_hz / n


def faded(samples: Real, decay_per_s: float, rate_hz: float) -> Real:
    """Return (..., n) samples times exp(-decay t), t from the first."""
    if not decay_per_s:
        return samples
    return np.asarray(samples * np.exp(-decay_per_s * np.arange(samples.shape[-1]) / rate_hz), np.float64)
