"""Whatever a file of another program holds, it becomes a recording of finite samples or is refused in one sentence."""

from __future__ import annotations

import gc
import io
import math
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import RecordingError
from daq.exchange.importing import as_session, import_recording
from tests.fuzz.mutations import Content, Damage, damaged, damages, fuzzed

N = 40
T = np.arange(N) / 1000.0
RING = np.exp(-T * 50) * np.sin(300 * T)


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("exchange")


def imported_or_refused(path: Path, content: bytes, **options) -> None:
    path.write_bytes(content)
    try:
        recording = import_recording(path, **options)
    except RecordingError as error:
        text = str(error)
        assert text.startswith(str(path))
        assert "\n" not in text
        assert len(text) < len(str(path)) + 2000
        return
    assert recording.data.ndim == 2
    assert recording.data.shape[0] == len(recording.names) == len(set(recording.names))
    assert np.isfinite(recording.data).all()
    assert math.isfinite(recording.rate_hz)
    assert recording.rate_hz > 0
    try:
        session = as_session(recording)
    except RecordingError as error:
        assert "\n" not in str(error)
        return
    assert 0 <= session.shots[0].pretrigger < session.shots[0].acceleration.shape[1]


# --- text


def csv(delimiter: str, decimal: str = ".", header: str = "time [s];a [g];b [g]") -> bytes:
    rows = [[f"{t:.4f}", f"{a:.6e}", f"{-a:.6f}"] for t, a in zip(T, RING, strict=True)]
    lines = [header.replace(";", delimiter), *(delimiter.join(row).replace(".", decimal) for row in rows)]
    return Content("\n".join(lines).encode())


TABLES = (csv(","), csv(";", ","), csv("\t"), csv(" ", header="# t a b"), csv(",", header="# comment\nt,a,b\ns,g,g"))

fields = st.one_of(
    st.floats().map(repr),
    st.integers(-(10**30), 10**30).map(str),
    st.sampled_from(["", "1", "-1", "1e5", "1d5", "1e999", "nan", "inf", "1,5", ".", "+", "a", '"1"', "٣", "1_0", "#"]),
    st.text(max_size=5),
)
tables = st.tuples(
    st.sampled_from([",", ";", "\t", " ", ", "]),
    st.sampled_from(["\n", "\r\n", "\r", "\x0b", "\n\n"]),
    st.integers(1, 4).flatmap(lambda width: st.lists(st.lists(fields, min_size=width, max_size=width), max_size=40)),
).map(lambda parts: parts[1].join(parts[0].join(row) for row in parts[2]))
encodings = st.sampled_from(["utf-8", "utf-16", "latin-1", "utf-8-sig"])


@given(st.sampled_from(TABLES), damages(10))
@fuzzed
def test_damaged_tables(place, content, damage: Damage):
    imported_or_refused(place / "table.csv", damaged(content, damage))


@given(tables, encodings)
@fuzzed
def test_any_table(place, text, encoding):
    imported_or_refused(place / "any.csv", text.encode(encoding, "replace"), rate_hz=1000.0)


@given(st.binary(max_size=400), st.sampled_from([".csv", ".mat", ".unv", ".uff", ".h5", ""]))
@fuzzed
def test_any_bytes(place, content, ending):
    imported_or_refused(place / f"bytes{ending}", content)


@given(
    st.one_of(st.none(), st.floats()),
    st.one_of(
        st.none(),
        st.lists(st.one_of(st.text(max_size=3), st.integers(), st.sampled_from(["a", "b", 0, 1])), max_size=3),
    ),
    st.one_of(st.none(), st.text(max_size=4)),
)
@fuzzed
def test_any_wish(place, rate_hz, channels, unit):
    imported_or_refused(place / "wish.csv", TABLES[0], rate_hz=rate_hz, channels=channels, unit=unit)


# --- MAT 5


def mat5(compressed: bool) -> bytes:
    buffer = io.BytesIO()
    inner = {"fs": 1000.0, "acc": np.vstack([RING, -RING]), "units": "g", "cell": np.array([1, "a"], dtype=object)}
    scipy.io.savemat(buffer, {"t": T, "d": inner, "i": np.arange(N, dtype=np.int16)}, do_compression=compressed)
    return Content(buffer.getvalue())


MATS = (mat5(False), mat5(True))


@given(st.sampled_from(MATS), damages())
@fuzzed
def test_damaged_mat_5(place, content, damage: Damage):
    imported_or_refused(place / "damaged.mat", damaged(content, damage))


@given(damages())
@fuzzed
def test_damaged_mat_5_behind_its_header(place, damage: Damage):
    imported_or_refused(place / "damaged.mat", MATS[0][:128] + damaged(MATS[0][128:], damage))


# --- universal files


@pytest.fixture(scope="module")
def universal(place) -> tuple[bytes, ...]:
    contents = []
    for number, binary in enumerate((0, 1)):
        path = place / f"sound{number}.uff"
        for i in range(2):
            block = pyuff.prepare_58(
                binary=binary, func_type=1, rsp_node=i + 1, rsp_dir=3, ref_node=1, ref_dir=3, data=RING, x=T,
                id1=f"acc{i}", ord_data_type=4, num_pts=N, abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1e-3,
                z_axis_value=0.0, abscissa_spec_data_type=17, ordinate_spec_data_type=12,
                ordinate_axis_units_lab="m/s^2", orddenom_spec_data_type=0,
            )  # fmt: skip
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves its file open where it writes binary
                pyuff.UFF(str(path)).write_sets(block, "add" if i else "overwrite")
                gc.collect()
        contents.append(Content(path.read_bytes()))
    return tuple(contents)


@given(st.integers(0, 1), damages())
@fuzzed
def test_damaged_universal_files(place, universal, which, damage: Damage):
    imported_or_refused(place / "damaged.uff", damaged(universal[which], damage))


# --- MAT 7.3


@pytest.fixture(scope="module")
def mat73(place) -> bytes:
    path = place / "sound73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("t", data=T[None]).attrs["MATLAB_class"] = np.bytes_("double")
        group = file.create_group("d")
        group["acc"] = np.vstack([RING, -RING]).T
        group["fs"] = [[1000.0]]
        units = group.create_dataset("units", data=np.array([[ord("g")]], dtype="u2"))
        units.attrs["MATLAB_class"] = np.bytes_("char")
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    return Content(content)


@given(damages())
@fuzzed
def test_damaged_mat_73(place, mat73, damage: Damage):
    imported_or_refused(place / "damaged73.mat", damaged(mat73, damage))
