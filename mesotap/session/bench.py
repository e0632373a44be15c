"""Puts a rig together from the configuration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.contact.theory import theory
from mesotap.configuration.config import Config
from rig import Operator, Rig
from rig.hand import HandStage
from sim_backend.clock import VirtualClock
from sim_backend.person import SimulatedPerson
from sim_backend.rig import SimulatedRig

if TYPE_CHECKING:
    from rig.drivers.wire_record import WireFile
    from sim_backend.emulators.rig import EmulatedRig
    from sim_backend.emulators.wire import Disturbance


def build_rig(
    config: Config,
    simulated: bool,
    operator: Operator,
    seed: int | None = None,
    realtime: bool = False,
    emulated: bool = False,
    devices: Path | None = None,
    wire_file: WireFile | None = None,
    speed: float = 1.0,
) -> Rig:
    """Build the rig that the configuration describes.

    Parameters
    ----------
    simulated
        The simulated rig instead of devices.
    operator
        Who turns, taps and hangs weights where no motor does.
    seed, realtime
        Of the simulated rig.
    emulated
        The drivers, on emulated devices with the simulated rig's physics; in real time these are in a process of
        their own.
    devices
        Folder of that process, if it runs already.
    wire_file
        Where to record what goes over the wires; None for nowhere.
    speed
        How many times faster than on the bench simulated time passes where it passes in real time; the emulated
        devices of a rig that is sped up are in this process.

    Raises
    ------
    RigError
        If a part has no driver.
    """
    if emulated:
        from sim_backend.emulators.rig import emulated_of

        emulated_of(config.rig.parts)
    if emulated and realtime and speed == 1.0:
        from mesotap.session.emulated_devices import separate_rig

        seed = config.sim_backend.seed if seed is None else seed
        return separate_rig(config, operator, seed, devices, wire_file)
    if emulated:
        clock = VirtualClock(realtime, speed)
        return emulated_rig(config, operator, seed, wires=True, wire_file=wire_file, clock=clock)
    if simulated:
        return simulated_rig(config, operator, seed, realtime, speed)
    from rig.drivers.assembly import assemble  # hardware code only where there is hardware

    return assemble(config.rig, operator, wire_file=wire_file)


def emulated_rig(
    config: Config,
    operator: Operator | None = None,
    seed: int | None = None,
    wires: bool = False,
    amplifier_wire: Disturbance | None = None,
    stage_wire: Disturbance | None = None,
    round_trip_s: float = 0.0,
    wire_file: WireFile | None = None,
    clock: VirtualClock | None = None,
) -> EmulatedRig:
    """Build the emulated rig; see `sim_backend.emulators.rig.EmulatedRig`."""
    from sim_backend.emulators.rig import EmulatedRig

    stiffness = stiffness_from_theory(config)
    rig = EmulatedRig(
        config.rig,
        config.sim_backend,
        stiffness,
        seed,
        wires,
        amplifier_wire,
        stage_wire,
        round_trip_s,
        clock=clock,
        wire_file=wire_file,
    )
    if config.rig.parts.stage == "hand":
        person = SimulatedPerson(rig.physics.micrometer, operator)
        rig.stage = HandStage(person, rig.clock, lambda: f"gauge {rig.load_cell.read().voltage_mv:.2f} mV")
    return rig


def simulated_rig(
    config: Config,
    operator: Operator | None = None,
    seed: int | None = None,
    realtime: bool = False,
    speed: float = 1.0,
) -> SimulatedRig:
    """Build the simulated rig; where its stage is turned by hand, a simulated person follows the prompts."""
    rig = SimulatedRig(
        config.rig, config.sim_backend, stiffness_from_theory(config), seed=seed, clock=VirtualClock(realtime, speed)
    )
    if config.rig.parts.stage == "hand":
        person = SimulatedPerson(rig.stage, operator)
        rig.stage = HandStage(person, rig.clock, lambda: f"gauge {rig.load_cell.read().voltage_mv:.2f} mV")
    return rig


def stiffness_from_theory(config: Config) -> Callable[[float], float] | None:
    """Return k_c(P) of the last theory that the contact has, or None for the table.

    That is the roughest, and what a ring-down sees of it: elastic unloading. The approach under load is some tens of
    nanometres of it by either stiffness, beside micrometres of the springs.
    """
    if config.sim_backend.contact.stiffness == "table":
        return None
    curve = theory(config.analysis.contact)[-1]
    return lambda load_n: float(curve.stiffness(np.array([load_n]))[0])


def truth_now(rig: Rig) -> dict[str, Any]:
    """Truth of a simulated or emulated rig at its present load; nothing for a real one."""
    from mesotap.session.emulated_devices import SeparateRig

    if isinstance(rig, SeparateRig):
        return dict(rig.devices.call("truth"))
    physics = getattr(rig, "physics", rig)
    return physics.truth_at_load(physics.true_load_mn() * 1e-3) if isinstance(physics, SimulatedRig) else {}
