"""Stabilisation diagram of a ring-down: which poles come back as the model order grows."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from analysis.results import RecordingModes
from mesotap.report.figures._style import BLUE, GREY, PAGE_MM, VERMILION, blank, styled

BEYOND_LAST_MODE = 1.3


@styled
def stabilisation_figure(modes: RecordingModes) -> Figure:
    """Draw every pole of every model order over its frequency, stable ones filled, with the chosen modes marked."""
    figure = blank(PAGE_MM, 62)
    axes = figure.subplots()
    frequency = np.array([p.frequency_hz for p in modes.diagram])
    order = np.array([p.order for p in modes.diagram])
    stable = np.array([p.stable for p in modes.diagram], dtype=bool)
    end = BEYOND_LAST_MODE * max((m.frequency_hz.value for m in modes.modes), default=float(frequency.max()))
    for mode in modes.modes:
        axes.axvline(mode.frequency_hz.value, color=VERMILION, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
    loose: dict[str, Any] = {"linestyle": "none", "marker": "o", "mew": 0.4, "markersize": 2.0}
    axes.plot(frequency[~stable], order[~stable], mfc="none", mec=GREY, label="only at this order", **loose)
    axes.plot(frequency[stable], order[stable], mfc=BLUE, mec=BLUE, label="as at the order before", **loose)
    axes.set_xlim(0, end)
    axes.set_ylim(0, float(order.max()) * 1.22)
    axes.set_xlabel("Frequency [Hz]")
    axes.set_ylabel("Model order")
    axes.legend(loc="upper right", ncols=2)
    return figure
