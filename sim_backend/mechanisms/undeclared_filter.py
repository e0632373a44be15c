"""The recorder or amplifier filters more than declared.

Free ringing hides it, unless channels that show other quantities or bodies are not filtered like that.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

from sim_backend.arrangement import Arrangement
from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values, geometric
from sim_backend.mechanisms.places import Place, channels_alike, each_channel

NAME = "corner_hz"
HIGHEST = 3000.0  # corner tried, over the highest mode: so high a one delays and does no more
TRIED = 7
DEGREE = 5  # of the spline through the samples: straight lines lose 2 % at 13 samples a period
SLOW = 5.0  # time constants of the filter in a sample, up to which a quadrature over it is exact to rounding
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """First-order low-pass, at rest before the first sample; exact for the spline through the samples."""
    z = 2 * math.pi * values[NAME] / sample_rate_hz
    at = np.arange(rows.shape[1], dtype=np.float64)
    spline = make_interp_spline(at, rows.T, k=DEGREE)
    moments = [moment / math.factorial(m) for m, moment in enumerate(_moments(z))]
    driven = np.asarray(sum(moment * spline(at[:-1], m) for m, moment in enumerate(moments))).T
    passed = lfilter([1.0], [1.0, -math.exp(-z)], np.concatenate([rows[:, :1], driven], axis=1), axis=1)
    return np.asarray(passed, np.float64)


def places(rig: Arrangement) -> list[Place]:
    """Return what can be filtered: without a measured input, what shows something else than the other channels."""
    groups = channels_alike(rig)
    return each_channel(rig) if rig.inputs else groups if len(groups) > 1 else []


def _moments(z: float) -> Real:
    """Return what the filter makes, in a sample of ``z`` time constants, of the powers of the time since it began."""
    if z < SLOW:
        t, dt = (NODES + 1) / 2, WEIGHTS / 2
        return np.asarray(np.array([t**m for m in range(DEGREE + 1)]) @ (z * np.exp(-z * (1 - t)) * dt), np.float64)
    found = [-math.expm1(-z)]
    for m in range(1, DEGREE + 1):
        found.append(1 - m / z * found[-1])
    return np.array(found)


MECHANISM = ChannelDistortion(
    id="undeclared_filter",
    component="sensor chain",
    summary="the recorder or amplifier filters more than declared",
    source="anti-aliasing filter",
    parameters=(Quantity(NAME, "Hz", 1.0, 1e6, "corner of the filter", log=True),),
    strength=None,
    trials=lambda scale: [
        {NAME: min(max(f, 1.0), 1e6)} for f in geometric(scale.frequency_hz[1], HIGHEST * scale.frequency_hz[1], TRIED)
    ],
    distort=distort,
    at=places,
    forgets=lambda values: 2 * math.pi * values[NAME],
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} passes a low-pass filter that is not declared, with its corner at "
        f"{values[NAME]:.4g} Hz."
    ),
)
