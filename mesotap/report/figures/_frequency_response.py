"""Frequency responses from the hammer's force: size, phase, coherence and the force's own spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.frequency_response.cross_check import CrossCheck
from analysis.frequency_response.estimators import FrequencyResponse, laplace
from mesotap.report.figures._style import DASHES, GREY, PAGE_MM, PALETTE, blank, panel_letter, plain, styled

MOST_LOADS = 4
THIN = 0.4  # of H2 and Hv, which part from H1 where the coherence is low, in points
BEYOND = 1.15  # of where the force excites, that is shown


def shown_responses(checks: Sequence[CrossCheck]) -> list[CrossCheck]:
    """Return the loads that are drawn, evenly chosen among those that have a response."""
    have = [check for check in checks if check.response is not None]
    if len(have) <= MOST_LOADS:
        return have
    return [have[i] for i in np.linspace(0, len(have) - 1, MOST_LOADS).round().astype(int)]


@styled
def cross_check_figure(checks: Sequence[CrossCheck]) -> Figure:
    """Draw |H1|, its phase and coherence with the fitted Eq. 9, and the force spectrum, of several loads."""
    figure = blank(PAGE_MM, 118)
    drawn = [
        (f"{check.target_load_mn:.0f} mN", check.response, check)
        for check in shown_responses(checks)
        if check.response is not None
    ]
    panels = _panels(figure, [(label, response) for label, response, _ in drawn])
    for number, (_, response, check) in enumerate(drawn):
        if check.fit is None:
            continue
        inside = response.frequency_hz <= response.force_limit_hz
        s = laplace(response.frequency_hz[inside], response.decay_per_s)
        model = check.fit.model.accelerance(s)
        style = {"color": PALETTE[number % len(PALETTE)], "linestyle": (0, (1, 1.5)), "linewidth": 1.4}
        panels[0].plot(response.frequency_hz[inside], np.abs(model), **style)
    return figure


@styled
def response_figure(response: FrequencyResponse) -> Figure:
    """Draw the responses of a recording: up to four channels."""
    figure = blank(PAGE_MM, 118)
    _panels(figure, [(plain(name), response) for name in response.channels[:MOST_LOADS]], by_row=True)
    return figure


def _panels(figure: Figure, drawn: Sequence[tuple[str, FrequencyResponse]], by_row: bool = False) -> NDArray[Any]:
    """Draw the four panels; ``by_row``: each entry is another channel of the same responses."""
    panels = figure.subplots(4, 1, sharex=True, height_ratios=[3, 1.6, 1.4, 1.6])
    top = 0.0
    for number, (label, response) in enumerate(drawn):
        row = number if by_row else 0
        f, h1 = response.frequency_hz, response.h1[row]
        top = max(top, BEYOND * response.force_limit_hz)
        style = {"color": PALETTE[number % len(PALETTE)], "linestyle": DASHES[number % len(DASHES)], "linewidth": 0.9}
        shown = f <= response.force_limit_hz
        panels[0].plot(f[shown], np.abs(h1[shown]), label=label, **style)
        if response.averages > 1:  # of one average all three are the same
            for other in (response.h2[row], response.hv[row]):
                panels[0].plot(f[shown], np.abs(other[shown]), color=style["color"], linewidth=THIN, alpha=0.6)
        low, high = response.interval(row)
        if np.isfinite(low).any():
            floor = np.abs(h1) * 1e-3
            panels[0].fill_between(
                f[shown], np.maximum(low, floor)[shown], high[shown], color=style["color"], alpha=0.2, linewidth=0
            )
        # from -270 to 90 degrees, so that a phase that scatters about 180 does not jump
        panels[1].plot(f[shown], (np.degrees(np.angle(h1[shown])) + 270) % 360 - 270, **style)
        if response.averages > 1:
            panels[2].plot(f[shown], response.coherence[row][shown], **style)
        if not (by_row and number):
            level = 20 * np.log10(np.maximum(response.force_spectrum / response.force_spectrum.max(), 1e-6))
            beyond = f <= BEYOND * response.force_limit_hz
            panels[3].plot(f[beyond], level[beyond], **style)
            panels[3].axvline(response.force_limit_hz, color=style["color"], linewidth=0.5)
    panels[0].set_yscale("log")
    unit = "(m/s²)/N" if drawn[0][1].unit == "m/s2/N" else plain(drawn[0][1].unit)
    panels[0].set_ylabel(f"|H| [{unit}]")
    panels[0].legend(loc="best", ncols=2)
    panels[1].set_ylabel("Phase [°]")
    panels[1].set_yticks([-270, -180, -90, 0, 90])
    panels[2].set_ylabel("Coherence")
    panels[2].set_ylim(0, 1.05)
    if all(response.averages <= 1 for _, response in drawn):
        panels[2].text(0.5, 0.5, "one hit: no coherence", transform=panels[2].transAxes, ha="center", color=GREY)
    panels[3].set_ylabel("Force [dB]")
    panels[3].axhline(-20, color=GREY, linewidth=0.5, linestyle=(0, (4, 2)))
    panels[3].set_ylim(-45, 3)
    panels[3].set_xlabel("Frequency [Hz]")
    panels[3].set_xlim(0, top)
    for axes, letter in zip(panels, "abcd", strict=True):
        panel_letter(axes, letter)
    return panels
