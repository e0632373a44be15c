"""The operator's terminal: what to do, and the keys that pause and end a session."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from rich.console import Console

from daq.records import Impact
from mesotap.operator.terminal import escape
from mesotap.session.states import State
from rig import Operator, RigError, SessionAborted
from rig.attention import Hold
from rig.interface import HEED_S

POLL_S = HEED_S
PAUSE_KEY, ABORT_KEY, ENTER = "p", "q", "\n"


class SessionLines:
    """Prints how a session goes on, a line a state and a rejected tap: for whoever reads it later.

    Parameters
    ----------
    console
        Where to.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._state: State | None = None

    def progress(self, state: State, text: str) -> None:
        """Print where the session is, when that changes."""
        if state is not self._state:
            self._state = state
            self._console.print(f"{state.value} ...", highlight=False)

    def impact(self, impact: Impact, accepted: int, wanted: int) -> None:
        """Print why a tap is not used."""
        if not impact.accepted:
            where = f"load {impact.target_load_mn:.0f} mN: tap {impact.number} not used"
            self._console.print(f"{where}: {escape(impact.reject_reason)}", highlight=False)


class Keyboard:
    """Keys pressed at the terminal: read without waiting longer than asked, kept for whoever asks for them.

    Without a terminal, or once it has hung up, there are none.
    """

    def __init__(self) -> None:
        self._pressed: list[str] = []
        self._gone = False

    @property
    def there(self) -> bool:
        """Whether there is a terminal with somebody who can press keys."""
        return not self._gone and sys.stdin.isatty()

    def pressed(self, keys: str, wait_s: float = 0.0) -> str:
        """Return the first of ``keys`` that was pressed and not yet asked for, waiting at most so long; or nothing."""
        self._read(wait_s if not any(key in keys for key in self._pressed) else 0.0)
        for i, key in enumerate(self._pressed):
            if key in keys:
                return self._pressed.pop(i)
        return ""

    def _read(self, wait_s: float) -> None:
        if not self.there:
            if wait_s > 0.0:  # a sleep of nothing gives the processor away
                time.sleep(wait_s)
            return
        try:
            while select.select([sys.stdin], [], [], wait_s)[0]:
                # past Python's own buffer, which select does not see
                data = os.read(sys.stdin.fileno(), 64)
                self._gone = not data
                self._pressed += data.decode(errors="ignore").lower().replace("\r", ENTER)
                wait_s = 0.0
                if self._gone:
                    return
        except OSError:  # the terminal was closed
            self._gone = True

    def forget(self) -> None:
        """Forget what was pressed before."""
        self._read(0.0)
        self._pressed.clear()


class TerminalOperator(Operator):
    """The person at the terminal.

    Parameters
    ----------
    console
        Where things are said.
    keyboard
        Shared with whoever else listens to it.
    """

    def __init__(self, console: Console, keyboard: Keyboard | None = None) -> None:
        self._console = console
        self.keyboard = self._keyboard = keyboard or Keyboard()

    def say(self, text: str) -> None:
        """Show one sentence."""
        self._console.print(escape(text), highlight=False)

    def wait_ready(self, text: str) -> None:
        """Show what to do and wait for Enter."""
        self._ask(text)
        while not self._keyboard.pressed(ENTER, POLL_S):
            self.idle()
            self._require_terminal(text)

    def turn(self, text: str, step_um: float, live: Callable[[], tuple[str, bool]]) -> None:
        """Show what to turn and the live load until Enter; ring while it is time to stop."""
        self._ask(text)
        while True:
            shown, stop = live()
            bell = "\a STOP" if stop else ""
            self._console.print(f"\r{escape(shown)}{bell}   ", end="", highlight=False)
            if self._keyboard.pressed(ENTER, POLL_S):
                return
            self.idle()
            self._require_terminal(text)

    def _ask(self, text: str) -> None:
        self._require_terminal(text)
        self._keyboard.forget()
        self._console.print(f"[bold]{escape(text)}[/bold] Press Enter when done.", highlight=False)

    def _require_terminal(self, text: str) -> None:
        if not self._keyboard.there:
            raise RigError(f"operator: nobody at a terminal to answer '{text}'")


def _endings() -> tuple[signal.Signals, ...]:
    """Signals that end a program which does nothing about them, and can be heeded."""
    return tuple(sorted(getattr(signal, name) for name in ENDING_SIGNALS if hasattr(signal, name)))


ENDING_SIGNALS = (
    *("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGXCPU", "SIGALRM", "SIGVTALRM"),
    *("SIGPROF", "SIGPWR", "SIGIO", "SIGSTKFLT"),
)
SUSPENDING_SIGNALS = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
"""Ctrl-Z, or a terminal that is somebody else's: a program that stands still watches no load, so they do nothing."""


def apart() -> bool:
    """Hold where there is nothing to attend to."""
    return False


class KeyControl:
    """Keys that interrupt a session: p pauses and goes on, q ends it safely; so does every signal that would end it.

    A signal is noted at once, and heeded where the session looks, a few times a second: nothing is ever left half
    done, and what brings the rig into its safe state is never interrupted. Use as a context manager; keys are only
    read where standard input is a terminal.

    Attributes
    ----------
    ends
        What it ends, in a word or two.
    """

    ends = "session"

    def __init__(self, console: Console, keyboard: Keyboard | None = None) -> None:
        self._console = console
        self._keyboard = keyboard or Keyboard()
        self._ended = ""
        self._told = False

    def check(self, hold: Hold | None = apart) -> None:
        """Return at once, or stay while paused, or raise `SessionAborted`, once: who leaves is not interrupted.

        Without ``hold`` nobody may stay here: a wish to pause is kept until somebody may.
        """
        if self._told:
            return
        key = self._keyboard.pressed(ABORT_KEY if hold is None else PAUSE_KEY + ABORT_KEY)
        self._heed(key)
        if key == PAUSE_KEY and hold is not None:
            self._pause(hold)

    def _heed(self, key: str) -> None:
        if self._ended or key == ABORT_KEY:
            self._told = True
            raise SessionAborted(f"{self.ends} ended by {self._ended or 'the operator'}")

    def _pause(self, hold: Hold) -> None:
        what = "the load is watched" if hold() else "the surfaces are apart"
        self._console.print(f"Paused, {what}. Press p to go on, q to end.", highlight=False)
        while True:
            hold()
            key = self._keyboard.pressed(PAUSE_KEY + ABORT_KEY, POLL_S)
            self._heed(key)
            if key == PAUSE_KEY:
                self._console.print("Going on.")
                return

    @contextmanager
    def listening(self) -> Iterator[KeyControl]:
        """Take keys one by one and turn signals into an orderly end; all as before afterwards."""
        before: dict[int, Any] = {number: signal.signal(number, self._signalled) for number in _endings()}
        before |= {number: signal.signal(number, signal.SIG_IGN) for number in SUSPENDING_SIGNALS}
        attributes: list[Any] | None = None
        if sys.stdin.isatty():
            attributes = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        try:
            yield self
        finally:
            if attributes is not None:
                with suppress(termios.error):  # the terminal was closed
                    termios.tcsetattr(sys.stdin, termios.TCSANOW, attributes)  # a halted terminal is never drained
            for number, handler in before.items():
                signal.signal(number, handler)

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        """Note who ended the session first."""
        if not self._ended:
            self._ended = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
