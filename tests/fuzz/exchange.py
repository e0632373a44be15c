"""Whatever a file of another program holds, it becomes a recording of finite samples or is refused in one sentence."""

from __future__ import annotations

import gc
import io
import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from daq.errors import RecordingError
from daq.exchange.importing import as_session, import_recording
from tests.fuzz.forked import reading_in_forks
from tests.fuzz.mutations import Content, Damage, damaged, damages
from tests.fuzz.source import Source, Target

N = 40
T = np.arange(N) / 1000.0
RING = np.exp(-T * 50) * np.sin(300 * T)


def imported_or_refused(path: Path, content: bytes, **options: Any) -> None:
    path.write_bytes(content)
    try:
        with reading_in_forks():
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
    assert 0 <= session.impacts[0].pretrigger < session.impacts[0].acceleration.shape[1]


def damaged_files(path: Path, sound: Sequence[bytes], most: int = 6) -> Target:
    """One of several sound files, damaged."""

    def draw(source: Source) -> tuple[int, Damage]:
        return source.integer(0, len(sound) - 1), damages(most)(source)

    return Target(draw, lambda drawn: imported_or_refused(path, damaged(sound[drawn[0]], drawn[1])))


# --- text


def csv(delimiter: str, decimal: str = ".", header: str = "time [s];a [g];b [g]") -> bytes:
    rows = [[f"{t:.4f}", f"{a:.6e}", f"{-a:.6f}"] for t, a in zip(T, RING, strict=True)]
    lines = [header.replace(";", delimiter), *(delimiter.join(row).replace(".", decimal) for row in rows)]
    return Content("\n".join(lines).encode())


TABLES = (csv(","), csv(";", ","), csv("\t"), csv(" ", header="# t a b"), csv(",", header="# comment\nt,a,b\ns,g,g"))
FIELDS = ("", "1", "-1", "1e5", "1d5", "1e999", "nan", "inf", "1,5", ".", "+", "a", '"1"', "٣", "1_0", "#")
TITLES = ("t", "time [s]", "t_ms", "a", "a [g]", "b (m/s2)", "", "Time", "s", "g")
ENCODINGS = ("utf-8", "utf-16", "latin-1", "utf-8-sig")


def field(source: Source) -> str:
    kind = source.integer(0, 3)
    if kind == 0:
        return repr(source.number())
    if kind == 1:
        return str(source.integer(-(10**30), 10**30))
    return source.choice(FIELDS) if kind == 2 else source.text(5)


def table(source: Source) -> str:
    """A table of any fields, or one of numbers that begins with even times and has few senseless fields or none."""
    delimiter, end = source.choice((",", ";", "\t", " ", ", ")), source.choice(("\n", "\r\n", "\r", "\x0b", "\n\n"))
    width = source.integer(1, 4)
    if source.integer(0, 1):
        rows = source.several(lambda inner: inner.several(field, width, width), 0, 40)
        return end.join(delimiter.join(row) for row in rows)
    size, step = 10.0 ** source.integer(-320, 308), 10.0 ** source.integer(-320, 308)
    start, length = source.number(), source.integer(14, 40)
    rows = [
        [repr(start + i * step), *(repr(size * source.integer(-99, 99)) for _ in range(width - 1))]
        for i in range(length)
    ]
    for at, column, text in source.several(
        lambda inner: (inner.integer(0, 39), inner.integer(0, 3), field(inner)), 0, 2
    ):
        if source.integer(0, 1):
            rows[at % length][column % width] = text
    header = [delimiter.join(source.choice(TITLES) for _ in range(width))] if source.integer(0, 1) else []
    return end.join([*header, *(delimiter.join(row) for row in rows)])


def damaged_tables(place: Path) -> Target:
    return damaged_files(place / "table.csv", TABLES)


