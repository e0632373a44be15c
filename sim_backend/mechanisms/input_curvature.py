"""An input that drives the rig with a gain that changes with its level."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ChannelDistortion
from sim_backend.mechanisms.places import each_input
from sim_backend.mechanisms.sensor_curvature import CUBE, curvature, distort, statement, trials

MECHANISM = ChannelDistortion(
    id="input_curvature",
    component="impactor",
    summary="an exciter whose gain changes with its level",
    source="static nonlinearity before the rig (Hammerstein)",
    parameters=curvature("input"),
    strength=CUBE,
    trials=trials,
    distort=distort,
    at=each_input,
    of="input",
    one_signed=False,
    statement=statement,
)
