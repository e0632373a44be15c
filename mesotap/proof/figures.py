"""The figures of a proof: detection against strength, p-values, probabilities, and who was taken for whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from mesotap.proof.scores import AtGrade, Count, Nulls, Reliability, power
from mesotap.report.figures._style import BLACK, BLUE, GREY, PAGE_MM, VERMILION, blank, styled

CELL_MM = 5.6
LABEL_MM, EDGE_MM = 38.0, 7.0


def _bars(count: Count) -> tuple[float, float]:
    low, high = count.interval
    return count.share - low, high - count.share


@styled
def detection_figure(lines: Sequence[AtGrade]) -> Figure:
    """Draw the share of single effects detected, located and named against d, and the test that knows the answer."""
    figure = blank(0.6 * PAGE_MM, 62.0)
    axes = figure.subplots()
    d = np.geomspace(1.0, 500.0, 200)
    axes.plot(d, [power(v) for v in d.tolist()], color=GREY, linestyle="--", label="a test that knows the answer")
    drawn = (
        ("detected", BLACK, "o", 0.94, [(g.grade, g.detected) for g in lines]),
        ("component right, of the detected", BLUE, "s", 1.0, [(g.grade, g.component) for g in lines]),
        ("named, or among declared look-alikes", VERMILION, "^", 1.06, [(g.grade, g.covered) for g in lines]),
    )
    for label, colour, marker, aside, points in drawn:
        shown = [(g * aside, c) for g, c in points if c.of]
        if shown:
            bars = np.array([_bars(c) for _, c in shown]).T
            x, y = [g for g, _ in shown], [c.share for _, c in shown]
            axes.errorbar(x, y, bars, color=colour, marker=marker, linewidth=0.8, capsize=1.5, label=label)
    axes.set_xscale("log")
    axes.set_xlim(1.0, 500.0)
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel("d: what survives the refit of Eq. 9, standard deviations of the noise")
    axes.set_ylabel("share of the sessions")
    axes.legend(loc="lower right")
    return figure


@styled
def p_value_figure(found: Nulls) -> Figure:
    """Draw the p-values of nulls, in order, against those of a uniform distribution, with its 95 % band."""
    from scipy.stats import beta

    figure = blank(0.5 * PAGE_MM, 62.0)
    axes = figure.subplots()
    n = len(found.p_values)
    rank = np.arange(1, n + 1)
    expected = rank / (n + 1)
    low, high = beta.ppf(0.025, rank, n + 1 - rank), beta.ppf(0.975, rank, n + 1 - rank)
    axes.fill_between(expected, low, high, color=GREY, alpha=0.25, linewidth=0, label="95 % of uniform ones")
    axes.plot([1e-4, 1], [1e-4, 1], color=GREY, linewidth=0.8)
    smallest = 0.3 / (n + 1)
    axes.plot(
        expected,
        np.maximum(found.p_values, smallest),
        "o",
        color=BLUE,
        markersize=3,
        label="sessions without an effect",
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(smallest, 1.2)
    axes.set_ylim(smallest, 1.2)
    axes.set_xlabel("p-value expected")
    axes.set_ylabel("p-value stated")
    axes.legend(loc="upper left")
    return figure


@styled
def reliability_figure(lines: Sequence[Reliability]) -> Figure:
    """Draw how often names were right against the probability stated."""
    figure = blank(0.5 * PAGE_MM, 62.0)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=GREY, linestyle="--", label="as often as stated")
    shown = [r for r in lines if r.right.of]
    if shown:
        bars = np.array([_bars(r.right) for r in shown]).T
        axes.errorbar(
            [r.mean for r in shown],
            [r.right.share for r in shown],
            bars,
            color=BLUE,
            marker="o",
            capsize=1.5,
            linestyle="",
            label="names",
        )
        for r in shown:
            axes.annotate(
                str(r.right.of), (r.mean, r.right.share), xytext=(-4, 4), textcoords="offset points", ha="right"
            )
    axes.set_xlim(0, 1.03)
    axes.set_ylim(0, 1.03)
    axes.set_xlabel("probability stated")
    axes.set_ylabel("share that is right")
    axes.legend(loc="upper left")
    return figure


@styled
def confusion_figure(table: Mapping[str, Mapping[str, int]], order: Sequence[str]) -> Figure:
    """Draw how often each thing was said of each thing hidden, in shares of a line; the numbers are sessions.

    ``order`` is that of the mechanisms; what was never hidden nor said is left out.
    """
    said = {name for line in table.values() for name in line}
    columns = [name for name in (*order, "unexplained", "consistent") if name in said or name in table]
    columns += sorted(said - set(columns))
    rows = [name for name in ("nothing", *order) if name in table]
    rows += sorted(set(table) - set(rows))
    # the turned labels are longer than the automatic layout thinks
    width, height = LABEL_MM + CELL_MM * len(columns) + EDGE_MM, LABEL_MM + CELL_MM * len(rows) + EDGE_MM
    figure = blank(width, height)
    figure.set_layout_engine("none")
    axes = figure.add_axes(
        (LABEL_MM / width, LABEL_MM / height, CELL_MM * len(columns) / width, CELL_MM * len(rows) / height)
    )
    shares = np.zeros((len(rows), len(columns)))
    for i, row in enumerate(rows):
        total = sum(table[row].values())
        for j, column in enumerate(columns):
            count = table[row].get(column, 0)
            shares[i, j] = count / total
            if count:
                shade = "white" if shares[i, j] > 0.6 else BLACK
                axes.text(j, i, str(count), ha="center", va="center", color=shade, fontsize=7)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    axes.set_xticks(
        range(len(columns)), [c.replace("_", " ") for c in columns], rotation=60, ha="right", rotation_mode="anchor"
    )
    axes.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
    figure.text(1 / width, 1 - 1 / height, "hidden (rows), said (columns)", va="top")
    axes.spines[:].set_visible(True)
    return figure
