from __future__ import annotations

import os
from pathlib import Path

import pytest

from daq import durable
from daq.durable import make_folder, write_whole
from daq.errors import RecordingError, UnwrittenError
from daq.journal import SessionFolder
from daq.records import Impact


def test_a_file_is_not_written_through_a_link_that_stands_in_for_its_unfinished_self(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "session.h5.part").symlink_to(victim)
    with pytest.raises(UnwrittenError, match=r"session\.h5\.part: cannot be written: a link stands there"):
        write_whole(tmp_path / "session.h5", b"content")
    assert victim.read_text() == "precious"
    assert not (tmp_path / "session.h5").exists()


def test_a_dangling_link_makes_no_file_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "a.part").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UnwrittenError, match="a link stands there"):
        write_whole(tmp_path / "a", b"content")
    assert not (tmp_path / "elsewhere").exists()


def test_what_an_earlier_program_left_unfinished_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.part").write_bytes(b"half of something longer")
    write_whole(tmp_path / "a", b"whole")
    assert (tmp_path / "a").read_bytes() == b"whole"
    assert not (tmp_path / "a.part").exists()


@pytest.mark.parametrize("name", ["lock", "journal.jsonl", "session.json", "00000.h5.part"])
def test_a_session_is_not_begun_over_a_link(tmp_path: Path, name: str) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    place = tmp_path / "run" / ("shots" if name.endswith(".part") else "") / name
    place.parent.mkdir(parents=True)
    place.symlink_to(victim)
    with pytest.raises(RecordingError):
        SessionFolder.create(tmp_path / "run", {"seed": 1}).close()
    assert victim.read_text() == "precious"


@pytest.mark.parametrize("name", ["lock", "journal.jsonl"])
def test_a_session_does_not_wait_for_a_fifo(tmp_path: Path, name: str) -> None:
    SessionFolder.create(tmp_path / "run", {"seed": 1}).close()
    (tmp_path / "run" / name).unlink()
    os.mkfifo(tmp_path / "run" / name)
    with pytest.raises(RecordingError, match=f"{name}: cannot be written: what is there is not a regular file"):
        SessionFolder.open(tmp_path / "run")


def test_every_new_folder_and_the_one_above_it_are_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(durable, "sync_folder", synced.append)
    make_folder(tmp_path / "a" / "b" / "c")
    for made in (tmp_path / "a", tmp_path / "a" / "b", tmp_path / "a" / "b" / "c"):
        assert made.is_dir()
        assert made in synced
        assert made.parent in synced[synced.index(made) :]


def test_a_impact_is_not_written_through_a_link(tmp_path: Path, impact: Impact) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    with SessionFolder.create(tmp_path / "run", {"seed": 1}) as folder:
        (tmp_path / "run" / "shots" / "00003.h5.part").symlink_to(victim)
        with pytest.raises(RecordingError, match="a link stands there"):
            folder.write_impact(impact, {})
    assert victim.read_text() == "precious"
