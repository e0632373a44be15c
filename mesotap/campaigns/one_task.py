"""One task: its command in an empty folder, within limits, and its result as a file that is complete or absent."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import json
import os
import platform
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from daq.durable import write_whole
from mesotap import __version__
from mesotap.campaigns.task import Task, content_sha256, program_sha256

INPUTS, TASKS, RESULTS, FAILURES = "inputs", "tasks", "results", "failures"
PACKAGE_ROOT = Path(__file__).resolve().parents[2]
LONGEST_LOG = 4000  # characters kept of what a command said before it failed
PR_SET_PDEATHSIG = 1  # prctl(2)
_LIBC = ctypes.CDLL(None)
_RUNNING: set[subprocess.Popen[str]] = set()
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


@dataclass(frozen=True, slots=True)
class Limits:
    """What a task may take: time of the clock in seconds, and bytes of addresses of each of its processes."""

    time_s: float = 900.0
    memory_bytes: int = 6_000_000_000


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a task ended: ``failure`` is empty where its result is there."""

    failure: str = ""
    seconds: float = 0.0


def result_file(folder: Path, digest: str) -> Path:
    """Return where the result of a task stands, once it is complete."""
    return folder / RESULTS / f"{digest}.json"


def run_task(folder: Path, digest: str, limits: Limits) -> Outcome:
    """Carry out a task of the campaign in ``folder``, unless its result is there.

    Its command is given nothing but its inputs, one thread of BLAS and OpenMP, and the limits. What it answers, and how
    it came about, is written whole.
    """
    if result_file(folder, digest).exists():
        return Outcome()
    task = Task.of(json.loads((folder / TASKS / f"{digest}.json").read_text(encoding="utf-8")))
    if task.digest(program_sha256()) != digest:
        return Outcome("the program here is another version than the one that planned this task")
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="mesotap-task-") as made:
        place = Path(made)
        if fault := _laid_out(folder, task, place):
            return Outcome(fault)
        status, said = _carried_out(task, place, limits)
        seconds = time.monotonic() - began
        if status is None:
            return Outcome(f"not done within {limits.time_s:.0f} s: {said}".rstrip(": "), seconds)
        if status:
            ended = f"killed by {signal.Signals(-status).name}" if status < 0 else f"exit code {status}"
            return Outcome(f"{ended}: {said}".rstrip(": "), seconds)
        try:
            answers = {name: json.loads((place / name).read_bytes()) for name in task.answers}
        except (OSError, ValueError) as error:
            return Outcome(f"no answer: {error}", seconds)
    result = {"task": asdict(task), "answers": answers, "provenance": _provenance(seconds)}
    write_whole(result_file(folder, digest), (json.dumps(result, indent=1, allow_nan=False) + "\n").encode())
    return Outcome(seconds=seconds)


@dataclass(frozen=True, slots=True)
class Run:
    """Carries out the task of a digest of a campaign, wherever it is called; it may be called twice."""

    folder: Path
    limits: Limits

    def __call__(self, digest: str) -> Outcome:
        """Return how the task ended."""
        return run_task(self.folder, digest, self.limits)


def _laid_out(folder: Path, task: Task, place: Path) -> str:
    """Copy the inputs of a task; return what is wrong with one."""
    for name, digest in task.inputs.items():
        kept = folder / INPUTS / digest
        try:
            shutil.copyfile(kept, place / name)
        except OSError as error:
            return f"{kept}: {error.strerror}"
        if content_sha256(place / name) != digest:
            return f"{kept}: is damaged: its content is not that of its name"
    return ""


def _carried_out(task: Task, place: Path, limits: Limits) -> tuple[int | None, str]:
    """Run the command; return its exit status, None where its time was over, and the end of what it said."""

    path = os.pathsep.join(filter(None, [str(PACKAGE_ROOT), os.environ.get("PYTHONPATH", "")]))
    child = subprocess.Popen(
        [sys.executable, "-m", "mesotap", *task.arguments],
        cwd=place,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": path, "PYTHONHASHSEED": "0"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        preexec_fn=functools.partial(_end_with, os.getpid()),
    )
    _RUNNING.add(child)
    try:
        resource.prlimit(child.pid, resource.RLIMIT_AS, (limits.memory_bytes, limits.memory_bytes))
        resource.prlimit(child.pid, resource.RLIMIT_CORE, (0, 0))
        _, said = child.communicate(timeout=limits.time_s)
        return child.returncode, said.strip()[-LONGEST_LOG:]
    except subprocess.TimeoutExpired:
        return None, ""
    finally:
        _end_all_of(child)
        _RUNNING.discard(child)


def _end_with(parent: int) -> None:
    """Have the kernel end this command with the process that began it, of which nobody else would hear."""
    _LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def end_running() -> None:
    """End the commands that this process has begun and not awaited; their tasks come out as failed."""
    for child in list(_RUNNING):
        _kill(child)


def _kill(child: subprocess.Popen[str]) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)


def _end_all_of(child: subprocess.Popen[str]) -> None:
    """End a command with all that it started."""
    _kill(child)
    child.wait()
    if child.stderr is not None:
        child.stderr.close()


def _provenance(seconds: float) -> dict[str, Any]:
    """Return what a result came about with; nothing of it is part of the answer."""
    import numpy
    import scipy

    versions = {"python": platform.python_version(), "numpy": numpy.__version__, "scipy": scipy.__version__}
    return {
        "mesotap": __version__,
        "program_sha256": program_sha256(),
        **versions,
        "machine": platform.node(),
        "processor": platform.machine(),
        "seconds": round(seconds, 3),
    }
