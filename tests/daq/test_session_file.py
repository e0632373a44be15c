from __future__ import annotations

import contextlib
import errno
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daq.errors import RecordingError
from daq.records import RigDescription, Session, ZeroReading
from daq.session_file import read_session, write_session
from rig.hardware_log import Repetition

from .same import same


@pytest.fixture
def file(tmp_path: Path, session: Session) -> Path:
    path = tmp_path / "case.h5"
    write_session(path, session)
    return path


def test_a_session_comes_back_as_it_was_written(file: Path, session: Session) -> None:
    assert same(read_session(file), replace(session, source=str(file)))


def _timed(session: Session, seconds: list[float]) -> Session:
    assert session.pre is not None
    return replace(session, pre=replace(session.pre, elapsed_s=np.array(seconds)))


def test_times_of_a_calibration_come_back(tmp_path: Path, session: Session) -> None:
    assert session.pre is not None
    timed = _timed(session, [1.5 * i for i in range(session.pre.load_mn.size)])
    write_session(tmp_path / "timed.h5", timed)
    assert same(read_session(tmp_path / "timed.h5"), replace(timed, source=str(tmp_path / "timed.h5")))


@pytest.mark.parametrize(
    ("change", "fault"),
    [(lambda t: t[1:], "values for"), (lambda t: -t, "onwards"), (lambda t: t * 1e9, "two days")],
    ids=["too few", "backwards", "years"],
)
def test_times_of_a_calibration_that_cannot_be_are_refused(
    tmp_path: Path, session: Session, change: Callable[[Any], Any], fault: str
) -> None:
    assert session.pre is not None
    good = _timed(session, [float(i) for i in range(session.pre.load_mn.size)])
    write_session(tmp_path / "bad.h5", good)
    with h5py.File(tmp_path / "bad.h5", "r+") as stored:
        changed = change(stored["calibration/pre/elapsed_s"][()])
        del stored["calibration/pre/elapsed_s"]
        stored["calibration/pre/elapsed_s"] = changed
    with pytest.raises(RecordingError, match=fault):
        read_session(tmp_path / "bad.h5")
    with pytest.raises(RecordingError, match=fault):
        write_session(tmp_path / "never.h5", _timed(session, changed.tolist()))


def test_a_session_without_calibration_strain_or_rig_comes_back(tmp_path: Path, session: Session) -> None:
    bare = replace(session, pre=None, rig=RigDescription(filter_family=""), impacts=session.impacts[:1], config="")
    path = tmp_path / "bare.h5"
    write_session(path, bare)
    assert same(read_session(path), replace(bare, source=str(path)))


def test_tube_springs_in_the_masses_come_back_and_leave_no_trace_where_there_are_none(
    tmp_path: Path, session: Session
) -> None:
    tubes = replace(session.rig, tube_added_kg=0.0027, tube_mode_kg=0.0013, tube_mode_hz=6078.0)
    write_session(tmp_path / "tubes.h5", replace(session, rig=tubes))
    assert read_session(tmp_path / "tubes.h5").rig == tubes
    write_session(tmp_path / "none.h5", session)
    with h5py.File(tmp_path / "none.h5") as file:
        assert not [name for name in file["rig"].attrs if name.startswith("tube")]


def test_channels_of_another_rig_come_back(tmp_path: Path, session: Session) -> None:
    channels = np.arange(900.0).reshape(3, 300)
    impact = replace(session.impacts[0], channels=channels, channel_names=("acc1", "acc2", "hammer µ"))
    path = tmp_path / "other.h5"
    write_session(path, replace(session, impacts=(impact,)))
    assert same(read_session(path).impacts[0], impact)


def test_a_hammers_force_comes_back_and_leaves_no_trace_where_there_is_none(tmp_path: Path, session: Session) -> None:
    samples = session.impacts[0].acceleration.shape[1]
    impact = replace(session.impacts[0], force=np.linspace(-1.0, 2.0, samples))
    write_session(tmp_path / "hammer.h5", replace(session, impacts=(impact,)))
    assert same(read_session(tmp_path / "hammer.h5").impacts[0], impact)
    with h5py.File(tmp_path / "hammer.h5") as file:
        assert file["impacts/00000/force"].attrs["units"] == "N"
    write_session(tmp_path / "none.h5", session)
    with h5py.File(tmp_path / "none.h5") as file:
        assert "force" not in file["impacts/00000"]


