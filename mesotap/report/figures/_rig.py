"""A diagnosis of a described rig: what it predicts and what it misses, before and after, and where."""

from __future__ import annotations

import itertools
import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from analysis.mismatch.recordings.account import BlockAccount
from analysis.mismatch.recordings.decay import decay_of
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.recorded import HELD
from analysis.mismatch.recordings.residual_band import residual_band
from mesotap.report.figures._style import (
    BLACK,
    BLUE,
    GREY,
    PAGE_MM,
    PALE,
    VERMILION,
    blank,
    panel_letter,
    plain,
    styled,
)
from sim_backend.mechanisms.kinds import ForceLaw

Real = NDArray[np.float64]

WINDOWS = 160  # in which errors are drawn against time
SEGMENTS = 8  # averaged in a spectrum
MOST_LINES = 4096  # samples of a segment
TICKS, PLAIN = 5, (-2, 4)  # of an axis with a quantity of any size, and powers of ten that are written out
RECORDING, LINEAR, NAMED = "recording", "rig as described", "with what was left out"


@styled
def rig_figure(d: BlockAccount) -> Figure:
    """Draw (a) recording and errors against time, held-out stretches shaded, (b) their spectra, (c) the law.

    (c) is frequency and damping against amplitude for a decay of one body, else the force that was left out along the
    motion, against deformation or its rate.
    """
    figure = blank(PAGE_MM, 118 if d.decay else 112)
    grid = figure.add_gridspec(2, 2)
    time, spectrum = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, 0])
    selection, decay = d.selection, d.decay
    fits = [(selection.baseline, LINEAR, VERMILION)]
    if selection.chosen is not None:
        fits.append((selection.chosen, NAMED, BLUE))
    recorded = d.judge.problem.recordings[0]
    unit = plain(d.described.seen[0].unit).replace("m/s2", "m/s²")
    t = recorded.start_s + np.arange(recorded.samples) / recorded.rate_hz
    _rms_lines(time, t, recorded.outputs[0], BLACK, RECORDING)
    _spectrum(spectrum, recorded.outputs[0], recorded.rate_hz, BLACK)
    for fitted, label, colour in fits:
        off = fitted.error(0, whole=True)[0][0]
        _rms_lines(time, t, off, colour, label)
        _spectrum(spectrum, off, recorded.rate_hz, colour)
    _shade(time, t, recorded.part == HELD)
    time.set_yscale("log")
    time.set_xlim(t[0], t[-1])
    time.set_xlabel("Time [s]")
    time.set_ylabel(f"rms [{unit}]" if unit else "rms")
    spectrum.set_yscale("log")
    spectrum.set_xlabel("Frequency [Hz]")
    spectrum.set_ylabel(f"rms in a line [{unit}]" if unit else "rms in a line")
    if selection.steps or d.far_off:
        low, high = residual_band(selection.baseline)[1]
        middle, half = (low + high) / 2, max(4 * (high - low), 0.25 * (low + high) / 2)
        first, last = max(middle - half, 0), min(middle + half, recorded.rate_hz / 2)
        spectrum.set_xlim(first, last)
        _fit_height(spectrum, first, last)
    panel_letter(time, "a")
    panel_letter(spectrum, "b")
    if decay:
        inner = grid[1, 1].subgridspec(2, 1, hspace=0.06)
        upper = figure.add_subplot(inner[0])
        _decay(d, upper, figure.add_subplot(inner[1], sharex=upper), unit)
        panel_letter(upper, "c")
    else:
        law = figure.add_subplot(grid[1, 1])
        _law(d, law)
        panel_letter(law, "c")
    figure.legend(*time.get_legend_handles_labels(), loc="outside upper center", ncols=4, columnspacing=1.6)
    return figure


