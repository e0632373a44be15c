"""k_c and zeta over load of several sessions in one figure (as the paper's Fig. 9), with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from mesotap.report.figures._contact import DRIFT_FOOTNOTE, DRIFT_MARK, LOG_RATIO, MEGA, PERCENT
from mesotap.report.figures._style import GREY, MARKERS, PAGE_MM, PALETTE, blank, panel_letter, plain, styled

MOST_NAMED = 12  # sessions in the legend


@styled
def compared_figure(sessions: Sequence[tuple[str, str, bool, Sequence[dict[str, Any]]]]) -> Figure:
    """Draw (a) contact stiffness and (b) damping against load.

    Parameters
    ----------
    sessions
        Label, group (sessions of one group have one colour), whether the gauge drifted, and the loads as results.json
        has them.
    """
    figure = blank(PAGE_MM, 80)
    left, right = figure.subplots(1, 2)
    groups = list(dict.fromkeys(group for _, group, _, _ in sessions))
    for number, (label, group, drifted, loads) in enumerate(sessions):
        colour = PALETTE[groups.index(group) % len(PALETTE)]
        look = {"color": colour, "marker": MARKERS[number % len(MARKERS)], "mfc": "none", "linewidth": 0.6, "mew": 0.8}
        look |= {"elinewidth": 0.7, "capsize": 1.5, "markersize": 4}
        if number < MOST_NAMED:
            look["label"] = plain(label) + (DRIFT_MARK if drifted else "")
        _draw(left, loads, "contact_stiffness_n_per_m", MEGA, look)
        _draw(right, loads, "zeta2", PERCENT, look)
    for letter, axes, name in (("a", left, "Contact stiffness [MN/m]"), ("b", right, "Damping ratio $\\zeta_2$ [%]")):
        panel_letter(axes, letter)
        axes.set_xlabel("Load [mN]")
        axes.set_ylabel(name)
        axes.set_xlim(0, None)
        axes.set_ylim(0, None)
    values = [load["zeta2"]["value"] for *_, loads in sessions for load in loads]
    if values and min(values) > 0 and max(values) > LOG_RATIO * min(values):
        right.set_ylim(auto=True)
        right.set_yscale("log")
        right.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        right.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        right.yaxis.set_minor_formatter(NullFormatter())
    left.legend(loc="best")
    if any(drifted for _, _, drifted, _ in sessions):
        figure.text(0.01, 0.005, DRIFT_FOOTNOTE, fontsize=7, color=GREY)
    return figure


def _draw(axes: Axes, loads: Sequence[dict[str, Any]], quantity: str, scale: float, look: dict[str, Any]) -> None:
    loads = sorted(loads, key=lambda load: load["load_mn"]["value"])
    x, across = [load["load_mn"]["value"] for load in loads], [_arms(load["load_mn"], 1.0) for load in loads]
    y, along = [scale * load[quantity]["value"] for load in loads], [_arms(load[quantity], scale) for load in loads]
    axes.errorbar(x, y, xerr=list(zip(*across, strict=True)), yerr=list(zip(*along, strict=True)), **look)


def _arms(estimate: dict[str, float], scale: float) -> tuple[float, float]:
    value = estimate["value"]
    return scale * max(value - estimate["low"], 0.0), scale * max(estimate["high"] - value, 0.0)
