"""The recorder or amplifier filters more than declared. Free ringing hides it: only a measured input shows it."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values, geometric
from sim_backend.mechanisms.places import each_channel

NAME = "corner_hz"


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """First-order low-pass, at rest before the first sample; exact for straight lines between the samples."""
    z = 2 * math.pi * values[NAME] / sample_rate_hz
    decay = math.exp(-z)
    mean = -math.expm1(-z) / z
    new, old = 1.0 - mean, mean - decay
    initial = (1.0 - new) * rows[:, :1]
    return np.asarray(lfilter([new, old], [1.0, -decay], rows, axis=1, zi=initial)[0], np.float64)


MECHANISM = ChannelDistortion(
    id="undeclared_filter",
    component="sensor chain",
    summary="the recorder or amplifier filters more than declared",
    source="anti-aliasing filter",
    parameters=(Quantity(NAME, "Hz", 1.0, 1e6, "corner of the filter", log=True),),
    strength=None,
    trials=lambda scale: [
        {NAME: min(max(f, 1.0), 1e6)} for f in geometric(scale.frequency_hz[1], 30 * scale.frequency_hz[1], 4)
    ],
    distort=distort,
    at=lambda rig: each_channel(rig) if rig.inputs else [],
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} passes a low-pass filter that is not declared, with its corner at "
        f"{values[NAME]:.4g} Hz."
    ),
)
