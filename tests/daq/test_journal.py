from __future__ import annotations

import hashlib
import json
import os
import signal
import struct
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import IO

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import RecordingError
from daq.impact_group import digest_of
from daq.journal import SessionFolder, append_after_death
from daq.journal_file import parse_journal
from daq.records import Impact

from .same import same

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with SessionFolder.create(tmp_path / "run", {"seed": 7, "config": "a: µ\n"}) as begun:
        begun.append({"event": "begin", "n": 0})
    return tmp_path / "run"


def test_header_and_events_come_back(folder: Path) -> None:
    with SessionFolder.open(folder) as again:
        again.append({"event": "calibrated", "points": [1.5, None, "µ"]})
    with SessionFolder.open(folder) as again:
        assert again.header == {"seed": 7, "config": "a: µ\n"}
        assert again.events() == [{"event": "begin", "n": 0}, {"event": "calibrated", "points": [1.5, None, "µ"]}]


def test_a_impact_and_its_checkpoint_come_back(folder: Path, impact: Impact) -> None:
    state = {"time": 12.5, "random": list(range(1000))}
    with SessionFolder.open(folder) as run:
        run.write_impact(impact, state)
        run.write_impact(replace(impact, number=0), {})
    with SessionFolder.open(folder) as run:
        assert run.impact_numbers() == [0, 3]
        again, checkpoint = run.read_impact(3)
        assert same(again, impact)
        assert checkpoint == state
        assert same(tuple(run.impacts()), (replace(impact, number=0), impact))


def test_a_impact_is_never_overwritten(folder: Path, impact: Impact) -> None:
    with SessionFolder.open(folder) as run:
        run.write_impact(impact, {})
        with pytest.raises(RecordingError, match=r"00003\.h5: this impact was recorded already"):
            run.write_impact(impact, {})


def test_leftovers_of_a_kill_are_removed(folder: Path, impact: Impact) -> None:
    (folder / "shots" / "00005.h5.part").write_bytes(b"half")
    with SessionFolder.open(folder) as run:
        assert run.impacts() == []
    assert list((folder / "shots").iterdir()) == []


def test_a_damaged_impact_is_named(folder: Path, impact: Impact) -> None:
    with SessionFolder.open(folder) as run:
        run.write_impact(impact, {})
        file = folder / "shots" / "00003.h5"
        file.write_bytes(file.read_bytes()[:1000])
        with pytest.raises(RecordingError, match=r"00003\.h5: the file is damaged or truncated"):
            run.impacts()


def test_two_programs_cannot_work_in_one_folder(folder: Path) -> None:
    code = "import sys\nfrom daq.journal import SessionFolder\n"
    code += "try: SessionFolder.open(sys.argv[1])\nexcept ValueError as e: print(e)"
    with SessionFolder.open(folder):
        done = subprocess.run(
            [sys.executable, "-c", code, str(folder)], capture_output=True, text=True, cwd=ROOT, check=True
        )
        assert done.stdout == f"{folder}: another program works on this session; end it first\n"
        with pytest.raises(RecordingError, match="another program works on this session"):
            SessionFolder.open(folder)
    SessionFolder.open(folder).close()


def test_a_session_is_not_begun_twice(folder: Path) -> None:
    with pytest.raises(RecordingError, match="holds a session already"):
        SessionFolder.create(folder, {})


def test_a_session_stopped_before_it_began(folder: Path) -> None:
    (folder / "session.json").unlink()
    message = "holds no session: it was stopped before it began; start it again with mesotap run"
    with pytest.raises(RecordingError, match=message):
        SessionFolder.open(folder)


def test_a_folder_left_before_the_header_can_be_begun(tmp_path: Path) -> None:
    (tmp_path / "run" / "shots").mkdir(parents=True)
    (tmp_path / "run" / "session.json.part").write_text("{")
    SessionFolder.create(tmp_path / "run", {"seed": 1}).close()
    with SessionFolder.open(tmp_path / "run") as run:
        assert run.header == {"seed": 1}


@pytest.mark.parametrize("content", ["", "{", "[1]", "nothing", "[" * 100_000])
def test_a_damaged_header_is_named(folder: Path, content: str) -> None:
    (folder / "session.json").write_text(content)
    with pytest.raises(RecordingError, match=r"session\.json: is damaged"):
        SessionFolder.open(folder)


def test_what_is_no_session_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no such session folder"):
        SessionFolder.open(tmp_path / "none")
    with pytest.raises(RecordingError, match=r"is not a session folder: it holds no session\.json"):
        SessionFolder.open(tmp_path)


def test_a_torn_last_line_is_dropped_and_cut_off(folder: Path) -> None:
    journal = folder / "journal.jsonl"
    whole = journal.read_bytes()
    journal.write_bytes(whole + b'{"event": "sh')
    with SessionFolder.open(folder) as run:
        assert len(run.events()) == 1
        run.append({"event": "next"})
    assert journal.read_bytes() == whole + b'{"event": "next"}\n'


