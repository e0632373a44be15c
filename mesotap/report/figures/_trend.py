"""Control charts over sessions: values with their alarms, and beneath each what EWMA and CUSUM make of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from analysis.control_charts import CUSUM_LIMIT, Chart
from mesotap.report.figures._style import BLACK, BLUE, GREY, PAGE_MM, PALE, VERMILION, blank, plain, styled

ROW_MM = 42.0


@styled
def trend_figure(charts: Sequence[tuple[str, str, Chart]]) -> Figure:
    """Draw a row for each quantity: its values on the left, its charts in units of their limits on the right.

    Parameters
    ----------
    charts
        Quantity, unit, chart.
    """
    figure = blank(PAGE_MM, ROW_MM * len(charts) + 6)
    rows: Any = figure.subplots(len(charts), 2, squeeze=False, sharex=True)
    for (left, right), (quantity, unit, drawn) in zip(rows, charts, strict=True):
        _values(left, drawn, f"{plain(quantity)} [{plain(unit)}]")
        _limits(right, drawn)
    for axes in rows[-1]:
        axes.set_xlabel("Session, in the order of dates")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    rows[0][1].legend(loc="upper left", ncols=3, columnspacing=1.0, handlelength=1.8, borderaxespad=0.2)
    return figure


def _values(axes: Axes, drawn: Chart, label: str) -> None:
    number = np.arange(1, len(drawn.values) + 1)
    axes.plot(number, drawn.values, color=GREY, linewidth=0.5, marker="o", mfc=BLUE, mec=BLUE, markersize=2.5)
    for alarm in drawn.alarms:
        axes.axvspan(alarm.since + 0.5, alarm.at + 1.5, color=PALE, zorder=0)
        axes.plot(alarm.at + 1, drawn.values[alarm.at], "o", mfc="none", mec=VERMILION, markersize=6)
    axes.set_title(label, loc="left")


def _limits(axes: Axes, drawn: Chart) -> None:
    number = np.arange(1, len(drawn.values) + 1)
    axes.plot(number, drawn.ewma / drawn.ewma_limit, color=BLACK, linewidth=1.0, label="EWMA")
    axes.plot(number, drawn.up / CUSUM_LIMIT, color=BLUE, linestyle=(0, (5, 1.5)), label="CUSUM up")
    axes.plot(number, -drawn.down / CUSUM_LIMIT, color=VERMILION, linestyle=(0, (1.5, 1.2)), label="CUSUM down")
    for limit in (-1, 1):
        axes.axhline(limit, color=GREY, linewidth=0.6)
    axes.set_ylim(-2.1, 2.1)
    axes.set_title("over its limit", loc="left")
