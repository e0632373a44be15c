"""The input saturates below its declared range."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values
from sim_backend.mechanisms.places import channels_alike

NAME = "clip_at_fraction_of_peak"
HIGHEST = 0.995  # from which on what is cut off is cut off at the peak itself


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Hold what is beyond the level: a share of the record's peak, ``peak``, or of the session's.

    Of a record with an offset, of its ``highest`` and ``lowest`` value.
    """
    share, peak = values[NAME], values["peak"]
    out: Real = np.clip(rows, share * values.get("lowest", -peak), share * values.get("highest", peak))
    return out


MECHANISM = ChannelDistortion(
    id="clipping",
    component="sensor chain",
    summary="the input saturates below its declared range",
    source="saturation of the conditioner",
    parameters=(Quantity(NAME, "1", 0.05, 1.05, "level beyond which nothing passes, over the peak"),),
    strength=None,
    trials=lambda scale: [
        {NAME: share, "of_session": whole} for whole in (0.0, 1.0) for share in (0.98, 0.95, 0.9, 0.8, 0.6)
    ],
    distort=distort,
    at=channels_alike,
    statement=lambda values, name: (
        f"What {name} shows is cut off at "
        + ("" if values[NAME] > HIGHEST else f"{100 * values[NAME]:.3g} % of ")
        + "the highest value recorded."
    ),
)
