"""What a task is sent to another machine with, and what it comes back with."""

from __future__ import annotations

import functools
import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from daq.durable import write_whole
from mesotap.campaigns.campaign import PLAN
from mesotap.campaigns.one_task import INPUTS, RESULTS, TASKS, Limits, Outcome, result_file, run_task
from mesotap.campaigns.task import content_sha256, program_sha256


@dataclass(frozen=True, slots=True)
class Order:
    """One task of a campaign, as a worker gets it.

    Attributes
    ----------
    digest
        The task.
    folder
        Where the campaign lies on the machine that carries it out.
    plan_sha256
        Hash of its plan, by which a worker knows whether it sees that folder.
    program_sha256
        Source of the program that planned it.
    limits
        What the task may take.
    content
        The task's file and its inputs, each by its path in the folder; None while workers seem to see the folder.
    """

    digest: str
    folder: Path
    plan_sha256: str
    program_sha256: str
    limits: Limits
    content: Mapping[str, bytes] | None = None


@dataclass(frozen=True, slots=True)
class Reply:
    """What a worker answers.

    Attributes
    ----------
    outcome
        How the task ended; None where it was not begun.
    result
        The result's file, whole, so that it reaches a folder which the worker does not see.
    refused
        Why it was not begun: ``folder`` where the worker sees none and was sent no content, ``program`` where it
        has another version.
    """

    outcome: Outcome | None = None
    result: bytes | None = None
    refused: str = ""


def order(digest: str, folder: Path, limits: Limits, with_content: bool) -> Order:
    """Return a task as it is sent, with all that it needs where workers do not see the campaign's folder."""
    content: dict[str, bytes] | None = None
    if with_content:
        task = f"{TASKS}/{digest}.json"
        content = {task: (folder / task).read_bytes()}
        inputs = json.loads(content[task])["inputs"].values()
        content |= {name: (folder / name).read_bytes() for name in (f"{INPUTS}/{sha256}" for sha256 in inputs)}
    return Order(digest, folder.absolute(), _plan_sha256(folder), program_sha256(), limits, content)


def carry_out(order: Order) -> Reply:
    """Carry out a task on a worker: in the campaign's folder if it is seen here, in a folder of its own otherwise."""
    if program_sha256() != order.program_sha256:
        return Reply(refused="program")
    if _sees(order):
        return _replied(order.folder, order)
    if order.content is None:
        return Reply(refused="folder")
    with tempfile.TemporaryDirectory(prefix="mesotap-order-") as made:
        folder = Path(made)
        for part in (INPUTS, TASKS, RESULTS):
            (folder / part).mkdir()
        for name, content in order.content.items():
            (folder / name).write_bytes(content)
        return _replied(folder, order)


def keep(folder: Path, digest: str, reply: Reply) -> None:
    """Write the result that came with a reply, unless it is there."""
    if reply.result is not None and not result_file(folder, digest).exists():
        write_whole(result_file(folder, digest), reply.result)


def _plan_sha256(folder: Path) -> str:
    """Return the hash of a campaign's plan, which with a million tasks is too long to be read for each."""
    found = (folder / PLAN).stat()
    return _hashed(folder / PLAN, found.st_mtime_ns, found.st_size)


@functools.lru_cache(maxsize=16)
def _hashed(path: Path, modified_ns: int, size: int) -> str:
    return content_sha256(path)


def _sees(order: Order) -> bool:
    try:
        return _plan_sha256(order.folder) == order.plan_sha256
    except OSError:
        return False


def _replied(folder: Path, order: Order) -> Reply:
    outcome = run_task(folder, order.digest, order.limits)
    result = result_file(folder, order.digest)
    return Reply(outcome, result.read_bytes() if result.exists() else None)