@pytest.mark.parametrize("line", [b"rubbish", b"[1]", b'{"no": "event"}', b"\0\0\0", b""])
def test_a_damaged_line_within_is_named(folder: Path, line: bytes) -> None:
    journal = folder / "journal.jsonl"
    journal.write_bytes(journal.read_bytes() + line + b'\n{"event": "later"}\n')
    with pytest.raises(RecordingError, match=r"journal\.jsonl: line 2 is damaged"):
        SessionFolder.open(folder)


@given(st.lists(st.dictionaries(st.text(), st.integers() | st.text() | st.none(), max_size=3), max_size=5), st.data())
def test_a_cut_at_any_byte_loses_only_what_was_cut(extras: list[dict[str, object]], data: st.DataObject) -> None:
    events = [{**extra, "event": i} for i, extra in enumerate(extras)]
    lines = [json.dumps(event).encode() + b"\n" for event in events]
    content = b"".join(lines)
    cut = data.draw(st.integers(0, len(content)))
    read, length = parse_journal(content[:cut], Path("j"))
    ends = [sum(map(len, lines[: i + 1])) for i in range(len(lines))]
    whole = sum(end <= cut for end in ends)
    assert read == events[:whole]
    assert length == ([0, *ends])[whole]


@given(st.binary(max_size=200))
def test_any_bytes_are_a_journal_or_a_sentence(content: bytes) -> None:
    try:
        events, length = parse_journal(content, Path("j"))
    except RecordingError:
        return
    assert 0 <= length <= len(content)
    assert all("event" in event for event in events)


