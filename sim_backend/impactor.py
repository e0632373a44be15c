"""Simulated tapping: strength fit for the preload, scatter, and taps that go wrong."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from rig import Impactor, RigError
from sim_backend import random_state
from sim_backend.clock import VirtualClock
from sim_backend.pulses import SHAPES
from sim_backend.ring_down import ring_down_linear
from sim_backend.settings import SimBackendSettings
from sim_backend.state_space import StateSpace
from sim_backend.taps import Rocking, Tap
from sim_backend.truth import TrueRig
from sim_backend.two_mass import LOWER

DELAY_S = (0.05, 0.2)
SECOND_IMPACT_S, SECOND_IMPACT_SHARE = (1.5e-3, 6e-3), (0.3, 0.6)
TOO_HARD_RATIO = (1.3, 2.5)  # of peak contact force and preload
TOO_WEAK_SHARE = (0.01, 0.02)  # of the usual strength
CLIPPED_RATIO = (1.2, 2.0)  # of peak acceleration and full scale
LOWER_MASS_PEAK_N = 0.12  # makes 1 m/s2
SIDE_HZ, SIDE_SHARE = 1000.0, 0.6  # of a tap beside one accelerometer: rotation, over what is common to both
ROCKING_HZ, ROCKING_DAMPING, ROCKING_SHARE = (3000.0, 6000.0), (0.01, 0.04), (0.3, 0.6)
CARE = 0.5  # of the usual share of bad taps, once told what was wrong
SMALLEST_PRELOAD_N = 0.01
WEAKEST_STRENGTH = 0.2
SEARCH_S, SEARCH_RATE_HZ = 6e-3, 2e5  # where and how finely the peak of a unit impact is searched


class SimulatedImpactor(Impactor):
    """Makes one tap soon after each call.

    Attributes
    ----------
    history
        The last hundred taps, for comparison with what became of them.
    """

    def __init__(
        self,
        settings: SimBackendSettings,
        truth: TrueRig,
        analog: StateSpace,
        full_scale_m_s2: float,
        clock: VirtualClock,
        true_load_n: Callable[[], float],
        seed: int,
    ):
        self.history: deque[Tap] = deque(maxlen=100)
        self._settings = settings
        self._second = self._second_impact() if settings.mechanisms else None
        self._truth = truth
        self._analog = analog
        self._full_scale = full_scale_m_s2
        self._clock = clock
        self._true_load_n = true_load_n
        self._rng = random_state.generator(seed, 2)
        self._pending: list[Tap] = []
        self._listeners: list[Callable[[Tap], None]] = []

    def on_tap(self, listener: Callable[[Tap], None]) -> None:
        """Have ``listener`` called with every tap as soon as it is decided."""
        self._listeners.append(listener)

    def pending(self) -> list[Tap]:
        """Return the taps that are still to come."""
        now = self._clock.now()
        self._pending = [tap for tap in self._pending if tap.onset_s > now]
        return list(self._pending)

    def tap(self, load_mn: float, hint: str = "") -> None:
        """Decide one tap for a preload of ``load_mn``; a hint makes a bad one half as likely."""
        if not (np.isfinite(load_mn) and load_mn >= 0):
            raise RigError(f"The simulated impactor cannot tap for a preload of {load_mn} mN: it must be known.")
        self._make(self._decide(load_mn * 1e-3, CARE if hint else 1.0))

    def tap_lower_mass(self, side: int = 0) -> None:
        """Tap the lower mass from above, for which the surfaces need not touch.

        ``side``: 0 in the middle, 1 beside accelerometer A, -1 beside B.
        """
        rng, scatter = self._rng, self._settings.pulse.strength_scatter_percent / 100
        onset_s = self._clock.now() + rng.uniform(*DELAY_S)
        peak = LOWER_MASS_PEAK_N * max(WEAKEST_STRENGTH, 1 + scatter * rng.standard_normal())
        rocking = Rocking(SIDE_HZ, ROCKING_DAMPING[1], side * SIDE_SHARE) if side else None
        self._make(Tap(onset_s, self._true_load_n(), 1.0, 1.0, (peak,), (0.0,), rocking, (), LOWER))

    def _make(self, tap: Tap) -> None:
        self._pending = [*self.pending(), tap]
        self.history.append(tap)
        for listener in self._listeners:
            listener(tap)

    def _decide(self, load_n: float, care: float) -> Tap:
        contact, pulse, bad, rng = self._settings.contact, self._settings.pulse, self._settings.bad_taps, self._rng
        # always the same number of draws, whatever is decided
        kinds = {kind: bool(rng.random() < care * rate) for kind, rate in bad.model_dump().items()}
        delay = rng.uniform(*DELAY_S)
        strength = max(WEAKEST_STRENGTH, 1 + pulse.strength_scatter_percent / 100 * rng.standard_normal())
        stiffness_factor = max(0.1, 1 + contact.stiffness_scatter_percent / 100 * rng.standard_normal())
        damping_factor = max(0.1, 1 + contact.damping_scatter_percent / 100 * rng.standard_normal())
        too_hard, too_weak = rng.uniform(*TOO_HARD_RATIO), rng.uniform(*TOO_WEAK_SHARE)
        clipped = rng.uniform(*CLIPPED_RATIO)
        second_delay, second_share = rng.uniform(*SECOND_IMPACT_S), rng.uniform(*SECOND_IMPACT_SHARE)
        rocking = Rocking(rng.uniform(*ROCKING_HZ), rng.uniform(*ROCKING_DAMPING), rng.uniform(*ROCKING_SHARE))

        preload = self._true_load_n()
        force, acceleration = self._unit_impact(preload, stiffness_factor, damping_factor)
        ratio = pulse.peak_force_ratio * strength
        if kinds["too_hard"]:
            ratio = too_hard
        elif kinds["too_weak"]:
            ratio = pulse.peak_force_ratio * too_weak
        peak = ratio * max(load_n, SMALLEST_PRELOAD_N) / force
        if kinds["clipped"] and acceleration > 0:
            peak = clipped * self._full_scale / acceleration
        peaks: tuple[float, ...] = (peak,)
        delays: tuple[float, ...] = (0.0,)
        if kinds["double"]:
            peaks, delays = (peak, second_share * peak), (0.0, max(second_delay, pulse.duration_ms * 1e-3))
        if self._second is not None and not kinds["double"]:
            delays = (0.0, max(rng.uniform(*SECOND_IMPACT_S), pulse.duration_ms * 1e-3))
            peaks = (peak, self._second * peak)
        return Tap(
            self._clock.now() + delay,
            preload,
            stiffness_factor,
            damping_factor,
            peaks,
            delays,
            rocking if kinds["off_centre"] else None,
            tuple(kind for kind, happens in kinds.items() if happens),
        )

    def _second_impact(self) -> float | None:
        """Impulse of a second impact that follows every tap over that of the first; None without one."""
        from sim_backend.adopted import second_impact

        return second_impact([m.adopted() for m in self._settings.mechanisms])

    def _unit_impact(self, preload_n: float, stiffness_factor: float, damping_factor: float) -> tuple[float, float]:
        """Return peak contact force, N, and peak filtered acceleration, m/s2, of an impact of 1 N by the linear model.

        With the surfaces apart an impact of 1 N counts as a force of 1 N.
        """
        if preload_n <= 0:
            return 1.0, 0.0
        tester = self._truth.tester(preload_n, stiffness_factor, damping_factor)
        pulse = SHAPES[self._settings.pulse.shape](1.0, self._settings.pulse.duration_ms * 1e-3)
        samples = int((pulse.duration_s + SEARCH_S) * SEARCH_RATE_HZ)
        response = ring_down_linear(tester, pulse, 0.0, samples, SEARCH_RATE_HZ, self._analog)
        return float(np.max(np.abs(response.contact_force))), float(np.max(np.abs(response.acceleration)))

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        return {"rng": random_state.state_of(self._rng), "taps": [tap.to_json() for tap in self.pending()]}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`; the history begins anew."""
        random_state.restore(self._rng, state["rng"])
        self._pending = [Tap.from_json(tap) for tap in state["taps"]]
        self.history.clear()
