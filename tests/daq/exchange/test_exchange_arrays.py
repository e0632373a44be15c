"""What MAT, HDF5 and universal files say of rates, times and units, and what of them is not a channel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
from scipy.io import savemat

from daq.errors import RecordingError
from daq.exchange import as_session, import_recording

N = 2048
T = np.arange(N) / 1000
A = np.exp(-5 * T) * np.sin(2 * np.pi * 60 * T)
B = 0.7 * A


def mat(folder: Path, **variables: Any) -> Path:
    savemat(folder / "x.mat", variables)
    return folder / "x.mat"


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"fs": 1000.0, "dt": 0.5}, "the sampling rate is contradictory: fs says 1000 Hz, dt 2 Hz"),
        ({"r": {"fs": 1000.0}, "s": {"fs": 2000.0}}, "is contradictory: r.fs says 1000 Hz, s.fs 2000 Hz"),
        ({"fs_khz": 1.0, "rate": 1.0}, "is contradictory: fs_khz says 1000 Hz, rate 1 Hz"),
        ({"fs": np.array([1000.0, 2000.0])}, "fs holds 2 values, expected one sampling rate"),
        ({"fs": 1000.0 + 1j}, "fs is complex, expected a real sampling rate"),
        ({"t": T, "time": T + 5}, "t and time are both times, and they differ"),
        ({"t": T, "units": "ticks,g"}, "the unit 'ticks' of the times in t is not known"),
        ({"t": T[::-1]}, "column t runs backwards: at sample 1 it steps by -0.001 s"),
    ],
)
def test_what_a_mat_file_says_of_its_rate_is_one_thing(tmp_path: Path, variables: dict[str, Any], message: str) -> None:
    with pytest.raises(RecordingError, match=message.replace("(", r"\(")):
        import_recording(mat(tmp_path, a=A, b=B, **variables))


def test_two_words_for_one_rate_are_no_contradiction(tmp_path: Path) -> None:
    assert import_recording(mat(tmp_path, a=A, b=B, fs=1000.0, dt=0.001, t_ms=1e3 * T)).rate_hz == 1000.0


def test_units_of_time_in_a_mat_file_are_converted(tmp_path: Path) -> None:
    recording = import_recording(mat(tmp_path, time=1e3 * T, a=A, b=B, units="msec,g"))
    assert (recording.rate_hz, recording.unit) == (1000.0, "m/s2")


@pytest.mark.parametrize(
    ("odd", "what"),
    [(A + 0j, "complex"), (A[:-1], "2047 samples, not 2048"), (np.ones((2, N, 3)), "2 by 2048 by 3 values")],
)
def test_what_is_left_out_is_told_and_nothing_takes_its_place(tmp_path: Path, odd: np.ndarray, what: str) -> None:
    path = mat(tmp_path, fs=1000.0, a=odd, b=B, c=A)
    recording = import_recording(path)
    assert recording.left_out == (f"a ({what})",)
    with pytest.raises(RecordingError, match=rf"a \({what}\): name A and B with --channel, of b, c"):
        as_session(recording)
    np.testing.assert_array_equal(as_session(recording, ("c", "b")).impacts[0].acceleration, [A, B])


def test_complex_channels_of_hdf5_are_left_out_and_told(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.mat", "w") as file:
        file["fs"], file["a"], file["b"], file["c"] = 1000.0, A + 1j, B, A
    assert import_recording(tmp_path / "x.mat").left_out == ("a (complex)",)


@pytest.mark.parametrize(("attribute", "value"), [("scale_factor", 1e-3), ("add_offset", 5.0)])
def test_packed_numbers_are_refused(tmp_path: Path, attribute: str, value: float) -> None:
    with h5py.File(tmp_path / "x.nc", "w") as file:
        file["fs"], file["a"], file["b"] = 1000.0, A, B
        file["a"].attrs[attribute] = value
    with pytest.raises(RecordingError, match=f"/a has the attribute {attribute}, which is not applied here"):
        import_recording(tmp_path / "x.nc")


def test_units_at_arrays_of_hdf5_count(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.nc", "w") as file:
        file["time"], file["a"], file["b"] = 1e3 * T, A, B
        file["time"].attrs["units"], file["a"].attrs["units"], file["b"].attrs["units"] = "ms", "mg", "m/s2"
    recording = import_recording(tmp_path / "x.nc")
    assert (recording.rate_hz, recording.units) == (1000.0, ("m/s2", "m/s2"))
    np.testing.assert_allclose(recording.data, [9.80665e-3 * A, B])


def uff(path: Path, times: tuple[np.ndarray, np.ndarray] = (T, T), before: str = "", **changes: Any) -> Path:
    for i, (values, time) in enumerate(zip((A, B), times, strict=True)):
        block = pyuff.prepare_58(
            binary=0, func_type=1, rsp_node=i + 1, rsp_dir=3, ref_node=1, ref_dir=3, data=values, x=time,
            id1=f"acc{i}", ord_data_type=4, num_pts=N, abscissa_spacing=1, abscissa_min=float(time[0]),
            abscissa_inc=float(time[1] - time[0]), z_axis_value=0.0, abscissa_spec_data_type=17,
            ordinate_spec_data_type=12, ordinate_axis_units_lab="g", orddenom_spec_data_type=0,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(block | changes, "add" if i else "overwrite")
    path.write_text(before + path.read_text())
    return path


MILLIMETRES = (
    "    -1\n   164\n         5mm (milli-newton)            2\n"
    "  1.0000000000000000D+03  1.0000000000000000D+00  1.0000000000000000D+00\n  2.7314999999999998D+02\n    -1\n"
)


def test_the_unit_of_the_abscissa_counts(tmp_path: Path) -> None:
    path = uff(tmp_path / "x.uff", (1e3 * T, 1e3 * T), abscissa_axis_units_lab="ms")
    assert import_recording(path).rate_hz == pytest.approx(1000.0)
    path = uff(tmp_path / "x.uff", abscissa_axis_units_lab="rev")
    with pytest.raises(RecordingError, match="the unit 'rev' of the times in abscissa is not known"):
        import_recording(path)


def test_data_sets_that_begin_apart_are_no_channels_of_one_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="data set 2 begins 5 s after the first one"):
        import_recording(uff(tmp_path / "x.uff", (T, T + 5)))


@pytest.mark.parametrize(
    ("label", "before", "factor"),
    [("G", "", 9.80665), ("mm/s2", "", 1e-3), ("NONE", MILLIMETRES, 1e-3), ("mm/s^2", MILLIMETRES, 1e-3)],
)
def test_units_in_universal_files_are_converted(tmp_path: Path, label: str, before: str, factor: float) -> None:
    recording = import_recording(uff(tmp_path / "x.uff", before=before, ordinate_axis_units_lab=label))
    assert recording.unit == "m/s2"
    np.testing.assert_allclose(recording.data, factor * np.array([A, B]), rtol=1e-6, atol=1e-9)


def test_a_label_in_metres_and_a_data_set_164_in_millimetres_contradict(tmp_path: Path) -> None:
    path = uff(tmp_path / "x.uff", before=MILLIMETRES, ordinate_axis_units_lab="m/s^2")
    with pytest.raises(RecordingError, match=r"data set 2 is in m/s\^2, but data set 164 says 1000 units of length"):
        import_recording(path)
