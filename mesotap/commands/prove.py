"""`mesotap prove`: a blind validation on sealed sessions, their diagnoses, and the score."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
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
from mesotap.proof.generator import outside_scenarios
from mesotap.proof.generator.effects import OUTSIDE
from mesotap.proof.generator.outside_scenarios import SIZE, TEN, held_back
from mesotap.proof.generator.scenarios import KINDS
from mesotap.proof.lookalikes import with_likeness
from mesotap.proof.page import Proof
from mesotap.proof.rigs import cases
from mesotap.proof.scored import scored

MOST_LOADS = 8  # that differ by 8 % and are drawn within 70 to 1000 mN without long search
FEWEST_TAPS = 2  # of which one may be held out


@dataclass(frozen=True, slots=True)
class Subject:
    """What is tried: what makes it, and what the page calls it and its generator."""

    maker: sealed.Maker
    heading: str
    generator: str
    kinds: tuple[str, ...] = KINDS


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


def outside(size: str | None, sealed_by: int | None, unsealed_by: int | None) -> Subject:
    """Return the trial on effects outside the list alone.

    Parameters
    ----------
    size
        Loads and taps at each, as ``6x8``; `SIZE` without.
    sealed_by, unsealed_by
        A seed: of only the five effects that it holds back, or of all others.

    Raises
    ------
    ProofError
        The size is none.
    """
    if sealed_by is not None and unsealed_by is not None:
        raise ProofError("--sealed and --unsealed: expected one of them")
    loads, taps = SIZE if size is None else _size_of(size)
    command = "mesotap prove --outside" + (f" --size {size}" if size else "")
    names = tuple(OUTSIDE)
    if sealed_by is not None:
        command, names = f"{command} --sealed {sealed_by}", held_back(sealed_by)
    if unsealed_by is not None:
        back = held_back(unsealed_by)
        command, names = f"{command} --unsealed {unsealed_by}", tuple(n for n in OUTSIDE if n not in back)
    maker = sealed.Maker(command, partial(outside_scenarios.draw, size=(loads, taps), names=names), TESTER.maker.make)
    heading = "The diagnosis, tried on sealed sessions with physics that nobody listed"
    return Subject(maker, heading, TESTER.generator, tuple(dict.fromkeys(TEN)))


def subject_of(
    rigs: bool, outside_alone: bool, size: str | None, sealed_by: int | None, unsealed_by: int | None
) -> Subject:
    """Return what the options of the command ask for.

    Raises
    ------
    ProofError
        Options that exclude each other, or a size that is none.
    """
    if outside_alone:
        if rigs:
            raise ProofError("--outside and --rigs: expected one of them")
        return outside(size, sealed_by, unsealed_by)
    for option, value in (("--size", size), ("--sealed", sealed_by), ("--unsealed", unsealed_by)):
        if value is not None:
            raise ProofError(f"{option}: goes with --outside")
    return RIGS if rigs else TESTER


def _size_of(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d?)x([1-9]\d?)", text)
    if found is None or int(found[1]) > MOST_LOADS or int(found[2]) < FEWEST_TAPS:
        raise ProofError(
            f"--size {text}: expected loads and taps at each, as 6x8; at most {MOST_LOADS} loads and at least "
            f"{FEWEST_TAPS} taps"
        )
    return int(found[1]), int(found[2])


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
    if only is not None and only not in subject.kinds:
        raise ProofError(f"--only {only}: expected one of {', '.join(subject.kinds)}")
    make_ready(json_path, output)
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
    make_ready(json_path, output)
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
    write_json(json_path, scored(proof.entries, proof.failures))
