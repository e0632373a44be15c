"""Samples are taken a little too early or too late, each by a time of its own."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values
from sim_backend.mechanisms.places import channels_alike

NAME = "jitter_samples"


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Add the slope times a normal error of the time; the channels share their clock."""
    late = values[NAME] * np.random.default_rng(rows.shape[1]).standard_normal(rows.shape[1])
    return np.asarray(rows - np.gradient(rows, axis=1) * late)


MECHANISM = ChannelDistortion(
    id="sampling_jitter",
    component="sensor chain",
    summary="the sampling clock is unsteady",
    source="IEEE Std 1241: aperture uncertainty",
    parameters=(Quantity(NAME, "samples", 0.0, 0.5, "standard deviation of a sample's time"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-3}],
    distort=distort,
    at=channels_alike,
    hidden=(
        "Jitter is noise: in proportion to the slope, with no shape that repeats, so that no model of the motion holds "
        "it. Louder taps tell it, as it grows with them and other noise does not; so does a pure tone of high "
        "frequency from a generator."
    ),
    statement=lambda values, name: f"What {name} show is sampled at times that scatter by {values[NAME]:.3g} samples.",
)
