"""Fig. 6: the record of one tap, and averaged spectra of several loads."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.results import LoadResult, SessionResults, Spectrum
from daq.records import Impact
from mesotap.report.figures._contact import drift_footnote, load_text, spread_over_loads
from mesotap.report.figures._style import (
    BLACK,
    BLUE,
    GREY,
    MARKERS,
    ORANGE,
    PAGE_MM,
    PALE,
    PALETTE,
    blank,
    decimated,
    panel_letter,
    styled,
)

ENLARGED_MS = 5.0  # Sec. 3.3: both accelerometers have to agree in the first few milliseconds
BEYOND_CONTACT_MODE = 1.8  # the frequency axis ends at so many times the highest f2


@styled
def record_figure(impact: Impact, enlarged_ms: float = ENLARGED_MS) -> Figure:
    """Draw both accelerometers against time: (a) the whole record, (b) its first milliseconds (Fig. 6a).

    Parameters
    ----------
    impact
        The tap; the trigger is at 0 ms.
    enlarged_ms
        Time after the trigger that (b) shows.
    """
    figure = blank(PAGE_MM, 62)
    whole, first = figure.subplots(1, 2, width_ratios=(1.35, 1))
    time_ms = (np.arange(impact.acceleration.shape[1]) - impact.pretrigger) / impact.sample_rate_hz * 1e3
    early = (time_ms >= -0.2 * enlarged_ms) & (time_ms <= enlarged_ms)
    # B is broad and pale beneath A: where they agree both are seen.
    lines = ((1, "accelerometer B", ORANGE, 2.2), (0, "accelerometer A", BLUE, 0.8))
    for row, label, colour, width in lines:
        signal = impact.acceleration[row]
        whole.plot(*decimated(time_ms, signal), color=colour, linewidth=0.5 * width)
        first.plot(time_ms[early], signal[early], color=colour, linewidth=width, label=label)
    for letter, axes in (("a", whole), ("b", first)):
        axes.axhline(0, color=GREY, linewidth=0.4, zorder=0)
        axes.axvspan(min(time_ms[0], 0.0), 0, color=PALE, linewidth=0, zorder=-1)
        axes.set_xlabel("Time after trigger [ms]")
        panel_letter(axes, letter)
    whole.set_xlim(time_ms[0], time_ms[-1])
    first.set_xlim(-0.2 * enlarged_ms, enlarged_ms)
    whole.set_ylabel("Acceleration [m/s²]")
    first.legend(
        handles=first.get_lines()[1::-1],
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=2,
        columnspacing=1.0,
        handlelength=1.4,
        borderaxespad=0,
    )
    return figure


def shown_spectra(results: SessionResults) -> list[LoadResult]:
    """Choose at most four loads with a spectrum, evenly over the range of loads, both ends among them."""
    found = [load for load in results.loads if load.spectrum is not None and load.spectrum.frequency_hz.size > 1]
    return spread_over_loads(found)


@styled
def spectra_figure(results: SessionResults) -> Figure:
    """Draw averaged amplitude spectra of chosen loads, the system mode f1 and the contact mode f2 marked (Fig. 6b)."""
    figure = blank(PAGE_MM, 72)
    axes = figure.subplots()
    chosen = shown_spectra(results)
    contact_modes = [load.f2_hz.value for load in chosen if load.f2_hz is not None]
    end = BEYOND_CONTACT_MODE * max(contact_modes) if contact_modes else math.inf
    smallest, largest = math.inf, 0.0
    for load, colour, marker in zip(chosen, PALETTE, MARKERS, strict=False):
        spectrum = _within(load.spectrum, end)
        if spectrum is None:
            continue
        frequency, amplitude = spectrum
        axes.plot(*decimated(frequency, amplitude), color=colour, linewidth=0.8)
        smallest, largest = min(smallest, float(np.quantile(amplitude, 0.02))), max(largest, float(amplitude.max()))
        for estimate in (load.f1_hz, load.f2_hz):
            if estimate is not None and frequency[0] <= estimate.value <= frequency[-1]:
                height = float(np.exp(np.interp(estimate.value, frequency, np.log(amplitude))))
                axes.plot(estimate.value, height, marker=marker, color=colour, mec="white", mew=0.5, markersize=5.5)
        axes.plot([], [], color=colour, marker=marker, mec="white", mew=0.5, label=load_text(load, results))
    axes.set_yscale("log")
    if largest > 0:
        axes.set_ylim(smallest / 2, largest * 2.5)
    axes.set_xlim(0, None if math.isinf(end) else end)
    axes.set_xlabel(f"Frequency [Hz]{drift_footnote(results)}")
    axes.set_ylabel("Acceleration spectrum [(m/s²)/Hz]")
    if chosen:
        axes.legend(title="Load", loc="upper right", title_fontsize=7.5, alignment="left")
    for text, values in (("$f_1$", [c.f1_hz for c in chosen]), ("$f_2$", [c.f2_hz for c in chosen])):
        known = [v.value for v in values if v is not None]
        if known:
            middle = (min(known) + max(known)) / 2
            axes.annotate(text, (middle, 1), xycoords=("data", "axes fraction"), ha="center", va="bottom", color=BLACK)
    return figure


def _within(spectrum: Spectrum | None, end_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the positive part of a spectrum up to a frequency, or None where nothing is left."""
    if spectrum is None:
        return None
    keep = (spectrum.frequency_hz > 0) & (spectrum.frequency_hz <= end_hz) & (spectrum.amplitude > 0)
    return (spectrum.frequency_hz[keep], spectrum.amplitude[keep]) if keep.sum() > 1 else None
