"""Any other ring-down: its record, and its spectrum with the identified modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.results import RecordingModes
from mesotap.report.figures._style import (
    GREY,
    PAGE_MM,
    PALETTE,
    VERMILION,
    blank,
    decimated,
    panel_letter,
    plain,
    styled,
)

MOST_CHANNELS = 3  # lines in one panel that an eye can follow
BEYOND_LAST_MODE = 1.6
MOST_LABELS = 8
LONGEST_IN_MS = 1.0  # s


class Recording(Protocol):
    """A recording of any number of channels."""

    @property
    def data(self) -> NDArray[np.float64]:
        """(c, n) samples."""

    @property
    def rate_hz(self) -> float:
        """Sampling rate."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the c channels."""

    @property
    def unit(self) -> str:
        """Unit of the samples."""

    @property
    def source(self) -> str:
        """Where the recording comes from."""


@styled
def modes_figure(recording: Recording, modes: RecordingModes) -> Figure:
    """Draw (a) the channels that move most against time, (b) the spectrum with the identified modes marked."""
    data = np.nan_to_num(np.atleast_2d(np.asarray(recording.data, dtype=float)))
    data = data - data.mean(axis=1, keepdims=True)
    figure = blank(PAGE_MM, 68)
    record, spectrum = figure.subplots(1, 2)
    strongest = np.sort(np.argsort(-data.std(axis=1), kind="stable")[:MOST_CHANNELS])
    time = np.arange(data.shape[1]) / recording.rate_hz
    in_ms = time[-1] < LONGEST_IN_MS
    time = time * 1e3 if in_ms else time
    unit = plain(recording.unit).replace("m/s2", "m/s²")
    for channel, colour in zip(strongest, PALETTE, strict=False):
        name = plain(recording.names[channel]) if channel < len(recording.names) else f"channel {channel}"
        record.plot(*decimated(time, data[channel]), color=colour, linewidth=0.7, label=name)
    record.axhline(0, color=GREY, linewidth=0.4, zorder=0)
    record.set_xlim(0, time[-1])
    record.set_xlabel(f"Time [{'ms' if in_ms else 's'}]")
    record.set_ylabel(f"Signal [{unit}]" if unit else "Signal")
    if len(strongest) > 1:
        record.legend(loc="upper right")

    frequency, amplitude = _spectrum(data, recording.rate_hz)
    end = min(frequency[-1], BEYOND_LAST_MODE * max((m.frequency_hz.value for m in modes.modes), default=math.inf))
    keep = (frequency > 0) & (frequency <= end) & (amplitude > 0)
    if keep.any():
        spectrum.plot(*decimated(frequency[keep], amplitude[keep]), color=PALETTE[0], linewidth=0.7)
        spectrum.set_yscale("log")
        low, high = float(np.quantile(amplitude[keep], 0.02)), float(amplitude[keep].max())
        spectrum.set_ylim(low / 2, high * (high / low) ** 0.05)
    spectrum.set_xlim(0, end)
    for number, mode in enumerate(modes.modes, start=1):
        at = mode.frequency_hz.value
        spectrum.axvline(at, color=VERMILION, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
        if len(modes.modes) <= MOST_LABELS:
            spectrum.annotate(
                f"{number}", (at, 1), xycoords=("data", "axes fraction"), ha="center", va="bottom", color=VERMILION
            )
    spectrum.set_xlabel("Frequency [Hz]")
    spectrum.set_ylabel(f"Amplitude spectrum [({unit})/Hz]" if unit else "Amplitude spectrum [1/Hz]")
    panel_letter(record, "a")
    panel_letter(spectrum, "b")
    return figure


def _spectrum(data: NDArray[np.float64], rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(m,) Hz and the root mean square over the channels of the spectra from the largest sample on."""
    start = int(np.argmax(np.abs(data).max(axis=0)))
    tail = data[:, start if data.shape[1] - start > data.shape[1] // 4 else 0 :]
    amplitude = np.abs(np.fft.rfft(tail, axis=1)) / rate_hz
    frequency = np.arange(amplitude.shape[1]) * (rate_hz / tail.shape[1])
    return frequency, np.sqrt(np.mean(np.square(amplitude), axis=0, dtype=np.float64))
