"""Blind validation: truths and sessions are hashed before anything is diagnosed, and checked when opened.

===================  ==================================================================
`sessions/*`         what the diagnosis sees, one at a time: a session file, or a folder with
                     recordings and the description of their rig
`truths.sealed`      compressed truths, opened into `truths.json` after the last diagnosis
`hashes.txt`         seed and SHA-256 of `truths.json` and of every file (`sha256sum -c`)
`answers/campaign`   the diagnoses as tasks: an interrupted run resumes from there
`answers/*.json`     what was answered
===================  ==================================================================
"""

from __future__ import annotations

import gzip
import hashlib
import json
import multiprocessing
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from daq.durable import make_folder, write_whole
from daq.errors import RecordingError
from daq.regular import read_regular
from mesotap.campaigns.campaign import Campaign, OnProgress
from mesotap.campaigns.engine import Engine
from mesotap.campaigns.one_task import Limits
from mesotap.campaigns.task import Task, content_sha256
from mesotap.proof.errors import ProofError
from mesotap.proof.generator import scenarios as of_the_tester

SESSIONS, ANSWERS, PARTS, CAMPAIGN = "sessions", "answers", "parts", "campaign"
ANSWER = "answer.json"
HASHES, SEALED, TRUTHS = "hashes.txt", "truths.sealed", "truths.json"
CONTRACT = 2  # version of the answers
LIMITS = Limits(time_s=900.0)  # of a diagnosis
LARGEST_TRUTHS = 50_000_000  # bytes; those of 300 sessions have a million
LONGEST_ERROR = 300  # characters kept of the error of a failed diagnosis

RIG = "rig.yaml"


class Scenario(Protocol):
    """What is to be made; its name is that of its file or folder."""

    @property
    def name(self) -> str:
        """Name, without an ending."""


@dataclass(frozen=True, slots=True)
class Maker:
    """What makes the sessions of a proof.

    Attributes
    ----------
    command
        That asks for it, without seed and number.
    draw
        Return what is to be made from a seed, how many, and their only kind.
    make
        Make one of them from the seed into a folder, and return its truth.
    """

    command: str
    draw: Callable[[int, int, str | None], Sequence[Scenario]]
    make: Callable[[int, Any, Path], dict[str, Any]]


TESTER = Maker("mesotap prove", of_the_tester.draw_scenarios, of_the_tester.make)


def seal(
    folder: Path,
    seed: int,
    sessions: int,
    only: str | None,
    jobs: int,
    on_progress: OnProgress,
    maker: Maker = TESTER,
) -> str:
    """Make the sessions of a proof and their hashes; what is there already stays. Return the text of `hashes.txt`.

    Raises
    ------
    ProofError
        The folder holds another proof, or a session or the truths are not those that were hashed.
    """
    heading = f"# {maker.command} --seed {seed} --sessions {sessions}" + (f" --only {only}" if only else "")
    listed = folder / HASHES
    if listed.exists():
        text = listed.read_text(encoding="utf-8")
        if text.splitlines()[0] != heading:
            raise ProofError(f"{folder}: holds another proof ({text.splitlines()[0][2:]}); name another folder")
        check(folder)
        on_progress(sessions, sessions)
        return text
    (folder / SESSIONS).mkdir(parents=True, exist_ok=True)
    (folder / PARTS).mkdir(exist_ok=True)
    started = folder / PARTS / "proof"
    if started.exists() and started.read_text(encoding="utf-8") != heading:
        raise ProofError(f"{folder}: another proof was started here; name another folder")
    started.write_text(heading, encoding="utf-8")
    scenarios = maker.draw(seed, sessions, only)
    missing = [s for s in scenarios if not _part(folder, s.name).exists()]
    on_progress(len(scenarios) - len(missing), len(scenarios))
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done, made in enumerate(
            as_completed([pool.submit(_make, maker.make, folder, seed, s) for s in missing]), start=1
        ):
            made.result()
            on_progress(len(scenarios) - len(missing) + done, len(scenarios))
    truths = {s.name: json.loads(gzip.decompress(_part(folder, s.name).read_bytes())) for s in scenarios}
    content = (json.dumps(truths, indent=1, allow_nan=False) + "\n").encode()
    write_whole(folder / SEALED, gzip.compress(content, mtime=0))
    lines = [heading, f"{hashlib.sha256(content).hexdigest()}  {TRUTHS}"]
    lines += [f"{_hash(f)}  {f.relative_to(folder)}" for s in scenarios for f in files_of(folder, s.name)]
    text = "\n".join(lines) + "\n"
    write_whole(listed, text.encode())
    shutil.rmtree(folder / PARTS)
    return text


def _make(make: Callable[[int, Any, Path], dict[str, Any]], folder: Path, seed: int, scenario: Scenario) -> None:
    truth = make(seed, scenario, folder / SESSIONS)
    write_whole(_part(folder, scenario.name), gzip.compress(json.dumps(truth, allow_nan=False).encode(), mtime=0))


def _part(folder: Path, name: str) -> Path:
    return folder / PARTS / f"{name}.gz"


def files_of(folder: Path, name: str) -> list[Path]:
    """Return what the diagnosis of a session is given."""
    path = folder / SESSIONS / name
    return sorted(path.iterdir()) if path.is_dir() else [path.with_suffix(".h5")]


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _listed(folder: Path) -> dict[str, str]:
    """File to hash, as `hashes.txt` has them."""
    lines = (folder / HASHES).read_text(encoding="utf-8").splitlines()[1:]
    return {name: digest for digest, name in (line.split("  ", 1) for line in lines)}


