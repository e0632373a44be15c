"""A campaign on several machines, by dask.distributed (decision 128).

What dask does not promise by itself is seen to here. It is handed no more tasks than it has threads, so that only the
task which a worker was at is lost with it. The scheduler may end and come back: what was handed over is handed over
again. A silence ends: a task without an answer has failed, and without a scheduler or a worker for long the campaign
stops and says so. A worker with another version of the program is sent away.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mesotap.campaigns.engine import Engine, Outcomes, Processes, Run
from mesotap.campaigns.errors import CampaignError
from mesotap.campaigns.parcel import Reply, carry_out, keep, order
from mesotap.campaigns.sites import Site, kind_of, site_of
from mesotap.campaigns.task import program_sha256

if TYPE_CHECKING:
    from distributed import Client, Future

LOOK_S = 1.0  # between looks at processes, connection and workers
CALL_S = 30.0  # that an answer of the scheduler may take
GRACE_S = 120.0  # beyond a task's own limit, in which a worker has to tell how it ended
AGAIN = Reply(refused="again")


@dataclass(slots=True)
class _Flight:
    """A task that was handed over, and when an answer is given up."""

    future: Future
    until: float


@contextlib.contextmanager
def engine_of(cluster: str | None, jobs: int, needed: bool = True) -> Iterator[Engine]:
    """Return what carries a campaign out: so many processes here, or what ``--cluster`` asks for; it is ended after.

    Where nothing is left to be carried out it is not ``needed``: no cluster is sought then, nor its extra.

    Raises
    ------
    CampaignError
        What is asked for is not to be understood, or its extra is not installed.
    """
    if cluster is not None and not needed:
        kind_of(cluster)
    if cluster is None or not needed:
        yield Processes(jobs)
        return
    with contextlib.closing(Cluster(site_of(cluster))) as engine:
        yield engine


class Cluster:
    """Runs tasks on the workers of a site; close it at the end."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._client: Client | None = None
        self._flying: dict[str, _Flight] = {}
        self._woken = threading.Event()
        self._workers: dict[str, int] = {}  # address of each that may work, to its threads
        self._refused: dict[str, str] = {}  # address of each that may not, and why
        self._content_sent = False
        self._looked = self._worked = -float("inf")
        self._handed = 0
        self.program = program_sha256()

    def run(self, digests: Sequence[str], run: Run) -> Outcomes:
        """Return outcomes as they come.

        Raises
        ------
        CampaignError
            There is no scheduler or no worker for long; what is done is kept.
        """
        waiting = deque(digests)
        self._worked = time.monotonic()
        try:
            while waiting or self._flying:
                waiting.extendleft(self._look_after(run))
                while waiting and self._client and len(self._flying) < sum(self._workers.values()):
                    self._hand_over(waiting.popleft(), run)
                for digest, reply in self._replies(run):
                    if isinstance(reply, Exception):
                        yield digest, reply
                    elif reply.outcome is None:
                        self._content_sent |= reply.refused == "folder"
                        waiting.append(digest)
                    else:
                        keep(run.folder, digest, reply)
                        yield digest, reply.outcome
                self._woken.wait(LOOK_S / 5)
                self._woken.clear()
        finally:
            self._drop()

    def close(self) -> None:
        """End the connection, and what was started for it."""
        self._disconnect()
        self._site.close()

    def _look_after(self, run: Run) -> list[str]:
        """See to processes, connection and workers; return the tasks that have to be handed over again."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return []
        self._looked = now
        self._site.look_after()
        if self._client is not None and self._client.status != "running":
            return self._lose_connection()
        try:
            if self._client is None:
                self._connect()
            self._admit()
        except (OSError, TimeoutError, CancelledError, RuntimeError) as error:
            self._give_up_in_time(f"no scheduler answers ({type(error).__name__})")
            return self._lose_connection()
        if self._workers:
            self._worked = now
        if len(self._flying) > sum(self._workers.values()):  # some wait for a worker: that is no silence of theirs
            for flight in self._flying.values():
                flight.until = now + run.limits.time_s + GRACE_S
        why = f"; {next(iter(self._refused.values()))}" if self._refused else ""
        self._give_up_in_time(f"no worker{why}")
        return []

    def _give_up_in_time(self, what: str) -> None:
        if time.monotonic() - self._worked > self._site.patience_s:
            raise CampaignError(
                f"--cluster {self._site.name}: {what} for {self._site.patience_s:.0f} s; {self._site.advice}; "
                "what is done is kept: 'mesotap campaign FOLDER --resume' goes on"
            )

    def _connect(self) -> None:
        from distributed import Client

        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is said here
        self._client = Client(self._site.address, timeout=5 * LOOK_S, set_as_default=False)

        def count_no_losses(dask_scheduler: Any) -> None:
            dask_scheduler.allowed_failures = 0  # a lost worker is told at once: the campaign counts

        self._client.run_on_scheduler(count_no_losses, callback_timeout=CALL_S)

    def _admit(self) -> None:
        """Look which workers are there; send away those with another program."""
        client = self._client
        if client is None:
            return
        there: dict[str, int] = client.nthreads(callback_timeout=CALL_S)
        if new := [address for address in there if address not in self._workers and address not in self._refused]:
            programs = client.run(program_sha256, workers=new, on_error="return", callback_timeout=CALL_S)
            for address in new:
                if isinstance(found := programs.get(address), OSError | None):
                    continue  # gone again; the next look tells
                if found != self.program:
                    said = f"it says: {found}" if isinstance(found, Exception) else "it has another version of mesotap"
                    self._refused[address] = f"the worker {address} was sent away: {said}"
            if away := [address for address in new if address in self._refused]:
                client.retire_workers(away, close_workers=True, callback_timeout=CALL_S)
        self._workers = {address: n for address, n in there.items() if address not in self._refused}

    def _hand_over(self, digest: str, run: Run) -> None:
        client = self._client
        if client is None:
            return
        sent = order(digest, run.folder, run.limits, self._content_sent)
        self._handed += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # dask would have large inputs scattered first
            future = client.submit(carry_out, sent, key=f"mesotap-{digest[:16]}-{self._handed}", pure=False)
        self._flying[digest] = _Flight(future, time.monotonic() + run.limits.time_s + GRACE_S)
        future.add_done_callback(lambda _: self._woken.set())

    def _replies(self, run: Run) -> Iterator[tuple[str, Reply | Exception]]:
        """Return what came of tasks that were handed over, each once."""
        for digest, flight in list(self._flying.items()):
            if flight.future.status == "pending":
                if time.monotonic() < flight.until:
                    continue
                reply: Reply | Exception = TimeoutError(f"no answer within {run.limits.time_s + GRACE_S:.0f} s")
                self._forget([flight.future])
            else:
                reply = self._reply(flight.future)
            self._flying.pop(digest, None)
            yield digest, reply

    def _reply(self, future: Future) -> Reply | Exception:
        try:
            if future.status == "finished":
                reply: Reply = future.result(timeout=CALL_S)
                return reply
            error = future.exception(timeout=CALL_S) if future.status == "error" else None
        except (OSError, TimeoutError, CancelledError):
            return AGAIN
        if error is None or isinstance(error, ImportError | AttributeError):  # a worker without this program
            return AGAIN
        if type(error).__name__ == "KilledWorker":
            return RuntimeError("the worker that carried it out ended")
        return error if isinstance(error, Exception) else RuntimeError(repr(error))

    def _forget(self, futures: list[Future]) -> None:
        if self._client is not None:
            with contextlib.suppress(Exception):
                self._client.cancel(futures, force=True)

    def _drop(self) -> None:
        """Have what is not answered forgotten."""
        self._forget([flight.future for flight in self._flying.values()])
        self._flying.clear()

    def _lose_connection(self) -> list[str]:
        """Give the connection up; return the tasks that nobody answers for."""
        lost = list(self._flying)
        self._flying.clear()
        self._disconnect()
        return lost

    def _disconnect(self) -> None:
        """Close the connection, which may take what time it likes."""
        client, self._client = self._client, None
        self._workers = {}
        if client is not None:
            closing = threading.Thread(target=_close, args=(client,), daemon=True)
            closing.start()
            closing.join(5 * LOOK_S)


def _close(client: Client) -> None:
    with contextlib.suppress(Exception):
        client.close(timeout=5 * LOOK_S)
