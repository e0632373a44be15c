"""A recording for other programs: universal file, CSV or MAT file."""

from __future__ import annotations

import csv
import io
import math
import tempfile
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.durable import write_whole
from daq.errors import RecordingError
from daq.exchange.recording import Recording
from daq.exchange.universal import RATE_LINE

UNIVERSAL = (".uff", ".unv", ".uf", ".ufb")
SUFFIXES = (*UNIVERSAL, ".csv", ".mat")

Shape = tuple[complex, NDArray[np.complex128]]
"""Pole, 1/s, of a mode and its shape (c,) over the channels."""

_KINDS = {"m": 8, "m/s": 11, "m/s2": 12, "N": 13}
"""Specific data types of data sets 55 and 58 by unit; 0 is unknown."""

_PARTS = {"k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "\u00b5": 1e-6, "\u03bc": 1e-6, "n": 1e-9}
"""Factors of the letters before a unit; the micro sign and the Greek letter look alike."""

_SPELLED = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss", "æ": "ae", "Æ": "Ae", "ø": "oe"}
    | {"Ø": "Oe", "å": "aa", "Å": "Aa", "\u00b5": "u", "\u03bc": "u", "ł": "l", "Ł": "L", "°": "deg"}
)
"""How letters that ASCII has not are spelled, where that is more than leaving an accent out."""

_TIME, _TIME_RESPONSE, _COMPLEX_EIGENVALUE = 17, 1, 3
_ENTITY = 10  # letters of the name of a component in data set 58


