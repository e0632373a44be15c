"""Figures of a diagnosis: where Eq. 9 leaves more than noise, what force is missing, and what is gained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from analysis.mismatch.evidence.excess import ExcessMap, Impacts
from analysis.mismatch.evidence.reconstruction import Reconstruction
from analysis.mismatch.evidence.varying import Varying
from analysis.mismatch.ring_downs.problem import RingDownFit
from mesotap.report.figures._style import (
    BLACK,
    BLUE,
    GREY,
    MARKERS,
    PAGE_MM,
    PALETTE,
    VERMILION,
    blank,
    decimated,
    panel_letter,
    styled,
)

Real = NDArray[np.float64]

MILLI, MICRO_PER_UNIT, KILO = 1e3, 1e6, 1e3
SAME_LOAD = 1.02  # ratio to the next load below which rows share a label
MOST_LOADS = 4  # drawn in the figures with a line a load
SMALLEST_SPAN = 1.5  # of the colour scale, as a ratio
LARGEST_SPAN = 1e3
SHOWN_SWINGS = 16  # of the contact mode, from the pulse on
SMALLEST_SWING = 0.2  # of the largest that is drawn
SMOOTHING_BINS = 9
FINER = 6  # points drawn for each sample of a curve
DEFLECTION_BINS, FEWEST_IN_BIN = 15, 4
NORMAL_95 = 1.959964
WITH_WHAT_WAS_LEFT_OUT = "with what was left out"
CHANNELS = ("mean of A and B", "difference of A and B")


@dataclass(frozen=True, slots=True)
class ForcePicture:
    """One impact's contact force, reconstructed, and by the laws along the same motion, (n,) N each.

    ``augmented`` is None where no law is better than Eq. 9's; ``frequency_hz`` that of the contact mode.
    """

    motion: Reconstruction
    linear: Real
    augmented: Real | None
    stiffness: float
    frequency_hz: float


def load_ticks(loads_n: Sequence[float]) -> tuple[list[float], list[str]]:
    """Return where labels of ascending loads stand, and the labels in mN; rows of nearly the same load share one."""
    rows: list[list[int]] = []
    for i, load in enumerate(loads_n):
        if i and load < SAME_LOAD * loads_n[i - 1]:
            rows[-1].append(i)
        else:
            rows.append([i])
    places = [(own[0] + own[-1] + 1) / 2 for own in rows]
    return places, [f"{MILLI * np.mean([loads_n[i] for i in own]):.0f}" for own in rows]


@styled
def excess_figure(by_frequency: ExcessMap, by_time: ExcessMap) -> Figure:
    """Draw the residual's power over the noise's against load and (top) frequency, (bottom) time after the pulse."""
    channels = len(by_frequency.power)
    figure = blank(PAGE_MM, 105)
    panels = figure.subplots(2, channels, squeeze=False)
    high = max(float(np.nanmax(m.power)) for m in (by_frequency, by_time))
    norm = LogNorm(1.0, min(max(high, SMALLEST_SPAN), LARGEST_SPAN))
    for row, (found, scale, label) in enumerate(
        ((by_frequency, 1 / KILO, "Frequency [kHz]"), (by_time, MILLI, "Time after the pulse [ms]"))
    ):
        edges = found.edges * scale
        if row:
            edges = np.concatenate([[edges[1] / 2], edges[1:]])
        for c, axes in enumerate(panels[row]):
            image = axes.pcolormesh(
                edges, np.arange(len(found.loads_n) + 1), np.maximum(found.power[c], 1.0), norm=norm, cmap="cividis"
            )
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.set_xlabel(label)
            axes.set_yticks(*load_ticks(found.loads_n))
            axes.tick_params(axis="y", length=0)
            if c == 0:
                axes.set_ylabel("Load [mN]")
            panel_letter(axes, "abcd"[row * channels + c])
            if channels == len(CHANNELS):
                axes.set_title(CHANNELS[c], loc="right", pad=3)
    bar = figure.colorbar(image, ax=panels, shrink=0.7, pad=0.01)
    bar.set_label("Power of the residual over that of the noise")
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if high < KILO / 100 else ""))
    return figure


@styled
def excess_by_impact_figure(impacts: Impacts) -> Figure:
    """Draw how far each impact's residual is beyond noise against (a) its order, (b) its strength."""
    figure = blank(PAGE_MM, 62)
    panels = figure.subplots(1, 2, sharey=True)
    loads = sorted(set(impacts.load_n.tolist()))
    colours = colormaps["viridis"](np.linspace(0, 0.9, len(loads)))
    for load, colour in zip(loads, colours, strict=True):
        own = impacts.load_n == load
        label = f"{MILLI * load:.0f} mN"
        for axes, x in zip(panels, (impacts.order, impacts.force_ratio), strict=True):
            axes.plot(x[own], impacts.excess[own], "o", color=colour, mec="white", mew=0.3, label=label)
    for axes, letter in zip(panels, "ab", strict=True):
        axes.axhspan(-NORMAL_95, NORMAL_95, color=GREY, alpha=0.15, linewidth=0)
        axes.axhline(0, color=GREY, linewidth=0.5)
        panel_letter(axes, letter)
    panels[0].set_xlabel("Place in the session")
    panels[1].set_xlabel("Largest dynamic contact force over the load")
    panels[0].set_ylabel("Residual beyond noise\n[standard deviations]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 8), handletextpad=0.2)
    return figure


@styled
def varying_figure(in_time: Sequence[Varying], by_amplitude: Sequence[Varying]) -> Figure:
    """Draw k_c, and c_c over its critical value, free in windows of (a, c) time and (b, d) amplitude."""
    figure = blank(PAGE_MM, 110)
    panels = figure.subplots(2, 2, sharex="col", sharey="row")
    chosen = _spread(len(in_time))
    for column, found in enumerate((in_time, by_amplitude)):
        for place, i in enumerate(chosen):
            one = found[i]
            x = one.middle * (MILLI if column == 0 else 1.0)
            for axes, value, error in (
                (panels[0, column], one.stiffness, one.stiffness_error),
                (panels[1, column], one.damping_ratio, one.damping_ratio_error),
            ):
                axes.errorbar(
                    x,
                    100 * value,
                    yerr=100 * NORMAL_95 * error,
                    color=PALETTE[place],
                    marker=MARKERS[place],
                    markersize=3.4,
                    mec="white",
                    mew=0.3,
                    linewidth=0.6,
                    elinewidth=0.7,
                    capsize=1.4,
                    capthick=0.7,
                    label=f"{MILLI * one.load_n:.0f} mN",
                )
    for axes in panels.flat:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    for axes in panels[0]:
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    _limit(panels[0, 0], [(100 * v.stiffness, 100 * v.stiffness_error) for f in (in_time, by_amplitude) for v in f])
    _limit(
        panels[1, 0],
        [(100 * v.damping_ratio, 100 * v.damping_ratio_error) for f in (in_time, by_amplitude) for v in f],
    )
    panels[0, 0].set_ylabel("Change of $k_c$ [%]")
    panels[1, 0].set_ylabel("$c_c$ over critical [%]")
    panels[1, 0].set_xlabel("Time after the pulse [ms]")
    panels[1, 1].set_xlabel("Dynamic contact force over the load")
    for letter, axes in zip("abcd", panels.flat, strict=True):
        panel_letter(axes, letter)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _limit(axes: Axes, values: Sequence[tuple[Real, Real]]) -> None:
    """Let the well-known windows of each load set the axis: those with wide intervals may leave it."""
    ends = [np.stack([v - NORMAL_95 * e, v + NORMAL_95 * e])[:, e <= 4 * np.median(e)] for v, e in values if v.size]
    if not ends:
        return
    low, high = (float(pick(np.concatenate([e[i] for e in ends]))) for i, pick in enumerate((np.min, np.max)))
    margin = 0.06 * (high - low)
    axes.set_ylim(low - margin, high + margin)


def _spread(count: int) -> list[int]:
    if count <= MOST_LOADS:
        return list(range(count))
    return sorted({round(i) for i in np.linspace(0, count - 1, MOST_LOADS)})


@styled
def force_figure(pictures: Sequence[ForcePicture], name: str = "") -> Figure:
    """Draw (top) the contact force against deflection and (bottom) what it is beyond Eq. 9's, an impact a column.

    ``name`` is that of the augmented law.
    """
    figure = blank(PAGE_MM, 120)
    panels = figure.subplots(2, len(pictures), squeeze=False)
    for column, picture in enumerate(pictures):
        motion = picture.motion
        swings = int(np.searchsorted(motion.time_s, motion.time_s[0] + SHOWN_SWINGS / picture.frequency_hz))
        size = np.abs(motion.deflection)
        shown = slice(0, min(swings, int(np.flatnonzero(size > SMALLEST_SWING * size.max())[-1]) + 1))
        x = motion.deflection[shown] * 1e9
        top, bottom = panels[:, column]
        for axes, base in ((top, 0.0), (bottom, picture.linear)):
            axes.plot(
                x,
                MILLI * (motion.force - base)[shown],
                "o",
                color=GREY,
                markersize=2.0,
                mew=0,
                alpha=0.55,
                label="reconstructed without a law",
            )
        reach = np.array([x.min(), x.max()])
        top.plot(reach, reach * 1e-9 * picture.stiffness * MILLI, color=BLUE, label="law of Eq. 9")
        bottom.axhline(0, color=BLUE)
        if picture.augmented is not None:
            extra = (picture.augmented - picture.linear)[shown]
            fine_x, total, fine_extra = _fine(x, MILLI * picture.augmented[shown], MILLI * extra)
            top.plot(fine_x, total, color=VERMILION, linewidth=0.7, label=f"with {name}")
            bottom.plot(fine_x, fine_extra, color=VERMILION, linewidth=0.7)
        bottom.errorbar(
            *_binned(x, MILLI * (motion.force - picture.linear)[shown]),
            color=BLACK,
            marker="o",
            markersize=3,
            capsize=1.5,
            elinewidth=0.8,
            linestyle="none",
            zorder=4,
            label="means, 95 %",
        )
        if motion.preload_n > 0 and MILLI * motion.preload_n < -1.15 * top.get_ylim()[0]:
            top.axhline(-MILLI * motion.preload_n, color=BLACK, linewidth=0.6, linestyle=(0, (2, 2)))
        ratio = float(np.abs(motion.force).max()) / motion.preload_n if motion.preload_n > 0 else np.nan
        top.set_title(
            f"impact {int(motion.name) if motion.name.isdigit() else motion.name}, {MILLI * motion.preload_n:.0f} mN, "
            f"dynamic force {100 * ratio:.0f} % of it",
            loc="right",
            pad=3,
        )
        panel_letter(top, "ab"[column % 2])
        panel_letter(bottom, "cd"[column % 2])
        bottom.set_xlabel("Deflection of the contact [nm]")
    panels[0, 0].set_ylabel("Dynamic contact force [mN]")
    panels[1, 0].set_ylabel("Force beyond Eq. 9 [mN]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    means, words = panels[1, 0].get_legend_handles_labels()
    handles, labels = [*handles, means[-1]], [*labels, words[-1]]
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), markerscale=1.5)
    return figure