def _rms_lines(axes: Axes, t: Real, y: Real, colour: str, label: str) -> None:
    edges = np.linspace(0, t.size, min(WINDOWS, t.size // 8) + 1).astype(int)
    rms = np.array([math.sqrt(float(np.mean(y[a:b] ** 2))) for a, b in itertools.pairwise(edges)])
    axes.plot((t[edges[:-1]] + t[edges[1:] - 1]) / 2, rms, color=colour, linewidth=0.8, label=label)


def _spectrum(axes: Axes, y: Real, rate: float, colour: str) -> None:
    from scipy.signal import welch

    f, p = welch(y, rate, nperseg=min(max(y.size // SEGMENTS, MOST_LINES // 2), MOST_LINES, y.size), scaling="spectrum")
    axes.plot(f[1:], np.sqrt(p[1:]), color=colour, linewidth=0.7)


def _fit_height(axes: Axes, first: float, last: float) -> None:
    """Set the ordinate to what is drawn between two abscissas, and drop the rest of the lines."""
    low, high = math.inf, 0.0
    for line in axes.lines:
        x, y = np.asarray(line.get_xdata(), np.float64), np.asarray(line.get_ydata(), np.float64)
        kept = (x >= first) & (x <= last) & (y > 0)
        line.set_data(x[kept], y[kept])
        low, high = min(low, float(y[kept].min(initial=math.inf))), max(high, float(y[kept].max(initial=0.0)))
    if low < high:
        axes.set_ylim(0.5 * low, 2 * high)


def _shade(axes: Axes, t: Real, held: NDArray[np.bool_]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], held.astype(np.int8), [0]])))
    for i, (a, b) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        axes.axvspan(t[a], t[b - 1], color=PALE, linewidth=0, zorder=0, label="held out" if i == 0 else None)


def _decay(d: BlockAccount, frequency: Axes, damping: Axes, unit: str) -> None:
    recorded = d.judge.problem.recordings[0]
    drawn = [(d.decay, "o", BLACK, "none")]
    for fitted, colour in ((d.selection.baseline, VERMILION), (d.selection.chosen, BLUE)):
        if fitted is not None:
            shown = fitted.simulation.run(fitted.x, fitted.own[0], 0, whole=True)[0][0]
            drawn.append((decay_of(recorded, shown), "", colour, "-"))
    for points, marker, colour, line in drawn:
        at = [p.amplitude for p in points]
        frequency.plot(at, [p.frequency_hz for p in points], marker=marker, color=colour, linestyle=line)
        damping.plot(at, [100 * p.damping_ratio for p in points], marker=marker, color=colour, linestyle=line)
    for axes in (frequency, damping):
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    frequency.tick_params(labelbottom=False)
    frequency.set_ylabel("$f$ [Hz]")
    damping.set_ylabel(r"$\zeta$ [%]")
    damping.set_xlabel(f"Amplitude [{unit}]" if unit else "Amplitude")


def _law(d: BlockAccount, axes: Axes) -> None:
    """Draw what the mechanisms add to the force of the element that the first of them acts in.

    Against deformation or its rate, whichever the force goes with.
    """
    rig = d.described
    length, force_unit = plain(rig.length_unit), plain(rig.force_unit)
    axes.set_xlabel(f"Deformation [{length}]")
    axes.set_ylabel(f"Force left out [{force_unit}]")
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    fitted = d.selection.chosen
    if fitted is None or not any(isinstance(t.mechanism, ForceLaw) for t in fitted.terms):
        axes.text(0.5, 0.5, "nothing named in an element", transform=axes.transAxes, ha="center", color=GREY)
        return
    place = next(t.place[0] for t in fitted.terms if isinstance(t.mechanism, ForceLaw))
    name = d.judge.problem.arrangement.elements[place].name
    deformation, rate, force = _force(fitted, place)
    by_rate = _roughness(rate, force) < _roughness(deformation, force)
    axes.plot(rate if by_rate else deformation, force, ".", color=BLUE, markersize=1.5, rasterized=False)
    axes.set_xlabel(f"Rate of {name} [{length}/s]" if by_rate else f"Deformation of {name} [{length}]")
    axes.xaxis.set_major_locator(MaxNLocator(TICKS))
    axes.ticklabel_format(style="sci", scilimits=PLAIN, useMathText=True)


def _roughness(x: Real, y: Real) -> float:
    """Return how far y goes up and down on the way along x: little where it is a function of x."""
    return float(np.sum(np.abs(np.diff(y[np.argsort(x)]))))


def _force(fitted: SimulatedFit, place: int) -> tuple[Real, Real, Real]:
    deformation, rate = fitted.simulation.deformations(fitted.x, fitted.own[0], 0)
    recorded = fitted.problem.recordings[0]
    moved = fitted.simulation.motion(fitted.x, fitted.own[0], 0, recorded.fitted, False)
    force = np.zeros_like(deformation) if moved is None else moved.extra.T
    kept = np.linspace(0, deformation.shape[1] - 1, min(1500, deformation.shape[1])).astype(int)
    return deformation[place, kept], rate[place, kept], force[place, kept]
