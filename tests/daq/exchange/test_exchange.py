from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from daq.errors import RecordingError
from daq.exchange import Recording, as_session, import_recording
from daq.session_file import read_session, write_session
from tests.daq.same import same

N = 400
RATE = 25600.0
TIME = np.arange(N) / RATE
A = np.where(TIME > 0.004, np.sin(2 * np.pi * 700 * (TIME - 0.004)), 0.0) + 1e-4 * np.cos(9e4 * TIME)
B = 0.9 * A


def csv(path: Path, rows: np.ndarray, delimiter: str = ",", header: str = "", decimal: str = ".") -> Path:
    text = "\n".join(delimiter.join(repr(float(v)).replace(".", decimal) for v in row) for row in rows)
    path.write_text(header + text + "\n")
    return path


def mat73(path: Path, arrays: dict[str, Any]) -> Path:
    with h5py.File(path, "w", userblock_size=512) as f:
        for name, value in arrays.items():
            if isinstance(value, str):
                codes = np.array([[ord(c)] for c in value], dtype=np.uint16)
                f[name] = codes
                f[name].attrs["MATLAB_class"] = np.bytes_("char")
            else:
                f[name] = np.atleast_2d(value)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def uff(path: Path, channels: list[np.ndarray], **changes: Any) -> Path:
    for number, data in enumerate(channels):
        block = pyuff.prepare_58(
            binary=0, func_type=1, rsp_node=number + 1, rsp_dir=3, ref_node=1, ref_dir=3,
            data=data, x=TIME[: len(data)], id1=f"acc{number}", ord_data_type=4,
            num_pts=len(data), abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1 / RATE, z_axis_value=0.0,
            abscissa_spec_data_type=17, ordinate_spec_data_type=12, ordinate_axis_units_lab="m/s^2",
            orddenom_spec_data_type=0,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(block | changes, "add" if number else "overwrite")
    return path


PLAIN = "time{0}left{0}right\n"
HEADERS = ["", PLAIN, "# rig 7\n# " + PLAIN, "My rig\n\n" + PLAIN + "s{0}m/s2{0}m/s2\n"]


@pytest.mark.parametrize(
    ("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("  ", ".")]
)
@pytest.mark.parametrize("header", HEADERS)
def test_csv_with_a_time_column(tmp_path: Path, delimiter: str, decimal: str, header: str) -> None:
    path = csv(tmp_path / "x.csv", np.c_[TIME, A, B], delimiter, header.format(delimiter), decimal)
    recording = import_recording(path)
    np.testing.assert_array_equal(recording.data, [A, B])
    assert recording.rate_hz == RATE
    assert recording.names == (("left", "right") if header else ("column2", "column3"))
    assert recording.unit == ("m/s2" if header.startswith("My") else "")
    assert recording.source == str(path)


def test_csv_without_times_takes_the_rate_given(tmp_path: Path) -> None:
    path = csv(tmp_path / "x.csv", np.c_[A, B])
    assert import_recording(path, rate_hz=1000.0).rate_hz == 1000.0
    with pytest.raises(RecordingError, match=r"says neither times nor a sampling rate: give the rate in Hz \(--rate\)"):
        import_recording(path)


@pytest.mark.parametrize("title", ["A (g)", "A [g]"])
def test_g_becomes_metres(tmp_path: Path, title: str) -> None:
    path = csv(tmp_path / "x.csv", np.c_[TIME * 1e3, A], ",", f"t (ms),{title}\n")
    recording = import_recording(path)
    np.testing.assert_allclose(recording.data[0], 9.80665 * A)
    assert (recording.unit, recording.names, recording.rate_hz) == ("m/s2", ("A",), RATE)


def test_a_unit_said_by_the_operator_wins(tmp_path: Path) -> None:
    recording = import_recording(csv(tmp_path / "x.csv", np.c_[TIME, A]), unit="g")
    np.testing.assert_allclose(recording.data[0], 9.80665 * A)


def test_times_rounded_by_their_writer_are_even(tmp_path: Path) -> None:
    time = np.round(np.arange(4000) / 51200, 6)
    path = csv(tmp_path / "x.csv", np.c_[time, np.resize(A, 4000)])
    assert import_recording(path).rate_hz == pytest.approx(51200, rel=1e-5)


@pytest.mark.parametrize("step", [5e-324, 4e-309])
def test_times_too_close_for_any_rate_are_refused(tmp_path: Path, step: float) -> None:
    rows = np.column_stack([np.arange(20) * step, A[:20], B[:20]])
    with pytest.raises(RecordingError, match=r"column time says a sampling rate of inf Hz"):
        import_recording(csv(tmp_path / "close.csv", rows, header="time,a,b\n"))


def test_numbers_that_overflow_when_they_are_tried_as_times_are_no_times(tmp_path: Path) -> None:
    rows = np.column_stack([1e307 * np.arange(-10, 10), A[:20], B[:20]])
    recording = import_recording(csv(tmp_path / "huge.csv", rows), rate_hz=1000.0)
    assert len(recording.names) == 3


def test_numbers_wider_than_doubles_are_refused_in_one_sentence(tmp_path: Path) -> None:
    wide = A.astype(np.longdouble)
    wide[3] = np.longdouble("1e4000")
    with pytest.raises(RecordingError, match="a") as refused:
        import_recording(mat73(tmp_path / "wide.mat", {"time": TIME, "a": wide}))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("channels", [["right", "left"], [1, 0], ["1", "0"]])
def test_channels_are_chosen_by_name_or_number(tmp_path: Path, channels: list[str | int]) -> None:
    path = csv(tmp_path / "x.csv", np.c_[TIME, A, B], ",", "time,left,right\n")
    recording = import_recording(path, channels=channels)
    assert recording.names == ("right", "left")
    np.testing.assert_array_equal(recording.data, [B, A])


def _structs() -> dict[str, Any]:
    return {"H": {"time": TIME[:, None], "acc1": A[:, None], "acc2": B[None, :], "units": "s, m/s^2"}, "note": "a"}


def test_mat_5_with_structs(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", _structs())
    recording = import_recording(tmp_path / "x.mat")
    np.testing.assert_array_equal(recording.data, [A, B])
    assert (recording.rate_hz, recording.names, recording.unit) == (RATE, ("acc1", "acc2"), "m/s2")


def test_mat_with_a_matrix_and_a_rate(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"fs": RATE, "y": np.c_[A, B]})
    recording = import_recording(tmp_path / "x.mat")
    np.testing.assert_array_equal(recording.data, [A, B])
    assert (recording.rate_hz, recording.names) == (RATE, ("y(0)", "y(1)"))


@pytest.mark.parametrize("compressed", [False, True])
def test_mat_5_of_any_kind_of_number(tmp_path: Path, compressed: bool) -> None:
    counts = np.round(1000 * A).astype(np.int16)
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = A.astype(np.float32), 7.0
    variables = {"t": TIME, "counts": counts, "cells": cells, "z": A + 1j * A}
    savemat(tmp_path / "x.mat", variables, do_compression=compressed)
    recording = import_recording(tmp_path / "x.mat", channels=["counts", "cells{0}"])
    np.testing.assert_array_equal(recording.data, [counts, A.astype(np.float32)])
    with pytest.raises(RecordingError, match="has no channel z"):
        import_recording(tmp_path / "x.mat", channels=["z"])


def test_mat_5_with_an_array_of_structs(tmp_path: Path) -> None:
    runs = np.array([(A,), (B,)], dtype=[("a", object)])
    savemat(tmp_path / "x.mat", {"runs": runs, "dt": 1 / RATE})
    recording = import_recording(tmp_path / "x.mat")
    np.testing.assert_array_equal(recording.data, [A, B])
    assert (recording.names, recording.rate_hz) == (("runs(0).a", "runs(1).a"), RATE)


def test_mat_73_with_a_group(tmp_path: Path) -> None:
    arrays = {"H/time": TIME, "H/acc1": A, "H/acc2": B[:, None], "H/units": "s, g", "#refs#/a": np.zeros(9999)}
    recording = import_recording(mat73(tmp_path / "x.mat", arrays))
    np.testing.assert_allclose(recording.data, 9.80665 * np.array([A, B]))
    assert (recording.rate_hz, recording.names, recording.unit) == (RATE, ("acc1", "acc2"), "m/s2")


def test_a_universal_file(tmp_path: Path) -> None:
    recording = import_recording(uff(tmp_path / "x.uff", [A, B]))
    np.testing.assert_allclose(recording.data, [A, B], atol=1e-11)
    assert recording.rate_hz == pytest.approx(RATE, rel=1e-5)
    assert (recording.names, recording.unit) == (("acc0", "acc1"), "m/s2")


# What goes wrong, and what is said


def _with(rows: np.ndarray, row: int, column: int, value: float) -> np.ndarray:
    rows = rows.copy()
    rows[row, column] = value
    return rows


TABLE = np.c_[TIME, A, B]
HEADER = "time,left,right\n"


@pytest.mark.parametrize(
    ("rows", "arguments", "message"),
    [
        (_with(TABLE, 17, 2, math.nan), {}, "channel right holds a NaN at sample 17"),
        (_with(TABLE, 17, 1, math.inf), {}, "channel left holds an infinite value at sample 17"),
        (_with(TABLE, 17, 0, math.nan), {}, "column time holds no number at sample 17"),
        (_with(TABLE, 17, 0, TIME[16]), {}, "column time is not evenly spaced: at sample 17 it steps by 0 s"),
        (np.delete(TABLE, 17, axis=0), {}, "column time is not evenly spaced: at sample 17 it steps by 7.8125e-05 s"),
        (TABLE, {"channels": ["top"]}, "has no channel top; it holds 0: left, 1: right"),
        (TABLE, {"channels": [2]}, "has no channel 2; it holds 0: left, 1: right"),
        (TABLE, {"channels": [-1]}, "has no channel -1"),
        (TABLE, {"channels": []}, "no channel was asked for"),
        (TABLE, {"rate_hz": 12800.0}, "contradictory: the rate given says 12800 Hz, column time 25600 Hz"),
        (TABLE, {"rate_hz": 0.0}, "the sampling rate given is 0 Hz, expected above 0"),
        (TABLE, {"rate_hz": -5.0}, "the sampling rate given is -5 Hz"),
        (TABLE, {"rate_hz": math.nan}, "the sampling rate given is nan Hz"),
        (TABLE[:9], {}, "holds only 9 lines of numbers, expected at least 16"),
        (TABLE[:, :1], {}, "no table of numbers|holds no channel"),
    ],
)
def test_a_faulty_csv_is_told_in_one_sentence(
    tmp_path: Path, rows: np.ndarray, arguments: dict[str, Any], message: str
) -> None:
    path = csv(tmp_path / "x.csv", rows, ",", HEADER if rows.shape[1] == 3 else "time\n")
    with pytest.raises(RecordingError, match=message) as caught:
        import_recording(path, **arguments)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def _insert(line: str) -> str:
    text = ["time,left,right"] + [",".join(map(repr, map(float, row))) for row in TABLE]
    return "\n".join([*text[:50], line, *text[50:]]) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (_insert("1,2,abc"), "line 51, column 3: 'abc' is not a number"),
        (_insert("1,,3"), "line 51, column 2: is empty"),
        (_insert("1,2"), "line 51 has 2 fields, expected 3"),
        (_insert("")[: _insert("").rindex(",")], "line 402 has 2 fields, expected 3; the file seems truncated"),
    ],
)
def test_a_damaged_line_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=message):
        import_recording(path)