def check(folder: Path) -> None:
    """Hold every session and the truths against the hashes.

    Raises
    ------
    ProofError
        One of them is missing or another than the one that was hashed.
    """
    for name, digest in _listed(folder).items():
        if name == TRUTHS:
            found = hashlib.sha256(_unsealed(folder)).hexdigest()
        else:
            path = folder / name
            if not path.is_file():
                raise ProofError(f"{path}: is missing; its hash is in {HASHES}")
            found = _hash(path)
        if found != digest:
            raise ProofError(f"{folder / name}: is not the file that was hashed before the proof")


def _unsealed(folder: Path) -> bytes:
    path = folder / SEALED
    try:
        return gzip.decompress(path.read_bytes())
    except (OSError, EOFError) as error:
        raise ProofError(f"{path}: cannot be opened: {error}") from error


def names(folder: Path) -> list[str]:
    """Names of the sealed sessions."""
    return list(dict.fromkeys(Path(Path(name).parts[1]).stem for name in _listed(folder) if name != TRUTHS))


def excluded(folder: Path) -> dict[str, str]:
    """Return which mechanism is excluded for which session: the only part of the truth that a diagnosis is given."""
    truths = json.loads(_unsealed(folder))
    return {name: truth["without"] for name, truth in truths.items() if truth["without"]}


def unseal(folder: Path) -> dict[str, dict[str, Any]]:
    """Check all hashes, write the truths down in the open, and return them."""
    check(folder)
    content = _unsealed(folder)
    write_whole(folder / TRUTHS, content)
    truths: dict[str, dict[str, Any]] = json.loads(content)
    return truths


def diagnose_all(
    sessions: Mapping[str, Sequence[Path]],
    without: Mapping[str, str],
    answers: Path,
    engine: Engine,
    on_progress: OnProgress,
    folders: Sequence[str] = (),
) -> None:
    """Have every session diagnosed by a process of its own that is given its files only: a campaign.

    Answers that this program gave before are kept. ``folders`` hold a user's own mechanisms.
    """
    make_folder(answers)
    files: dict[str, Path | bytes] = {}
    tasks = {name: _diagnosis(given, without.get(name), folders, files) for name, given in sessions.items()}
    campaign = Campaign.plan(answers / CAMPAIGN, "diagnoses of a proof", tasks, files)
    campaign.retry()
    campaign.carry_out(engine, LIMITS, on_progress)
    for name in tasks:
        result = campaign.result(name)
        failed = [] if result else campaign.failures(name)
        answer = result["answers"][ANSWER] if result else {"failed": failed[-1][-LONGEST_ERROR:]}
        write_whole(answers / f"{name}.json", (json.dumps(answer, indent=1) + "\n").encode())


def _diagnosis(
    session: Sequence[Path], without: str | None, folders: Sequence[str], files: dict[str, Path | bytes]
) -> Task:
    """Return the task of one diagnosis, and put what it is given into ``files``."""
    given: dict[str, Path | bytes] = (
        {"session.h5": session[0]} if len(session) == 1 else {file.name: file for file in session}
    )
    if folders:
        own = {"analysis": {"mechanisms": [str(Path(folder).absolute()) for folder in folders]}}
        given["config.yaml"] = json.dumps(own).encode()
    inputs = {name: content_sha256(source) for name, source in given.items()}
    files.update({inputs[name]: source for name, source in given.items()})
    arguments = ["diagnose", *(name for name in given if name not in (RIG, "config.yaml"))]
    arguments += ["--rig", RIG] if RIG in given else []
    arguments += ["--json", ANSWER, "--contract", str(CONTRACT)]
    arguments += ["--without", without] if without else []
    return Task(tuple(arguments), inputs, (ANSWER,))


def answer_of(answers: Path, name: str) -> dict[str, Any]:
    """Return what was answered about a session; empty where nothing was, or by another version of the contract."""
    try:
        found = json.loads((answers / f"{name}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(found, dict):
        return {}
    return found if found.get("version") == CONTRACT or "failed" in found else {}


def practice_sessions(folder: Path) -> tuple[dict[str, Path], dict[str, dict[str, Any]]]:
    """Return session files and truths of a folder with a `truth.json`, by name.

    Raises
    ------
    ProofError
        There is no `truth.json`, it is malformed, or a session that it tells of is missing.
    """
    path = folder / "truth.json"
    try:
        truths = json.loads(read_regular(path, LARGEST_TRUTHS, "truths"))
    except RecordingError as error:
        raise ProofError(str(error)) from error
    except (ValueError, RecursionError) as error:
        raise ProofError(f"{path}: is not JSON: {error}") from error
    if not isinstance(truths, dict) or not all(
        isinstance(t, dict) and isinstance(t.get("kinds"), list) for t in truths.values()
    ):
        raise ProofError(f"{path}: expected an object with 'kinds' for each session")
    for name, truth in truths.items():
        if not isinstance(truth.get("d"), int | float):
            raise ProofError(f"{path}: {name} has no number 'd'")
    files = {name: folder / f"{name}.h5" for name in truths}
    for file in files.values():
        if not file.is_file():
            raise ProofError(f"{file}: is missing, though {path.name} tells of it")
    return files, truths


def chosen(names: list[str], count: int | None) -> Iterator[str]:
    """Choose ``count`` names evenly over the list; all of them without."""
    if count is None or count >= len(names):
        yield from names
        return
    for i in range(count):
        yield names[i * len(names) // count]
