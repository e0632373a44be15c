"""One hostile input: how it is made, the command that gets it, and what has to come of it."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LARGEST_MEMORY = 2_000_000_000
"""Bytes of addresses that any process of the command may have."""

LONGEST_S = 20.0
"""Time of the processor, all processes of the command together."""

KILLED_S = 120.0
"""Time of the clock after which a command is killed: a machine that is busy runs it at a fifth of its speed."""

REFUSED = 2

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


def run(
    arguments: Sequence[str | Path],
    folder: Path,
    longest_s: float = KILLED_S,
    alone: AbstractContextManager[Any] | None = None,
) -> Outcome:
    """Run ``mesotap`` within limits. A command that has not ended in time is killed, and its status is -9."""
    limit = f'ulimit -v {LARGEST_MEMORY // 1000}; exec "$@"'
    began = time.monotonic()
    out, err = folder.parent / f"{folder.name}.out", folder.parent / f"{folder.name}.err"
    with out.open("wb") as to_out, err.open("wb") as to_err:
        command = ["/bin/sh", "-c", limit, "sh", sys.executable, "-m", "mesotap", *map(os.fspath, arguments)]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parents[2])}
        # a process begins with the memory of the one that starts it, and its largest counts
        with alone or nullcontext():
            child = subprocess.Popen(
                command, cwd=folder, stdin=subprocess.DEVNULL, stdout=to_out, stderr=to_err, env=environment
            )
        ended, status, usage = 0, 0, resource.getrusage(resource.RUSAGE_SELF)
        while not ended:
            ended, status, usage = os.wait4(child.pid, os.WNOHANG)
            if not ended:
                if time.monotonic() - began > longest_s:
                    child.kill()
                time.sleep(0.01)
        child.returncode = os.waitstatus_to_exitcode(status)
    return Outcome(
        child.returncode,
        out.read_bytes(),
        err.read_bytes(),
        time.monotonic() - began,
        usage.ru_utime + usage.ru_stime,
        1024 * usage.ru_maxrss,
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
