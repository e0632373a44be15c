"""The look of every figure: sizes of a journal's columns, type, colours that the colour-blind tell apart."""

from __future__ import annotations

import contextlib
import functools
import itertools
import re
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

COLUMN_MM, PAGE_MM = 85.0, 175.0  # one and two columns of most journals
MM_PER_INCH = 25.4
LARGEST_LINE = 3000  # points of one drawn line: more than a page shows

BLACK, GREY, PALE = "#000000", "#6b6b6b", "#e4e4e4"
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
PALETTE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)  # M. Okabe and K. Ito, Color Universal Design, 2008
MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1.5, 1.2)), (0, (8, 2, 2, 2)), (0, (2, 2)))

FONT = "DejaVu Sans"  # comes with matplotlib, so a figure is the same on every machine
STYLE: Any = {  # the keys' type differs between versions of matplotlib
    "font.family": FONT,
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "lines.linewidth": 1.0,
    "lines.markersize": 4.0,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "axes.formatter.useoffset": False,
    "figure.dpi": 100,
    "savefig.dpi": 300,
    "svg.fonttype": "path",
    "svg.hashsalt": "mesotap",
    "pdf.fonttype": 42,
    "path.simplify": True,
    "path.simplify_threshold": 0.05,
}

OF_THE_PROCESS = {"backend", "backend_fallback", "interactive", "toolbar"}  # no matter of looks

Parameters = ParamSpec("Parameters")


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """Draw with matplotlib's defaults and the house style, whatever the caller has set."""
    defaults: Any = {key: value for key, value in mpl.rcParamsDefault.items() if key not in OF_THE_PROCESS}
    with mpl.rc_context(defaults | STYLE):
        yield


def styled(draw: Callable[Parameters, Figure]) -> Callable[Parameters, Figure]:
    """Run a drawing function in the house style."""

    @functools.wraps(draw)
    def in_style(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Figure:
        with house_style():
            return draw(*args, **kwargs)

    return in_style


def blank(width_mm: float, height_mm: float) -> Figure:
    """Return an empty figure of a size in mm, with its own Agg canvas."""
    figure = Figure(figsize=(width_mm / MM_PER_INCH, height_mm / MM_PER_INCH), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panel_letter(axes: Axes, letter: str) -> None:
    """Write (a), (b), ... above the left corner of a panel."""
    axes.set_title(f"({letter})", loc="left", pad=3)


@functools.cache
def _drawable() -> frozenset[int]:
    return frozenset(font_manager.get_font(font_manager.findfont(FONT)).get_charmap())


def plain(text: str) -> str:
    """Return text of a user as a figure can draw it: no mathematics, no control characters, no unknown glyphs."""
    text = re.sub(r"\s+", " ", text).strip()
    text = "".join(c if ord(c) in _drawable() else "\N{WHITE SQUARE}" for c in text)
    text = text.replace("\\", "/").replace("$", r"\$")
    # matplotlib leaves out of its legends what begins with an underscore
    return f"\N{NO-BREAK SPACE}{text}" if text.startswith("_") else text


def decimated(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Decimate a dense line to the smallest and largest value of each stretch, so that no peak is lost.

    Parameters
    ----------
    x, y
        (n,) abscissa, ascending, and ordinate.

    Returns
    -------
    tuple
        (m,) of both, m at most ``LARGEST_LINE``; the input itself where it is short enough.
    """
    if x.size <= LARGEST_LINE:
        return x, y
    edges = np.linspace(0, x.size, LARGEST_LINE // 2 + 1).astype(int)
    kept: list[int] = []
    for start, stop in itertools.pairwise(edges.tolist()):
        kept += sorted({start + int(np.argmin(y[start:stop])), start + int(np.argmax(y[start:stop]))})
    return x[kept], y[kept]
