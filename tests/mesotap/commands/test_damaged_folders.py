"""Whatever happened to a session folder, each command ends in one sentence or does what is right."""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import signal
import stat
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import pytest
from rich.console import Console

from daq.records import Session
from daq.session_file import read_session
from mesotap.__main__ import _sentence
from mesotap.commands import files, recordings, recover, session
from mesotap.report import report
from tests.fuzz.session_folders import DAMAGES

WHOLE = bool(os.environ.get("MESOTAP_WHOLE_COMMANDS"))
"""Whether sessions that can be opened are analysed and reported too, which takes 5 s each."""

LONGEST_S = 600

ROOT = {"format", "format_version", "created", "operator", "specimen", "title", "software", "complete"}
RIG = {"m1_kg", "m2_kg", "k1_n_per_m", "k2_n_per_m", "sample_rate_hz"}
IMPACT = {
    *("load_set", "target_load_mn", "load_before_mn", "load_after_mn", "time", "sample_rate_hz", "pretrigger"),
    *("accepted", "reject_reason"),
}


def silent() -> Console:
    return Console(file=io.StringIO(), width=200)


COMMANDS: dict[str, Callable[[Path], object]] = {
    "resume": lambda folder: session.resume(folder, None, silent()),
    "report": lambda folder: files.write_session_report(folder, None, None, (), None, silent()),
    "analyze": lambda folder: files.analyze([folder], None, None, None, (), None, None, silent()),
    "info": lambda folder: recordings.info(folder, None, silent()),
    "recover": lambda folder: recover.recover_folder(folder, folder.parent / "recovered.h5", None, silent()),
}


