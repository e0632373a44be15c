"""Puts a rig together from the configuration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from analysis.contact.theory import theory
from mesotap.config import Config
from rig import Operator, Rig, RigError
from rig.hand import HandStage
from sim_backend.person import SimulatedPerson
from sim_backend.rig import SimulatedRig


def build_rig(
    config: Config, simulated: bool, operator: Operator, seed: int | None = None, realtime: bool = False
) -> Rig:
    """Build the rig that the configuration describes.

    Raises
    ------
    RigError
        If a part has no driver.
    """
    if not simulated:
        raise RigError(
            "rig: strain-gauge amplifier and accelerometers have no driver in this version; add --simulate to work "
            "with the simulated rig"
        )
    return simulated_rig(config, operator, seed, realtime)


def simulated_rig(
    config: Config, operator: Operator | None = None, seed: int | None = None, realtime: bool = False
) -> SimulatedRig:
    """Build the simulated rig; where its stage is turned by hand, a simulated person follows the prompts."""
    rig = SimulatedRig(config.rig, config.sim_backend, _stiffness_from_theory(config), realtime, seed)
    if config.rig.parts.stage == "hand":
        person = SimulatedPerson(rig.stage, operator)
        rig.stage = HandStage(person, rig.clock, lambda: f"gauge {rig.load_cell.read().voltage_mv:.2f} mV")
    return rig


def _stiffness_from_theory(config: Config) -> Callable[[float], float] | None:
    """Return k_c(P) of the last theory that the contact has (the roughest), or None for the table."""
    if config.sim_backend.contact.stiffness == "table":
        return None
    curve = theory(config.analysis.contact)[-1]
    return lambda load_n: float(curve.stiffness(np.array([load_n]))[0])


def truth_now(rig: Rig) -> dict[str, Any]:
    """Truth of a simulated rig at its present load; nothing for a real one."""
    return rig.truth_at_load(rig.true_load_mn() * 1e-3) if isinstance(rig, SimulatedRig) else {}
