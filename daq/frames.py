"""A session as the tables and labelled arrays that notebooks use; pandas and xarray are an extra: mesotap[frames]."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from daq.errors import RecordingError
from daq.records import Session

if TYPE_CHECKING:
    import pandas
    import xarray

CHANNELS = ("A", "B")


def impact_table(session: Session) -> pandas.DataFrame:
    """Return a table with a row for each impact, accepted or not; the index is the impact's number.

    Columns: load_set, target_load_mn, load_before_mn, load_after_mn, voltage_before_mv, voltage_after_mv, time (UTC),
    sample_rate_hz, samples, pretrigger, peak_m_s2 (largest magnitude of A and B), accepted, reject_reason.

    Raises
    ------
    RecordingError
        pandas is not installed.
    """
    pd = _needed("pandas")
    rows = [
        {
            "number": i.number,
            "load_set": i.load_set,
            "target_load_mn": i.target_load_mn,
            "load_before_mn": i.load_before_mn,
            "load_after_mn": i.load_after_mn,
            "voltage_before_mv": i.voltage_before_mv,
            "voltage_after_mv": i.voltage_after_mv,
            "time": i.time,
            "sample_rate_hz": i.sample_rate_hz,
            "samples": i.acceleration.shape[1],
            "pretrigger": i.pretrigger,
            "peak_m_s2": float(np.abs(i.acceleration).max(initial=0.0)),
            "accepted": i.accepted,
            "reject_reason": i.reject_reason,
        }
        for i in session.impacts
    ]
    table = pd.DataFrame(rows).set_index("number")
    table["time"] = pd.to_datetime(table["time"], utc=True, format="ISO8601", errors="coerce")
    return table


def record_array(session: Session) -> xarray.Dataset:
    """Return the records of all impacts: ``acceleration`` (impact, channel, sample), m/s2, with coordinates.

    The coordinate ``time_s`` (impact, sample) counts from the trigger; records shorter than the longest one end in NaN.
    ``load_mn``, ``target_load_mn``, ``load_set`` and ``accepted`` are coordinates of the impact.

    Raises
    ------
    RecordingError
        xarray is not installed.
    """
    xr = _needed("xarray")
    impacts = session.impacts
    longest = max((i.acceleration.shape[1] for i in impacts), default=0)
    records = np.full((len(impacts), len(CHANNELS), longest), np.nan)
    times = np.full((len(impacts), longest), np.nan)
    for row, impact in enumerate(impacts):
        n = impact.acceleration.shape[1]
        records[row, :, :n] = impact.acceleration
        times[row, :n] = (np.arange(n) - impact.pretrigger) / impact.sample_rate_hz
    of_impact = {
        "load_mn": [i.load_before_mn for i in impacts],
        "target_load_mn": [i.target_load_mn for i in impacts],
        "load_set": [i.load_set for i in impacts],
        "accepted": [i.accepted for i in impacts],
    }
    return xr.Dataset(
        {"acceleration": (("impact", "channel", "sample"), records, {"units": "m/s2"})},
        coords={
            "impact": [i.number for i in impacts],
            "channel": list(CHANNELS),
            "time_s": (("impact", "sample"), times, {"units": "s"}),
            **{name: ("impact", values) for name, values in of_impact.items()},
        },
        attrs={"specimen": session.specimen, "operator": session.operator, "created": session.created},
    )


def _needed(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise RecordingError(f"{name} is not installed; pip install 'mesotap[frames]' brings it") from None