def test_an_altered_force_is_told(tmp_path: Path, session: Session) -> None:
    samples = session.impacts[0].acceleration.shape[1]
    path = tmp_path / "hammer.h5"
    write_session(path, replace(session, impacts=(replace(session.impacts[0], force=np.ones(samples)),)))
    with h5py.File(path, "r+") as file:
        file["impacts/00000/force"][3] = 2.0
    with pytest.raises(RecordingError, match="were altered"):
        read_session(path)


@pytest.mark.parametrize("units", [None, "lbf"])
def test_what_another_program_keeps_under_that_name_is_no_force(tmp_path: Path, session: Session, units) -> None:
    path = tmp_path / "other.h5"
    write_session(path, replace(session, impacts=session.impacts[:1]))
    with h5py.File(path, "r+") as file:
        data = file["impacts/00000"].create_dataset("force", data=np.ones(7))
        if units is not None:
            data.attrs["units"] = units
    assert read_session(path).impacts[0].force is None


def test_a_force_of_another_length_is_refused(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "other.h5"
    with pytest.raises(RecordingError, match=r"/force has shape"):
        write_session(path, replace(session, impacts=(replace(session.impacts[0], force=np.ones(3)),)))
    write_session(path, replace(session, impacts=session.impacts[:1]))
    with h5py.File(path, "r+") as file:
        file["impacts/00000"].create_dataset("force", data=np.ones(7)).attrs["units"] = "N"
    with pytest.raises(RecordingError, match="force"):
        read_session(path)


def test_extra_beyond_an_attribute_comes_back(tmp_path: Path, session: Session) -> None:
    impact = replace(session.impacts[0], extra={"state": list(range(30_000))})
    path = tmp_path / "big.h5"
    write_session(path, replace(session, impacts=(impact,)))
    assert read_session(path).impacts[0].extra == impact.extra


def test_a_written_file_keeps_format_1(file: Path) -> None:
    with h5py.File(file) as f:
        assert (f.attrs["format"], f.attrs["format_version"], bool(f.attrs["complete"])) == ("mesotap-session", 1, True)
        assert f["config"].shape == ()
        assert set(f) >= {"config", "rig", "impacts", "calibration"}
        group = f["impacts/00003"]
        assert group["acceleration"].attrs["units"] == "m/s2"
        assert group["acceleration"].dtype == np.float64
        assert group["acceleration"].compression == "gzip"
        assert group.attrs["reject_reason"] == "too weak; noisy – µ"


def test_an_unwritable_session_is_refused_before_a_file_appears(tmp_path: Path, session: Session) -> None:
    bad = session.impacts[1].acceleration.copy()
    bad[0, 17] = np.nan
    broken = replace(session, impacts=(replace(session.impacts[1], acceleration=bad),))
    with pytest.raises(RecordingError, match=r"/impacts/00003/acceleration holds a NaN at channel A, sample 17"):
        write_session(tmp_path / "x.h5", broken)
    assert list(tmp_path.iterdir()) == []


def _delete(name: str) -> Callable[[h5py.File], None]:
    def change(f: h5py.File) -> None:
        del f[name]

    return change


def _replace(name: str, data: Any, **attributes: Any) -> Callable[[h5py.File], None]:
    def change(f: h5py.File) -> None:
        del f[name]
        f[name] = data
        f[name].attrs.update(attributes)

    return change


def _attribute(name: str, key: str, value: Any = None) -> Callable[[h5py.File], None]:
    def change(f: h5py.File) -> None:
        if value is None:
            del f[name].attrs[key]
        else:
            f[name].attrs[key] = value

    return change


def _nan(f: h5py.File) -> None:
    f["impacts/00003/acceleration"][1, 5] = np.nan


I3 = "impacts/00003"
A3 = f"{I3}/acceleration"
RECORD_FAULTS = [
    (_nan, "/impacts/00003/acceleration holds a NaN at channel B, sample 5"),
    (_delete(A3), "/impacts/00003/acceleration is missing"),
    (_replace(I3, 3), "/impacts/00003 is not a group"),
    (_replace(A3, np.zeros((3, 9)), units="m/s2"), r"acceleration has shape \(3, 9\), expected \(2, n\)"),
    (_replace(A3, np.zeros(9), units="m/s2"), r"acceleration has shape \(9,\), expected \(2, n\)"),
    (_replace(A3, np.zeros((2, 0)), units="m/s2"), "acceleration is empty"),
    (_replace(A3, np.zeros((2, 9), int), units="m/s2"), "acceleration is not an array of floating-point numbers"),
    (_replace(A3, b"abc", units="m/s2"), "acceleration is not an array"),
    (_attribute(A3, "units", "g"), "units are 'g', expected 'm/s2'"),
    (_attribute(A3, "units"), "units are None, expected 'm/s2'"),
    (_replace(f"{I3}/strain_mv", np.zeros(7)), r"strain_mv has shape \(7,\), expected \(300,\)"),
    (_attribute(I3, "pretrigger", 300), "pretrigger 300 lies outside the 300 samples"),
    (_attribute(I3, "pretrigger", -1), "attribute pretrigger of /impacts/00003 is -1"),
    (_attribute(I3, "pretrigger", 2.5), "pretrigger of /impacts/00003 is 2.5, expected a whole number"),
    (_attribute(I3, "sample_rate_hz", 0.0), "sample_rate_hz of /impacts/00003 is 0, expected above 0"),
    (_attribute(I3, "sample_rate_hz", np.nan), "sample_rate_hz is NaN"),
    (_attribute(I3, "sample_rate_hz", "fast"), "sample_rate_hz of /impacts/00003 is not a number but 'fast'"),
    (_attribute(I3, "sample_rate_hz", 12500.0), "sample_rate_hz is 12500 but /rig says 25000"),
    (_attribute(I3, "load_set"), "attribute load_set of /impacts/00003 is missing"),
    (_attribute(I3, "load_set", -2), "load_set of /impacts/00003 is -2"),
    (_attribute(I3, "target_load_mn", np.inf), "target_load_mn of /impacts/00003 is infinite"),
    (_attribute(I3, "accepted", "yes"), "accepted of /impacts/00003 is neither true nor false"),
    (_attribute(I3, "time", "yesterday"), "time of /impacts/00003 is 'yesterday', not an ISO 8601 date"),
    (_attribute(I3, "reject_reason", 4), "reject_reason of /impacts/00003 is not text"),
    (lambda f: f.move("impacts/00003", "impacts/3"), "/impacts/3: an impact's name has five digits"),
]
FAULTS = [
    (_delete("config"), "/config is missing"),
    (_delete("rig"), "/rig is missing"),
    (_delete("impacts"), "/impacts is missing"),
    (_delete("calibration/pre/voltage_mv"), "/calibration/pre/voltage_mv is missing"),
    (_replace("config", [1, 2]), "/config is not a scalar string"),
    (_replace("rig", 3), "/rig is not a group"),
    (_attribute("/", "format", "other"), "is not a session file"),
    (_attribute("/", "format"), "is not a session file"),
    (_attribute("/", "format_version", 2), "format_version of / is 2, this program reads 1"),
    (_attribute("/", "complete"), "attribute complete of / is missing"),
    (_attribute("/", "operator", 3), "attribute operator of / is not text"),
    (_attribute("/", "created", "noon"), "created of / is 'noon', not an ISO 8601 date"),
    (_attribute("rig", "m1_kg", -0.1), "attribute m1_kg of /rig is -0.1, expected above 0"),
    (_attribute("rig", "k2_n_per_m", "stiff"), "attribute k2_n_per_m of /rig is not a number"),
    (_attribute("rig", "filter_family", "bessel"), "filter_family is 'bessel'"),
    (_attribute("rig", "m1_kg", [0.1, 0.2]), "attribute m1_kg of /rig is not a number"),
    (_replace("calibration/pre/load_mn", [1.0, 2.0]), "load_mn has 2 values but voltage_mv has 3"),
    (_attribute("calibration/pre", "time"), "attribute time of /calibration/pre is missing"),
]


@pytest.mark.parametrize(("fault", "message"), FAULTS)
def test_a_fault_is_named(file: Path, fault: Callable[[h5py.File], None], message: str) -> None:
    with h5py.File(file, "r+") as f:
        fault(f)
    with pytest.raises(RecordingError, match=message) as caught:
        read_session(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("fault", "message"), RECORD_FAULTS)
def test_a_record_with_a_fault_is_named_and_left_out(
    file: Path, session: Session, fault: Callable[[h5py.File], None], message: str
) -> None:
    with h5py.File(file, "r+") as f:
        fault(f)
    found = read_session(file)
    (said,) = found.refused
    assert re.search(message, said)
    assert said.endswith("; this record is left out")
    assert "\n" not in said
    assert same(found, replace(session, impacts=session.impacts[:1], source=str(file), refused=found.refused))


@pytest.mark.parametrize(("fault", "message"), RECORD_FAULTS)
def test_a_file_whose_only_record_has_a_fault_is_refused(
    file: Path, fault: Callable[[h5py.File], None], message: str
) -> None:
    with h5py.File(file, "r+") as f:
        del f["impacts/00000"]
        fault(f)
    with pytest.raises(RecordingError, match=message) as caught:
        read_session(file)
    assert str(caught.value).startswith(f"{file}: ")


def test_a_file_of_records_with_faults_is_refused_by_the_first(file: Path) -> None:
    with h5py.File(file, "r+") as f:
        f["impacts/00000"].attrs["pretrigger"] = -3
        f[A3][1, 5] = np.nan
    with pytest.raises(RecordingError, match=r"/impacts/00000 is -3, .*; nor can any of its 1 other records be read$"):
        read_session(file)


def test_a_rate_that_most_records_contradict_is_the_headers_fault(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "rates.h5"
    rates = (25000.0, 12500.0, 12500.0, 25000.0)
    impacts = [replace(session.impacts[0], number=n, sample_rate_hz=rate) for n, rate in enumerate(rates)]
    write_session(path, replace(session, impacts=tuple(impacts)))
    found = read_session(path)
    assert [i.number for i in found.impacts] == [0, 3]
    assert len(found.refused) == 2
    write_session(path, replace(session, impacts=tuple(impacts[:3])))
    with pytest.raises(RecordingError, match="/impacts/00001: sample_rate_hz is 12500 but /rig says 25000"):
        read_session(path)


def test_of_many_faults_the_first_ten_are_named_and_the_others_counted(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "many.h5"
    impacts = tuple(replace(session.impacts[0], number=n) for n in range(14))
    write_session(path, replace(session, impacts=impacts))
    with h5py.File(path, "r+") as f:
        for n in range(1, 14):
            f[f"impacts/{n:05d}"].attrs["pretrigger"] = -1
    found = read_session(path)
    assert [i.number for i in found.impacts] == [0]
    assert len(found.refused) == 11
    assert found.refused[-1] == "3 more records cannot be read and are left out"


def test_a_record_in_which_nothing_changes_is_named_and_left_out(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "still.h5"
    tap = replace(session.impacts[0], accepted=True, reject_reason="")
    still = replace(tap, number=1, acceleration=np.full_like(tap.acceleration, 3.0))
    write_session(path, replace(session, impacts=(tap, still)))
    found = read_session(path)
    assert [i.number for i in found.impacts] == [0]
    said = "/impacts/00001/acceleration: constant throughout, so that no tap was recorded; this record is left out"
    assert found.refused == (said,)
    write_session(path, replace(session, impacts=(still,)))
    assert [i.number for i in read_session(path).impacts] == [1]  # told of the whole session by what analyses it


def test_a_shape_too_large_to_be_true_is_refused_without_reading_it(file: Path) -> None:
    with h5py.File(file, "r+") as f:
        del f[A3]
        f.create_dataset(A3, (2, 10**12), dtype="f8", chunks=(2, 1024)).attrs["units"] = "m/s2"
    with pytest.raises(RecordingError, match="/impacts/00003"):
        read_session(file)


def test_a_record_that_is_anothers_has_the_whole_file_in_doubt(file: Path) -> None:
    with h5py.File(file, "r+") as f:
        del f[A3]
        f[A3] = f["impacts/00000/acceleration"]
    with pytest.raises(RecordingError, match="is the same as another item"):
        read_session(file)


def test_attributes_as_other_programs_write_them_are_read(file: Path) -> None:
    with h5py.File(file, "r+") as f:
        f.attrs["operator"] = np.bytes_("N. N.")
        f.attrs["format"] = np.array(["mesotap-session"], dtype=h5py.string_dtype())
        f.attrs["complete"] = np.uint8(1)
        f.attrs["title"] = h5py.Empty("S1")
        f[I3].attrs["pretrigger"] = np.array([50.0])
        f[A3].attrs["units"] = np.bytes_("m/s2")
        for name in ("bits", "m1_kg", "filter_family"):
            del f["rig"].attrs[name]
        f["notes"] = "anything"
        f["impacts"].create_group("summary")
        f[I3].attrs["extra"] = "no JSON"
    session = read_session(file)
    assert (session.operator, session.complete, session.title, session.rig.bits) == ("N. N.", True, "", 0)
    assert session.impacts[1].pretrigger == 50
    assert np.isnan(session.rig.m1_kg)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: None, "there is no such file"),
        (lambda p: p.mkdir(), "is a folder"),
        (lambda p: p.write_bytes(b""), "the file is empty"),
        (lambda p: p.write_text("Dear Sir,"), "is not an HDF5 file"),
    ],
)
def test_what_is_no_session_file_gets_one_sentence(
    tmp_path: Path, make: Callable[[Path], object], message: str
) -> None:
    path = tmp_path / "x.h5"
    make(path)
    with pytest.raises(RecordingError, match=message):
        read_session(path)


def test_a_truncated_file_is_refused(file: Path) -> None:
    content = file.read_bytes()
    for fraction in (0.1, 0.5, 0.9, 0.999):
        file.write_bytes(content[: int(len(content) * fraction)])
        with pytest.raises(RecordingError, match="damaged or truncated"):
            read_session(file)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(where=st.integers(0, 10**6), what=st.binary(min_size=1, max_size=8))
def test_a_damaged_file_is_read_or_refused_in_one_sentence(
    tmp_path: Path, session: Session, where: int, what: bytes
) -> None:
    path = tmp_path / "fuzz.h5"
    write_session(path, session)
    content = bytearray(path.read_bytes())
    where %= len(content)
    content[where : where + len(what)] = what
    path.write_bytes(content)
    with contextlib.suppress(RecordingError):
        read_session(path)


def test_a_damaged_heap_is_refused_before_the_library_loops_in_it(tmp_path: Path) -> None:
    path = tmp_path / "old.h5"
    with h5py.File(path, "w") as f:
        f.attrs["format"] = "mesotap-session"
    content = bytearray(path.read_bytes())
    heap = content.find(b"GCOL")
    content[heap + 24 : heap + 32] = b"\xff" * 8
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged or truncated"):
        read_session(path)


def test_a_damaged_heap_is_refused_where_its_padding_is_damaged_too(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "heap.h5"
    write_session(path, session)
    content = bytearray(path.read_bytes())
    heap = content.find(b"GCOL")
    content[heap + 7] = 1
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged or truncated"):
        read_session(path)


def test_samples_that_look_like_a_damaged_heap_are_samples(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "look.h5"
    impact = session.impacts[0]
    samples = impact.acceleration.copy()
    samples[0, 3] = np.frombuffer(b"GCOL\x01\x01@@")[0]
    write_session(path, replace(session, impacts=(replace(impact, acceleration=samples),)))
    with h5py.File(path, "r+") as f:
        data = f["impacts"][impact.name]["acceleration"][()]
        del f["impacts"][impact.name]["acceleration"]
        f["impacts"][impact.name]["acceleration"] = data
        f["impacts"][impact.name]["acceleration"].attrs["units"] = "m/s2"
    assert b"GCOL\x01\x01" in path.read_bytes()
    assert read_session(path).impacts[0].acceleration[0, 3] == samples[0, 3]


def test_a_text_longer_than_its_file_is_refused_before_room_is_made_for_it(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "long.h5"
    write_session(path, session)
    with h5py.File(path) as f:
        length = f["config"].id.get_offset()
    with path.open("r+b") as file:
        file.seek(length)
        file.write(b"\xff\xff\xff\xef")
    with pytest.raises(RecordingError, match="/config is damaged: it claims to be longer than the file"):
        read_session(path)


def test_an_old_attribute_longer_than_its_file_is_refused_before_room_is_made_for_it(tmp_path: Path) -> None:
    path = tmp_path / "old.h5"
    with h5py.File(path, "w") as f:
        f.attrs["format"] = "mesotap-session"
        f.attrs["format_version"] = 1
        f.attrs["created"] = "a text"
    content = bytearray(path.read_bytes())
    length = content.find((6).to_bytes(4, "little") + content.find(b"GCOL").to_bytes(8, "little"))
    content[length : length + 4] = b"\xff\xff\xff\xef"
    path.write_bytes(content)
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    with pytest.raises(RecordingError, match="is damaged: it needs more memory than a file of its size may"):
        read_session(path)
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss < before + 1_000_000  # kB


@pytest.mark.parametrize(("number", "message"), [(errno.ENOSPC, "the disk is full"), (errno.EROFS, "is read-only")])
def test_a_write_that_fails_leaves_the_old_file(
    file: Path, session: Session, monkeypatch: pytest.MonkeyPatch, number: int, message: str
) -> None:
    before = file.read_bytes()

    def fail(descriptor: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(RecordingError, match=message):
        write_session(file, replace(session, title="new"))
    assert file.read_bytes() == before
    assert [p.name for p in file.parent.iterdir()] == ["case.h5"]


def test_a_full_disk_is_told_in_a_sentence(file: Path, session: Session) -> None:
    """A real limit on the size of files stands for the full disk."""
    code = (
        "import resource, signal, sys\n"
        "from daq.session_file import read_session, write_session\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "session = read_session(sys.argv[1])\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "try:\n    write_session(sys.argv[1], session)\n"
        "except ValueError as error:\n    print(type(error).__name__, error)\n"
    )
    before = file.read_bytes()
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, text=True, cwd=root, check=True)
    assert (
        done.stdout == f"UnwrittenError {file}: cannot be written: it would grow beyond the largest file allowed here\n"
    )
    assert file.read_bytes() == before


def test_a_missing_folder_is_told_in_a_sentence(tmp_path: Path, session: Session) -> None:
    with pytest.raises(RecordingError, match="the folder does not exist"):
        write_session(tmp_path / "none" / "x.h5", session)


@pytest.mark.slow
@pytest.mark.data
def test_the_practice_sessions_load(recordings: Path) -> None:
    files = sorted((recordings / "concealed-practice").glob("*.h5"))
    assert len(files) == 44
    for file in files:
        session = read_session(file)
        assert session.impacts
        assert all(impact.acceleration.dtype == np.float64 for impact in session.impacts)


@pytest.mark.data
def test_a_practice_session_survives_a_round_trip(recordings: Path, tmp_path: Path) -> None:
    session = read_session(recordings / "concealed-practice" / "case-007.h5")
    write_session(tmp_path / "copy.h5", session)
    assert same(read_session(tmp_path / "copy.h5"), replace(session, source=str(tmp_path / "copy.h5")))


def test_an_impact_that_was_altered_is_named_and_left_out(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "session.h5"
    write_session(file, session)
    with h5py.File(file, "r+") as opened:
        opened["impacts/00003/acceleration"][0, 0] += 1e-9
    found = read_session(file)
    assert "/impacts/00003: the samples or numbers of impact 00003 were altered" in found.refused[0]
    assert [impact.number for impact in found.impacts] == [0]


def test_what_had_to_be_repeated_comes_back(session: Session, tmp_path: Path) -> None:
    kept = (Repetition("stage", "a question was asked again", 7, "2026-01-01T00:00:01Z", "2026-01-01T00:09:00Z"),)
    for hardware in (None, (), kept):
        write_session(tmp_path / "session.h5", replace(session, hardware=hardware))
        assert read_session(tmp_path / "session.h5").hardware == hardware


@pytest.mark.parametrize("theirs", ["good", "{}", "[1]", '[{"device": "a", "what": "b", "count": "c"}]', 5])
def test_what_another_program_calls_hardware_is_no_fault(session: Session, tmp_path: Path, theirs: object) -> None:
    write_session(tmp_path / "session.h5", session)
    with h5py.File(tmp_path / "session.h5", "r+") as file:
        file.attrs["hardware"] = theirs
    assert read_session(tmp_path / "session.h5").hardware is None


def test_readings_without_load_come_back(session: Session, tmp_path: Path) -> None:
    zeros = (ZeroReading(0.35, "2026-01-01T10:00:00Z"), ZeroReading(0.36, "2026-01-01T11:00:00Z"))
    write_session(tmp_path / "session.h5", replace(session, zeros=zeros))
    assert read_session(tmp_path / "session.h5").zeros == zeros


@pytest.mark.parametrize("theirs", ["no JSON", "[1]", '[{"voltage_mv": "a", "time": 3}]', '{"voltage_mv": 1}'])
def test_what_another_program_calls_zero_readings_is_no_fault(session: Session, tmp_path: Path, theirs: str) -> None:
    write_session(tmp_path / "session.h5", session)
    with h5py.File(tmp_path / "session.h5", "r+") as file:
        file.attrs["zero_readings"] = theirs
    assert read_session(tmp_path / "session.h5").zeros == ()
