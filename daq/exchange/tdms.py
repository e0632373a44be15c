"""TDMS files of LabVIEW and NI-DAQmx, with npTDMS where that is installed."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import RecordingError
from daq.exchange.recording import FEWEST_SAMPLES, Columns

BEGINS = b"TDSm"
STEP, START, UNIT = "wf_increment", "wf_start_time", "unit_string"
"""Properties that NI's programs give a waveform."""


def read_tdms(path: Path, content: bytes) -> Columns:
    """Return the channels of a TDMS file that belong together: those like the first that is long enough.

    Raises
    ------
    RecordingError
        npTDMS is not installed; or the file is damaged or cut, or holds no channel of numbers.
    """
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise RecordingError(
            f"{path}: is a TDMS file, which pip install 'mesotap[tdms]' lets mesotap read; or write it as CSV or MAT "
            "with the program that recorded it"
        ) from None
    try:
        file = TdmsFile.read(io.BytesIO(content))
        channels = [channel for group in file.groups() for channel in group.channels()]
        waveforms = [_waveform(channel) for channel in channels]
        cut = file.file_status.incomplete_final_segment
    except MemoryError:
        raise
    except Exception as error:  # whatever its parser stumbles over
        raise RecordingError(f"{path}: is a damaged or truncated TDMS file") from error
    if cut:
        raise RecordingError(f"{path}: is truncated: its last part is not whole, as when the recording was interrupted")
    usable = [w for w in waveforms if w["data"] is not None and w["data"].size >= FEWEST_SAMPLES]
    if not usable:
        raise RecordingError(f"{path}: holds no channel of at least {FEWEST_SAMPLES} numbers")
    several = len({w["group"] for w in usable}) > 1
    columns = Columns([], [], [], rate_hz=1 / usable[0]["step"] if usable[0]["step"] else None)
    for waveform in waveforms:
        why = _why_not(waveform, usable[0])
        name = f"{waveform['group']}/{waveform['name']}" if several else waveform["name"]
        if why:
            columns.skipped.append(f"{name} ({why})")
            continue
        columns.names.append(name)
        columns.units.append(waveform["unit"])
        columns.data.append(waveform["data"])
    return columns


def _waveform(channel: Any) -> dict[str, Any]:
    values = np.asarray(channel[:])
    numbers = values.dtype.kind in "iuf" and values.ndim == 1
    step = channel.properties.get(STEP, 0.0)
    return {
        "group": str(channel.group_name),
        "name": str(channel.name),
        "unit": str(channel.properties.get(UNIT, "")),
        "data": values.astype(np.float64) if numbers else None,
        "step": float(step) if np.isfinite(float(step)) and float(step) > 0 else 0.0,
        "start": str(channel.properties.get(START, "")),
    }


def _why_not(waveform: dict[str, Any], first: dict[str, Any]) -> str:
    """Return why a channel is not one of the recording that the first belongs to; empty if it is."""
    if waveform["data"] is None:
        return "no numbers"
    if waveform["data"].size != first["data"].size:
        return f"{waveform['data'].size} samples"
    if waveform["step"] != first["step"]:
        return "another sampling rate"
    return "" if waveform["start"] == first["start"] else "begins at another time"
