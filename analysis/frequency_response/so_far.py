"""What a hammer shows while taps are made: the last one, and the average of those so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.frequency_response.cross_check import LOWEST_HZ, response_of
from analysis.frequency_response.estimators import Complex, ForceError, FrequencyResponse, Real, Spectra, estimators
from analysis.frequency_response.impacts import Measured
from daq.records import Impact, RigDescription
from rig.settings import Hammer


@dataclass(frozen=True, slots=True)
class HammerSoFar:
    """What a hammer showed in some taps.

    Attributes
    ----------
    words
        A line: peak of the last tap and how far it excites, or its fault; from the second tap on the lowest coherence
        of the mean of A and B in that band. Empty without a hammer.
    averaged
        Response of the mean of A and B to the force, m/s2/N, averaged over the taps that can be used; None without one.
    last
        (k,) response to the last tap alone, on the lines of ``averaged``; None where it cannot be used.
    last_force
        (k,) size of its force's Fourier transform, N/Hz, likewise.
    """

    words: str = ""
    averaged: FrequencyResponse | None = None
    last: Complex | None = None
    last_force: Real | None = None


def hammer_so_far(
    impacts: Sequence[Impact], rig: RigDescription | None = None, hammer: Hammer | None = None
) -> HammerSoFar:
    """Return what a hammer showed in taps, the last of them last.

    Parameters
    ----------
    rig
        Whose band-pass is taken out of both channels; without it nothing is.
    hammer
        How far its channel reaches, and whether it passes that band-pass.
    """
    hit = [impact for impact in impacts if impact.force is not None]
    if not hit or hit[-1].force is None:
        return HammerSoFar()
    rig = rig or RigDescription(filter_family="")
    measured = _measured(hit, rig, hammer)
    averaged = None if measured is None else measured.response
    try:
        alone = response_of(hit[-1:], rig, hammer).response
    except ForceError as error:
        return HammerSoFar(f"hammer: {error}", averaged)
    said = f"hammer {_peak(hit[-1].force):.3g} N, excites to {alone.force_limit_hz:.0f} Hz"
    if measured is None or averaged is None or averaged.averages < 2:
        words = said
    else:
        inside = (averaged.frequency_hz > LOWEST_HZ) & (averaged.frequency_hz < averaged.force_limit_hz)
        least = averaged.coherence[0][inside].min(initial=1.0)
        words = f"{said}; {averaged.averages:.0f} taps: coherence {float(least):.2f} or more" if inside.any() else said
    if measured is None or measured.used[-1] != f"impact {hit[-1].name}":
        return HammerSoFar(words, averaged)
    h1, size = _last(measured, hit[-1].sample_rate_hz)
    return HammerSoFar(words, averaged, h1, size)


def _measured(hit: Sequence[Impact], rig: RigDescription, hammer: Hammer | None) -> Measured | None:
    try:
        return response_of(hit, rig, hammer)
    except ForceError:
        return None


def _last(measured: Measured, rate_hz: float) -> tuple[Complex, Real]:
    """Return the response to the last of the taps averaged, and its force's spectrum, on the lines of the average."""
    alone = Spectra(measured.spectra.force[-1:], measured.spectra.response[-1:])
    return estimators(alone)[0][0], np.abs(alone.force[0]) / rate_hz


def _peak(force: Real) -> float:
    """Return the largest departure of a force (n,) from what it is at rest, N."""
    return float(np.abs(force - np.median(force)).max())
