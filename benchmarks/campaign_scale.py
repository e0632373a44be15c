"""How far a campaign's own scheduler carries: its code as it is, with workers and tasks that are simulated.

`Campaign` and `Cluster` run as in `--cluster`: tasks are planned, handed over, polled, kept and written to files.
Only dask's client is replaced by one whose workers answer after a known length of time. The clock goes on while the
scheduler computes and writes, and jumps where it would wait, so that what it takes for a task counts and the wait for
tasks does not. What dask itself takes for a task, and the network, is not in it.

usage: campaign_scale.py [--workers N ...] [--tasks N] [--seconds S] [--folder DIR]
"""

from __future__ import annotations

import argparse
import heapq
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mesotap.campaigns import cluster
from mesotap.campaigns.campaign import Campaign
from mesotap.campaigns.one_task import Limits, Outcome
from mesotap.campaigns.parcel import Order, Reply
from mesotap.campaigns.task import Task

RESULT = b'{"task": {}, "answers": {"answer.json": {"verdict": "consistent"}}, "provenance": {"seconds": 2.0}}\n' * 20


class Clock:
    """Time as it passes, and what was skipped of it."""

    def __init__(self) -> None:
        self._skipped = 0.0
        self.due: list[float] = []

    def now(self) -> float:
        """Return seconds."""
        return time.perf_counter() + self._skipped

    def wait(self, longest_s: float) -> None:
        """Skip to when the next task is done, so far at most."""
        now = self.now()
        while self.due and self.due[0] <= now:
            heapq.heappop(self.due)
        self._skipped += min(self.due[0] - now, longest_s) if self.due else longest_s

    def set(self) -> None:
        """Whoever waits is woken by the next task in any case."""

    def clear(self) -> None:
        """As `set`."""


class Future:
    """A task that is done when its time has come."""

    def __init__(self, clock: Clock, seconds: float) -> None:
        self._clock, self._until = clock, clock.now() + seconds
        self._reply = Reply(Outcome("", seconds), RESULT)
        heapq.heappush(clock.due, self._until)

    @property
    def status(self) -> str:
        """As dask calls it."""
        return "finished" if self._clock.now() >= self._until else "pending"

    def result(self, timeout: float) -> Reply:
        """Return what a worker would answer."""
        return self._reply

    def add_done_callback(self, called: Callable[[Any], None]) -> None:
        """Nobody waits for it."""


class Client:
    """Workers that take a known time."""

    status = "running"

    def __init__(self, clock: Clock, workers: int, seconds: float, program: str) -> None:
        self._clock, self._seconds, self._program = clock, seconds, program
        self._threads = {f"tcp://10.0.{i // 256}.{i % 256}:1": 1 for i in range(workers)}

    def nthreads(self, callback_timeout: float) -> dict[str, int]:
        """Return the workers."""
        return self._threads

    def run(self, function: Callable[[], str], workers: Sequence[str], **how: Any) -> dict[str, str]:
        """Return what each worker says that its program is."""
        return dict.fromkeys(workers, self._program)

    def submit(self, function: Callable[[Order], Reply], sent: Order, **how: Any) -> Future:
        """Hand a task over."""
        return Future(self._clock, self._seconds)

    def cancel(self, futures: Sequence[Future], force: bool) -> None:
        """Nothing goes on."""

    def close(self, timeout: float) -> None:
        """Nothing is open."""


class Scale(cluster.Cluster):
    """`Cluster` with such workers."""

    def __init__(self, clock: Clock, workers: int, seconds: float) -> None:
        super().__init__(SimpleNamespace(name="simulated", address="", patience_s=600.0, advice="", look_after=int))
        self._woken = clock  # type: ignore[assignment]
        self._simulated = Client(clock, workers, seconds, self.program)

    def _connect(self) -> None:
        self._client = self._simulated  # type: ignore[assignment]


def measured(workers: int, tasks: int, seconds: float, folder: Path) -> str:
    """Carry a campaign out and return a row of the table."""
    clock = Clock()
    cluster.time = SimpleNamespace(monotonic=clock.now)  # type: ignore[assignment]
    began = time.perf_counter()
    named = {f"{i:07d}": Task(("diagnose", f"{i}.h5")) for i in range(tasks)}
    campaign = Campaign.plan(folder, "scale", named, {})
    planned = time.perf_counter() - began
    ends: list[float] = []
    first, began = clock.now(), time.perf_counter()
    done = campaign.carry_out(
        Scale(clock, workers, seconds), Limits(), lambda ended, of: ends.append(clock.now()) if ended == of else None
    )
    spent, took = time.perf_counter() - began, ends[-1] - first
    if done["done"] != tasks:
        raise SystemExit(f"{tasks - done['done']} tasks are not done")
    least = -(-tasks // workers) * seconds
    cells = (
        f"{workers}", f"{tasks}", f"{1e3 * planned / tasks:.2f}", f"{1e3 * spent / tasks:.2f}", f"{least:.0f}",
        f"{took:.0f}", f"{100 * least / took:.1f} %", f"{tasks / took:.1f}",
    )  # fmt: skip
    return _row(cells)


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 10, 100, 300, 1000])
    parser.add_argument("--tasks", type=int, help="by default 20 for each worker, 1000 at least")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    print(f"tasks of {asked.seconds:g} s")
    columns = ("workers", "tasks", "plan one, ms", "carry one out, ms", "least, s", "took, s", "of it", "tasks/s")
    print(_row(columns))
    print(_row(["---"] * len(columns)))
    for workers in asked.workers:
        with tempfile.TemporaryDirectory(dir=asked.folder) as made:
            tasks = asked.tasks or max(20 * workers, 1000)
            print(measured(workers, tasks, asked.seconds, Path(made) / "campaign"), flush=True)


if __name__ == "__main__":
    main()
