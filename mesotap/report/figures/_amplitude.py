"""A mode against its amplitude along the ring-down: what a linear contact keeps constant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from analysis.modal.amplitude import AmplitudePoint
from analysis.results import LoadResult, Mode, RecordingModes, SessionResults
from calibration.estimate import Estimate
from mesotap.report.figures._contact import LOG_RATIO, PERCENT, drift_footnote, load_text, spread_over_loads
from mesotap.report.figures._recording import Recording
from mesotap.report.figures._style import GREY, MARKERS, PAGE_MM, PALETTE, blank, panel_letter, plain, styled

MOST_MODES = 4
FEWEST_POINTS = 2
WIDE = 4.0  # an interval this much wider than its line's median doesn't set the axis
SMALLEST_CHANGE_PERCENT = 0.02  # half of the frequency axis, at least: less is not a change to look at
SMALLEST_DAMPING_SPAN = 0.2  # of the damping ratio, at least
MARGIN = 0.06  # of the axis, above and below what is drawn


@dataclass(frozen=True, slots=True)
class _Line:
    """One load or mode of the figure; the frequency's change is against ``reference_hz``."""

    label: str
    reference_hz: float
    points: tuple[AmplitudePoint, ...]


@dataclass(frozen=True, slots=True)
class _Reading:
    """One point of a panel with half of its 95 % interval, in the panel's unit."""

    amplitude: float
    value: float
    half_width: float


def shown_amplitudes(results: SessionResults) -> list[LoadResult]:
    """Choose at most four loads whose contact mode was followed along the ring-down, evenly over the loads."""
    return spread_over_loads([load for load in results.loads if _drawable(load.f2_hz, load.along_decay)])


def shown_modes(modes: RecordingModes) -> list[tuple[int, Mode]]:
    """Choose the at most four modes with the most points along the ring-down, with their numbers from 1."""
    found = [(n, m) for n, m in enumerate(modes.modes, start=1) if _drawable(m.frequency_hz, m.along_decay)]
    return sorted(sorted(found, key=lambda pair: -len(pair[1].along_decay))[:MOST_MODES], key=lambda pair: pair[0])


@styled
def amplitude_figure(results: SessionResults) -> Figure:
    """Draw (a) the change of f2 and (b) zeta2 of chosen loads against the amplitude along the ring-down."""
    lines = [
        _Line(load_text(load, results), load.f2_hz.value, load.along_decay)
        for load in shown_amplitudes(results)
        if load.f2_hz is not None
    ]
    return _drawn(lines, "Load", "m/s²", ("$f_2$", r"$\zeta_2$"), drift_footnote(results))


@styled
def mode_amplitude_figure(recording: Recording, modes: RecordingModes) -> Figure:
    """Draw (a) the change of frequency and (b) the damping ratio of chosen modes against their amplitude."""
    lines = [_Line(f"mode {n}", mode.frequency_hz.value, mode.along_decay) for n, mode in shown_modes(modes)]
    return _drawn(lines, "", plain(recording.unit).replace("m/s2", "m/s²"), ("frequency", "Damping ratio"), "")


def _drawable(reference: Estimate | None, points: Sequence[AmplitudePoint]) -> bool:
    known = [p for p in points if p.amplitude > 0 and math.isfinite(p.amplitude + p.frequency_hz.value)]
    return reference is not None and reference.value > 0 and len(known) >= FEWEST_POINTS


