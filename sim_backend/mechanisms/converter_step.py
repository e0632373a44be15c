"""A converter whose scale has a step in its middle: the largest integral nonlinearity of many converters."""

from __future__ import annotations

import math

from scipy.special import erf

from sim_backend.arrangement import Arrangement
from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values
from sim_backend.mechanisms.places import Place, channels_alike

NAME = "step_m_s2"
ROUNDED = "rounded_share"
ROUNDINGS = (0.003, 0.01, 0.03)  # of the peak: noise blurs the step by its own rms


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Add half the step to what is above zero and take it off what is below, blurred by the noise."""
    width = math.sqrt(2) * values[ROUNDED] * values["peak"]
    return rows + 0.5 * values[NAME] * erf(rows / width)


def at(rig: Arrangement) -> list[Place]:
    """Return each of several channels that show the same: one alone cannot tell a step from a law of the rig."""
    return [(i,) for group in channels_alike(rig) if len(group) > 1 for i in group]


MECHANISM = ChannelDistortion(
    id="converter_step",
    component="sensor chain",
    summary="the converter's scale has a step in its middle",
    source="IEEE Std 1241: integral nonlinearity, at the major carry",
    parameters=(Quantity(NAME, "m/s2", -1e3, 1e3, "height of the step"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-6, ROUNDED: share} for share in ROUNDINGS],
    distort=distort,
    at=at,
    one_signed=False,
    statement=lambda values, name: (
        f"The scale of {name} has a step of {1e3 * values[NAME]:.3g} mm/s2 at zero: the converter is not linear."
    ),
)
