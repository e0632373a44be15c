"""Quantities of the tester over sessions, on control charts: gauge, springs, noise, and k_c of a check specimen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.control_charts import CUSUM_LIMIT, Chart, chart
from mesotap.answers.rounding import counted
from mesotap.catalogue.entry import UNREADABLE, Entry
from mesotap.catalogue.listing import copies
from mesotap.catalogue.store import seconds_of

QUANTITIES = {
    "gauge slope": ("slope_mv_per_mn", "mV/mN"),
    "gauge zero": ("zero_mv", "mV"),
    "k1": ("k1_n_per_m", "N/m"),
    "k2": ("k2_n_per_m", "N/m"),
    "f1": ("f1_hz", "Hz"),
    "noise": ("noise_m_s2", "m/s2"),
}
"""What is charted: the entry's field and the unit. k1 and k2 follow f1 where sessions take them from it."""

CHECK = "k_c of the check specimen"
BEYOND = 0.1
"""Relative distance outside a session's loads at which its curve is still read."""

FEWEST = 4
"""Values below which there is no chart."""


@dataclass(frozen=True, slots=True)
class Trend:
    """One quantity: the sessions that have it, in time order, their values and the chart."""

    quantity: str
    unit: str
    sessions: tuple[Entry, ...]
    chart: Chart


def in_order(entries: Sequence[Entry]) -> list[Entry]:
    """Return the sessions that count, in the order of their dates: no copies, none that cannot be read or dated."""
    twice = copies(entries)
    usable = [
        e
        for e in entries
        if e.state not in UNREADABLE and e.path not in twice and seconds_of(e.created) is not None
    ]  # fmt: skip
    return sorted(usable, key=lambda e: (seconds_of(e.created), e.path))


def trends(entries: Sequence[Entry], load_mn: float | None) -> tuple[list[Trend], list[str]]:
    """Return the charts, and why there is none of a quantity.

    Parameters
    ----------
    entries
        Sessions, in any order.
    load_mn
        At which k_c of the check specimen is read off each session's curve; None leaves it out.
    """
    ordered = in_order(entries)
    made: list[Trend] = []
    said: list[str] = []
    series = {
        name: (unit, [(e, v) for e in ordered if (v := getattr(e, field)) is not None])
        for name, (field, unit) in QUANTITIES.items()
    }
    if load_mn is not None:
        series[CHECK] = ("N/m", [(e, v) for e in ordered if (v := stiffness_at(e, load_mn)) is not None])
    for name, (unit, found) in series.items():
        values = [value for _, value in found]
        if len(values) < FEWEST:
            said.append(f"{name}: had by {counted(len(values), 'session')}, a chart needs {FEWEST}")
        elif np.ptp(values) <= 1e-9 * abs(float(np.mean(values))):
            said.append(f"{name}: is the same in all {len(values)} sessions: it is declared, not measured")
        else:
            made.append(Trend(name, unit, tuple(e for e, _ in found), chart(values)))
    return made, said


def stiffness_at(entry: Entry, load_mn: float) -> float | None:
    """Return k_c of a session at a load, N/m, on straight lines in logarithms between its loads; None far from them."""
    points = sorted(
        (math.log(load.load_mn.value), math.log(load.contact_stiffness_n_per_m.value))
        for load in entry.loads
        if load.load_mn and load.contact_stiffness_n_per_m
        and load.load_mn.value > 0 and load.contact_stiffness_n_per_m.value > 0
    )  # fmt: skip
    if not points:
        return None
    x, y = (np.array(column) for column in zip(*points, strict=True))
    at = math.log(load_mn)
    if not x[0] - BEYOND <= at <= x[-1] + BEYOND:
        return None
    i = int(np.clip(np.searchsorted(x, at), 1, max(len(x) - 1, 1)))
    if len(x) < 2 or x[i] == x[i - 1]:
        return float(math.exp(y[0])) if abs(at - x[0]) < BEYOND else None
    slope = (y[i] - y[i - 1]) / (x[i] - x[i - 1])
    return float(math.exp(y[i] + slope * (at - x[i])))


def alarm_sentence(trend: Trend, number: int) -> str:
    """Return in a sentence what an alarm says."""
    alarm = trend.chart.alarms[number]
    which = " and ".join(n for n, told in (("EWMA", alarm.by_ewma), ("CUSUM", alarm.by_cusum)) if told)
    at, since = trend.sessions[alarm.at], trend.sessions[alarm.since]
    way = "higher" if alarm.upwards else "lower"
    text = f"{trend.quantity}: is {way} since {since.name} ({since.created[:10]}), told by {which} at {at.name}"
    if alarm.change is None:
        seen = alarm.at - alarm.since + 1
        text += f"; by how much cannot be said: {_too_few(seen, alarm.since)}"
    else:
        mean = float(np.mean(trend.chart.values))
        percent = f" ({100 * alarm.change.value / mean:+.2g} %)" if mean and trend.quantity != "gauge zero" else ""
        text += f": by {alarm.change.value:.3g} ± {alarm.change.half_width:.2g} {trend.unit}{percent}"
    return text


def _too_few(after: int, before: int) -> str:
    """Return why a change has no size: an interval needs two values on either side, and some scatter."""
    if after < 2:
        return "it shows in one session so far, and an interval needs two"
    return "one session was before it, and an interval needs two" if before < 2 else "the values before do not scatter"


def trends_json(made: Sequence[Trend], said: Sequence[str]) -> dict[str, Any]:
    """Return the charts as JSON types."""
    return {
        "format": "mesotap-trend",
        "version": 1,
        "charts": [_chart_json(trend) for trend in made],
        "notes": list(said),
    }


def _chart_json(trend: Trend) -> dict[str, Any]:
    drawn = trend.chart
    columns = (drawn.values, drawn.scores, drawn.ewma, drawn.ewma_limit, drawn.up, drawn.down)
    names = ("value", "score", "ewma", "ewma_limit", "cusum_up", "cusum_down")
    return {
        "quantity": trend.quantity,
        "unit": trend.unit,
        "cusum_limit": CUSUM_LIMIT,
        "points": [
            {
                "session": entry.path,
                "created": entry.created,
                **{name: _finite(float(column[i])) for name, column in zip(names, columns, strict=True)},
            }
            for i, entry in enumerate(trend.sessions)
        ],
        "alarms": [
            {
                "at": trend.sessions[alarm.at].path,
                "since": trend.sessions[alarm.since].path,
                "direction": "up" if alarm.upwards else "down",
                "by": [n for n, told in (("ewma", alarm.by_ewma), ("cusum", alarm.by_cusum)) if told],
                "change": None if alarm.change is None else alarm.change.as_json(),
                "statement": alarm_sentence(trend, number),
            }
            for number, alarm in enumerate(drawn.alarms)
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
