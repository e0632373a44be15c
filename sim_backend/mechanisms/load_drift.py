"""The strain gauge drifts between its calibrations; the calibrations show it, not the ring-downs."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values

NAME = "gauge_drift_mv"


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Move the zero of the gauge's readings (mV) in a straight line from before to after."""
    out: Real = rows + values[NAME] * np.linspace(0.0, 1.0, rows.shape[1])
    return out


MECHANISM = ChannelDistortion(
    id="load_drift",
    component="load cell",
    summary="strain-gauge drift between calibrations",
    source="zero or sensitivity that changed from the calibration before to the one after",
    parameters=(Quantity(NAME, "mV", -1e3, 1e3, "change of the zero from before to after"),),
    strength=NAME,
    trials=lambda scale: [],
    distort=distort,
    at=lambda rig: [],
    of="load cell",
    one_signed=False,
    statement=lambda values, name: (
        f"The load cell's zero moved by {values[NAME]:.3g} mV between the calibrations before and after the test."
    ),
)
