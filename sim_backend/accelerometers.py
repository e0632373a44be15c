"""Simulated recorder: the analog signal of the accelerometers through a converter, block by block."""

from __future__ import annotations

from typing import Any

import numpy as np

from rig import Accelerometers, Block, RigError
from rig.settings import Wiring
from sim_backend.analog import AnalogSignal
from sim_backend.clock import VirtualClock
from sim_backend.recorder import Converter

BLOCK_SAMPLES = 256
SILENCE_S = 1.0  # how long a silent recorder is waited for


class SimulatedAccelerometers(Accelerometers):
    """Streams blocks of 256 samples; sample i is taken i / rate after `start`.

    Attributes
    ----------
    signal
        What is behind the inputs; an emulated recorder samples the same.
    converters
        One for each wired input, in volts.
    fault
        None, or for tests ``"silence"`` (no block comes) or ``"gap"`` (the next block is lost).
    """

    def __init__(self, wiring: Wiring, signal: AnalogSignal, converters: list[Converter], clock: VirtualClock):
        self.sample_rate_hz = wiring.sample_rate_hz
        self.bits = wiring.bits
        self.signal = signal
        self.converters = converters
        self.fault: str | None = None
        self._wiring = wiring
        self._units_per_volt = wiring.units_per_volt()
        reach = [c.reach() * abs(u) for c, u in zip(converters, self._units_per_volt, strict=True)]
        self.full_scale_m_s2 = min(reach[:2])
        self._clock = clock
        self._next = 0

    def start(self) -> None:
        """Begin to stream, now; whatever rang before has come to rest."""
        self._next = 0
        self.signal.begin(self.sample_rate_hz)

    def stop(self) -> None:
        """End the stream."""
        self.signal.end()

    def read_block(self) -> Block:
        """Return the next block; time passes until its last sample has been taken."""
        if not self.signal.running:
            raise RigError("The simulated recorder is not streaming: start it before blocks are read.")
        if self.fault == "silence":
            self._clock.sleep(SILENCE_S)
            raise RigError(f"The simulated recorder sent nothing for {SILENCE_S:g} s: check its cable.")
        if self.fault == "gap":
            self.signal.skip(BLOCK_SAMPLES)
            self._next += BLOCK_SAMPLES
            self.fault = None
        first = self._next
        self._next += BLOCK_SAMPLES
        volts = self.signal.take(BLOCK_SAMPLES)
        values = np.empty_like(volts)
        for row, (convert, unit) in enumerate(zip(self.converters, self._units_per_volt, strict=True)):
            values[row] = convert(volts[row]) * unit
        return Block(first, values[:2], *self._wiring.sorted_out(list(values)))

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types; a running stream is not part of it."""
        return {"rng": self.signal.checkpoint(), "fault": self.fault}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`, not streaming."""
        self.stop()
        self.signal.restore(state["rng"])
        self.fault = state["fault"]