def test_an_append_that_fails_leaves_the_journal_as_it_was(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = (folder / "journal.jsonl").read_bytes()
    with SessionFolder.open(folder) as run:
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", lambda descriptor: (_ for _ in ()).throw(OSError(28, "No space left on device")))
            with pytest.raises(RecordingError, match="the disk is full"):
                run.append({"event": "lost"})
        assert (folder / "journal.jsonl").read_bytes() == before
        run.append({"event": "kept"})
        assert [event["event"] for event in run.events()] == ["begin", "kept"]


def work(path: Path, told: int) -> None:
    """Keep impact after impact, and say so."""
    try:
        run = SessionFolder.open(path)
    except ValueError:
        run = SessionFolder.create(path, {"seed": 1})
    os.write(told, b"ready\n")
    while True:
        n = len(run.impact_numbers())
        a = np.full((2, 3000), float(n))
        run.append({"event": "strike", "shot": n})
        run.write_impact(Impact(n, 0, 1.0, 1.0, 1.0, "2026-01-01T00:00:00Z", 25000.0, 10, a, True), {"n": n})
        run.append({"event": "shot", "shot": n})
        os.write(told, b"%d\n" % n)


def working(path: Path) -> tuple[int, IO[str]]:
    """Return a process that does so, and what it says."""
    reading, telling = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            work(path, telling)
        finally:
            os._exit(1)
    os.close(telling)
    return child, os.fdopen(reading)


def test_kills_lose_at_most_the_impact_in_flight(tmp_path: Path) -> None:
    path = tmp_path / "run"
    reported = -1
    round_ = 0
    while round_ < 20 or reported <= 20:  # a machine that is busy writes less between two kills
        round_ += 1
        child, said = working(path)
        with said:
            assert said.readline() == "ready\n"
            time.sleep(0.0007 + 0.0023 * round_)
            os.kill(child, signal.SIGKILL)
            assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
            lines = said.read().split("\n")[:-1]
        reported = max([reported, *map(int, lines)])
        with SessionFolder.open(path) as run:
            numbers = run.impact_numbers()
            assert numbers == list(range(len(numbers)))
            assert len(numbers) in (reported + 1, reported + 2)
            reported = max(reported, len(numbers) - 1)
            done = [event["shot"] for event in run.events() if event["event"] == "shot"]
            assert set(done) <= set(numbers)
    with SessionFolder.open(path) as run:
        for number in numbers:
            impact, checkpoint = run.read_impact(number)
            assert checkpoint == {"n": number}
            assert (impact.acceleration == number).all()


def test_the_disk_is_waited_for_twice_an_impact_however_many_there_are(
    tmp_path: Path, impact: Impact, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the file and for its place in the folder: each takes milliseconds, while the session holds a load."""
    waited = []
    sync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: (waited.append(descriptor), sync(descriptor))[1])
    with SessionFolder.create(tmp_path / "run", {}) as run:
        counts = []
        for number in range(30):
            waited.clear()
            run.write_impact(replace(impact, number=number), {"n": number})
            counts.append(len(waited))
    assert counts == [2] * 30


@pytest.mark.parametrize("torn", [b"", b'{"event": "sh', b"\0\0\0\n"])
def test_an_event_is_added_after_the_death_of_a_session(folder: Path, torn: bytes) -> None:
    journal = folder / "journal.jsonl"
    whole = journal.read_bytes()
    journal.write_bytes(whole + torn)
    assert append_after_death(folder, {"event": "safe", "troubles": []})
    assert journal.read_bytes() == whole + b'{"event": "safe", "troubles": []}\n'
    with SessionFolder.open(folder) as run:
        assert run.events()[-1] == {"event": "safe", "troubles": []}


def test_damage_further_up_does_not_keep_an_event_out_of_the_journal(folder: Path) -> None:
    journal = folder / "journal.jsonl"
    before = b'rubbish\n{"event": "begin"}\n'
    journal.write_bytes(before)
    assert append_after_death(folder, {"event": "safe"})
    assert journal.read_bytes() == before + b'{"event": "safe"}\n'


@pytest.mark.parametrize("what", ["no folder", "no journal", "a folder", "a link", "a FIFO"])
def test_nothing_is_added_where_there_is_no_journal(tmp_path: Path, what: str) -> None:
    run = tmp_path / "run"
    if what != "no folder":
        run.mkdir()
    if what == "a folder":
        (run / "journal.jsonl").mkdir()
    if what == "a link":
        (tmp_path / "other").write_text("")
        (run / "journal.jsonl").symlink_to(tmp_path / "other")
    if what == "a FIFO":
        os.mkfifo(run / "journal.jsonl")
    assert not append_after_death(run, {"event": "safe"})
    if what == "a link":
        assert (tmp_path / "other").read_text() == ""
    if what == "no journal":
        assert list(run.iterdir()) == []


def test_a_full_disk_leaves_the_journal_of_a_dead_session_as_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (folder / "journal.jsonl").read_bytes()
    monkeypatch.setattr(os, "fsync", lambda descriptor: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    assert not append_after_death(folder, {"event": "safe"})
    assert (folder / "journal.jsonl").read_bytes() == before


def altered(path: Path, item: str) -> None:
    with h5py.File(path, "r+") as file:
        group = file["shot"] if "shot" in file else file["impacts/00003"]
        if item == "sample":
            group["acceleration"][1, 17] = np.nextafter(group["acceleration"][1, 17], 1e9)
        elif item == "strain":
            group["strain_mv"][5] += 1e-6
        else:
            group.attrs[item] = {"accepted": True, "load_before_mn": 264.6, "reject_reason": ""}[item]


@pytest.mark.parametrize("item", ["sample", "strain", "accepted", "load_before_mn", "reject_reason"])
def test_a_impact_that_was_altered_is_named(folder: Path, impact: Impact, item: str) -> None:
    with SessionFolder.open(folder) as run:
        run.write_impact(impact, {})
        altered(folder / "shots" / "00003.h5", item)
        with pytest.raises(RecordingError, match=r"00003\.h5: /shot: .* of impact 00003 were altered"):
            run.read_impact(3)


def test_a_impact_without_a_digest_is_read_as_it_is(folder: Path, impact: Impact) -> None:
    with SessionFolder.open(folder) as run:
        run.write_impact(impact, {})
        with h5py.File(folder / "shots" / "00003.h5", "r+") as file:
            del file["shot"].attrs["digest"]
        assert same(run.read_impact(3)[0], impact)


def test_a_impact_that_was_exchanged_for_another_is_named(folder: Path, impact: Impact) -> None:
    with SessionFolder.open(folder) as run:
        run.append({"event": "shot", "number": 3, "digest": digest_of(impact)})
        run.write_impact(replace(impact, load_after_mn=265.2), {})
        with pytest.raises(RecordingError, match="is not the impact 3 that the journal lists"):
            run.read_impact(3)


def test_the_digest_is_that_of_samples_and_numbers_as_documented(impact: Impact) -> None:
    content = b"mesotap impact 1\n"
    content += b"acceleration (2, 300)\n" + b"".join(struct.pack("<d", v) for row in impact.acceleration for v in row)
    content += b"strain_mv (300,)\n" + b"".join(struct.pack("<d", v) for v in impact.strain_mv)
    content += json.dumps([1, 265.0, 264.5, 265.1, 11.1, 11.2, 25000.0, 50, False, "too weak; noisy – µ", []]).encode()
    assert digest_of(impact) == "sha256:" + hashlib.sha256(content).hexdigest()


def test_equal_taps_have_equal_digests_whenever_they_were_made(impact: Impact) -> None:
    assert digest_of(impact) == digest_of(replace(impact, time="2030-01-01T00:00:00Z", number=9, extra={}))
