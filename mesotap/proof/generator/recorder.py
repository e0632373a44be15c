"""What becomes of the bodies' accelerations in the sensor chain: filter, sampling, noise, converter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfilt

from mesotap.proof.generator.integration import STEPS_PER_SAMPLE
from mesotap.proof.generator.plan import RATE_HZ, Noise, Plan

Real = NDArray[np.float64]

CHANNELS = 2
BITS = 16
RANGES_M_S2 = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)  # of recorder and amplifier together
HEADROOM = 1.5
WARM_UP = 4000  # samples that the slow noise has run before a record begins


def filtered(plan: Plan, seen: Real, undeclared_hz: float = math.inf) -> Real:
    """Return the (n, c, steps) accelerations after the declared band-pass, and a first-order low-pass that is not."""
    rate = RATE_HZ * STEPS_PER_SAMPLE
    out = sosfilt(butter(4, plan.lowpass_hz, "lowpass", fs=rate, output="sos"), seen, axis=-1)
    out = sosfilt(butter(1, plan.highpass_hz, "highpass", fs=rate, output="sos"), out, axis=-1)
    if math.isfinite(undeclared_hz):
        out = sosfilt(butter(1, undeclared_hz, "lowpass", fs=rate, output="sos"), out, axis=-1)
    return np.asarray(out)


def sampled(plan: Plan, fine: Real, delay_of_b: float | Real = 0.0) -> Real:
    """Return what channels A and B sample, (n, 2, samples); B's signal comes ``delay_of_b`` samples late, each or all.

    Between the steps of the integration B is interpolated by a cubic through four of them.
    """
    first = plan.offset[:, None] + STEPS_PER_SAMPLE * np.arange(plan.samples)[None, :]
    impact = np.arange(first.shape[0])[:, None]
    b = fine[:, -1]
    place = first - delay_of_b * STEPS_PER_SAMPLE
    whole = np.floor(place).astype(int)
    u = place - whole
    weights = (
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    )
    late = sum(w * _at(b, impact, whole + k) for w, k in zip(weights, (-1, 0, 1, 2), strict=True))
    return np.stack([fine[impact, 0, first], late], axis=1)


def _at(fine: Real, impact: NDArray[np.int64], place: NDArray[np.int64]) -> Real:
    """Values at steps; at rest before the tap."""
    inside = np.clip(place, 0, fine.shape[1] - 1)
    return np.where(place >= 0, fine[impact, inside], 0.0)


def noise_of(rng: np.random.Generator, noise: Noise, shape: tuple[int, ...]) -> Real:
    """Draw noise along the last axis of ``shape``."""
    pole = math.exp(-2 * math.pi * noise.corner_hz / RATE_HZ)
    white = rng.standard_normal(shape) * math.sqrt(1 - noise.slow_share)
    driven = rng.standard_normal((*shape[:-1], shape[-1] + WARM_UP)) * math.sqrt((1 - pole**2) * noise.slow_share)
    slow = lfilter([1.0], [1.0, -pole], driven, axis=-1)[..., WARM_UP:]
    return np.asarray(noise.rms * (white + slow))


def full_scale(y: Real) -> float:
    """Return the smallest range that holds a session with some room, m/s2."""
    peak = HEADROOM * float(np.abs(y).max())
    return next((r for r in RANGES_M_S2 if r > peak), RANGES_M_S2[-1])


def converted(y: Real, range_m_s2: float) -> Real:
    """Return the values as the converter has them: ``BITS`` bits over plus and minus ``range_m_s2``."""
    step = range_m_s2 / 2 ** (BITS - 1)
    return np.asarray(np.clip(np.round(y / step), -(2 ** (BITS - 1)), 2 ** (BITS - 1) - 1) * step)


def whitened(noise: Noise, y: Real) -> Real:
    """Return (..., n) in which ``noise`` is white with unit variance.

    White noise plus first-order noise has the spectrum of a first-order moving average over a first-order pole;
    the moving average is factored so that its zero lies inside the unit circle.
    """
    zero, deviation, pole = innovations(noise)
    return np.asarray(lfilter([1.0, -pole], [1.0, -zero], y, axis=-1) / deviation)


def innovations(noise: Noise) -> tuple[float, float, float]:
    """Return zero, standard deviation of the innovations (in the noise's unit) and pole of the noise."""
    pole = math.exp(-2 * math.pi * noise.corner_hz / RATE_HZ)
    white, slow = 1 - noise.slow_share, noise.slow_share
    middle = white * (1 + pole**2) + slow * (1 - pole**2)
    side = white * pole
    # zero + 1/zero = middle/side, and the innovations' variance is side/zero
    zero = 2 * side / (middle + math.sqrt(middle**2 - 4 * side**2))
    variance = side / zero
    return zero, noise.rms * math.sqrt(variance), pole
