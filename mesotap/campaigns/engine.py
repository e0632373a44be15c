"""What runs the tasks of a campaign: processes of this machine here, a cluster elsewhere."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Protocol

from mesotap.campaigns.one_task import Outcome, Run, end_running

Outcomes = Generator[tuple[str, Outcome | Exception], None, None]


class Engine(Protocol):
    """Runs tasks in any order, on any machine that sees the campaign's folder."""

    def run(self, digests: Sequence[str], run: Run) -> Outcomes:
        """Return outcomes as they come; an exception stands for a task that was lost, with its worker for instance.

        When the generator is closed early, what was not begun is not begun.
        """


class Processes:
    """A process for each task, so many at a time."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def run(self, digests: Sequence[str], run: Run) -> Outcomes:
        """Return outcomes as they come."""
        pool = ThreadPoolExecutor(self._jobs)  # each waits for a process of its own
        running = {pool.submit(run, digest): digest for digest in digests}
        try:
            for future in as_completed(running):
                error = future.exception()
                if error is not None and not isinstance(error, Exception):
                    raise error
                yield running[future], future.result() if error is None else error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(future.done() for future in running):
                end_running()
                time.sleep(0.02)