def any_table(place: Path) -> Target:
    def check(drawn: tuple[str, str]) -> None:
        text, encoding = drawn
        imported_or_refused(place / "any.csv", text.encode(encoding, "replace"), rate_hz=1000.0)

    return Target(lambda source: (table(source), source.choice(ENCODINGS)), check)


def any_bytes(place: Path) -> Target:
    def draw(source: Source) -> tuple[bytes, str]:
        return source.content(400), source.choice((".csv", ".mat", ".unv", ".uff", ".h5", ""))

    return Target(draw, lambda drawn: imported_or_refused(place / f"bytes{drawn[1]}", drawn[0]))


def channel(source: Source) -> str | int:
    kind = source.integer(0, 2)
    if kind == 0:
        return source.text(3)
    return source.integer(-(2**70), 2**70) if kind == 1 else source.choice(("a", "b", 0, 1))


def any_wish(place: Path) -> Target:
    def draw(source: Source) -> dict[str, Any]:
        return {
            "rate_hz": source.number() if source.integer(0, 1) else None,
            "channels": source.several(channel, 0, 3) if source.integer(0, 1) else None,
            "unit": source.text(4) if source.integer(0, 1) else None,
        }

    return Target(draw, lambda options: imported_or_refused(place / "wish.csv", TABLES[0], **options))


# --- MAT 5


def mat5(compressed: bool) -> bytes:
    import scipy.io  # here: a damaged file of MAT 7.3 is read by a forked process, and a small one forks faster

    buffer = io.BytesIO()
    inner = {"fs": 1000.0, "acc": np.vstack([RING, -RING]), "units": "g", "cell": np.array([1, "a"], dtype=object)}
    scipy.io.savemat(buffer, {"t": T, "d": inner, "i": np.arange(N, dtype=np.int16)}, do_compression=compressed)
    return Content(buffer.getvalue())


def damaged_mat_5(place: Path) -> Target:
    return damaged_files(place / "damaged.mat", (mat5(False), mat5(True)))


def damaged_mat_5_behind_its_header(place: Path) -> Target:
    sound, path = mat5(False), place / "damaged.mat"
    return Target(damages(), lambda damage: imported_or_refused(path, sound[:128] + damaged(sound[128:], damage)))


# --- universal files


def universal(path: Path, binary: int) -> bytes:
    import pyuff  # here, as scipy.io

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
    return Content(path.read_bytes())


def damaged_universal_files(place: Path) -> Target:
    return damaged_files(place / "damaged.uff", [universal(place / f"sound{binary}.uff", binary) for binary in (0, 1)])


# --- MAT 7.3


def mat73(path: Path) -> bytes:
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


def damaged_mat_73(place: Path) -> Target:
    return damaged_files(place / "damaged73.mat", (mat73(place / "sound73.mat"),))


# --- WAV and TDMS


def wav(dtype: str) -> bytes:
    from scipy.io import wavfile  # here, as scipy.io

    buffer = io.BytesIO()
    wavfile.write(buffer, 1000, np.stack([RING, -RING], axis=1).astype(dtype))
    return Content(buffer.getvalue())


def damaged_wav(place: Path) -> Target:
    return damaged_files(place / "damaged.wav", [wav(dtype) for dtype in ("i2", "u1", "f4")])


def tdms() -> bytes:
    from nptdms import ChannelObject, TdmsWriter  # here, as scipy.io

    buffer = io.BytesIO()
    with TdmsWriter(buffer) as writer:
        for _ in range(2):
            properties = {"wf_increment": 1e-3, "unit_string": "g"}
            writer.write_segment([ChannelObject("g", name, RING, properties) for name in "ab"])
    return Content(buffer.getvalue())


def damaged_tdms(place: Path) -> Target:
    return damaged_files(place / "damaged.tdms", (tdms(),))


TARGETS = (
    damaged_tables,
    any_table,
    any_bytes,
    any_wish,
    damaged_mat_5,
    damaged_mat_5_behind_its_header,
    damaged_universal_files,
    damaged_mat_73,
    damaged_wav,
    damaged_tdms,
)
