"""Fig. 5: the strain gauge against dead weights, before and after the session."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.results import SessionResults
from calibration.gauge import GaugeResult
from daq.records import CalibrationPoints, Session
from mesotap.report.figures._style import BLACK, BLUE, COLUMN_MM, GREY, VERMILION, blank, styled

LOOK = {"before": ("o", BLUE), "after": ("s", VERMILION)}


@styled
def calibration_figure(session: Session, results: SessionResults) -> Figure:
    """Draw gauge voltage against load with the line midway between the calibrations; beneath, what it leaves in mN.

    Straight lines through the residuals of each calibration show a drift of offset or sensitivity.
    """
    sets = [(name, points) for name, points in (("before", session.pre), ("after", session.post)) if points is not None]
    line = results.calibration
    figure = blank(COLUMN_MM, 84)
    axes, beneath = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    end = max((float(points.load_mn.max()) for _, points in sets if points.load_mn.size), default=1.0) * 1.05
    for name, points in sets:
        marker, colour = LOOK[name]
        axes.plot(
            points.load_mn, points.voltage_mv, linestyle="none", marker=marker, mfc="none", mec=colour, mew=0.8,
            label=f"{name} the session",
        )  # fmt: skip
        if line is not None:
            _draw_residuals(beneath, points, line, marker, colour)
    if line is not None:
        ends = np.array([0.0, end])
        voltage = line.offset_mv.value + line.sensitivity_mv_per_mn.value * ends
        axes.plot(ends, voltage, color=BLACK, linewidth=0.7, zorder=1, label="line midway" if len(sets) > 1 else "line")
    beneath.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    beneath.set_xlim(-0.02 * end, end)
    beneath.set_xlabel("Dead weight [mN]")
    beneath.set_ylabel("Residual [mN]")
    axes.set_ylabel("Gauge voltage [mV]")
    axes.legend(loc="upper left")
    figure.align_ylabels()
    return figure


def _draw_residuals(axes: Axes, points: CalibrationPoints, line: GaugeResult, marker: str, colour: str) -> None:
    expected = line.offset_mv.value + line.sensitivity_mv_per_mn.value * points.load_mn
    residual_mn = (points.voltage_mv - expected) / line.sensitivity_mv_per_mn.value
    axes.plot(
        points.load_mn, residual_mn, linestyle="none", marker=marker, mfc="none", mec=colour, mew=0.8, markersize=3
    )
    if np.unique(points.load_mn).size > 1:
        slope, offset = np.polyfit(points.load_mn, residual_mn, 1)
        ends = np.array([points.load_mn.min(), points.load_mn.max()])
        axes.plot(ends, offset + slope * ends, color=colour, linewidth=0.7)
