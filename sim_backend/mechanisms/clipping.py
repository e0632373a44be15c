"""The input saturates below its declared range."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, Real, Values

NAME = "clip_at_fraction_of_peak"


def distort(y: Real, values: Values, sample_rate_hz: float) -> Real:
    """Hold what is beyond the level: a share of the record's peak, ``peak``, or of the session's."""
    level = values[NAME] * values["peak"]
    out: Real = np.clip(y, -level, level)
    return out


MECHANISM = Mechanism(
    id="clipping",
    component="sensor chain",
    summary="the input saturates below its declared range",
    source="saturation of the conditioner",
    parameters=(Quantity(NAME, "1", 0.05, 1.0, "level beyond which nothing passes, over the peak"),),
    strength=None,
    trials=lambda scale: [
        {NAME: share, "of_session": whole} for whole in (0.0, 1.0) for share in (0.98, 0.95, 0.9, 0.8, 0.6)
    ],
    distort=distort,
    statement=lambda values: (
        f"Accelerations are cut off at {100 * values[NAME]:.3g} % of their peaks, below the declared range."
    ),
)