PROSE = "Call me Ishmael. Some years ago, never mind how long, I had 1, 2 or\n3 reasons.\n1851\n" * 20


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.png", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "is not a recording but a PNG image"),
        ("x.csv", bytes(range(256)) * 4, "is not a recording"),
        ("x.txt", PROSE.encode(), "is not a recording: it holds no table of numbers"),
        ("x.csv", b"", "the file is empty"),
        ("x.csv", b"\n\n \n", "the file is empty"),
        ("x.mat", b"MATLAB 5.0 MAT-file, but not really", "is damaged, truncated, or no MAT file of version 5 or 7.3"),
        ("x.mat", PROSE.encode(), "is damaged, truncated, or no MAT file of version 5 or 7.3"),
        ("x.uff", b"    -1\n    58\nrubbish\n    -1\n", "is a damaged or truncated universal file"),
        ("x.uff", b"    -1\n    58\nrubbish\n", "is truncated: its last data set does not end"),
        ("x.uff", b"    -1\n   151\nrubbish\n    -1\n", "damaged|no time response"),
    ],
)
def test_what_is_no_recording_gets_one_sentence(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message) as caught:
        import_recording(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no such file"):
        import_recording(tmp_path / "none.csv")
    with pytest.raises(RecordingError, match="is a folder"):
        import_recording(tmp_path)


def test_a_mat_without_arrays(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"a": 3.0, "text": "abc"})
    with pytest.raises(RecordingError, match="it holds no array of at least 16 samples"):
        import_recording(tmp_path / "x.mat")


