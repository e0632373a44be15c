"""The figure of a learned law: its force with the 95 % band over what the recordings cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.mismatch.answer import LawTable
from mesotap.answers.rounding import significant
from mesotap.report.figures._style import BLACK, BLUE, GREY, MARKERS, PAGE_MM, VERMILION, blank, styled
from sim_backend.arrays import Real

LABELS = {"deflection_m": ("Deflection", "m"), "rate_m_per_s": ("Rate", "m/s")}
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
Overlay = tuple[str, Real]
"""Name of a listed law and its force on the law's grid, N."""


@styled
def law_figure(table: LawTable, listed: Sequence[Overlay] = ()) -> Figure:
    """Draw a learned law against what it depends on; a surface as lines at five values of the second axis.

    Parameters
    ----------
    listed
        Forces of the listed laws that come nearest, on the same grid.
    """
    figure = blank(PAGE_MM, 78)
    axes = figure.add_subplot()
    (name, along), *others = table.axes.items()
    per, prefix = _scale(along)
    force_per, force_prefix = _scale(table.force_n)
    if others:
        _lines(axes, table, (per, force_per))
    else:
        axes.fill_between(along / per, table.low / force_per, table.high / force_per, color=BLUE, alpha=0.25,
                          linewidth=0, label="95 %")  # fmt: skip
        axes.plot(along / per, table.force_n / force_per, color=BLUE, label="learned")
        for (other, force), colour in zip(listed, (VERMILION, GREY), strict=False):
            axes.plot(along / per, force / force_per, color=colour, linestyle="--", linewidth=0.9, label=other)
    axes.axhline(0.0, color=BLACK, linewidth=0.4)
    word, unit = LABELS[name]
    axes.set_xlabel(f"{word} [{prefix}{unit}]")
    axes.set_ylabel(f"Force beyond the linear element [{force_prefix}N]")
    axes.legend(frameon=False)
    return figure


def _lines(axes: Axes, table: LawTable, per: tuple[float, float]) -> None:
    """Draw a surface as lines along its first axis."""
    (_, along), (second, across) = table.axes.items()
    unit = LABELS[second][1]
    own, prefix = _scale(across)
    for i, marker in zip(np.linspace(0, across.size - 1, 5).astype(int), MARKERS, strict=False):
        label = f"{significant(float(across[i] / own), 2)} {prefix}{unit}"
        axes.plot(along / per[0], table.force_n[:, i] / per[1], marker=marker, markersize=2.5, label=label)


def _scale(values: Real) -> tuple[float, str]:
    """Return the unit's factor and prefix in which values are written."""
    largest = float(np.abs(values).max())
    return next(((f, p) for f, p in PREFIXES if largest >= f), PREFIXES[-1])
