"""`mesotap prove`: a blind validation on sealed sessions, their diagnoses, and the score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from mesotap.campaigns.engine import Engine
from mesotap.commands.outputs import make_ready, write_json
from mesotap.commands.progress import progress
from mesotap.operator.terminal import escape
from mesotap.proof import page, sealed
from mesotap.proof.entries import Entry, entry_of
from mesotap.proof.errors import ProofError
from mesotap.proof.generator.scenarios import KINDS
from mesotap.proof.lookalikes import with_likeness
from mesotap.proof.page import Proof
from mesotap.proof.rigs import cases


@dataclass(frozen=True, slots=True)
class Subject:
    """What is tried: what makes it, and what the page calls it and its generator."""

    maker: sealed.Maker
    heading: str
    generator: str


TESTER = Subject(
    sealed.TESTER,
    "The diagnosis, tried on sealed sessions",
    "sessions come from a generator (`mesotap/proof/generator`)",
)
RIGS = Subject(
    sealed.Maker("mesotap prove --rigs", cases.draw_scenarios, cases.make),
    "The diagnosis, tried on sealed recordings of described rigs",
    "rigs and recordings come from a generator (`mesotap/proof/rigs`)",
)


def prove(
    seed: int,
    sessions: int,
    only: str | None,
    output: Path,
    jobs: int,
    engine: Engine,
    folders: Sequence[str],
    console: Console,
    subject: Subject = TESTER,
    json_path: Path | None = None,
) -> None:
    """Make what is to be tried, have it diagnosed, open the truths and score the answers."""
    if only is not None and only not in KINDS:
        raise ProofError(f"--only {only}: expected one of {', '.join(KINDS)}")
    make_ready(json_path, None)
    with progress(console, "sealing") as shown:
        hashes = sealed.seal(output, seed, sessions, only, jobs, shown, subject.maker)
    console.print(hashes, highlight=False, soft_wrap=True, end="")
    files = {name: sealed.files_of(output, name) for name in sealed.names(output)}
    answers = output / sealed.ANSWERS
    with progress(console, "diagnosing") as shown:
        sealed.diagnose_all(files, sealed.excluded(output), answers, engine, shown, folders)
    truths = sealed.unseal(output)
    entries, failures = _entries(truths, answers)
    if subject is TESTER:
        with progress(console, "look-alikes") as shown:
            entries = with_likeness(entries, seed, len(files), only, output / "likeness.json", shown)
    command = hashes.splitlines()[0][2:]
    origin = (
        f"Made by `{command}`. Truths and session files were hashed before the first diagnosis "
        "([hashes.txt](hashes.txt)); every diagnosis ran in a process of its own that was given its files only. The "
        f"{subject.generator} that shares no code with the mechanisms, the integrator or the fits of the diagnosis."
    )
    _write(Proof(subject.heading, origin, tuple(entries), failures), output, json_path, console)


def prove_practice(
    folder: Path,
    sessions: int | None,
    output: Path,
    engine: Engine,
    folders: Sequence[str],
    console: Console,
    json_path: Path | None = None,
) -> None:
    """Have the sessions of another program diagnosed and score the answers by the truths beside them."""
    make_ready(json_path, None)
    files, truths = sealed.practice_sessions(folder)
    chosen = list(sealed.chosen(sorted(files), sessions))
    answers = output / sealed.ANSWERS
    with progress(console, "diagnosing") as shown:
        sealed.diagnose_all({n: [files[n]] for n in chosen}, {}, answers, engine, shown, folders)
    entries, failures = _entries({n: truths[n] for n in chosen}, answers)
    origin = f"{len(chosen)} of {len(files)} sessions that another program made, with its truths beside them."
    proof = Proof("The diagnosis, tried on another program's sessions", origin, tuple(entries), failures)
    _write(proof, output, json_path, console)


def _entries(truths: dict[str, dict[str, Any]], answers: Path) -> tuple[list[Entry], dict[str, str]]:
    entries, failures = [], {}
    for name, truth in truths.items():
        answer = sealed.answer_of(answers, name)
        entry = entry_of(name, truth, answer)
        if entry is None:
            failures[name] = str(answer.get("failed", "no answer"))
        else:
            entries.append(entry)
    return entries, failures


def _write(proof: Proof, output: Path, json_path: Path | None, console: Console) -> None:
    written = page.write(proof, output)
    console.print(written.read_text(encoding="utf-8"), highlight=False, markup=False)
    console.print(f"written: {escape(written)}", highlight=False)
    write_json(json_path, page.scored(proof))
