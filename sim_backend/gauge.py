"""Simulated strain gauge, and the weights that calibrate it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import DeadWeights, LoadCell, LoadReading, RigError
from rig.interface import HEED_S
from sim_backend import random_state
from sim_backend.clock import VirtualClock
from sim_backend.settings import SimulatedGauge

READING_RATE_HZ = 100.0
LATE_BY_S = 5.0  # age of a reading with the fault "late"
SMALLEST_WEIGHT_MN = 1e-6
STEP_MV = 2.0**-16  # of the amplifier's converter: 24 bits over +-128 mV, whole in the float32 of a register as well
LARGEST_CODE = 2**23 - 1

Fault = str | tuple[str, float] | None


class SimulatedLoadCell(LoadCell):
    """Bridge voltage of the true load: offset, true sensitivity, drift of both, and noise.

    Attributes
    ----------
    fault
        None, or what is wrong with it, for tests: ``"frozen"`` (the same voltage again and again), ``"dropout"``
        (no answer), ``"nan"``, ``"late"`` (an old reading), ``("scale", factor)`` on the load's share of the voltage,
        ``("offset", mv)``.
    """

    def __init__(
        self,
        settings: SimulatedGauge,
        sensitivity_mv_per_mn: float,
        clock: VirtualClock,
        load_mn: Callable[[], float],
        seed: int,
    ):
        self.fault: Fault = None
        self._settings = settings
        self._sensitivity = sensitivity_mv_per_mn
        self._clock = clock
        self._load_mn = load_mn
        self._rng = random_state.generator(seed, 1)
        self._last_voltage: float | None = None

    def true_sensitivity(self) -> float:
        """Return the sensitivity now, mV/mN, its drift included."""
        hours = self._clock.now() / 3600
        return self._sensitivity * (1 + self._settings.sensitivity_drift_percent_per_hour / 100 * hours)

    def true_offset(self) -> float:
        """Return the voltage without load now, mV, its drift included."""
        return self._settings.offset_mv + self._settings.drift_mv_per_hour * self._clock.now() / 3600

    def true_voltage(self) -> float:
        """Return the voltage now, mV, without noise and fault."""
        return self.true_offset() + self.true_sensitivity() * self._load_mn()

    def sample_code(self) -> int:
        """Return what the amplifier's converter reads now, noise and all, in steps of `STEP_MV`."""
        voltage = self.true_voltage()
        if isinstance(self.fault, tuple | list):
            kind, amount = self.fault
            if kind == "scale":
                voltage = self.true_offset() + amount * (voltage - self.true_offset())
            elif kind == "offset":
                voltage += amount
        voltage += self._settings.noise_mv * float(self._rng.standard_normal())
        return min(max(round(voltage / STEP_MV), -LARGEST_CODE - 1), LARGEST_CODE)

    def read(self, duration_s: float = 0.1) -> LoadReading:
        """Average at 100 samples a second, at least two samples."""
        fault = self.fault
        count = max(2, round(duration_s * READING_RATE_HZ))
        begun = self._clock.now()
        if fault in ("dropout", "frozen"):
            self._clock.sleep_until(begun + max(duration_s, count / READING_RATE_HZ))
        if fault == "dropout":
            raise RigError("The simulated load cell does not answer: check its cable and its amplifier.")
        if fault == "frozen":
            held = self.true_voltage() if self._last_voltage is None else self._last_voltage
            self._last_voltage = held
            return LoadReading(self._clock.now(), held, 0.0, count)

        samples = np.empty(count)
        for i in range(count):
            self.idle()
            self._clock.sleep_until(begun + (i + 1) / READING_RATE_HZ)
            samples[i] = self.sample_code() * STEP_MV
        self._clock.sleep_until(begun + max(duration_s, count / READING_RATE_HZ))
        mean, spread = float(np.mean(samples)), float(np.std(samples, ddof=1))
        self._last_voltage = mean
        if fault == "nan":
            return LoadReading(self._clock.now(), math.nan, math.nan, count)
        time_s = self._clock.now() - (LATE_BY_S if fault == "late" else 0.0)
        return LoadReading(time_s, mean, spread, count)

    def stream(self, dynamic_mn: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the voltage that the recorder samples, mV, with a dynamic load, mN, on top of the static one."""
        noise = self._settings.noise_mv * rng.standard_normal(len(dynamic_mn))
        return self.true_voltage() + self.true_sensitivity() * dynamic_mn + noise

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        fault = list(self.fault) if isinstance(self.fault, tuple) else self.fault
        return {"rng": random_state.state_of(self._rng), "last_voltage_mv": self._last_voltage, "fault": fault}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        random_state.restore(self._rng, state["rng"])
        self._last_voltage = state["last_voltage_mv"]
        fault = state["fault"]
        self.fault = tuple(fault) if isinstance(fault, list) else fault


class SimulatedWeights(DeadWeights):
    """A set of weights, each a little off its nominal value, and by the same amount every time it is used."""

    def __init__(
        self,
        settings: SimulatedGauge,
        clock: VirtualClock,
        contact_load_mn: Callable[[], float],
        placed: Callable[[], None],
        seed: int,
    ) -> None:
        self._placed = placed
        self._error_mn = settings.weight_error_mn
        self._settling_s = settings.weight_settling_s
        self._clock = clock
        self._contact_load_mn = contact_load_mn
        self._seed = seed
        self._nominal_mn = 0.0

    @property
    def true_load_mn(self) -> float:
        """What really hangs on the gauge, mN."""
        if self._nominal_mn < SMALLEST_WEIGHT_MN:
            return 0.0
        rng = np.random.default_rng([self._seed, 4, round(self._nominal_mn * 1000)])
        return self._nominal_mn + self._error_mn * float(rng.standard_normal())

    def place(self, load_mn: float) -> None:
        """Hang this load on the gauge in place of what hung there; the surfaces must be apart."""
        if not (math.isfinite(load_mn) and load_mn >= 0):
            raise RigError(f"There is no weight of {load_mn} mN: ask for zero or more.")
        if self._contact_load_mn() > 0:
            raise RigError(
                f"The surfaces carry {self._contact_load_mn():.1f} mN, so a weight would not be alone on the gauge: "
                "move the stage back until they are apart."
            )
        self._nominal_mn = load_mn
        self._placed()
        begun = self._clock.now()
        for turn in range(1, math.ceil(self._settling_s / HEED_S)):
            self._clock.sleep_until(begun + turn * HEED_S)
            self.idle()
        self._clock.sleep_until(begun + self._settling_s)

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        return {"nominal_mn": self._nominal_mn}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._nominal_mn = state["nominal_mn"]
