"""Every impact in its order: what shows a contact that settles, wears or was knocked."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from analysis.results import ImpactResult, LoadResult, SessionResults
from mesotap.report.figures._contact import axis_load, drift_footnote, load_text
from mesotap.report.figures._style import BLUE, GREY, PAGE_MM, SKY, VERMILION, blank, styled

SMALLEST_AXIS_PERCENT = 0.5
LABELS_FLAT = 9  # loads whose names fit side by side


@styled
def impacts_figure(results: SessionResults) -> Figure:
    """Draw k_c of each impact in order, as deviation from the combined estimate of its load.

    Rejected taps with an estimate are open symbols; a deviation beyond the axis is drawn at its edge.
    """
    figure = blank(PAGE_MM, 68)
    axes = figure.subplots()
    reference = {load.load_set: value for load in results.loads if (value := _reference(load, results)) is not None}
    groups = [(load, [i for i in results.impacts if i.load_set == load.load_set]) for load in results.loads]
    groups = [(load, impacts) for load, impacts in groups if impacts and load.load_set in reference]
    limit = _limit(groups, reference)
    start, ticks = 0.0, []
    for index, (load, impacts) in enumerate(groups):
        centre = reference[load.load_set]
        end = start + len(impacts)
        if index % 2:
            axes.axvspan(start - 0.5, end - 0.5, color="#f3f3f3", linewidth=0, zorder=-2)
        combined = load.contact_stiffness_n_per_m
        if combined is not None and math.isfinite(combined.half_width):
            half = 100 * combined.half_width / centre
            axes.fill_between((start - 0.5, end - 0.5), -half, half, color=SKY, alpha=0.35, linewidth=0, zorder=-1)
        for position, impact in enumerate(impacts):
            _draw_impact(figure, impact, start + position, centre, limit)
        ticks.append((start + (len(impacts) - 1) / 2, load_text(load, results)))
        start = end
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    axes.set_xlim(-0.5, max(start, 1) - 0.5)
    axes.set_ylim(-1.08 * limit, 1.08 * limit)
    rotation = 0 if len(ticks) <= LABELS_FLAT else 60
    axes.set_xticks([at for at, _ in ticks], [text for _, text in ticks], rotation=rotation)
    axes.tick_params(axis="x", length=0)
    axes.set_xlabel(f"Impacts in order, by load{drift_footnote(results)}")
    axes.set_ylabel("$k_c$ against its load's\ncombined estimate [%]")
    axes.plot([], [], linestyle="none", marker="o", color=BLUE, markersize=3.5, label="accepted")
    axes.plot([], [], linestyle="none", marker="s", mfc="white", mec=VERMILION, markersize=3.5, label="rejected")
    axes.plot([], [], linestyle="none", marker="x", color=VERMILION, markersize=3.5, label="rejected, no estimate")
    axes.fill_between([], [], color=SKY, alpha=0.35, linewidth=0, label="combined, 95 % interval")
    figure.legend(loc="outside upper right", ncols=4, columnspacing=1.4, handletextpad=0.5, handlelength=1.4)
    return figure


def _reference(load: LoadResult, results: SessionResults) -> float | None:
    """Stiffness that deviations are taken from: the combined estimate, else the median of the load's impacts."""
    if not math.isfinite(axis_load(load)):
        return None
    if load.contact_stiffness_n_per_m is not None:
        return load.contact_stiffness_n_per_m.value
    values = [
        i.contact_stiffness_n_per_m.value
        for i in results.impacts
        if i.load_set == load.load_set and i.contact_stiffness_n_per_m is not None
    ]
    return float(np.median(values)) if values else None


def _limit(groups: list[tuple[LoadResult, list[ImpactResult]]], reference: dict[int, float]) -> float:
    """Half the height of the axis in %: the accepted impacts set it."""
    reach = [SMALLEST_AXIS_PERCENT]
    for load, impacts in groups:
        centre = reference[load.load_set]
        for impact in impacts:
            if impact.accepted and (k := impact.contact_stiffness_n_per_m) is not None:
                deviation = 100 * abs(k.value / centre - 1)
                reach.append(deviation + (100 * k.half_width / centre if k.half_width < centre else 0.0))
    return float(max(value for value in reach if math.isfinite(value)))


def _draw_impact(figure: Figure, impact: ImpactResult, at: float, centre: float, limit: float) -> None:
    axes = figure.axes[0]
    k = impact.contact_stiffness_n_per_m
    if k is None:
        if not impact.accepted:
            axes.plot(at, -limit, marker="x", color=VERMILION, markersize=3.5, mew=0.9)
        return
    deviation = 100 * (k.value / centre - 1)
    half = 100 * k.half_width / centre
    colour = BLUE if impact.accepted else VERMILION
    if abs(deviation) > limit:
        edge, marker = math.copysign(limit, deviation), "^" if deviation > 0 else "v"
        axes.plot(at, edge, marker=marker, mfc="white", mec=colour, markersize=4, mew=0.8)
        return
    if math.isfinite(half):
        axes.plot((at, at), (deviation - half, deviation + half), color=colour, linewidth=0.7)
    marker, face = ("o", colour) if impact.accepted else ("s", "white")
    axes.plot(at, deviation, marker=marker, mfc=face, mec=colour, markersize=3.2, mew=0.7)
