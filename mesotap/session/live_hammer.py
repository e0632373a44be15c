"""The instrumented hammer in the live view: each tap that its force channel shows, and the average of the last ones."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.frequency_response.estimators import HIGHEST_SHARE
from analysis.frequency_response.so_far import HammerSoFar, hammer_so_far
from daq.live_signals import HISTORY_S, LEVEL_S, LiveSignals, TapWindow
from daq.records import Impact
from mesotap.configuration.config import Config
from mesotap.session.progress import describe_rig
from rig.settings import Hammer

TAPS_AVERAGED = 20
"""Of the last ones, so that what is worked out after a tap stays small; a load of a session has eight."""

TRIGGER_SHARE = 0.001
"""Of what the channel can hold, from which a force is a tap: two steps of a 12-bit recorder."""

LONGEST_SHARE = 0.8
"""Of the samples kept, that a record may be long."""

HIGHEST_SHOWN_HZ = 5000.0
DIGITS = 5
ESTIMATORS = ("h1", "h2", "hv")


def response_told(found: HammerSoFar) -> dict[str, Any]:
    """Return what a page draws of taps with a hammer.

    Line i is at (i + 1) ``bin_hz``. ``force``: spectrum of the last tap's force, N/Hz; ``last``: size of the response
    to the last tap, m/s2/N, by which H1, H2 and Hv are one; ``mean``: of the average, ``mean["h1"]``, ``["h2"]`` and
    ``["hv"]``; ``coherence`` from the second tap on. The last three are None above ``excited_hz``, where the force is
    20 dB below its highest.
    """
    told: dict[str, Any] = {"kind": "response", "words": found.words, "taps": 0, "window": ""}
    averaged = found.averaged
    if averaged is None:
        return told
    frequency = averaged.frequency_hz
    rate = 2 * float(frequency[-1])
    shown = frequency <= min(HIGHEST_SHOWN_HZ, HIGHEST_SHARE * rate)
    dark = frequency > averaged.force_limit_hz

    def lines(values: NDArray[np.float64], where: NDArray[np.bool_] | bool) -> list[float | None]:
        hidden = np.where(where, math.nan, values)[shown]
        return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in hidden]

    told |= {
        "taps": round(averaged.averages),
        "window": averaged.window,
        "bin_hz": float(frequency[0]),
        "excited_hz": averaged.force_limit_hz,
        "mean": {name: lines(np.abs(getattr(averaged, name)[0]), dark) for name in ESTIMATORS},
        "coherence": lines(averaged.coherence[0], dark) if averaged.averages >= 2 else [],
        "force": [] if found.last_force is None else lines(found.last_force, False),
        "last": [] if found.last is None else lines(np.abs(found.last), dark),
    }
    return told


class LiveHammer:
    """Looks for taps in the force channel of a stream.

    Parameters
    ----------
    config
        The configuration in force.
    hammer
        That of its wiring.
    signals
        The stream.
    """

    def __init__(self, config: Config, hammer: Hammer, signals: LiveSignals) -> None:
        self._hammer, self._signals = hammer, signals
        self._rig = describe_rig(config.rig)
        self._level_n = TRIGGER_SHARE * hammer.reach_n()
        longest = round(LONGEST_SHARE * HISTORY_S * signals.rate)
        self._before = min(config.daq.trigger.pretrigger_samples, longest // 2)
        self._after = min(config.daq.trigger.record_samples, longest) - self._before
        self._taps: deque[Impact] = deque(maxlen=TAPS_AVERAGED)
        self._count = 0
        self._window = self._armed()

    def _armed(self) -> TapWindow:
        end = self._signals.stream.end
        return TapWindow(self._before, self._after, self._signals.rate, self._level_n, end, by_force=True)

    def follow(self) -> bool:
        """Look at the block that was read last; whether it completed a tap."""
        window, stream = self._window, self._signals.stream
        acceleration = window.feed(stream)
        if acceleration is None:
            return False
        force = stream.force(window.found, window.found + acceleration.shape[1])
        self._window = self._armed()
        nan = math.nan
        place = (self._count, 0, nan, nan, nan, "", self._signals.rate, window.before, acceleration)
        self._taps.append(Impact(*place, accepted=True, force=force))
        self._count += 1
        return True

    def reset(self) -> None:
        """Begin the average anew."""
        self._taps.clear()

    def drop(self) -> None:
        """Leave the last tap out."""
        if self._taps:
            self._taps.pop()

    def told(self) -> dict[str, Any]:
        """Return what a page draws of the taps so far."""
        return response_told(hammer_so_far(self._taps, self._rig, self._hammer))

    def level(self) -> dict[str, Any]:
        """Return peak over the last half second and what the channel holds, N, and whether it never changes."""
        stream = self._signals.stream
        force = stream.force(max(stream.begin, stream.end - round(LEVEL_S * self._signals.rate)), stream.end)
        if force is None or not force.size:
            return {"peak": None, "reach": self._hammer.reach_n(), "dead": True}
        peak = float(np.abs(force - np.median(force)).max())
        return {"peak": peak, "reach": self._hammer.reach_n(), "dead": not np.ptp(force) > 0}