def export_recording(path: Path, recording: Recording, *, binary: bool = True, modes: Sequence[Shape] = ()) -> None:
    """Write a recording in the format that the ending of ``path`` says.

    Parameters
    ----------
    path
        ``.uff``, ``.unv``, ``.uf``, ``.ufb`` (data sets 164, 58 a channel, 55 a mode), ``.csv`` or ``.mat``.
    recording
        What to write.
    binary
        Whether data sets 58 of a universal file are binary, which keeps every digit; in text there are 11.
    modes
        Modes of the recording, for a universal file: node *i* of their shapes is channel *i*, counted from 1.

    Raises
    ------
    RecordingError
        The ending is another, or the format holds no modes.
    UnwrittenError
        The file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RecordingError(f"{path}: is to be written in an unknown format; known are {', '.join(SUFFIXES)}")
    if modes and suffix not in UNIVERSAL:
        raise RecordingError(f"{path}: a {suffix} file holds no modes; write a universal file (.uff)")
    if suffix in UNIVERSAL:
        content = _universal(recording, binary, modes)
    else:
        content = _csv(recording) if suffix == ".csv" else _mat(recording)
    write_whole(path, content)


def _units(recording: Recording) -> tuple[str, ...]:
    return recording.units or (recording.unit,) * len(recording.names)


def _times(recording: Recording) -> NDArray[np.float64]:
    return np.arange(recording.data.shape[1]) / recording.rate_hz


def _universal(recording: Recording, binary: bool, modes: Sequence[Shape]) -> bytes:
    import pyuff

    sets: list[dict[str, Any]] = [
        pyuff.prepare_164(1, "SI: m, N, K", 2, length=1.0, force=1.0, temp=1.0, temp_offset=273.15)
    ]
    times = _times(recording)
    scaled = [in_si(unit) for unit in _units(recording)]  # data set 164 says SI of values with a data type
    kinds = [_KINDS.get(unit, 0) for unit, _ in scaled]
    for number, (name, (unit, factor), kind, samples) in enumerate(
        zip(recording.names, scaled, kinds, recording.data, strict=True), start=1
    ):
        sets.append(
            pyuff.prepare_58(
                binary=int(binary),
                func_type=_TIME_RESPONSE,
                id1=_line(name),
                id2=_line(recording.source),
                id3=f"{RATE_LINE}{float(recording.rate_hz)} Hz",
                rsp_ent_name=_line(name)[:_ENTITY] or "NONE",
                rsp_node=number,
                rsp_dir=1,
                ref_node=0,
                ref_dir=0,
                num_pts=samples.size,
                abscissa_spacing=1,
                abscissa_spec_data_type=_TIME,
                abscissa_axis_units_lab="s",
                ordinate_spec_data_type=kind,
                ordinate_axis_units_lab=_line(unit)[:20] or "NONE",
                orddenom_spec_data_type=0,
                z_axis_spec_data_type=0,
                data=samples * factor if factor != 1.0 else samples,
                x=times,
            )
        )
    nodes = list(range(1, len(recording.names) + 1))
    to_si = np.array([factor for _, factor in scaled])
    for number, (pole, shape) in enumerate(modes, start=1):
        none = np.zeros(shape.size, np.complex128)
        sets.append(
            pyuff.prepare_55(
                model_type=1,
                id1=f"mode {number} of {_line(recording.source)}"[:80],
                id2=f"pole {float(pole.real)} {float(pole.imag):+}j 1/s",
                id3=f"{float(abs(pole)) / (2 * math.pi)} Hz, damping ratio {float(-pole.real / abs(pole))}",
                analysis_type=_COMPLEX_EIGENVALUE,
                data_ch=2,
                spec_data_type=kinds[0] if len(set(kinds)) == 1 else 0,
                r1=shape * (to_si / to_si.max()),  # between channels as the samples are; one for all is arbitrary
                r2=none,
                r3=none,
                load_case=1,
                mode_n=number,
                eig=pole,
                modal_a=0j,
                modal_b=0j,
                node_nums=nodes,
            )
        )
    with tempfile.TemporaryDirectory(prefix="mesotap-export-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves files to the garbage collector
        place = Path(folder) / "export.uff"
        pyuff.UFF(str(place)).write_sets(sets, mode="overwrite")
        return place.read_bytes()


def in_si(unit: str) -> tuple[str, float]:
    """Return the SI unit of lengths, velocities, accelerations and forces, and the factor there; others stay.

    Examples
    --------
    >>> in_si("mm/s"), in_si("kN"), in_si("V")
    (('m/s', 0.001), ('N', 1000.0), ('V', 1.0))
    """
    letter, plain = unit[:1], unit[1:]
    if unit not in _KINDS and letter in _PARTS and plain in _KINDS:
        return plain, _PARTS[letter]
    return unit, 1.0


def rewritten(recording: Recording) -> tuple[str, ...]:
    """Return what a universal file holds otherwise than the recording, a sentence each: letters and units."""
    said = []
    for name, unit in zip(recording.names, _units(recording), strict=True):
        written, (si, _) = _line(name), in_si(unit)
        if written != name:
            said.append(f"channel {name} is called {written}: a universal file has ASCII letters, 80 a name")
        if si != unit:
            said.append(f"channel {name} is written in {si} instead of {unit}: a universal file is in SI units")
    return tuple(said)


def as_ascii(text: str) -> str:
    """Return text in the letters of a universal file: printable ASCII.

    Umlauts are written as in German, other letters without their accents, Greek mu as u; "?" stands for the rest.

    Examples
    --------
    >>> as_ascii("Gehäuse oben, 5 µm, près")
    'Gehaeuse oben, 5 um, pres'
    """
    spelled = unicodedata.normalize("NFKD", unicodedata.normalize("NFC", text).translate(_SPELLED))
    letters = (letter for letter in spelled if not unicodedata.combining(letter))
    return "".join(letter if letter.isascii() and letter.isprintable() else "?" for letter in letters)


def _line(text: str) -> str:
    """Return text that fits into a line of a universal file: printable ASCII, 80 letters."""
    return as_ascii(text)[:80]


def _csv(recording: Recording) -> bytes:
    titles = [f"{n} [{u}]" if u else n for n, u in zip(recording.names, _units(recording), strict=True)]
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(["time [s]", *titles])
    writer.writerows(np.column_stack([_times(recording), recording.data.T]).tolist())
    return text.getvalue().encode()


def _mat(recording: Recording) -> bytes:
    from scipy.io import savemat

    content = {
        "data": recording.data.T,
        "time_s": _times(recording)[:, None],
        "rate_hz": recording.rate_hz,
        "names": np.array(recording.names, dtype=object),
        "units": np.array(_units(recording), dtype=object),
        "source": recording.source,
    }
    place = io.BytesIO()
    savemat(place, content, do_compression=True)  # type: ignore[arg-type]  # the stub knows paths only
    return place.getvalue()
