"""Fig. 7, 8: contact stiffness and damping against load, and the impacts behind them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from analysis.contact.theory import TheoryCurve
from analysis.results import LoadResult, SessionResults
from analysis.statistics import BoxStatistics
from calibration.estimate import Estimate
from mesotap.report.figures._style import BLACK, BLUE, COLUMN_MM, DASHES, GREY, PALETTE, blank, plain, styled

N_PER_MN = 1e-3  # newtons in a millinewton
MEGA, PERCENT = 1e-6, 100.0
BOX_WIDTH = 0.036  # of the load axis
LOG_RATIO = 8.0  # damping that spans more than this is drawn on a logarithmic axis
HEADROOM, MOST_HEADROOM = 1.12, 2.4  # the stiffness axis ends at most at so many times the measured
THEORY_POINTS = 121
MOST_LOADS = 4  # in a figure with a line or more a load
BOX_LABEL, COMBINED_LABEL = "impacts: quartiles, whiskers, outliers", "combined, 95 % intervals"
DRIFT_MARK = "†"
DRIFT_FOOTNOTE = f"{DRIFT_MARK} The strain gauge drifted: loads are in doubt."
ESTIMATE_STYLE: dict[str, Any] = {
    "fmt": "D",
    "color": BLACK,
    "markersize": 2.0,
    "mew": 0.5,
    "elinewidth": 0.7,
    "capsize": 1.2,
    "capthick": 0.7,
    "zorder": 5,
}
THEORY_COLOURS = (*PALETTE[1:], BLACK)  # theory's colours: blue is the measurement's


def axis_load(load: LoadResult) -> float:
    """Return the load in mN at which a result is drawn: as measured, or the target where that is unknown."""
    return load.target_load_mn if load.load_mn is None else load.load_mn.value


def drifted(results: SessionResults) -> bool:
    """Whether the loads are in doubt because the gauge drifted between its calibrations."""
    return results.calibration is not None and results.calibration.drifted


def load_text(load: LoadResult, results: SessionResults) -> str:
    """Write a load as the legend and the table name it."""
    text = f"{axis_load(load):.0f} mN" if load.load_mn is not None else f"target {axis_load(load):.0f} mN"
    return text + (DRIFT_MARK if drifted(results) else "")


def drift_footnote(results: SessionResults) -> str:
    """Return the line beneath an axis label that says the gauge drifted; empty where it did not."""
    return f"\n{DRIFT_FOOTNOTE}" if drifted(results) else ""


def load_label(axes: Axes, results: SessionResults) -> None:
    """Label a load axis, with a footnote where the gauge drifted."""
    mark = f" {DRIFT_MARK}" if drifted(results) else ""
    axes.set_xlabel(f"Contact load $P$ [mN]{mark}{drift_footnote(results)}")


def spread_over_loads(loads: Sequence[LoadResult]) -> list[LoadResult]:
    """Choose at most four of the loads, evenly over their range, both ends among them."""
    ordered = sorted((load for load in loads if math.isfinite(axis_load(load))), key=axis_load)
    picks = np.linspace(0, len(ordered) - 1, min(MOST_LOADS, len(ordered)))
    return [ordered[round(pick)] for pick in picks]


@styled
def stiffness_figure(results: SessionResults, theory: Sequence[TheoryCurve]) -> Figure:
    """Draw contact stiffness against load: a box of the impacts, the combined estimate, theory (Fig. 7a, 8a).

    Beneath, boxes and intervals again in % of the combined estimate, as they are mostly small.
    """
    figure = blank(COLUMN_MM, 100)
    axes, spread = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    top = draw_loads(axes, results, lambda r: (r.contact_stiffness_n_per_m, r.stiffness_box), MEGA)
    draw_theory(axes, theory, top)
    _draw_spread(spread, results)
    load_label(spread, results)
    axes.set_ylabel("Contact stiffness $k_c$ [MN/m]")
    spread.set_ylabel("Spread [%]")
    figure.align_ylabels()
    _legend(figure, axes)
    return figure


@styled
def damping_figure(results: SessionResults) -> Figure:
    """Draw the damping ratio of the contact mode against load (Fig. 7b, 8b)."""
    figure = blank(COLUMN_MM, 100)
    axes = figure.subplots()
    top = draw_loads(axes, results, lambda r: (r.zeta2, r.damping_box), PERCENT)
    values = [r.zeta2.value * PERCENT for r in results.loads if r.zeta2 is not None and r.zeta2.value > 0]
    if values and max(values) > LOG_RATIO * min(values):
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(min(values) / 2, max(top, max(values)) * 1.5)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(0, top * HEADROOM if top > 0 else None)
    load_label(axes, results)
    axes.set_ylabel(r"Damping ratio of the contact mode $\zeta_2$ [%]")
    _legend(figure, axes)
    return figure


@styled
def published_figure(
    load_mn: NDArray[np.float64],
    contact_stiffness_n_per_m: NDArray[np.float64],
    theory: Sequence[TheoryCurve],
    label: str = "published, by Eq. 11",
    with_tubes: NDArray[np.float64] | None = None,
) -> Figure:
    """Draw the contact stiffness of a published table, analysed again, against load with theory.

    Parameters
    ----------
    load_mn, contact_stiffness_n_per_m
        (n,) load in mN and stiffness in N/m.
    theory
        Curves to draw beside it.
    label
        Name of the points in the legend.
    with_tubes
        (n,) stiffness with the inertia of the tube springs, N/m.
    """
    figure = blank(COLUMN_MM, 84)
    axes = figure.subplots()
    stiffness = np.asarray(contact_stiffness_n_per_m) * MEGA
    axes.plot(
        load_mn,
        stiffness,
        linestyle="none",
        marker="o",
        color=BLUE,
        mec="white",
        mew=0.5,
        markersize=5,
        label=plain(label),
        zorder=4,
    )
    if with_tubes is not None:
        axes.plot(
            load_mn, with_tubes * MEGA, linestyle="none", marker="o", mfc="none", color=BLUE, mew=0.7, markersize=5,
            label="with the tubes' inertia", zorder=5,
        )  # fmt: skip
    axes.set_xlim(0, float(np.max(load_mn)) * 1.06)
    draw_theory(axes, theory, float(np.max(stiffness)))
    axes.set_xlabel("Contact load $P$ [mN]")
    axes.set_ylabel("Contact stiffness $k_c$ [MN/m]")
    _legend(figure, axes)
    return figure


Reading = Callable[[LoadResult], tuple[Estimate | None, BoxStatistics | None]]


def draw_loads(axes: Axes, results: SessionResults, reading: Reading, scale: float) -> float:
    """Draw box and combined estimate of each load; return the largest number drawn."""
    loads = [load for load in results.loads if math.isfinite(axis_load(load))]
    end = max((axis_load(load) for load in loads), default=1.0) * 1.06
    axes.set_xlim(0, end)
    drawn = [(axis_load(load), box) for load in loads if (box := reading(load)[1]) is not None]
    if drawn:
        axes.bxp([_bxp(box, scale) for _, box in drawn], positions=[at for at, _ in drawn], **_box_style(end))
        axes.plot(
            [],
            [],
            linestyle="none",
            marker="s",
            markersize=6,
            mfc="#cfe3f1",
            mec=BLUE,
            mew=0.7,
            label=BOX_LABEL,
        )
    largest = [
        0.0,
        *(box.upper_whisker * scale for _, box in drawn),
        *(o * scale for _, box in drawn for o in box.outliers),
    ]
    label: str | None = COMBINED_LABEL
    for load in loads:
        estimate = reading(load)[0]
        if estimate is None:
            continue
        across = _finite(load.load_mn.half_width) if load.load_mn is not None else 0.0
        up = _finite(estimate.half_width) * scale
        axes.errorbar(
            axis_load(load),
            estimate.value * scale,
            yerr=up,
            xerr=across,
            mfc="white" if load.load_mn is None else BLACK,
            label=label,
            **ESTIMATE_STYLE,
        )
        label = None
        largest.append(estimate.value * scale + up)
    return max(value for value in largest if math.isfinite(value))


def _draw_spread(axes: Axes, results: SessionResults) -> None:
    """Draw boxes and intervals in % of each load's combined estimate."""
    end = axes.get_xlim()[1]
    axes.axhline(0, color=GREY, linewidth=0.4, zorder=0)
    for load in results.loads:
        estimate, box, at = load.contact_stiffness_n_per_m, load.stiffness_box, axis_load(load)
        if estimate is None or not estimate.value > 0 or not math.isfinite(at):
            continue
        if box is not None:
            axes.bxp([_bxp(box, PERCENT / estimate.value, PERCENT)], positions=[at], **_box_style(end))
        half = _finite(estimate.half_width) * PERCENT / estimate.value
        axes.errorbar(at, 0, yerr=half, mfc="white" if load.load_mn is None else BLACK, **ESTIMATE_STYLE)