def _drawn(lines: Sequence[_Line], title: str, unit: str, quantities: tuple[str, str], footnote: str) -> Figure:
    figure = blank(PAGE_MM, 72)
    change, damping = figure.subplots(1, 2)
    changes = [
        [_reading(p, p.frequency_hz, PERCENT / line.reference_hz, PERCENT) for p in line.points] for line in lines
    ]
    ratios = [[_reading(p, p.damping_ratio, PERCENT) for p in line.points] for line in lines]
    changes, ratios = [_known(r) for r in changes], [_known(r) for r in ratios]
    change.set_ylim(_change_limits(changes))
    _set_damping_axis(damping, ratios)
    change.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    for axes, readings in ((change, changes), (damping, ratios)):
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        for of_line, colour, marker in zip(readings, PALETTE, MARKERS, strict=False):
            _draw(axes, of_line, colour, marker)
    for line, colour, marker in zip(lines, PALETTE, MARKERS, strict=False):
        change.plot([], [], color=colour, marker=marker, linewidth=0.7, label=line.label)
    suffix = f" [{unit}]" if unit else ""
    change.set_xlabel(f"Amplitude{suffix}")
    damping.set_xlabel(f"Amplitude{suffix}{footnote}")
    change.set_ylabel(f"Change of {quantities[0]} [%]")
    damping.set_ylabel(f"{quantities[1]} [%]")
    panel_letter(change, "a")
    panel_letter(damping, "b")
    if lines:
        handles, labels = change.get_legend_handles_labels()
        labels = [f"{title} {label}".strip() for label in labels]
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), columnspacing=1.6)
    return figure


def _reading(point: AmplitudePoint, estimate: Estimate, scale: float, origin: float = 0.0) -> _Reading:
    return _Reading(point.amplitude, estimate.value * scale - origin, estimate.half_width * scale)


def _known(readings: Sequence[_Reading]) -> list[_Reading]:
    return [r for r in readings if r.amplitude > 0 and math.isfinite(r.amplitude + r.value)]


def _extent(lines: Sequence[Sequence[_Reading]]) -> tuple[float, float]:
    """Ends of the intervals that set the axis: those much wider than others of their line may leave it."""
    low, high = math.inf, -math.inf
    for readings in lines:
        widths = [r.half_width for r in readings if math.isfinite(r.half_width)]
        widest = WIDE * float(np.median(widths)) if widths else math.inf
        for r in readings:
            half = r.half_width if math.isfinite(r.half_width) else 0.0
            if half <= widest:
                low, high = min(low, r.value - half), max(high, r.value + half)
    return (low, high) if low <= high else (0.0, 0.0)


def _change_limits(lines: Sequence[Sequence[_Reading]]) -> tuple[float, float]:
    low, high = _extent(lines)
    low, high = min(low, -SMALLEST_CHANGE_PERCENT), max(high, SMALLEST_CHANGE_PERCENT)
    return low - MARGIN * (high - low), high + MARGIN * (high - low)


def _set_damping_axis(axes: Axes, lines: Sequence[Sequence[_Reading]]) -> None:
    low, high = _extent(lines)
    positive = [r.value for readings in lines for r in readings if r.value > 0]
    if positive and low <= min(positive) and high > LOG_RATIO * (smallest := max(low, min(positive) / 2)):
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(smallest / 1.3, high * 1.3)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        return
    middle = (low + high) / 2
    half = max((high - low) / 2, SMALLEST_DAMPING_SPAN * abs(middle) / 2) or 1.0
    axes.set_ylim(middle - (1 + 2 * MARGIN) * half, middle + (1 + 2 * MARGIN) * half)


def _draw(axes: Axes, readings: Sequence[_Reading], colour: str, marker: str) -> None:
    """Draw a line of points with their intervals; a point beyond the axis is an open triangle at its edge."""
    low, high = axes.get_ylim()
    inside = [r for r in readings if low <= r.value <= high]
    axes.errorbar(
        [r.amplitude for r in inside],
        [r.value for r in inside],
        yerr=[r.half_width if math.isfinite(r.half_width) else 0.0 for r in inside],
        color=colour,
        marker=marker,
        markersize=3.4,
        mec="white",
        mew=0.3,
        linewidth=0.6,
        elinewidth=0.7,
        capsize=1.4,
        capthick=0.7,
    )
    for r in readings:
        if r.value < low or r.value > high:
            edge, triangle = (low, "v") if r.value < low else (high, "^")
            axes.plot(
                r.amplitude, edge, marker=triangle, mfc="white", mec=colour, markersize=4.5, mew=0.8, clip_on=False
            )
