"""Actuators that Newport sells for its CONEX-CC and SMC100: what a move can be, by their data sheets.

The data sheets could not be had; each value is from public drivers that quote them, named beside it. What nobody quotes
is marked so in docs/hardware.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ActuatorName = Literal["tra12cc", "tra25cc", "trb6cc", "cma12cccl", "cma25ccl"]

UNKNOWN_STEP_UM = 0.2
"""Smallest step assumed of an actuator that is not named: the coarsest of those below."""


@dataclass(frozen=True, slots=True)
class Actuator:
    """One model.

    Attributes
    ----------
    travel_mm
        From 0 to this.
    step_um
        Smallest step that is sure to be made (minimum incremental motion), um.
    speed_um_per_s
        Highest speed, um/s.
    """

    travel_mm: float
    step_um: float
    speed_um_per_s: float


ACTUATORS: dict[ActuatorName, Actuator] = {
    # qmi 0.54.2 actuators.py: 12 mm, 0.2 um; kohdalab-trkr actuator.toml: 12 mm, 0.2 um. The data sheet's 400 um/s are
    # for light loads, qmi takes 30 um/s for more than 45 N; here the load is a few N
    "tra12cc": Actuator(12.0, 0.2, 400.0),
    # notes of a public pump-probe setup with one: 0.2 um; two public CONEX-CC scripts: 400 um/s; 25 mm by its name
    "tra25cc": Actuator(25.0, 0.2, 400.0),
    # qmi: 6 mm, 0.1 um, 200 um/s
    "trb6cc": Actuator(6.0, 0.1, 200.0),
    # its limits as an ESP300 reports them in a public rig's notes: 0 to 12.5 mm; step and speed as of its sister
    "cma12cccl": Actuator(12.5, 0.2, 400.0),
    # qmi: 25 mm, 0.2 um, 400 um/s
    "cma25ccl": Actuator(25.0, 0.2, 400.0),
}
