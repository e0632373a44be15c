"""Who works at the rig and who watches: the same for the terminal and for the pages of the console."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from enum import Enum

from rich.console import Console

from daq.journal import SessionFolder
from mesotap.configuration.config import Config
from mesotap.operator.console import KeyControl, SessionLines, TerminalOperator
from mesotap.session.hand_verdicts import HandVerdict
from mesotap.session.runner import Observer
from mesotap.session.watching import GaugeWatch
from rig import Operator


class Filing(Enum):
    """What is done with a session whose surfaces are apart for good."""

    FILE = "writing the session file"
    REPORT = "working out the report"
    DIAGNOSIS = "working out the diagnosis"


def _unseen(step: Filing, text: str) -> None:
    """Show nothing: a terminal has a progress line of its own for each."""


@dataclass(frozen=True, slots=True)
class People:
    """Who works at the rig and who watches.

    Attributes
    ----------
    operator
        Who is told things and asked to do things.
    control
        Who may pause and end the session.
    watching
        Called with the session's folder and its configuration as it begins or goes on; who watches it then.
    console
        Where tables and sentences go that no page has a place for.
    gauge
        Who is shown what the gauge reads.
    verdicts
        Takes what was decided by hand on taps since it was called last.
    filing
        Is told how far the session's file, report and diagnosis are.
    """

    operator: Operator
    control: KeyControl
    watching: Callable[[SessionFolder, Config], AbstractContextManager[Observer]]
    console: Console
    gauge: GaugeWatch = field(default_factory=GaugeWatch)
    verdicts: Callable[[], Sequence[HandVerdict]] = tuple
    filing: Callable[[Filing, str], None] = _unseen


def at_terminal(console: Console) -> People:
    """Return the person at the terminal, who works, watches and controls; lines alone where nobody sees a screen."""
    operator = TerminalOperator(console)
    control = KeyControl(console, operator.keyboard)
    if not console.is_terminal:
        return People(operator, control, lambda folder, config: nullcontext(SessionLines(console)), console)
    from mesotap.operator.session_screen import SessionScreen  # with what it needs to talk to the analysis

    screen = SessionScreen(console, operator.keyboard.there)
    return People(operator, control, screen.watching, console, screen)
