"""Explanations of stiffness against load: curves, errors at loads they were not fitted to, probabilities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.contact.theory import TheoryCurve
from analysis.contact.weighing import Weighed
from mesotap.report.figures._contact import N_PER_MN
from mesotap.report.figures._style import BLACK, BLUE, DASHES, GREY, PAGE_MM, PALE, PALETTE, blank, panel_letter, styled

SHOWN, BARS = 4, 9  # explanations with a curve; with a bar
CURVE_POINTS = 120
FIRST = 0.7  # of the lowest load, where curves begin
COLOURS = tuple(colour for colour in PALETTE if colour != BLUE)


@styled
def weighing_figure(
    load_mn: NDArray[np.float64],
    stiffness_n_per_m: NDArray[np.float64],
    weighed: Sequence[Weighed],
    drawn: TheoryCurve | None = None,
    half_width: NDArray[np.float64] | None = None,
    elsewhere: NDArray[np.bool_] | None = None,
) -> Figure:
    """Draw (a) points and curves, (b) the error at each load predicted from the others, (c) probabilities.

    Parameters
    ----------
    load_mn, stiffness_n_per_m
        (n,) each, mN and N/m.
    weighed
        Explanations, most probable first.
    drawn
        A theory that nothing was fitted to, to hold beside them.
    half_width
        (n,) half of the interval of each stiffness, N/m.
    elsewhere
        (n,) which points are of another assembly.
    """
    figure = blank(PAGE_MM, 92)
    curves, errors, bars = figure.subplots(1, 3, width_ratios=(1.15, 0.9, 0.8))
    end = 1.06 * float(load_mn.max())
    along = np.linspace(end / CURVE_POINTS, end, CURVE_POINTS)
    error = None if half_width is None else half_width * 1e-6
    curves.errorbar(
        load_mn,
        stiffness_n_per_m * 1e-6,
        yerr=error,
        fmt="o",
        color=BLUE,
        mec="white",
        mew=0.5,
        markersize=5.5,
        elinewidth=0.8,
        label="measured",
        zorder=5,
    )
    if elsewhere is not None and elsewhere.any():
        curves.plot(
            load_mn[elsewhere], stiffness_n_per_m[elsewhere] * 1e-6, "o", mfc="white", mec=BLUE, markersize=5.5,
            label="of another assembly (Fig. 6)", zorder=6,
        )  # fmt: skip
    top = 1.45 * float(stiffness_n_per_m.max()) * 1e-6
    if drawn is not None:
        k = np.asarray(drawn.stiffness(along * N_PER_MN)) * 1e-6
        label = f"theory as drawn ({drawn.equation}), nothing fitted"
        curves.plot(along, np.where(k < top, k, np.nan), color=BLACK, linewidth=0.9, linestyle=DASHES[1], label=label)
        before = 100 * np.expm1(np.log(stiffness_n_per_m / drawn.stiffness(load_mn * N_PER_MN)))
        errors.plot(load_mn, before, color=BLACK, marker="x", linewidth=0.6, linestyle=DASHES[1])
    for w, colour, dash in zip(weighed[:SHOWN], COLOURS, DASHES, strict=False):
        near = along[along > FIRST * float(load_mn.min())]
        k = w.curve(near * N_PER_MN) * 1e-6
        curves.plot(near, np.where(k < top, k, np.nan), color=colour, linestyle=dash, label=short_name(w.candidate.id))
        errors.plot(load_mn, 100 * np.expm1(w.left_out_error), color=colour, linestyle=dash, marker="o", markersize=3)
    curves.set_xlim(0, end)
    curves.set_ylim(0, top)
    curves.set_ylabel("Contact stiffness $k_c$ [MN/m]")
    errors.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    errors.set_xlim(0, end)
    errors.set_ylabel("Measured over predicted from the other loads [%]")
    for axes in (curves, errors):
        axes.set_xlabel("Contact load $P$ [mN]")
    _draw_bars(bars, weighed)
    for letter, axes in zip("abc", (curves, errors, bars), strict=True):
        panel_letter(axes, letter)
    figure.legend(*curves.get_legend_handles_labels(), loc="outside lower left", ncols=3, labelspacing=0.3)
    return figure


def short_name(name: str) -> str:
    """Write the id of an explanation as words."""
    return name.replace("_", " ").replace("+", " + ")


def _draw_bars(axes: Axes, weighed: Sequence[Weighed]) -> None:
    shown = list(weighed[:BARS])
    places = np.arange(len(shown))
    widths = [100 * w.probability for w in shown]
    colours = [COLOURS[i] if i < SHOWN else PALE for i in range(len(shown))]
    axes.barh(places, widths, height=0.34, color=colours, align="edge")
    for place, w, width in zip(places, shown, widths, strict=True):
        share = f"{width:.0f}" if width >= 1 else f"{width:.1g}" if width >= 0.1 else "< 0.1"
        axes.annotate(
            f"{short_name(w.candidate.id)}: {share} %", (0, place - 0.08), ha="left", va="bottom", fontsize=6.8
        )
    axes.set_ylim(len(shown) - 0.4, -0.7)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlim(0, max(100 * 0.01, 1.15 * max(widths)))
    axes.set_xlabel("Probability [%]")
