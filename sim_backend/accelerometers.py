"""Simulated accelerometers and recorder: a stream of noise in which taps arrive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import Accelerometers, Block, RigError
from rig.settings import Wiring
from sim_backend import random_state
from sim_backend.clock import VirtualClock
from sim_backend.gauge import SimulatedLoadCell
from sim_backend.impactor import SimulatedImpactor
from sim_backend.recorder import Converter, Noise
from sim_backend.settings import SimBackendSettings
from sim_backend.state_space import StateSpace
from sim_backend.taps import Tap, tap_record
from sim_backend.truth import TrueRig

BLOCK_SAMPLES = 256
SILENCE_S = 1.0  # how long a silent recorder is waited for


class SimulatedAccelerometers(Accelerometers):
    """Streams blocks of 256 samples; sample i is taken i / rate after `start`.

    Attributes
    ----------
    fault
        None, or for tests ``"silence"`` (no block comes) or ``"gap"`` (the next block is lost).
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
        self.sample_rate_hz = wiring.sample_rate_hz
        self.full_scale_m_s2 = wiring.full_scale_m_s2()
        self.bits = wiring.bits
        self.fault: str | None = None
        self._settings = settings
        self._with_strain = wiring.strain_gauge_input is not None
        self._truth = truth
        self._analog = analog
        self._clock = clock
        self._impactor = impactor
        self._gauge = gauge
        self._converter = Converter(self.full_scale_m_s2, self.bits)
        self._rng = random_state.generator(seed, 3)
        self._noise: Noise | None = None
        self._started_s = 0.0
        self._next = 0
        self._records: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []
        impactor.on_tap(self._hear)

    def start(self) -> None:
        """Begin to stream, now; whatever rang before has come to rest."""
        self._started_s = self._clock.now()
        self._next = 0
        self._records = []
        self._noise = Noise(self._settings.noise, 2, self.sample_rate_hz, self._rng)
        for tap in self._impactor.pending():
            self._hear(tap)

    def stop(self) -> None:
        """End the stream."""
        self._noise = None
        self._records = []

    def read_block(self) -> Block:
        """Return the next block; time passes until its last sample has been taken."""
        if self._noise is None:
            raise RigError("The simulated recorder is not streaming: start it before blocks are read.")
        if self.fault == "silence":
            self._clock.sleep(SILENCE_S)
            raise RigError(f"The simulated recorder sent nothing for {SILENCE_S:g} s: check its cable.")
        if self.fault == "gap":
            self._next += BLOCK_SAMPLES
            self.fault = None
        first, n = self._next, BLOCK_SAMPLES
        self._next += n
        self._clock.sleep_until(self._started_s + self._next / self.sample_rate_hz)

        acceleration = self._noise.draw(n)
        dynamic_mn = np.zeros(n)
        for start, record, load in self._records:
            low, high = max(first, start), min(first + n, start + len(load))
            if low < high:
                acceleration[:, low - first : high - first] += record[:, low - start : high - start]
                dynamic_mn[low - first : high - first] += load[low - start : high - start]
        self._records = [r for r in self._records if r[0] + len(r[2]) > self._next]
        strain = self._gauge.stream(dynamic_mn, self._rng) if self._with_strain else None
        return Block(first, self._converter(acceleration), strain)

    def _hear(self, tap: Tap) -> None:
        if self._noise is None:
            return
        after_start = tap.onset_s - self._started_s
        start = math.floor(after_start * self.sample_rate_hz)
        onset = max(0.0, after_start - start / self.sample_rate_hz)
        pulse, contact = self._settings.pulse, self._settings.contact
        record, load = tap_record(tap, self._truth, contact, pulse, onset, self.sample_rate_hz, self._analog)
        self._records.append((start, record, load))

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types; a running stream is not part of it."""
        return {"rng": random_state.state_of(self._rng), "fault": self.fault}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`, not streaming."""
        self.stop()
        random_state.restore(self._rng, state["rng"])
        self.fault = state["fault"]
