"""The check of wiring and polarity by one tap, while the live view runs: a quiet second, the tap, the verdicts."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numpy import float64
from numpy.typing import NDArray

from daq.live_signals import LiveSignals, TapWindow
from daq.wiring_check import AFTER_S, BEFORE_S, QUIET_S, check_wiring
from mesotap.configuration.config import Config
from mesotap.session.view_order import SIDES
from mesotap.session.wiring_verdicts import wiring_verdicts
from rig import Accelerometers, Clock

RELATION = (
    *("gain", "gain_half", "delay_samples", "delay_half"),
    *("correlation", "correlation_low", "correlation_high"),
)
"""What is shown of how B follows A."""

NONE, QUIET, WAITING, DONE = "none", "quiet", "waiting", "done"


class TapCheck:
    """One check after the other.

    Parameters
    ----------
    config
        The configuration in force.
    recorder, clock
        Of the rig.
    tap
        Called with the side on which a simulated person is to tap now.

    Attributes
    ----------
    outcome
        How far it is (``none``, ``quiet``: the noise is measured, ``waiting`` for the tap, ``done``), its verdicts, and
        the numbers of `RELATION`.
    """

    def __init__(self, config: Config, recorder: Accelerometers, clock: Clock, tap: Callable[[int], None]) -> None:
        self._config, self._recorder, self._clock, self._tap = config, recorder, clock, tap
        self._window: TapWindow | None = None
        self._side, self._until_s = 0, math.inf
        self.outcome: dict[str, Any] = {"state": NONE, "verdicts": [], "numbers": {}}

    @property
    def state(self) -> str:
        """How far it is."""
        return str(self.outcome["state"])

    def begin(self, side: str, signals: LiveSignals) -> None:
        """Begin one anew; ``side`` says where the lower mass is tapped."""
        rate, trigger = signals.rate, self._config.daq.trigger
        before, after = round((QUIET_S + BEFORE_S) * rate), round(AFTER_S * rate)
        self._window = TapWindow(before, after, rate, trigger.threshold_m_s2, signals.stream.end)
        self._side, self._until_s = SIDES[side], math.inf
        self.outcome = {"state": QUIET, "verdicts": [], "numbers": {}}

    def follow(self, signals: LiveSignals) -> None:
        """Look at the block that was read last."""
        window, timeout_s = self._window, self._config.daq.trigger.timeout_s
        if window is None:
            return
        record = window.feed(signals.stream)
        if record is not None:
            self._judge(record, window.before, signals.rate)
        elif window.waiting and self.state == QUIET:
            self.outcome = {**self.outcome, "state": WAITING}
            self._until_s = self._clock.now() + timeout_s
            self._tap(self._side)
        elif window.waiting and self._clock.now() > self._until_s:
            says = (
                f"neither A nor B saw a tap within {timeout_s:g} s: tap the lower mass itself, harder, and check that "
                "both cables are plugged in"
            )
            self._done([{"name": "channels", "passed": False, "says": says}], {})

    def where(self) -> str:
        """Return in words where to tap."""
        return {0: "between the accelerometers", 1: "beside A", -1: "beside B"}[self._side]

    def _judge(self, record: NDArray[float64], trigger: int, rate: float) -> None:
        quality, wiring = self._config.daq.quality, self._config.rig.wiring
        full_scale, bits = self._recorder.full_scale_m_s2, self._recorder.bits
        found = check_wiring(record, trigger, rate, full_scale, bits, quality.rotation_window_ms)
        verdicts = wiring_verdicts(found, wiring, quality, rate, self._side)
        numbers = {} if found.relation is None else {name: getattr(found.relation, name) for name in RELATION}
        self._done([{"name": v.name, "passed": v.passed, "says": v.says} for v in verdicts], numbers)

    def _done(self, verdicts: list[dict[str, Any]], numbers: dict[str, float]) -> None:
        self._window = None
        self.outcome = {"state": DONE, "verdicts": verdicts, "numbers": numbers}
