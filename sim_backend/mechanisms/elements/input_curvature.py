"""An input that drives the rig with a gain that changes with its level."""

from __future__ import annotations

from dataclasses import replace

from sim_backend.mechanisms.elements import sensor_curvature

MECHANISM = replace(
    sensor_curvature.MECHANISM,
    id="input_curvature",
    component="impactor",
    summary="an exciter whose gain changes with its level",
    source="static nonlinearity before the rig (Hammerstein)",
    parameters=tuple(sensor_curvature.shown("input").values()),
    drives=True,
)
