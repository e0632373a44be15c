"""Simulated instrumented hammer: the force of each tap, its sensitivity a little off, with noise of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.settings import Hammer
from sim_backend import random_state
from sim_backend.settings import SimBackendSettings, SimulatedHammer
from sim_backend.state_space import StateSpace
from sim_backend.taps import Tap, tap_force

SENSITIVITY, NOISE = 15, 14
"""Roles of its random numbers: none of them is drawn where there is no hammer."""


class HammerSignal:
    """What the hammer's cable carries, in the declared newtons, while somebody samples.

    Attributes
    ----------
    gain
        Force as it is read over the true one.
    """

    def __init__(self, hammer: Hammer, settings: SimBackendSettings, analog: StateSpace, seed: int):
        described = settings.hammer or SimulatedHammer()
        error = 0.0
        if settings.parameter_errors:
            draw = float(random_state.generator(seed, SENSITIVITY).standard_normal())
            error = hammer.sensitivity_uncertainty_percent / 100 * draw
        self.gain = described.gain * (1 + error)
        self._noise_n = described.noise_n if described.gain else 0.0
        self._pulse = settings.pulse
        self._analog = analog if hammer.filtered else None
        self._rng = random_state.generator(seed, NOISE)
        self._records: list[tuple[int, NDArray[np.float64]]] = []

    def forget(self) -> None:
        """Begin anew: whatever was hit before is over."""
        self._records = []

    def hear(self, tap: Tap, start: int, onset_s: float, rate_hz: float) -> None:
        """Take in a tap that begins ``onset_s`` after sample ``start``."""
        self._records.append((start, self.gain * tap_force(tap, self._pulse, onset_s, rate_hz, self._analog)))

    def take(self, first: int, samples: int) -> NDArray[np.float64]:
        """Return the force at samples ``first`` to ``first + samples``, N."""
        force = self._noise_n * self._rng.standard_normal(samples)
        for start, record in self._records:
            low, high = max(first, start), min(first + samples, start + len(record))
            if low < high:
                force[low - first : high - first] += record[low - start : high - start]
        self._records = [r for r in self._records if r[0] + len(r[1]) > first + samples]
        return force

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        return random_state.state_of(self._rng)

    def restore(self, state: dict[str, Any] | None) -> None:
        """Take up the state of `checkpoint`; None, of a session without a hammer, leaves it as it is."""
        self.forget()
        if state is not None:
            random_state.restore(self._rng, state)
