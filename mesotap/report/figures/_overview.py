"""What a session found, small enough for the first screen of a telephone: contact stiffness and its interval."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from analysis.results import LoadResult, SessionResults
from mesotap.answers.rounding import significant
from mesotap.report.figures._contact import ESTIMATE_STYLE, HEADROOM, MEGA, PERCENT, axis_load, load_label
from mesotap.report.figures._style import BLACK, BLUE, COLUMN_MM, GREY, blank, styled

HEIGHT_MM = 52  # with its caption a third of a screen of 390 by 844
MARKER_PT, PANEL_PT = 4.0, 60.0  # of a marker and, at least, of the upper panel's height


@styled
def overview_figure(results: SessionResults) -> Figure:
    """Draw contact stiffness against load, and beneath its 95 % intervals again in % of it: most are small."""
    figure = blank(COLUMN_MM, HEIGHT_MM)
    axes, relative = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    loads = _measured(results)
    style = ESTIMATE_STYLE | {"markersize": MARKER_PT, "color": BLUE, "elinewidth": 1.0, "capsize": 2.0}
    relative.axhline(0, color=GREY, linewidth=0.4, zorder=0)
    for load, stiffness, half in loads:
        at, filled = axis_load(load), "white" if load.load_mn is None else BLUE
        across = load.load_mn.half_width if load.load_mn is not None else 0.0
        across = across if math.isfinite(across) else 0.0
        axes.errorbar(at, stiffness * MEGA, yerr=half * MEGA, xerr=across, mfc=filled, **style)
        relative.errorbar(at, 0, yerr=half / abs(stiffness) * PERCENT, mfc=filled, **style | {"markersize": 2.0})
    axes.set_xlim(0, max((axis_load(load) for load, *_ in loads), default=1.0) * 1.06)
    axes.set_ylim(min([0.0, *(k - h for _, k, h in loads)]) * MEGA, _top(loads) * MEGA)
    axes.set_ylabel("$k_c$ [MN/m]", color=BLACK)
    relative.set_ylabel("± [%]")
    load_label(relative, results)
    figure.align_ylabels()
    return figure


def seen_intervals(results: SessionResults) -> str:
    """Say in the caption how wide the intervals are, and whether the markers hide them; empty where none is known."""
    measured = _measured(results)
    loads = [(k, half) for _, k, half in measured if half > 0]
    if not loads:
        return ""
    percent = sorted(half / abs(k) * PERCENT for k, half in loads)
    low, high = significant(percent[0], 2), significant(percent[-1], 2)
    marker = MARKER_PT / 2 / PANEL_PT * _top(measured)
    hidden = sum(half < marker for _, half in loads)
    words = f"± {low} %" if low == high else f"± {low} to {high} %"
    if not hidden:
        return words
    return f"{words}: {'smaller than the marker' if hidden == len(loads) else 'some smaller than the marker'}"


def _measured(results: SessionResults) -> list[tuple[LoadResult, float, float]]:
    """Return each load that has a stiffness, this, and half of its interval; 0 where that is not known."""
    found = [(load, k) for load in results.loads if (k := load.contact_stiffness_n_per_m) is not None]
    return [
        (load, k.value, k.half_width if math.isfinite(k.half_width) else 0.0)
        for load, k in found
        if math.isfinite(axis_load(load)) and math.isfinite(k.value) and k.value
    ]


def _top(loads: list[tuple[LoadResult, float, float]]) -> float:
    return max((k + half for _, k, half in loads), default=1.0) * HEADROOM or 1.0
