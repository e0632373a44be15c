"""A campaign: its folder, its tasks by name, and how they are all brought to a result or set aside.

===================  ==================================================================
`campaign.json`      title, program, and each task's name with its digest
`inputs/<sha256>`    what the tasks are given, each content once
`tasks/<digest>`     command, inputs and answers of a task
`results/<digest>`   answers and provenance: complete or absent
`failures/<digest>`  what went wrong, a line for each attempt
===================  ==================================================================
"""

from __future__ import annotations

import contextlib
import fcntl
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daq.durable import make_folder, write_error, write_whole
from mesotap.campaigns.engine import Engine
from mesotap.campaigns.errors import CampaignError
from mesotap.campaigns.one_task import FAILURES, INPUTS, RESULTS, TASKS, Limits, Outcome, Run, result_file
from mesotap.campaigns.task import Task, program_sha256

PLAN = "campaign.json"
FORMAT, VERSION = "mesotap-campaign", 1
ATTEMPTS = 3  # failures after which a task is set aside

OnProgress = Callable[[int, int], None]
"""Called with how many tasks have come to an end, and how many there are."""


def seed_of(root: int, index: int) -> int:
    """Return the seed of task ``index``: independent of all others', and of who runs it when.

    Examples
    --------
    >>> seed_of(1, 0) == seed_of(1, 0), seed_of(1, 0) == seed_of(1, 1)
    (True, False)
    """
    return int(np.random.SeedSequence(root, spawn_key=(index,)).generate_state(1)[0])


@dataclass(frozen=True, slots=True)
class Campaign:
    """The tasks of a folder.

    Attributes
    ----------
    folder
        Where it lies.
    title
        What it is about, one line.
    digests
        Name of each task to its digest, in order.
    """

    folder: Path
    title: str
    digests: Mapping[str, str]

    @classmethod
    def plan(cls, folder: Path, title: str, tasks: Mapping[str, Task], files: Mapping[str, Path | bytes]) -> Campaign:
        """Write down the tasks of a campaign with their inputs, or find those of the same campaign in the folder.

        Parameters
        ----------
        files
            SHA-256 of every input to the file, or the content, that has it.

        Raises
        ------
        CampaignError
            The folder holds another campaign, or something else.
        """
        if (folder / PLAN).exists():
            there = cls.open(folder)
            if there.title != title:
                raise CampaignError(f"{folder}: holds another campaign ({there.title}); name another folder")
        elif folder.exists() and any(folder.iterdir()):
            raise CampaignError(f"{folder}: is not empty and holds no campaign; name another folder")
        program = program_sha256()
        digests = {name: task.digest(program) for name, task in tasks.items()}
        try:
            for part in (INPUTS, TASKS, RESULTS, FAILURES):
                make_folder(folder / part)
        except OSError as error:
            raise write_error(folder, error) from error
        for digest, source in files.items():
            if not (folder / INPUTS / digest).exists():
                write_whole(folder / INPUTS / digest, source if isinstance(source, bytes) else source.read_bytes())
        for name, task in tasks.items():
            path = folder / TASKS / f"{digests[name]}.json"
            if not path.exists():
                write_whole(path, _json(asdict(task)))
        plan = {"format": FORMAT, "version": VERSION, "title": title, "program_sha256": program, "tasks": digests}
        write_whole(folder / PLAN, _json(plan))
        return cls(folder, title, digests)

    @classmethod
    def open(cls, folder: Path) -> Campaign:
        """Open the campaign of a folder.

        Raises
        ------
        CampaignError
            There is none.
        """
        path = folder / PLAN
        try:
            plan = json.loads(path.read_text(encoding="utf-8"))
            if plan["format"] != FORMAT or plan["version"] != VERSION:
                raise CampaignError(f"{path}: is not a campaign of version {VERSION}")
            return cls(folder, str(plan["title"]), {str(k): str(v) for k, v in plan["tasks"].items()})
        except OSError as error:
            raise CampaignError(f"{path}: {error.strerror}; 'mesotap sweep' begins a campaign") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise CampaignError(f"{path}: is not the plan of a campaign") from error

    def result(self, name: str) -> dict[str, Any] | None:
        """Return task, answers and provenance of a task that is done.

        Raises
        ------
        CampaignError
            The file is not as it was written.
        """
        path = result_file(self.folder, self.digests[name])
        if not path.exists():
            return None
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            return {key: found[key] for key in ("task", "answers", "provenance")}
        except (ValueError, KeyError, TypeError) as error:
            raise CampaignError(
                f"{path}: is damaged; remove it, and 'mesotap campaign {self.folder} --resume' makes it again"
            ) from error

    def failures(self, name: str) -> list[str]:
        """Return what went wrong at each attempt."""
        return self._failures(self.digests[name])

    def _failures(self, digest: str) -> list[str]:
        path = self.folder / FAILURES / f"{digest}.json"
        return list(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else []

    def state(self, name: str) -> str:
        """Return ``done``, ``set aside`` or ``owed``."""
        if result_file(self.folder, self.digests[name]).exists():
            return "done"
        return "set aside" if len(self.failures(name)) >= ATTEMPTS else "owed"

    def retry(self) -> None:
        """Forget the failures of what was set aside."""
        for name, digest in self.digests.items():
            if self.state(name) == "set aside":
                (self.folder / FAILURES / f"{digest}.json").unlink()

    def carry_out(self, engine: Engine, limits: Limits, on_progress: OnProgress) -> Counter[str]:
        """Bring every task to a result, or to three failures; return how many are ``done`` and ``set aside``.

        It always ends: a task that an engine loses, or says nothing of, has failed once more.

        Raises
        ------
        CampaignError
            Another process carries this campaign out.
        """
        with self._alone():
            attempts = {digest: len(self._failures(digest)) for digest in self._failed()}
            every = dict.fromkeys(self.digests.values())
            ended = {d for d in every.keys() & (self._done() | attempts.keys()) if self._has_ended(d, attempts)}

            def note(digest: str, outcome: Outcome | Exception) -> None:
                if not result_file(self.folder, digest).exists():
                    attempts[digest] = self._note(digest, outcome)
                if self._has_ended(digest, attempts):
                    ended.add(digest)
                on_progress(len(ended), len(every))

            on_progress(len(ended), len(every))
            while silent := {digest: None for digest in every if digest not in ended}:
                with contextlib.closing(engine.run(list(silent), Run(self.folder, limits))) as outcomes:
                    for digest, outcome in outcomes:
                        silent.pop(digest, None)
                        note(digest, outcome)
                for digest in silent:
                    note(digest, RuntimeError("the engine ended without a word about it"))
        return Counter(self.state(name) for name in self.digests)

    def _has_ended(self, digest: str, attempts: Mapping[str, int]) -> bool:
        return result_file(self.folder, digest).exists() or attempts.get(digest, 0) >= ATTEMPTS

    def _done(self) -> set[str]:
        return {path.stem for path in (self.folder / RESULTS).glob("*.json")}

    def _failed(self) -> list[str]:
        return [path.stem for path in (self.folder / FAILURES).glob("*.json")]

    def _note(self, digest: str, outcome: Outcome | Exception) -> int:
        """Keep what went wrong with an attempt; return how many have failed."""
        failure = outcome.failure if isinstance(outcome, Outcome) else f"{type(outcome).__name__}: {outcome}"
        failures = [*self._failures(digest), failure or "its result is not there"]
        write_whole(self.folder / FAILURES / f"{digest}.json", _json(failures))
        return len(failures)

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        with (self.folder / "lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise CampaignError(f"{self.folder}: another process carries this campaign out") from error
            yield


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()
