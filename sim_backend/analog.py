"""What arrives at the recorder's inputs: accelerations and bridge voltage, before any converter.

The simulated recorder and the emulated one sample the same signal, so that with one seed both record the same.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import RigError
from rig.settings import Wiring
from sim_backend import random_state
from sim_backend.clock import VirtualClock
from sim_backend.gauge import SimulatedLoadCell
from sim_backend.hammer import HammerSignal
from sim_backend.impactor import SimulatedImpactor
from sim_backend.recorder import Noise
from sim_backend.settings import SimBackendSettings
from sim_backend.state_space import StateSpace
from sim_backend.taps import Tap, tap_record
from sim_backend.truth import TrueRig


class AnalogSignal:
    """Noise in which taps arrive, sampled while somebody takes samples.

    Attributes
    ----------
    inputs
        Recorder inputs that are wired, in the order A, B, strain gauge, hammer.
    hammer
        The instrumented hammer, None without one.
    """

    def __init__(
        self,
        settings: SimBackendSettings,
        wiring: Wiring,
        truth: TrueRig,
        analog: StateSpace,
        clock: VirtualClock,
        impactor: SimulatedImpactor,
        gauge: SimulatedLoadCell,
        seed: int,
    ):
        self.inputs = wiring.inputs()
        self._units_per_volt = np.array(wiring.units_per_volt())[:, None]
        self._settings = settings
        self._mechanisms = tuple(m.adopted() for m in settings.mechanisms)
        self._truth = truth
        self._analog = analog
        self._clock = clock
        self._impactor = impactor
        self._gauge = gauge
        self._rng = random_state.generator(seed, 3)
        self._noise: Noise | None = None
        self._rate_hz = wiring.sample_rate_hz
        self._started_s = 0.0
        self._next = 0
        self._records: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []
        self.hammer = None if wiring.hammer is None else HammerSignal(wiring.hammer, settings, analog, seed)
        self._samples_strain = wiring.strain_gauge_input is not None
        impactor.on_tap(self._hear)

    @property
    def running(self) -> bool:
        """Whether it is being sampled."""
        return self._noise is not None

    def begin(self, sample_rate_hz: float) -> None:
        """Begin to be sampled, now: sample i is taken i / rate from here; whatever rang before has come to rest."""
        self._rate_hz = sample_rate_hz
        self._started_s = self._clock.now()
        self._next = 0
        self._records = []
        if self.hammer is not None:
            self.hammer.forget()
        self._noise = Noise(self._settings.noise, 2, sample_rate_hz, self._rng)
        for tap in self._impactor.pending():
            self._hear(tap)

    def end(self) -> None:
        """Be sampled no longer."""
        self._noise = None
        self._records = []

    def skip(self, samples: int) -> None:
        """Leave out samples: time passes, nobody looks."""
        self._next += samples

    def take(self, samples: int) -> NDArray[np.float64]:
        """Return the next voltages at `inputs`, (inputs, samples), V; time passes until the last has been taken."""
        if self._noise is None:
            raise RigError("The simulated signal is not being sampled: begin before samples are taken.")
        first, n = self._next, samples
        self._next += n
        self._clock.sleep_until(self._started_s + self._next / self._rate_hz)

        acceleration = self._noise.draw(n)
        if self._mechanisms:
            acceleration += self._tones(first, n)
        acceleration += self._hum(first, n)
        dynamic_mn = np.zeros(n)
        for start, record, load in self._records:
            low, high = max(first, start), min(first + n, start + len(load))
            if low < high:
                acceleration[:, low - first : high - first] += record[:, low - start : high - start]
                dynamic_mn[low - first : high - first] += load[low - start : high - start]
        self._records = [r for r in self._records if r[0] + len(r[2]) > self._next]
        sensed = [acceleration]
        if self._samples_strain:
            sensed.append(self._gauge.stream(dynamic_mn, self._rng)[None])
        if self.hammer is not None:
            sensed.append(self.hammer.take(first, n)[None])
        return self._plugged(np.vstack(sensed) / self._units_per_volt)

    def _plugged(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is at each input: A and B may be the wrong way round."""
        return volts[[1, 0, *range(2, len(volts))]] if self._settings.sensors.swapped else volts

    def _hum(self, first: int, samples: int) -> NDArray[np.float64]:
        """The mains in each cable, (2, samples); zero by default."""
        t = self._started_s + (first + np.arange(samples)) / self._rate_hz
        sensors = self._settings.sensors
        sizes = np.array([[sensors.a.hum_m_s2], [sensors.b.hum_m_s2]])
        return sizes * np.sin(2 * np.pi * sensors.mains_hz * t)

    def _tones(self, first: int, samples: int) -> NDArray[np.float64]:
        """Steady tones that the mechanisms put into both channels; their phase is that of the rig's time."""
        from sim_backend.adopted import tones

        t = self._started_s + (first + np.arange(samples)) / self._rate_hz
        out = np.zeros(samples)
        for frequency_hz, amplitude in tones(self._mechanisms):
            out += amplitude * np.sin(2 * np.pi * frequency_hz * t)
        return out

    def _hear(self, tap: Tap) -> None:
        if self._noise is None:
            return
        after_start = tap.onset_s - self._started_s
        start = math.floor(after_start * self._rate_hz)
        onset = max(0.0, after_start - start / self._rate_hz)
        pulse = self._settings.pulse
        record, load = tap_record(tap, self._truth, pulse, onset, self._rate_hz, self._analog, self._mechanisms)
        self._records.append((start, self._sensed(record), load))
        if self.hammer is not None:
            self.hammer.hear(tap, start, onset, self._rate_hz)

    def _sensed(self, record: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the accelerometers make of a tap, (2, n)."""
        sensed = record.copy()
        for row, sensor in enumerate((self._settings.sensors.a, self._settings.sensors.b)):
            late = sensor.delay_samples
            sensed[row, late:] = sensor.gain * record[row, : record.shape[1] - late]
            sensed[row, :late] = 0.0
        return sensed

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types; that it is being sampled is not part of it."""
        state = random_state.state_of(self._rng)
        return state if self.hammer is None else {**state, "hammer": self.hammer.checkpoint()}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`, not being sampled."""
        self.end()
        if self.hammer is not None:
            self.hammer.restore(state.get("hammer"))
        random_state.restore(self._rng, {key: value for key, value in state.items() if key != "hammer"})
