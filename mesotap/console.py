"""The operator's terminal: what goes on, what to do, and the keys that pause and end a session."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from daq.records import Shot
from mesotap.session.states import State
from mesotap.terminal import escape
from rig import Operator, RigError, SessionAborted

POLL_S = 0.1
PAUSE_KEY, ABORT_KEY = "p", "q"


class SessionDisplay:
    """Shows a session as it runs: a line for the state, a bar for the impacts of the whole plan.

    Parameters
    ----------
    impacts
        Accepted impacts that the whole plan asks for.
    done
        How many there are already.
    console
        Where to.
    """

    def __init__(self, impacts: int, done: int, console: Console) -> None:
        self._console = console
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("good taps"),
            TimeElapsedColumn(),
            console=console,
            transient=True,
        )
        self._task = self._progress.add_task("starting", total=impacts, completed=done)
        self._state: State | None = None

    def progress(self, state: State, text: str) -> None:
        """Show where the session is."""
        if state is not self._state:
            self._state = state
            if not self._console.is_terminal:
                self._console.print(f"{state.value} ...", highlight=False)
        self._progress.update(self._task, description=f"{state.value}: {escape(text)}")

    def shot(self, shot: Shot, accepted: int, wanted: int) -> None:
        """Show the verdict on one tap."""
        where = f"load {shot.target_load_mn:.0f} mN"
        if shot.accepted:
            self._progress.advance(self._task)
            self._progress.update(self._task, description=f"{where}: tap {accepted} of {wanted}")
        else:
            self._console.print(f"{where}: tap {shot.number} not used: {escape(shot.reject_reason)}", highlight=False)

    def __enter__(self) -> SessionDisplay:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()


class TerminalOperator(Operator):
    """The person at the terminal.

    Parameters
    ----------
    console
        Where things are said.
    """

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, text: str) -> None:
        """Show one sentence."""
        self._console.print(escape(text), highlight=False)

    def wait_ready(self, text: str) -> None:
        """Show what to do and wait for Enter."""
        self._require_terminal(text)
        self._console.print(f"[bold]{escape(text)}[/bold] Press Enter when done.", highlight=False)
        sys.stdin.readline()

    def turn(self, text: str, step_um: float, live: Callable[[], tuple[str, bool]]) -> None:
        """Show what to turn and the live load until Enter; ring while it is time to stop."""
        self._require_terminal(text)
        self._console.print(f"[bold]{escape(text)}[/bold] Press Enter when done.", highlight=False)
        while True:
            shown, stop = live()
            bell = "\a STOP" if stop else ""
            self._console.print(f"\r{escape(shown)}{bell}   ", end="", highlight=False)
            if select.select([sys.stdin], [], [], POLL_S)[0]:
                sys.stdin.readline()
                return

    def _require_terminal(self, text: str) -> None:
        if not sys.stdin.isatty():
            raise RigError(f"operator: nobody at a terminal to answer '{text}'")


class KeyControl:
    """Keys that interrupt a session: p pauses and goes on, q ends it safely; so do Ctrl-C and SIGTERM.

    Use as a context manager; keys are only read where standard input is a terminal.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._ended = ""

    def check(self, hold: Callable[[], None]) -> None:
        """Return at once, or stay while paused, or raise `SessionAborted`."""
        if self._ended:
            raise SessionAborted(f"session ended by {self._ended}")
        key = self._key()
        if key == ABORT_KEY:
            raise SessionAborted("session ended by the operator")
        if key == PAUSE_KEY:
            self._pause(hold)

    def _pause(self, hold: Callable[[], None]) -> None:
        self._console.print("Paused, the load is watched. Press p to go on, q to end.", highlight=False)
        while True:
            hold()
            time.sleep(POLL_S)
            key = self._key()
            if key == PAUSE_KEY:
                self._console.print("Going on.")
                return
            if key == ABORT_KEY or self._ended:
                raise SessionAborted("session ended while paused")

    def _key(self) -> str:
        if not sys.stdin.isatty() or not select.select([sys.stdin], [], [], 0)[0]:
            return ""
        # past Python's own buffer, which select does not see
        return os.read(sys.stdin.fileno(), 1).decode(errors="ignore").lower()

    @contextmanager
    def listening(self) -> Iterator[KeyControl]:
        """Take keys one by one and turn signals into an orderly end; all as before afterwards."""
        before = {number: signal.signal(number, self._signalled) for number in (signal.SIGINT, signal.SIGTERM)}
        attributes: list[Any] | None = None
        if sys.stdin.isatty():
            attributes = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        try:
            yield self
        finally:
            if attributes is not None:
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, attributes)
            for number, handler in before.items():
                signal.signal(number, handler)

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        """Interrupt what goes on once; what then brings the rig into its safe state is not interrupted again."""
        if self._ended:
            return
        self._ended = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        raise SessionAborted(f"session ended by {self._ended}")
