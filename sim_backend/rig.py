"""The simulated rig: the physics of Eq. 9 behind the interface of a real one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Protocol

from rig import Rig, RigError, Stage
from rig.interface import nothing
from rig.settings import RigSettings
from sim_backend.accelerometers import SimulatedAccelerometers
from sim_backend.analog import AnalogSignal
from sim_backend.clock import VirtualClock
from sim_backend.gauge import SimulatedLoadCell, SimulatedWeights
from sim_backend.impactor import SimulatedImpactor
from sim_backend.kept_state import refuse_damaged, shortened
from sim_backend.recorder import analog_filter, converters
from sim_backend.settings import SimBackendSettings
from sim_backend.stage import SimulatedStage
from sim_backend.static import ContactTable
from sim_backend.truth import TrueRig, draw_parameters

CHECKPOINT_VERSION = 1


class Keeping(Protocol):
    """A part that can be kept and taken up again."""

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""


class SimulatedRig(Rig):
    """A tester that is not there.

    Everything random comes from the seed: the same calls give the same readings, bit for bit, and so they do after
    `checkpoint` and `restore`.

    Parameters
    ----------
    rig_settings
        The rig as declared; what it truly is may differ by the declared uncertainty.
    settings
        What is simulated, and how it misbehaves.
    contact_stiffness
        k_c(P), N to N/m; None for the table of the settings.
    realtime
        Whether time passes as on the wall.
    seed
        Instead of the one in the settings.
    clock
        Instead of one of its own.

    Attributes
    ----------
    peak_true_load_mn
        Largest load the contact has really carried, mN.
    seed
        The seed in force.
    micrometer
        The motor micrometer, also where `stage` is in somebody's hand.
    load_changed
        Called when the load on the gauge has changed: what converts at a rate of its own takes it in then.
    """

    clock: VirtualClock
    load_cell: SimulatedLoadCell
    stage: Stage
    accelerometers: SimulatedAccelerometers
    impactor: SimulatedImpactor
    weights: SimulatedWeights

    def __init__(
        self,
        rig_settings: RigSettings,
        settings: SimBackendSettings,
        contact_stiffness: Callable[[float], float] | None = None,
        realtime: bool = False,
        seed: int | None = None,
        clock: VirtualClock | None = None,
    ):
        self.name = "simulated rig"
        self.peak_true_load_mn = 0.0
        self._push_um = 0.0
        self.seed = seed = settings.seed if seed is None else seed
        self._settings = settings
        self._truth = TrueRig(
            draw_parameters(rig_settings, settings, seed), ContactTable(settings.contact), contact_stiffness
        )
        wiring, analog = rig_settings.wiring, analog_filter(rig_settings.filter)
        self.clock = VirtualClock(realtime) if clock is None else clock
        self.load_changed: Callable[[], None] = nothing
        # the physics keeps to its own micrometer, also when `stage` is put into somebody's hand
        self.micrometer = SimulatedStage(settings.stage, self.clock, self._note_load)
        self.stage = self.micrometer
        self.weights = SimulatedWeights(settings.gauge, self.clock, self.true_load_mn, self._note_load, seed)
        self.load_cell = SimulatedLoadCell(
            settings.gauge,
            self._truth.parameters.sensitivity_mv_per_mn,
            self.clock,
            lambda: self.true_load_mn() + self.weights.true_load_mn,
            seed,
        )
        self.impactor = SimulatedImpactor(
            settings, self._truth, analog, wiring.full_scale_m_s2(), self.clock, self._true_load_n, seed
        )
        signal = AnalogSignal(settings, wiring, self._truth, analog, self.clock, self.impactor, self.load_cell, seed)
        self.accelerometers = SimulatedAccelerometers(
            wiring, signal, converters(wiring, settings.recorder, seed), self.clock
        )
        self._load_at = (math.nan, 0.0)  # carriage position, um, and the load there, N
        self._parts: dict[str, Keeping] = {
            "stage": self.micrometer,
            "weights": self.weights,
            "load_cell": self.load_cell,
            "impactor": self.impactor,
            "accelerometers": self.accelerometers,
        }

    def open(self) -> list[str]:
        """Tell what answers; a part that is made to fail says so as a real one would."""
        if self.load_cell.fault == "dropout":
            raise RigError("The simulated load cell does not answer: check its cable and its amplifier.")
        recorder, stage = self.accelerometers, self._settings.stage
        return [
            f"simulated load cell: {self.load_cell.true_voltage():.3f} mV, noise {self._settings.gauge.noise_mv} mV",
            f"simulated stage: at {self.micrometer.read().position_um:.2f} um, resolution {stage.resolution_um} um, "
            f"backlash {stage.backlash_um} um, {'clamped' if self.micrometer.locked else 'free'}",
            f"simulated accelerometers: {recorder.sample_rate_hz:g} Hz, {recorder.bits} bits, "
            f"full scale {recorder.full_scale_m_s2:.1f} m/s2",
            f"simulated impactor: {self._settings.pulse.shape} pulses of {self._settings.pulse.duration_ms} ms",
            "simulated dead weights: any load, with the surfaces apart",
            *(f"simulated beyond Eq. 9: {m.adopted().mechanism.summary}" for m in self._settings.mechanisms),
        ]

    def close(self) -> None:
        """End the stream."""
        self.accelerometers.stop()

    def push(self, depth_um: float) -> None:
        """Have somebody lean on the upper mass, so that it is so much deeper than the stage holds it."""
        self._push_um = depth_um
        self._note_load()

    def tap_lower_mass(self, side: int = 0) -> None:
        """Have the person tap the lower mass by hand, whatever taps the upper one; see `SimulatedImpactor`."""
        self.impactor.tap_lower_mass(side)

    def true_load_mn(self) -> float:
        """Return the load that the contact carries now, mN."""
        return self._true_load_n() * 1e3

    def true_parameters(self) -> dict[str, float]:
        """Return the true masses (kg), springs (N/m), dampers (N s/m), sensitivity (mV/mN), contact position (um)."""
        return {**asdict(self._truth.parameters), "contact_position_um": self._settings.contact_position_um}

    def truth_at_load(self, load_n: float) -> dict[str, float]:
        """Return contact and modes at a load, N, without scatter.

        Keys: load_mn, contact_stiffness_n_per_m, contact_damping_n_s_per_m, f1_hz, f2_hz, zeta1, zeta2.
        """
        return self._truth.at_load(load_n)

    def checkpoint(self) -> dict[str, Any]:
        """Return all that the rig is, as JSON types; only a running stream is left out."""
        parts = {name: part.checkpoint() for name, part in self._parts.items()}
        own = {"version": CHECKPOINT_VERSION, "seed": self.seed, "time_s": self.clock.time_s}
        return {**own, "peak_true_load_mn": self.peak_true_load_mn, **parts}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint` of a rig with the same settings and seed."""
        if state.get("version") != CHECKPOINT_VERSION or state.get("seed") != self.seed:
            seeds = f"seed {shortened(state.get('seed'))} against {shortened(self.seed)}"
            raise RigError(
                f"The kept state is not of this simulated rig ({seeds}): "
                "use the same config.yaml, or begin a new session."
            )
        refuse_damaged({**state, "seed": 0})
        self.clock.time_s = state["time_s"]
        self.peak_true_load_mn = state["peak_true_load_mn"]
        for name, part in self._parts.items():
            part.restore(state[name])

    def _true_load_n(self) -> float:
        carriage = self.micrometer.carriage_um + self._push_um
        if carriage != self._load_at[0]:
            overlap_um = carriage - self._settings.contact_position_um
            self._load_at = (carriage, self._truth.equilibrium.load(overlap_um * 1e-6))
        return self._load_at[1]

    def _note_load(self) -> None:
        self.peak_true_load_mn = max(self.peak_true_load_mn, self.true_load_mn())
        self.load_changed()
