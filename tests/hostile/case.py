"""One hostile input: how it is made, the command that gets it, and what has to come of it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

LARGEST_MEMORY = 2_000_000_000
"""Bytes of addresses that any process of the command may have."""

LONGEST_S = 20.0
"""Time of the processor, all processes of the command together."""

KILLED_S = 120.0
"""Time of the clock after which a command is killed: a machine that is busy runs it at a fifth of its speed."""

REFUSED = 2

WITHIN_LIMITS = Path(__file__).with_name("within_limits.py")

Make = Callable[[Path], Sequence[str | Path]]
"""Writes the input into an empty folder, in which the command then runs; returns the command."""


@dataclass(frozen=True)
class Case:
    """What is given to the command line.

    Attributes
    ----------
    says
        What its refusal has to say.
    shows
        What has to be shown where it is read; None where it has to be refused.
    either
        Read or refused: both are right.
    lines
        Whether the refusal may have several lines, one a fault.
    """

    kind: str
    name: str
    make: Make
    says: str = ""
    shows: str | None = None
    either: bool = False
    lines: bool = False
    quick: bool = False


@dataclass(frozen=True)
class Outcome:
    """How the command ended."""

    status: int
    stdout: bytes
    stderr: bytes
    seconds: float
    processor_s: float
    memory: int
    """Bytes that its largest process had at most."""


def run(arguments: Sequence[str | Path], folder: Path, longest_s: float = KILLED_S) -> Outcome:
    """Run ``mesotap`` within limits. A command that has not ended in time is killed, and its status is -9."""
    began = time.monotonic()
    out, err, report = (folder.parent / f"{folder.name}.{name}" for name in ("out", "err", "usage"))
    limits = [report, LARGEST_MEMORY, longest_s]
    with out.open("wb") as to_out, err.open("wb") as to_err:
        command = [sys.executable, "-I", "-S", WITHIN_LIMITS, *limits, sys.executable, "-m", "mesotap", *arguments]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parents[2])}
        subprocess.run(
            [*map(str, command)],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=to_out,
            stderr=to_err,
            env=environment,
            check=True,
        )
    status, processor_s, memory = report.read_text(encoding="ascii").split()
    return Outcome(
        int(status),
        out.read_bytes(),
        err.read_bytes(),
        time.monotonic() - began,
        float(processor_s),
        int(memory),
    )


def fault(case: Case, outcome: Outcome) -> str:
    """Return what is wrong with how a case ended; empty where all is right."""
    try:
        shown, said = outcome.stdout.decode(), outcome.stderr.decode()
    except UnicodeDecodeError:
        return "what it printed is not UTF-8"
    if outcome.processor_s > LONGEST_S:
        return f"it took {outcome.processor_s:.0f} s of the processor"
    if outcome.status not in (0, REFUSED):
        return f"it ended with {outcome.status}: {said[-600:]}"
    for text in (shown, said):
        bad = next((c for c in text if not c.isprintable() and c != "\n"), None)
        if bad is not None:
            return f"it printed the control character {bad!r}"
    if "Traceback" in said:
        return f"it ended in a traceback: {said[-600:]}"
    if outcome.status == 0:
        if case.shows is None and not case.either:
            return f"it was read: {shown[:300]}"
        return "" if case.shows is None or case.shows in shown else f"{case.shows!r} is not in {shown[:600]!r}"
    if case.shows is not None and not case.either:
        return f"it was refused: {said[:300]}"
    if not said.startswith("mesotap: ") or not said.endswith("\n"):
        return f"it is not one sentence: {said[:300]!r}"
    if said.count("\n") > 1 and not case.lines:
        return f"it is more than one sentence: {said[:600]!r}"
    return "" if case.says in said else f"{case.says!r} is not in {said[:600]!r}"