@pytest.fixture(autouse=True)
def _bounded(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def too_long(number: int, frame: object) -> None:
        raise TimeoutError(f"still at it after {LONGEST_S} s")

    if not WHOLE:
        monkeypatch.setattr(session, "_report", lambda *arguments: None)
        monkeypatch.setattr(session, "results_json", lambda results: {})
        monkeypatch.setattr(files, "analysed", lambda *arguments: SimpleNamespace(remarks=()))
        monkeypatch.setattr(files, "show_session", lambda *arguments: None)
        monkeypatch.setattr(files, "results_json", lambda results: {})
        monkeypatch.setattr(report, "write_report", lambda *arguments, **more: None)
    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(LONGEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def said_by(command: str, folder: Path) -> str:
    """What a command ends with: one line, or nothing."""
    try:
        COMMANDS[command](folder)
    except Exception as error:
        sentence = _sentence(error)
        if sentence is None:
            raise
        assert "\n" not in sentence
        return sentence
    return ""


def content(folder: Path) -> dict[str, str]:
    """Everything in a folder, to see whether it was altered."""
    found = {}
    for path in sorted(folder.rglob("*")):
        kind = path.lstat()
        what = str(path.readlink()) if path.is_symlink() else ""
        if stat.S_ISREG(kind.st_mode) and os.access(path, os.R_OK) and kind.st_size < 1 << 30:
            what = hashlib.sha256(path.read_bytes()).hexdigest()
        found[str(path.relative_to(folder))] = f"{kind.st_mode} {kind.st_mtime_ns} {what}"
    return found


def faults(path: Path) -> list[str]:
    """Where a file departs from the page of format 1; written from that page, not from the reader."""
    found = []
    with h5py.File(path) as file:
        found += [f"/ lacks {name}" for name in ROOT - set(file.attrs)]
        found += [f"/rig lacks {name}" for name in RIG - set(file["rig"].attrs)]
        if file["config"].shape != ():
            found.append("/config")
        for name, group in file["impacts"].items():
            found += [f"{name} lacks {attribute}" for attribute in IMPACT - set(group.attrs)]
            data = group["acceleration"]
            if data.ndim != 2 or data.shape[0] != 2 or data.attrs["units"] != "m/s2":
                found.append(f"{name}/acceleration")
            if not 0 <= group.attrs["pretrigger"] < data.shape[1]:
                found.append(f"{name}: pretrigger")
    return found


def some_quick(damages: Sequence[str], every: int = 4) -> list[Any]:
    """Return all of them; every so many of a kind are not slow."""
    kinds: dict[str, int] = {}
    found = []
    for damage in damages:
        kind = damage.partition(":")[0]
        kinds[kind] = kinds.get(kind, -1) + 1
        found.append(pytest.param(damage, marks=pytest.mark.slow if kinds[kind] % every else ()))
    return found


@pytest.mark.parametrize("damage", some_quick(list(DAMAGES)))
def test_each_command_ends_in_one_sentence_or_does_what_is_right(sound: Path, tmp_path: Path, damage: str) -> None:
    for command in COMMANDS:
        folder = tmp_path / command / "run"
        shutil.copytree(sound / "unfinished", folder)
        DAMAGES[damage](folder)
        before = content(folder)
        said = said_by(command, folder)
        after = content(folder)
        folder.chmod(0o700)  # so that it can be cleared away
        if command == "recover":
            assert after == before
            assert bool(said) != (folder.parent / "recovered.h5").exists()
            if not said:
                assert faults(folder.parent / "recovered.h5") == []


def recovered(folder: Path) -> tuple[Session, list[str]]:
    console = silent()
    output = folder.parent / "recovered.h5"
    output.unlink(missing_ok=True)
    recover.recover_folder(folder, output, None, console)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    return read_session(output), [line.removeprefix("- ") for line in lines[:-1]]


@pytest.mark.parametrize(
    ("damage", "impacts", "lost"),
    [
        ("journal: a line damaged in the middle", [0, 1, 2], "journal.jsonl, line 4: is not a journal entry"),
        ("journal: missing", [0, 1, 2], "journal.jsonl: is missing"),
        ("journal: empty", [0, 1, 2], "journal.jsonl: is empty"),
        ("journal: a shot twice", [0, 1, 2], "journal.jsonl, line 8: stands twice"),
        ("journal: a shot accepted maybe", [0, 1, 2], "journal.jsonl, line 7: entry 'shot': accepted is 'maybe'"),
        ("journal: a voltage that is NaN", [0, 1, 2], "journal.jsonl, line 3: entry 'calibrated': voltage_mv.1 is nan"),
        ("journal: without its first half", [0, 1, 2], "journal.jsonl, line 1: entry 'settled' cannot happen while"),
        ("journal: a shot that is not in it", [0, 1, 2], "impact 00000: is not in the journal; kept"),
        ("journal: shots out of order", [0, 1, 2], "journal.jsonl, line 8: entry 'shot': number is 0, after 1"),
        ("journal: a shot of another digest", [1, 2], "shots/00000.h5: is left out: it is not the impact 00000 that"),
        ("header: of a newer version", [0, 1, 2], "session.json: was written by a newer version (mesotap 9.9"),
        ("header: missing", [0, 1, 2], "configuration: none can be read: masses, springs and filter are unknown"),
        ("header: cut", [0, 1, 2], "session.json: is damaged: of its items created, config, simulated could be read"),
        ("shots: one missing", [0, 2], "impact 00001: is lost: the journal lists it, but there is no whole file of it"),
        ("shots: one cut", [0, 2], "shots/00001.h5: is lost: the file is damaged or truncated"),
        ("shots: a sample altered", [0, 2], "shots/00001.h5: is lost: /shot: the samples or numbers of impact 00001"),
        ("shots: one renamed", [0, 1, 2], "shots/tap number 1.h5: is under another name: it is impact 00001"),
        ("shots: two exchanged", [0, 1, 2], "shots/00000.h5: is under another name: it is impact 00001"),
        ("shots: a copy of one", [0, 1, 2], "shots/00001 (copy).h5: is left out: it is a copy of impact 00001"),
        ("shots: a foreign HDF5 file", [0, 1, 2], "shots/00003.h5: is lost: it is not an impact of a session"),
    ],
)
def test_what_is_whole_is_recovered_and_the_rest_is_told(
    sound: Path, tmp_path: Path, damage: str, impacts: list[int], lost: str
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "unfinished", folder)
    whole = recovered(folder)[0]
    DAMAGES[damage](folder)
    found, lines = recovered(folder)
    assert [impact.number for impact in found.impacts] == impacts
    for impact in found.impacts:
        assert impact.acceleration.tobytes() == whole.impacts[impact.number].acceleration.tobytes()
        assert impact.accepted == whole.impacts[impact.number].accepted
    assert any(line.startswith(lost) for line in lines), lines
    assert not found.complete


def test_masses_of_a_lost_configuration_are_unknown_and_not_the_defaults(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "unfinished", folder)
    DAMAGES["header: missing"](folder)
    found = recovered(folder)[0]
    assert not found.rig.is_tester
    assert found.config == ""
    assert found.pre is not None


def test_masses_of_a_configuration_that_is_refused_for_something_else_are_kept(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "unfinished", folder)
    whole = recovered(folder)[0]
    DAMAGES["header: configuration with a load refused"](folder)
    found, lines = recovered(folder)
    assert found.rig == whole.rig
    assert any(line.startswith("session.json: its configuration cannot be used: ") for line in lines)
    assert "session.json: of its configuration only masses, springs, filter and wiring were used" in lines


def test_masses_that_are_refused_are_unknown(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "unfinished", folder)
    DAMAGES["header: configuration with a value refused"](folder)
    assert not recovered(folder)[0].rig.is_tester


def test_a_finished_session_is_recovered_as_what_it_is(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "finished", folder)
    found, lines = recovered(folder)
    true = read_session(folder / "session.h5")
    assert lines == []
    assert found.complete
    assert found.rig == true.rig
    assert [s.acceleration.tobytes() for s in found.impacts] == [s.acceleration.tobytes() for s in true.impacts]
    assert found.pre is not None
    assert found.post is not None
    assert found.post.time == true.post.time  # type: ignore[union-attr]


def test_the_configuration_of_a_lost_header_is_that_of_the_finished_file(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "finished", folder)
    (folder / "session.json").unlink()
    found, lines = recovered(folder)
    assert found.rig.m1_kg == read_session(folder / "session.h5").rig.m1_kg
    assert "session.h5: the configuration was taken from here" in lines
    assert not found.complete


@pytest.mark.parametrize("damage", ["shots: none", "shots: missing", "shots: a file"])
def test_nothing_whole_is_one_sentence_and_no_file(sound: Path, tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "unfinished", folder)
    DAMAGES[damage](folder)
    assert said_by("recover", folder) == f"{folder}: holds no intact impact to make a session of"
    assert list(tmp_path.iterdir()) == [folder]


def test_the_damaged_folder_is_no_place_for_the_file(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(sound / "unfinished", folder)
    with pytest.raises(ValueError, match="lies in the damaged folder, which is left as it is"):
        recover.recover_folder(folder, folder / "session.h5", None, silent())