def test_a_mat_whose_rate_and_times_disagree(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"time": TIME, "a": A, "fs": 1000.0})
    with pytest.raises(RecordingError, match="contradictory: column time says 25600 Hz, its header 1000 Hz"):
        import_recording(tmp_path / "x.mat")


@pytest.mark.parametrize("fraction", [0.05, 0.3, 0.7, 0.97])
@pytest.mark.parametrize("kind", ["mat", "mat73", "uff"])
def test_a_truncated_file_is_told(tmp_path: Path, kind: str, fraction: float) -> None:
    path = tmp_path / "x.bin"
    if kind == "mat":
        path = tmp_path / "x.mat"
        savemat(path, {"time": TIME, "a": A})
    elif kind == "mat73":
        mat73(path, {"time": TIME, "a": A})
    else:
        uff(path, [A])
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * fraction)])
    with pytest.raises(RecordingError, match=r"truncated|no array|is not an HDF5 file"):
        import_recording(path)


def test_a_session_file_is_not_imported(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    write_session(path, as_session(Recording(np.array([A, B]), RATE, ("a", "b"), "m/s2", str(path))))
    with pytest.raises(RecordingError, match="is a session file already"):
        import_recording(path)


# As a session


def test_a_recording_becomes_a_session_of_one_impact(tmp_path: Path) -> None:
    recording = Recording(np.array([A, 2 * A, B]), RATE, ("a", "hammer", "b"), "m/s2", str(tmp_path / "x.csv"))
    session = as_session(recording, channels=("a", "b"))
    (impact,) = session.impacts
    np.testing.assert_array_equal(impact.acceleration, [A, B])
    assert impact.channels is not None
    np.testing.assert_array_equal(impact.channels, recording.data)
    assert impact.channel_names == ("a", "hammer", "b")
    assert impact.pretrigger == 103  # the first sample after 4 ms
    assert math.isnan(impact.target_load_mn)
    assert not session.rig.is_tester
    write_session(tmp_path / "x.h5", session)
    assert same(read_session(tmp_path / "x.h5").impacts, session.impacts)


def test_one_channel_is_not_enough() -> None:
    with pytest.raises(RecordingError, match=r"x\.csv: has only one channel \(a\), two are needed"):
        as_session(Recording(A[None, :], RATE, ("a",), "", "x.csv"))


@pytest.mark.parametrize(("channels", "message"), [((0, 0), "two different"), (("a", "c"), "has no channel c")])
def test_two_different_channels_that_are_there_are_needed(channels: tuple[str | int, ...], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        as_session(Recording(np.array([A, B]), RATE, ("a", "b"), "", "x.csv"), channels)


# Fuzzing: a recording or a sentence, nothing else

FUZZ = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def recording_or_sentence(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        recording = import_recording(path, rate_hz=None)
    except RecordingError as error:
        if "\n" in str(error) or not str(error).startswith(str(path)):
            raise AssertionError(str(error)) from error
    else:
        assert np.isfinite(recording.data).all()
        assert recording.rate_hz > 0


@FUZZ
@given(
    start=st.sampled_from([b"", b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n\x1a\n", b"    -1\n    58\n", b"1,2\n"]),
    content=st.binary(max_size=600),
    suffix=st.sampled_from([".csv", ".mat", ".uff"]),
)
def test_any_bytes(tmp_path: Path, start: bytes, content: bytes, suffix: str) -> None:
    recording_or_sentence(tmp_path / f"x{suffix}", start + content)


CELL = st.one_of(st.floats().map(repr), st.integers(-9, 9).map(str), st.text(max_size=5), st.just(""))


@pytest.mark.slow
@FUZZ
@given(rows=st.lists(st.lists(CELL, min_size=1, max_size=3), max_size=40), delimiter=st.sampled_from(",;\t "))
def test_any_table(tmp_path: Path, rows: list[list[str]], delimiter: str) -> None:
    recording_or_sentence(tmp_path / "x.csv", "\n".join(map(delimiter.join, rows)).encode())


@pytest.mark.slow
@FUZZ
@given(values=st.lists(st.floats(), min_size=32, max_size=60), title=st.text(max_size=12))
def test_any_numbers(tmp_path: Path, values: list[float], title: str) -> None:
    rows = [f"{a!r},{b!r}" for a, b in zip(values[::2], values[1::2], strict=False)]
    recording_or_sentence(tmp_path / "x.csv", "\n".join([f"time,{title}", *rows]).encode())


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("valid")
    savemat(folder / "plain.mat", {"H": {"time": TIME[:50], "a": A[:50], "units": "s, g"}})
    savemat(folder / "packed.mat", {"time": TIME, "a": A}, do_compression=True)
    mat73(folder / "new.mat", {"time": TIME[:50], "a": A[:50]})
    uff(folder / "x.uff", [A[:50], B[:50]])
    csv(folder / "x.csv", TABLE[:50], ",", HEADER)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.slow
@settings(FUZZ, max_examples=250)
@given(
    name=st.sampled_from(["plain.mat", "packed.mat", "new.mat", "x.uff", "x.csv"]),
    changes=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=4)), max_size=4),
    cut=st.floats(0, 1) | st.just(1.0),
)
def test_any_damage(
    tmp_path: Path, valid: dict[str, bytes], name: str, changes: list[tuple[float, bytes]], cut: float
) -> None:
    content = bytearray(valid[name])
    for where, what in changes:
        at = int(where * (len(content) - 1))
        content[at : at + len(what)] = what
    recording_or_sentence(tmp_path / name, bytes(content[: int(cut * len(content))]))


@pytest.mark.data
def test_the_beam_recording(recordings: Path) -> None:
    recording = import_recording(recordings / "brake-reuss-beam" / "HammerImpact.mat")
    assert recording.data.shape == (3, 65536)
    assert (recording.rate_hz, recording.names, recording.unit) == (12800.0, ("acc1", "acc2", "acc3"), "m/s2")


@pytest.mark.data
def test_the_silverbox_recording(recordings: Path) -> None:
    path = recordings / "silverbox" / "SNLS80mV.csv"
    recording = import_recording(path, rate_hz=610.35)
    assert recording.data.shape == (2, 131072)
    np.testing.assert_array_equal(recording.data[:, 0], [0.0057756, 0.0093978])
    with pytest.raises(RecordingError, match="give the rate in Hz"):
        import_recording(path)
