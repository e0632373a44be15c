"""What the commands that answer something have in common."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn

from analysis.results import SessionResults
from daq.records import Session
from mesotap.answers.analysing import analysed_as_configured
from mesotap.answers.frequency_response import show_cross_checks
from mesotap.answers.rounding import with_uncertainty
from mesotap.configuration.config import Config
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

QUIET_S = 5.0
"""After which a log is told the step again: a report takes about as long."""


def analysed(
    session: Session, config: Config, console: Console, on_progress: Callable[[str], None] = lambda text: None
) -> SessionResults:
    """Analyse a session under a progress line."""
    with Progress(SpinnerColumn(), TextColumn("{task.description}"), console=console, transient=True) as shown:
        task = shown.add_task("finding the modes of every impact")

        def show(done: int, total: int) -> None:
            text = f"analysed {done} of {total} loads"
            shown.update(task, description=text)
            on_progress(text)

        return analysed_as_configured(session, config, show)


@contextmanager
def telling(
    console: Console, what: str, clock: Callable[[], float] = time.monotonic, at_once: bool = False
) -> Iterator[Callable[[str], None]]:
    """Say what is done; yield what is told each step.

    A terminal shows the latest step in one line. Elsewhere, as in a log, a step after each `QUIET_S` is a line, and,
    with ``at_once``, the beginning.
    """
    if console.is_terminal:
        with console.status(f"{what} ...") as status:
            yield lambda step: status.update(f"{what}: {step} ...")
        return
    if at_once:
        console.print(f"{what} ...", highlight=False)
    told = clock()

    def tell(step: str) -> None:
        nonlocal told
        if clock() - told >= QUIET_S:
            told = clock()
            console.print(f"{what}: {step} ...", highlight=False)

    yield tell


def writing_report(
    console: Console, clock: Callable[[], float] = time.monotonic, what: str = "writing the report"
) -> AbstractContextManager[Callable[[str], None]]:
    """Say so while a report is drawn and written, see `telling`."""
    return telling(console, what, clock, at_once=True)


def show_session(results: SessionResults, console: Console) -> None:
    """Print the table of a session's loads, and what there is to say of them."""
    shown = Table(title=f"{escape(results.source)}: {results.method}, 95 % intervals")
    for heading in ("load, mN", "impacts", "f1, Hz", "f2, Hz", "zeta1, %", "zeta2, %", "k_c, MN/m", "c_c, N s/m"):
        shown.add_column(heading, justify="right")
    for load in results.loads:
        shown.add_row(
            with_uncertainty(load.load_mn),
            str(load.impacts_used),
            with_uncertainty(load.f1_hz),
            with_uncertainty(load.f2_hz),
            with_uncertainty(load.zeta1, 100),
            with_uncertainty(load.zeta2, 100),
            with_uncertainty(load.contact_stiffness_n_per_m, 1e-6),
            with_uncertainty(load.contact_damping_n_s_per_m),
        )
    console.print(shown)
    for note in (*results.remarks, *results.notes):
        console.print(f"- {escape(note)}", highlight=False)
    for load in results.loads:
        for note in load.notes:
            console.print(f"- load {load.target_load_mn:.0f} mN: {escape(note)}", highlight=False)
    show_cross_checks(results.hammer, console)
    if results.calibration is not None:
        console.print(escape(results.calibration.statement), highlight=False)