def _legend(figure: Figure, axes: Axes) -> None:
    """Put the legend beneath: what was measured first, then theory."""
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda i: labels[i] not in (BOX_LABEL, COMBINED_LABEL))
    figure.legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="outside lower center",
        handlelength=2.8,
        labelspacing=0.3,
    )


def draw_theory(axes: Axes, theory: Sequence[TheoryCurve], measured_top: float) -> None:
    """Draw curves over the load axis; the measurement, not the highest theory, sets the scale."""
    end = axes.get_xlim()[1]
    load_mn = np.linspace(end / THEORY_POINTS, end, THEORY_POINTS)
    curves = [(curve, np.asarray(curve.stiffness(load_mn * N_PER_MN), dtype=float) * MEGA) for curve in theory]
    peaks = [float(np.nanmax(k)) for _, k in curves if np.isfinite(k).any()]
    measured_top = measured_top or max(peaks, default=1.0)
    top = max([measured_top, *(peak for peak in peaks if peak <= MOST_HEADROOM * measured_top)])
    if any(peak > MOST_HEADROOM * measured_top for peak in peaks):
        top = max(top, MOST_HEADROOM * measured_top / HEADROOM)
    axes.set_ylim(0, top * HEADROOM)
    for (curve, stiffness), colour, dash in zip(curves, _cycle(THEORY_COLOURS), _cycle(DASHES), strict=False):
        inside = np.isfinite(stiffness) & (stiffness <= top * HEADROOM)
        label = plain(f"{curve.name} ({curve.equation})" if curve.equation else curve.name)
        if inside.any():
            axes.plot(load_mn, stiffness, color=colour, linestyle=dash, label=label, zorder=2)
        else:
            axes.plot([], [], color=colour, linestyle=dash, label=f"{label}: above the axis")


def _cycle(items: Sequence[Any]) -> Iterable[Any]:
    while True:
        yield from items


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _bxp(box: BoxStatistics, scale: float, centre: float = 0.0) -> dict[str, object]:
    return {
        "q1": box.lower_quartile * scale - centre,
        "med": box.median * scale - centre,
        "q3": box.upper_quartile * scale - centre,
        "whislo": box.lower_whisker * scale - centre,
        "whishi": box.upper_whisker * scale - centre,
        "fliers": [outlier * scale - centre for outlier in box.outliers],
    }


def _box_style(end: float) -> dict[str, Any]:
    line = {"color": BLUE, "linewidth": 0.7}
    return {
        "widths": BOX_WIDTH * end,
        "manage_ticks": False,
        "patch_artist": True,
        "boxprops": {"facecolor": "#cfe3f1", "edgecolor": BLUE, "linewidth": 0.7},
        "medianprops": line | {"linewidth": 1.1},
        "whiskerprops": line,
        "capprops": line,
        "flierprops": {"marker": "o", "markersize": 2.4, "mec": BLUE, "mfc": "none", "mew": 0.6},
        "zorder": 3,
    }
