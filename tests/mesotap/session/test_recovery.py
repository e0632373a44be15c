"""Folders that somebody made to harm whoever recovers them: what is whole in them is saved, and no more is taken."""

from __future__ import annotations

import json
import os
import shutil
import threading
from pathlib import Path

import h5py
import numpy as np
import pytest

from daq.durable import write_whole
from daq.errors import RecordingError, UnwrittenError
from daq.hdf5 import CHECKSUMMED
from daq.limited import LimitedReader
from daq.limits import LEAST_ROOM, folder_room
from daq.records import Impact
from daq.session_file import read_session, write_session
from mesotap.session import recovery
from mesotap.session.recovery import recover
from tests.fuzz.session_folders import DAMAGES
from tests.fuzz.sessions import small_session
from tests.mesotap.session.read_by_a_child import MARK, ask_for_its_own, ends_at_the_mark


def test_a_impact_that_crashes_the_library_costs_no_other(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recovery, "any_impact_in", ends_at_the_mark)
    impact = folder / "shots/00001.h5"
    impact.write_bytes(impact.read_bytes() + MARK)
    found = recover(folder)
    assert [s.number for s in found.session.impacts] == [0, 2]
    assert "shots/00001.h5: is lost: the file is damaged or truncated: the library that reads it failed" in found.losses


@pytest.mark.usefixtures("in_new_processes")
def test_one_process_reads_file_after_file_and_is_followed_by_another_where_it_ended(tmp_path: Path) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(MARK)
    with LimitedReader() as reader:
        first = reader.read(ask_for_its_own, bad)
        assert reader.read(ask_for_its_own, bad) == first != os.getpid()
        with pytest.raises(RecordingError, match="the library that reads it failed"):
            reader.read(ends_at_the_mark, bad)
        assert reader.read(ask_for_its_own, bad) != first


def test_a_impact_that_claims_more_than_its_file_may_hold_is_lost(folder: Path) -> None:
    with h5py.File(folder / "shots/00001.h5", "r+", libver=CHECKSUMMED) as file:
        impact = file["shot"]
        del impact["acceleration"], impact["strain_mv"], impact.attrs["digest"]
        zeros = impact.create_dataset(
            "acceleration", (2, 500_000), "f8", compression="gzip", data=np.zeros((2, 500_000))
        )
        zeros.attrs["units"] = "m/s2"
    found = recover(folder)
    assert [s.number for s in found.session.impacts] == [0, 2]
    assert any("shots/00001.h5: is lost: /shot/acceleration claims shape" in line for line in found.losses)


def test_the_impacts_of_a_folder_claim_no_more_than_it_may_hold(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = recover(folder).session.impacts[0]
    one = whole.acceleration.nbytes + (0 if whole.strain_mv is None else whole.strain_mv.nbytes)
    monkeypatch.setattr(recovery, "folder_room", lambda size: 2 * one)
    found = recover(folder)
    assert [s.number for s in found.session.impacts] == [0, 1]
    assert any(line.startswith("shots/00002.h5: is lost: the impacts claim more samples") for line in found.losses)
    assert folder_room(0) == LEAST_ROOM


def test_samples_that_pack_to_almost_nothing_are_written_such_that_they_can_be_read(tmp_path: Path) -> None:
    session = small_session(impacts=1, samples=3_000_000)
    impact = session.impacts[0]
    flat = np.zeros_like(impact.acceleration)
    impacts = (
        Impact(**{n: getattr(impact, n) for n in Impact.__slots__} | {"acceleration": flat, "strain_mv": flat[0]}),
    )
    path = tmp_path / "s.h5"
    write_session(
        path, type(session)(**{n: getattr(session, n) for n in type(session).__slots__} | {"impacts": impacts})
    )
    assert read_session(path).impacts[0].acceleration.shape == flat.shape


def test_a_session_of_which_the_configuration_is_lost_is_not_complete(sound: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(sound / "finished", tmp_path / "run"))
    assert recover(folder).session.complete
    DAMAGES["header: configuration with a load refused"](folder)
    found = recover(folder)
    assert found.losses
    assert not found.session.complete


@pytest.mark.parametrize(
    ("operator", "kept", "told"),
    [
        (r'"a\0b"', r"a\0b", "operator holds characters that no file keeps; they are written as escapes"),
        (r'"\ud800"', r"\ud800", "operator holds characters that no file keeps; they are written as escapes"),
        ('"' + 70_000 * "x" + '"', 60_000 * "x", "operator is longer than 60000 bytes; the rest is cut off"),
    ],
)
def test_names_that_no_file_keeps_are_escaped_or_cut(
    folder: Path, tmp_path: Path, operator: str, kept: str, told: str
) -> None:
    header = json.loads((folder / "session.json").read_text())
    before = header["config"]
    header["config"] = before.replace("operator: ''", f"operator: {operator}")
    assert header["config"] != before
    (folder / "session.json").write_text(json.dumps(header))
    found = recover(folder)
    assert f"session.json: {told}" in found.losses
    write_session(tmp_path / "s.h5", found.session)
    again = read_session(tmp_path / "s.h5")
    assert again.operator == kept
    assert again.rig.is_tester


def test_half_a_character_in_the_configuration_is_escaped(folder: Path, tmp_path: Path) -> None:
    header = json.loads((folder / "session.json").read_text())
    header["config"] = "# \ud800\n" + header["config"]
    (folder / "session.json").write_text(json.dumps(header))
    found = recover(folder)
    assert any("its configuration holds characters that no file keeps" in line for line in found.losses)
    write_session(tmp_path / "s.h5", found.session)
    assert read_session(tmp_path / "s.h5").config.startswith(r"# \ud800")


def test_a_linked_folder_of_impacts_is_not_followed(folder: Path, sound: Path) -> None:
    shutil.rmtree(folder / "shots")
    (folder / "shots").symlink_to(sound / "unfinished/shots")
    with pytest.raises(RecordingError, match="holds no intact impact"):
        recover(folder)


@pytest.mark.parametrize("links", [True, False])
def test_of_several_that_begin_one_file_one_succeeds(
    tmp_path: Path, links: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not links:

        def refused(self: Path, target: Path) -> None:
            raise PermissionError(1, "Operation not permitted")

        monkeypatch.setattr(Path, "hardlink_to", refused)
    path, done, refusals = tmp_path / "x.h5", [], []

    def write(number: int) -> None:
        try:
            write_whole(path, bytes([number]) * 100_000, new=True)
            done.append(number)
        except UnwrittenError as error:
            refusals.append(str(error))

    monkeypatch.setattr("daq.durable.os.getpid", threading.get_native_id)
    threads = [threading.Thread(target=write, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(done) == 1
    assert path.read_bytes() == bytes([done[0]]) * 100_000
    assert refusals == 3 * [
        f"{path}: cannot be written: there is a file of that name by now, which is left as it is; name another"
    ]
    assert list(tmp_path.iterdir()) == [path]
