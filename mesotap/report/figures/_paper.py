"""Fig. 3, 7, 8 and 9 in the paper's axes: theory, published points, and a session's impacts as boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from analysis.contact import gaussian
from analysis.contact.presets import published_numbers
from analysis.contact.theory import TheoryCurve, surfaces_of, theory
from analysis.published import PublishedTable
from analysis.quoted import FLAT_KEYS
from analysis.results import SessionResults
from mesotap.report.figures._contact import BOX_LABEL, COMBINED_LABEL, N_PER_MN, draw_loads, draw_theory
from mesotap.report.figures._style import (
    BLACK,
    BLUE,
    DASHES,
    GREEN,
    GREY,
    PAGE_MM,
    PURPLE,
    VERMILION,
    blank,
    panel_letter,
    styled,
)

FIGURE_3_MN = np.geomspace(1.0, 1000.0, 200)
QUOTED_LABEL = "quoted in the text"
SIMULATED_LABELS = {
    BOX_LABEL: f"simulated session, {BOX_LABEL}",
    COMBINED_LABEL: f"simulated session, {COMBINED_LABEL}",
}
PUBLISHED_LABEL = "published (Eq. 11)"


@styled
def paper_figure_3() -> Figure:
    """Draw stiffness against load of flats of three roughnesses and of the sphere, with what is quoted (Fig. 3)."""
    figure = blank(PAGE_MM * 0.7, 86)
    axes = figure.subplots()
    quoted = published_numbers()["quoted"]["theory"]
    flat = surfaces_of("paper-flat")
    load = FIGURE_3_MN * N_PER_MN
    for (key, R_q), colour, dash in zip(FLAT_KEYS.items(), (BLUE, VERMILION, GREEN), DASHES, strict=False):
        k = gaussian.stiffness(load, flat.eta, flat.A_n or np.nan, flat.E_star, flat.R_s, R_q)
        size = f"{R_q * 1e9:.0f} nm" if R_q < 1e-6 else f"{R_q * 1e6:.0f} µm"
        axes.plot(FIGURE_3_MN, k * 1e-6, color=colour, linestyle=dash, label=f"flats, $R_q$ = {size} (Eq. 5)")
        _quoted(axes, quoted["load_mn"], quoted[key], colour)
    spheres = zip(theory("paper-sphere"), (BLACK, PURPLE, GREY), ("hertz_smooth", "hertz_rough", None), strict=True)
    for curve, colour, quote in spheres:
        label = f"{curve.name} ({curve.equation})"
        dash = DASHES[3] if quote is None else "-"
        axes.plot(FIGURE_3_MN, curve.stiffness(load) * 1e-6, color=colour, linestyle=dash, label=label)
        if quote is not None:
            _quoted(axes, quoted["load_mn"], quoted[quote], colour)
    axes.plot([], [], linestyle="none", marker="o", mfc="none", mec=GREY, label=QUOTED_LABEL)
    axes.set_yscale("log")
    axes.set_xlim(0, 1020)
    axes.set_ylim(0.02, 400)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlabel("Contact load $P$ [mN]")
    axes.set_ylabel("Contact stiffness $k_c$ [MN/m]")
    figure.legend(loc="outside right upper")
    return figure


@styled
def paper_figure_7_8(table: PublishedTable, results: SessionResults, curves: Sequence[TheoryCurve]) -> Figure:
    """Draw (a) stiffness and (b) damping against load of a published table, with a session's boxes (Fig. 7, 8)."""
    figure = blank(PAGE_MM, 82)
    left, right = figure.subplots(1, 2)
    top = draw_loads(left, results, lambda r: (r.contact_stiffness_n_per_m, r.stiffness_box), 1e-6)
    left.set_xlim(0, 1.06 * float(table.load_mn.max()))
    k = table.contact_stiffness_n_per_m * 1e-6
    _published(left, table.load_mn, k, PUBLISHED_LABEL)
    draw_theory(left, curves, max(top, float(k.max())))
    draw_loads(right, results, lambda r: (r.zeta2, r.damping_box), 100.0)
    quoted = published_numbers()["quoted"]["damping"]["sphere" if table.number == 3 else "flat"]
    _published(right, quoted["load_mn"], quoted["damping_percent"], QUOTED_LABEL)
    right.set_ylim(0, None)
    right.set_xlim(left.get_xlim())
    _finish(figure, left, right)
    return figure


@styled
def paper_figure_9(table: PublishedTable) -> Figure:
    """Draw (a) stiffness and (b) damping of the flats dry, with wear debris and lubricated (Fig. 9).

    Only the dry samples have a table; of the other conditions the text gives one load.
    """
    figure = blank(PAGE_MM, 74)
    left, right = figure.subplots(1, 2)
    conditions = published_numbers()["quoted"]["conditions"]
    left.plot(
        table.load_mn,
        table.contact_stiffness_n_per_m * 1e-6,
        "-",
        marker="o",
        color=BLUE,
        label="dry, Table 5 (Eq. 11)",
    )
    looks = (
        ("dry", "dry", BLUE, "D"),
        ("wear_debris", "wear debris", VERMILION, "s"),
        ("boundary_lubricated", "boundary lubricated", GREEN, "^"),
    )
    for key, name, colour, marker in looks:
        for axes, quantity in ((left, "contact_stiffness_n_per_um"), (right, "damping_percent")):
            axes.plot(
                conditions["load_mn"],
                conditions[key][quantity],
                linestyle="none",
                marker=marker,
                markersize=6,
                mfc="none",
                mec=colour,
                label=f"{name}, quoted in the text" if axes is left else None,
            )
    flat = published_numbers()["quoted"]["damping"]["flat"]
    right.plot(flat["load_mn"], flat["damping_percent"], linestyle="none", marker="o", color=BLUE, markersize=4)
    left.set_xlim(0, 1000)
    right.set_xlim(0, 1000)
    left.set_ylim(0, None)
    right.set_ylim(0, None)
    _finish(figure, left, right)
    return figure


def _finish(figure: Figure, left: Axes, right: Axes) -> None:
    for letter, axes in (("a", left), ("b", right)):
        panel_letter(axes, letter)
        axes.set_xlabel("Contact load $P$ [mN]")
    left.set_ylabel("Contact stiffness $k_c$ [MN/m]")
    right.set_ylabel(r"Contact damping ratio $\zeta_2$ [%]")
    entries: dict[str, Artist] = {}
    for axes in (left, right):
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(SIMULATED_LABELS.get(label, label), handle)
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=2, labelspacing=0.3)


def _quoted(axes: Axes, load_mn: Sequence[float], stiffness: Sequence[float], colour: str) -> None:
    axes.plot(
        load_mn, stiffness, linestyle="none", marker="o", mfc="none", mec=colour, mew=1.0, clip_on=False, zorder=5
    )


def _published(
    axes: Axes, load_mn: NDArray[np.float64] | Sequence[float], values: NDArray[np.float64], label: str
) -> None:
    axes.plot(
        load_mn,
        values,
        linestyle="none",
        marker="o",
        mfc="none",
        mec=BLACK,
        mew=0.9,
        markersize=6.5,
        label=label,
        zorder=6,
    )
