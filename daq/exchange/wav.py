"""WAV files: channels of one rate, as shares of full scale where the samples are whole numbers."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from daq.errors import RecordingError
from daq.exchange.recording import Columns

BEGINS = (b"RIFF", b"RIFX", b"RF64")
_HEAD = 12  # bytes before the first chunk
_UNKNOWN_SIZE = 0xFFFFFFFF  # of RF64, which gives sizes elsewhere, and of what was never finished


def read_wav(path: Path, content: bytes) -> Columns:
    """Return the channels of a WAV file (PCM of 8 to 32 bits, or floating point).

    Whole numbers become shares of full scale, -1 to 1: a WAV file knows no unit. Frequencies and damping do not depend
    on it.

    Raises
    ------
    RecordingError
        It is another RIFF file, is damaged or cut, or its samples are compressed.
    """
    if content[8:12] != b"WAVE":
        raise RecordingError(f"{path}: is not a recording but a RIFF file of kind {content[8:12]!r}, such as AVI")
    _refuse_cut(path, content)
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks with names and notes
            rate_hz, samples = wavfile.read(io.BytesIO(content))
    except Exception as error:  # whatever scipy's reader stumbles over
        raise RecordingError(
            f"{path}: is a damaged WAV file, or its samples are not plain numbers ({error}); write it as PCM"
        ) from error
    data = np.atleast_2d(samples.T).astype(np.float64)
    if samples.dtype.kind in "iu":
        middle = 2.0 ** (8 * samples.dtype.itemsize - 1)
        data = (data - middle if samples.dtype.kind == "u" else data) / middle
    names = [f"channel{i + 1}" for i in range(len(data))]
    return Columns(names, [""] * len(data), list(data), rate_hz=float(rate_hz))


def _refuse_cut(path: Path, content: bytes) -> None:
    """Refuse a file whose samples are fewer than it says: a reader takes what is there."""
    order = "big" if content.startswith(b"RIFX") else "little"
    at = _HEAD
    while at + 8 <= len(content):
        name, size = content[at : at + 4], int.from_bytes(content[at + 4 : at + 8], order)  # type: ignore[arg-type]
        if size == _UNKNOWN_SIZE and name == b"data":
            return
        if at + 8 + size > len(content):
            held = len(content) - at - 8
            raise RecordingError(
                f"{path}: is truncated or damaged: a part of it claims {size} bytes, of which it has {held}"
            )
        at += 8 + size + size % 2
