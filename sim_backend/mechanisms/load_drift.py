"""The strain gauge drifts between its calibrations; the calibrations show it, not the ring-downs."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity

NAME = "gauge_drift_mv"

MECHANISM = Mechanism(
    id="load_drift",
    component="load cell",
    summary="strain-gauge drift between calibrations",
    source="zero or sensitivity that changed from the calibration before to the one after",
    parameters=(Quantity(NAME, "mV", -1e3, 1e3, "change of the zero from before to after"),),
    strength=NAME,
    trials=lambda scale: [],
    one_signed=False,
    statement=lambda values: (
        f"The load cell's zero moved by {values[NAME]:.3g} mV between the calibrations before and after the test."
    ),
)
