"""Folders into the catalogue: what is read, what is not read again, what is damaged, moved, or of another format."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import random
import shutil
import sqlite3
from pathlib import Path

import h5py
import numpy as np
import pytest

from daq.errors import RecordingError
from daq.journal import SessionFolder
from daq.session_file import write_session
from mesotap.catalogue.entry import Entry, entry_from
from mesotap.catalogue.indexing import update
from mesotap.catalogue.store import Catalogue, CatalogueError
from tests.fuzz.session_folders import DAMAGES
from tests.mesotap.benches import header_of, small_config
from tests.mesotap.catalogue.lab import NOISE, SLOPE, ZERO, filed, results, session


@pytest.fixture
def catalogue(tmp_path):
    with Catalogue(tmp_path / "index.sqlite") as made:
        yield made


def entries(catalogue: Catalogue) -> dict[str, Entry]:
    return {e.name: e for e in catalogue.find()}


def test_a_session_is_read_with_its_answers(tmp_path, catalogue):
    folder = filed(tmp_path / "lab" / "2026" / "s1")
    sha256 = hashlib.sha256((folder / "session.h5").read_bytes()).hexdigest()
    named = [{"id": "contact_loss", "probability": 0.9, "statement": "the contact opens"}]
    said = {"format": "mesotap-diagnosis", "version": 2, "verdict": "missing_physics", "mechanisms": named}
    (folder / "diagnosis.json").write_text(json.dumps({**said, "recordings": [{"file": "s", "sha256": sha256}]}))
    update(catalogue, [tmp_path / "lab"])
    (found,) = catalogue.find()
    assert (found.path, found.state, found.specimen, found.operator) == (str(folder), "complete", "steel", "Ann")
    assert (found.slope_mv_per_mn, found.k1_n_per_m) == (pytest.approx(SLOPE), 538e3)
    assert found.zero_mv == pytest.approx(ZERO)
    assert found.noise_m_s2 == pytest.approx(NOISE, rel=0.1)
    assert (found.verdict, found.mechanisms[0].id, found.answer) == ("missing_physics", "contact_loss", "results.json")
    assert found.loads[0].contact_stiffness_n_per_m.value == 5e6
    assert entry_from(json.loads(json.dumps(found.as_json()))) == found


def test_a_diagnosis_of_another_recording_is_left_out_and_said(tmp_path, catalogue):
    folder = filed(tmp_path / "s1")
    said = {"format": "mesotap-diagnosis", "version": 2, "verdict": "consistent", "mechanisms": []}
    (folder / "diagnosis.json").write_text(json.dumps({**said, "recordings": [{"file": "s", "sha256": "0" * 64}]}))
    update(catalogue, [tmp_path])
    (found,) = catalogue.find()
    assert found.verdict == ""
    assert "of another recording" in found.notes[0]


def test_only_what_changed_is_read_again(tmp_path, catalogue):
    first = filed(tmp_path / "lab" / "a")
    filed(tmp_path / "lab" / "b", session(seed=2))
    assert update(catalogue, [tmp_path / "lab"]).read == 2
    assert update(catalogue, [tmp_path / "lab"]).unchanged == 2
    (first / "results.json").write_text(json.dumps(results(k_c=7e6)))
    again = update(catalogue, [tmp_path / "lab"])
    assert (again.read, again.unchanged) == (1, 1)
    assert entries(catalogue)["a"].loads[0].contact_stiffness_n_per_m.value == 7e6


def test_the_same_answer_whatever_it_was_before(tmp_path, catalogue):
    """An index that grew, was kept through moves and was made anew says the same of what is there."""
    for number in range(3):
        filed(tmp_path / "lab" / f"s{number}", session(seed=number))
        update(catalogue, [tmp_path / "lab"])
    (tmp_path / "lab" / "s1").rename(tmp_path / "lab" / "moved")
    update(catalogue, [tmp_path / "lab"])
    with Catalogue(tmp_path / "anew.sqlite") as anew:
        update(anew, [tmp_path / "lab"])
        assert anew.find() == [e for e in catalogue.find() if e.state != "moved"]


def test_a_session_that_was_moved_or_is_gone_is_said_to_be(tmp_path, catalogue):
    for number in range(2):
        filed(tmp_path / "lab" / f"s{number}", session(seed=number))
    update(catalogue, [tmp_path / "lab"])
    (tmp_path / "lab" / "s0").rename(tmp_path / "elsewhere")
    shutil.rmtree(tmp_path / "lab" / "s1")
    done = update(catalogue, [tmp_path / "elsewhere", tmp_path / "lab"])
    assert (done.moved, done.gone) == (1, 1)
    assert (entries(catalogue)["s0"].state, entries(catalogue)["s0"].reason) == (
        "moved",
        f"was moved to {tmp_path / 'elsewhere'}",
    )
    assert entries(catalogue)["s1"].state == "gone"
    filed(tmp_path / "lab" / "s1", session(seed=1))
    update(catalogue, [tmp_path / "lab"])
    assert entries(catalogue)["s1"].state == "complete"


def test_a_folder_that_was_renamed_is_found_by_its_new_name_alone(tmp_path, catalogue):
    filed(tmp_path / "lab" / "s0")
    update(catalogue, [tmp_path / "lab"])
    (tmp_path / "lab").rename(tmp_path / "lab of 2026")
    update(catalogue, [tmp_path / "lab of 2026"])
    assert sorted(e.state for e in catalogue.find()) == ["complete", "moved"]


def test_other_formats_and_damaged_files_are_listed_with_the_reason(tmp_path, catalogue):
    folder = filed(tmp_path / "s1")
    for name, version in (("older.h5", 0), ("newer.h5", 2)):
        shutil.copy(folder / "session.h5", tmp_path / name)
        with h5py.File(tmp_path / name, "r+") as file:
            file.attrs["format_version"] = version
    content = (folder / "session.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: len(content) // 2])
    with h5py.File(tmp_path / "of-another-program.h5", "w") as file:
        file["data"] = np.zeros(3)
    done = update(catalogue, [tmp_path])
    found = entries(catalogue)
    assert {n: found[n].state for n in ("older.h5", "newer.h5", "cut.h5")} == {
        "older.h5": "other format",
        "newer.h5": "other format",
        "cut.h5": "damaged",
    }
    assert found["older.h5"].format == "mesotap-session 0"
    assert "this program reads 1" in found["older.h5"].reason
    assert "cut.h5" in found["cut.h5"].reason
    assert any("of-another-program.h5" in other for other in done.others)


def test_a_session_that_runs_is_listed_without_its_lock(tmp_path, catalogue):
    config = small_config("mesotap.specimen=brass")
    with SessionFolder.create(tmp_path / "lab" / "s", header_of(config)):
        update(catalogue, [tmp_path / "lab"])
    (found,) = catalogue.find()
    assert (found.state, found.specimen, found.reason) == ("unfinished", "brass", "goes on with connecting")


@pytest.mark.parametrize(
    "results_text", ["", "[]", '{"format": "mesotap-results", "version": 1, "loads": [{}]}', "[" * 9999]
)
def test_answers_that_are_none_are_said(tmp_path, catalogue, results_text):
    folder = filed(tmp_path / "s")
    (folder / "results.json").write_text(results_text)
    update(catalogue, [tmp_path])
    (found,) = catalogue.find()
    assert found.state == "complete"
    assert "is not the results of a session" in found.notes[0]


@pytest.mark.slow
def test_no_damage_of_a_folder_ends_an_update(tmp_path, sound, catalogue):
    place = tmp_path / "lab"
    harmless = {name: do for name, do in DAMAGES.items() if "permissions" not in name and "3 GB" not in name}
    for number, damage in enumerate(harmless.values()):
        damage(Path(shutil.copytree(sound / "unfinished", place / f"s{number:03d}")))
    update(catalogue, [place])
    found = [e for e in catalogue.find() if e.path.startswith(str(place / "s"))]
    assert len({e.path for e in found}) >= len(harmless)
    for one in found:
        assert one.state == "complete" or one.reason, one.path
    shutil.rmtree(place)


def _index(index: Path, folder: Path, rounds: int) -> None:
    for _ in range(rounds):
        with Catalogue(index) as catalogue:
            update(catalogue, [folder])
            assert catalogue.find()


def test_two_processes_index_and_read_at_once(tmp_path):
    for number in range(4):
        filed(tmp_path / "lab" / f"s{number}", session(seed=number))
    context = multiprocessing.get_context("fork")
    both = [context.Process(target=_index, args=(tmp_path / "i.sqlite", tmp_path / "lab", 3)) for _ in range(2)]
    for one in both:
        one.start()
    for one in both:
        one.join(120)
    assert [one.exitcode for one in both] == [0, 0]
    with Catalogue(tmp_path / "i.sqlite", read_only=True) as catalogue:
        assert len(catalogue.find()) == 4


def test_a_foreign_file_is_no_catalogue_and_stays(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(CatalogueError, match="is not a catalogue, and left as it is"):
        Catalogue(tmp_path / "notes.txt")
    assert (tmp_path / "notes.txt").read_text() == "mine"
    with sqlite3.connect(tmp_path / "other.db") as other:
        other.execute("CREATE TABLE mine (x)")
    other.close()
    with pytest.raises(CatalogueError, match="of another program"):
        Catalogue(tmp_path / "other.db")
    with pytest.raises(CatalogueError, match="is a folder"):
        Catalogue(tmp_path)


def test_a_damaged_catalogue_says_to_delete_it(tmp_path):
    with Catalogue(tmp_path / "i.sqlite") as catalogue:
        for number in range(3):
            filed(tmp_path / "lab" / f"s{number}", session(seed=number))
        update(catalogue, [tmp_path / "lab"])
    sound = (tmp_path / "i.sqlite").read_bytes()
    noise = [sound[:200] + random.Random(seed).randbytes(len(sound) - 200) for seed in range(20)]
    # SQLite quotes the name of what it cannot read
    quoted = sound.replace(b"tablesession", b"table\xff\xfession")
    quoted = quoted.replace(b"CREATE TABLE session", b"CREATE TABLX session")
    for content in (*noise, quoted):
        (tmp_path / "i.sqlite").write_bytes(content)
        with pytest.raises(CatalogueError, match="delete it"), Catalogue(tmp_path / "i.sqlite") as catalogue:
            catalogue.find()


def test_an_index_of_another_schema_is_made_anew(tmp_path):
    filed(tmp_path / "lab" / "s")
    with Catalogue(tmp_path / "i.sqlite") as catalogue:
        update(catalogue, [tmp_path / "lab"])
    database = sqlite3.connect(tmp_path / "i.sqlite")
    database.execute("PRAGMA user_version = 99")
    database.close()
    with pytest.raises(CatalogueError, match="another version"):
        Catalogue(tmp_path / "i.sqlite", read_only=True)
    with Catalogue(tmp_path / "i.sqlite") as catalogue:
        assert catalogue.find() == []


def test_a_folder_that_is_not_there_is_refused(tmp_path, catalogue):
    with pytest.raises(RecordingError, match="there is no such folder"):
        update(catalogue, [tmp_path / "nowhere"])


def test_a_file_by_itself_has_its_report_beside_it(tmp_path, catalogue):
    write_session(tmp_path / "run.h5", session())
    (tmp_path / "run-report").mkdir()
    (tmp_path / "run-report" / "results.json").write_text(json.dumps(results(k_c=8e6)))
    update(catalogue, [tmp_path])
    (found,) = catalogue.find()
    assert (found.name, found.answer) == ("run.h5", "run-report/results.json")
    assert found.loads[0].contact_stiffness_n_per_m.value == 8e6
