"""Oscillations that run on whatever the impact does, as mains hum: they are there before it, and no modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.modes import ModeEstimate

Real = NDArray[np.float64]

MAINS_HZ = (50.0, 60.0)
OFF_HZ = 0.2  # by which the mains frequency may be off
LASTING = 3.0  # standard errors of its damping, by which what never decays may seem to
HARMONICS = 7  # of the mains, at which a lasting oscillation is told to be perhaps hum
PERIODS = 2.0  # before the impact, at least, by which an oscillation is told from an offset
SURELY = 4.0  # times what is heard by chance: an oscillation that would be heard
BY_CHANCE = 1e-3  # chance of noise before the impact that looks like an oscillation at that frequency
AS_STRONG = (
    0.005  # of the energy that a mode begins with, before the impact: of 17 true modes in a noise of narrow band
)
# none had 1e-4 there, of 12 that were part of it all had 0.01


def runs_before(before: Real, modes: Sequence[ModeEstimate], sample_rate_hz: float) -> list[bool]:
    """Whether each oscillation is in the samples before an impact, too, as strong as after it, and does not decay.

    Parameters
    ----------
    before
        (c, n) samples ahead of the impact.
    modes
        Found after it.
    sample_rate_hz
        Samples a second.

    Examples
    --------
    >>> from analysis.modal.modes import mode_from_sampled_pole
    >>> hum = np.cos(0.1 * np.arange(900)) + 0.01 * np.random.default_rng(1).standard_normal(900)
    >>> found = mode_from_sampled_pole(np.exp(0.1j - 1e-9), 1e-8 * np.eye(2), np.array([0.5 + 0j]), 1e3)
    >>> runs_before(hum[None, :400], [found], 1e3)
    [True]
    """
    c, n = before.shape
    told = []
    for mode in modes:
        turn = mode.pole.imag / sample_rate_hz
        zeta = mode.damping_ratio
        if n < 8 or n * turn < 2 * np.pi * PERIODS or zeta.value > LASTING * zeta.standard_error:
            told.append(False)
            continue
        angle = turn * np.arange(n)
        design = np.array([np.cos(angle), np.sin(angle), np.ones(n)]).T
        found = np.linalg.lstsq(design, before.T, rcond=None)[0]
        noise = np.maximum(((before.T - design @ found) ** 2).mean(axis=0), 1e-300)
        strength = (found[:2] ** 2).sum(axis=0)
        heard = float((strength / noise).sum()) * n / 2 > stats.chi2.isf(BY_CHANCE, 2 * c)
        told.append(heard and float(strength.sum()) > AS_STRONG * float((np.abs(2 * mode.amplitude) ** 2).sum()))
    return told


def perhaps_lasting(modes: Sequence[ModeEstimate], quiet: Real, sample_rate_hz: float) -> list[str]:
    """Sentences about modes that do not decay as far as a record tells: hum of the mains, or an excitation.

    None about those that would have been heard before the impact, had they been there.

    Parameters
    ----------
    modes
        Of the record.
    quiet
        (c, n) what was recorded before the impact.
    sample_rate_hz
        Samples a second.
    """
    told = []
    c, n = quiet.shape
    noise = np.maximum(quiet.var(axis=1), 1e-300) if n else np.ones(c)
    for mode in modes:
        f = mode.frequency_hz
        if mode.damping_ratio.low > 0:
            continue
        long_enough = n * f.value >= PERIODS * sample_rate_hz
        would_be = float((np.abs(2 * mode.amplitude) ** 2 / noise).sum()) * n / 2
        if long_enough and would_be > SURELY * stats.chi2.isf(BY_CHANCE, 2 * c):
            continue
        mains = [hz for hz in MAINS_HZ if is_harmonic(mode, hz)]
        what = f"hum of the mains ({mains[0]:g} Hz)" if mains else "something that goes on, not a decay"
        told.append(
            f"the mode at {f.value:.5g} Hz may be {what}: it does not decay as far as the recording tells, and too "
            "little was recorded before an impact to show whether it was there"
        )
    return told


def is_harmonic(mode: ModeEstimate, mains_hz: float) -> bool:
    """Whether a mode is at a multiple of the mains frequency, within its interval."""
    f = mode.frequency_hz
    k = round(f.value / mains_hz)
    return 1 <= k <= HARMONICS and abs(f.value - k * mains_hz) < f.high - f.value + k * OFF_HZ
