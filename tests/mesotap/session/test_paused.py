"""Whenever the operator pauses under load, the load is watched, wherever the session was then."""

from __future__ import annotations

import contextlib
import io

import pytest
from rich.console import Console

from daq.journal import SessionFolder
from mesotap.operator.console import PAUSE_KEY, Keyboard, KeyControl
from mesotap.session.bench import emulated_rig
from mesotap.session.runner import Bench, SessionRunner
from mesotap.session.states import State
from mesotap.session.watching import GaugeWatch
from rig import SessionAborted
from tests.mesotap.benches import Silent, Watching, header_of, simulated_rig, small_config

PAUSE_S = 1.0
"""Of rig time."""

LOOKS = 7
"""In that time, at the least: the gauge is read ten times a second, on the drivers' wires somewhat less often."""

MOST_ASKED = 20_000
UNSTOPPABLE = (State.CONNECT, State.FILE, State.DONE)
"""States in which nobody can pause."""

UNDER_LOAD = (State.SET_LOAD, State.LOCK, State.TAP)


class Presses(Keyboard):
    """Presses p at the n-th time that anybody asks within a state, and again ``PAUSE_S`` of rig time later; ends then.

    What is asked for while p is pressed already is not given twice: who asks for other keys leaves it where it is.
    """

    def __init__(self, clock, state: State, nth: int) -> None:
        super().__init__()
        self.clock, self.wanted, self.left = clock, state, nth
        self.state = lambda: State.CONNECT
        self.paused_at = self.went_on_at = None
        self.asked = 0

    @property
    def there(self) -> bool:
        return True

    def pressed(self, keys: str, wait_s: float = 0.0) -> str:
        self.asked += self.paused_at is not None
        assert self.asked < MOST_ASKED, "the pause does not end, or nothing goes on after it"
        if self.state() is self.wanted and self.left > 0:
            self.left -= 1
        if self.left:
            return ""
        if self.paused_at is None:
            if PAUSE_KEY in keys:
                self.paused_at = self.clock.now()
                return PAUSE_KEY
        elif self.clock.now() >= self.paused_at + PAUSE_S and self.went_on_at is None and PAUSE_KEY in keys:
            self.went_on_at = self.clock.now()
            return PAUSE_KEY
        return ""


class Shown(GaugeWatch):
    """Counts the loads that are shown while the session is paused, and ends the session after the pause."""

    def __init__(self, keys: Presses) -> None:
        self.keys, self.loads = keys, 0

    def load(self, load_mn: float) -> None:
        if self.keys.went_on_at is not None:
            raise SessionAborted("seen enough")
        self.loads += self.keys.paused_at is not None


def paused(path, rig, state: State, nth: int) -> tuple[Presses, Shown, str]:
    config = small_config("mesotap.dwell_s=2")
    keys = Presses(rig.clock, state, nth)
    shown = Shown(keys)
    said = io.StringIO()
    control = KeyControl(Console(file=said, width=200), keys)
    with SessionFolder.create(path, header_of(config)) as folder:
        runner = SessionRunner(config, folder, Bench(rig, Silent(), Watching(), control, gauge=shown))
        keys.state = lambda: runner.progress.state
        with contextlib.suppress(SessionAborted):
            runner.run()
    return keys, shown, said.getvalue()


@pytest.mark.parametrize("nth", [1, 2, 5, 8, 13])
@pytest.mark.parametrize("state", UNDER_LOAD, ids=lambda s: s.name)
def test_the_load_is_watched_wherever_a_session_is_paused(tmp_path, state, nth):
    keys, shown, _ = paused(tmp_path / "s", simulated_rig(small_config()), state, nth)
    assert keys.went_on_at is not None
    assert shown.loads >= LOOKS


@pytest.mark.parametrize("state", [s for s in State if s not in UNSTOPPABLE], ids=lambda s: s.name)
def test_what_is_said_of_a_pause_is_true_in_every_state(tmp_path, state):
    keys, shown, said = paused(tmp_path / "s", simulated_rig(small_config()), state, 1)
    assert keys.went_on_at is not None
    assert shown.loads >= LOOKS or shown.loads == 0
    assert ("Paused, the load is watched." in said) == (shown.loads > 0)
    assert ("Paused, the surfaces are apart." in said) == (shown.loads == 0)


@pytest.mark.parametrize("nth", [2, 5])
@pytest.mark.parametrize("state", UNDER_LOAD, ids=lambda s: s.name)
def test_with_the_drivers(tmp_path, state, nth):
    keys, shown, _ = paused(tmp_path / "s", emulated_rig(small_config()), state, nth)
    assert keys.went_on_at is not None
    assert shown.loads >= LOOKS