def _fine(*rows: Real) -> list[Real]:
    """Return smooth curves through samples in time: few samples of a swing would be drawn as chords."""
    place = np.arange(rows[0].size)
    between = np.linspace(0, place[-1], FINER * place[-1] + 1)
    return [np.asarray(CubicSpline(place, row)(between), np.float64) for row in rows]


def _binned(x: Real, y: Real) -> tuple[Real, Real, Real]:
    """Return middle, mean and half of the 95 % interval of the points in bins of the deflection."""
    edges = np.linspace(x.min(), x.max(), DEFLECTION_BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, DEFLECTION_BINS - 1)
    rows = [(x[own].mean(), y[own].mean(), NORMAL_95 * y[own].std(ddof=1) / np.sqrt(own.sum()))
            for b in range(DEFLECTION_BINS) if (own := place == b).sum() >= FEWEST_IN_BIN]  # fmt: skip
    middle, mean, half = np.array(rows).reshape(-1, 3).T
    return middle, mean, half


@styled
def residual_spectra_figure(
    before: tuple[Real, Real],
    after: tuple[Real, Real] | None,
    names: Sequence[str] = CHANNELS,
    later: str = WITH_WHAT_WAS_LEFT_OUT,
) -> Figure:
    """Draw the residuals' spectra before and after, over the noise's; each (frequencies, power (channels, n)).

    ``later`` is what the model after has more than that before.
    """
    channels = len(before[1])
    figure = blank(PAGE_MM, 62)
    panels = figure.subplots(1, channels, sharey=True, squeeze=False)[0]
    for c, axes in enumerate(panels):
        for found, colour, label in ((before, BLUE, "Eq. 9"), (after, VERMILION, later)):
            if found is None:
                continue
            x, y = decimated(found[0] / KILO, _smooth(found[1][c]))
            axes.plot(x, 10 * np.log10(np.maximum(y, 1e-3)), color=colour, linewidth=0.8, label=label)
        axes.axhline(0, color=BLACK, linewidth=0.6, linestyle=(0, (2, 2)), label="noise")
        axes.set_xlabel("Frequency [kHz]")
        panel_letter(axes, "ab"[c % 2])
        if channels == len(CHANNELS):
            axes.set_title(names[c], loc="right", pad=3)
    panels[0].set_ylabel("Residual over noise [dB]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _smooth(power: Real) -> Real:
    kernel = np.ones(SMOOTHING_BINS) / SMOOTHING_BINS
    return np.convolve(np.pad(power, SMOOTHING_BINS // 2, mode="edge"), kernel, mode="valid")


@styled
def held_out_figure(before: RingDownFit, after: RingDownFit | None, later: str = WITH_WHAT_WAS_LEFT_OUT) -> Figure:
    """Draw the residual of each held-out impact over the noise, by its fits before and after; ``later`` as above."""
    figure = blank(PAGE_MM, 58)
    axes = figure.subplots()
    records = before.segments
    deviations = [m.deviation for m in before.problem.experiment.noise]
    rms_before, rms_after = before.rms(), None if after is None else after.rms()
    noise = float(np.sqrt(np.mean(np.square(deviations))))
    place = np.arange(len(records))
    for rms, colour, marker, label in (
        (rms_before, BLUE, "o", "Eq. 9"),
        (rms_after, VERMILION, "s", later),
    ):
        if rms is not None:
            axes.plot(place, rms / noise, marker=marker, linestyle="none", color=colour, label=label)
    if rms_after is not None:
        axes.vlines(place, rms_after / noise, rms_before / noise, color=GREY, linewidth=0.6, zorder=0)
    axes.axhline(1.0, color=BLACK, linewidth=0.6, linestyle=(0, (2, 2)), label="noise")
    axes.set_xticks(place, [f"{r.name.lstrip('0') or '0'}\n{MILLI * r.preload_n:.0f}" for r in records])
    axes.set_xlabel("Held-out impact, and its load [mN]")
    axes.set_ylabel("Residual over noise, rms")
    if rms_after is not None and float(rms_before.max() / noise) > SMALLEST_SPAN * 2:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    figure.legend(loc="outside upper center", ncols=3)
    return figure
