"""What a fit of decays finds in a recording and what is no mode all the same: hum, drifts, what hardly oscillates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.modal.modes import ModeEstimate
from analysis.modal.steady import MAINS_HZ, is_harmonic, runs_before

Real = NDArray[np.float64]

APERIODIC = 0.9  # damping ratio of what hardly oscillates
TURNS = 2.0  # periods in the record, of an oscillation that is told from a drift though it does not decay


def modes_alone(
    found: Sequence[ModeEstimate], quiet: Real, heard_s: float, sample_rate_hz: float
) -> tuple[tuple[ModeEstimate, ...], list[str]]:
    """Modes of a structure among what was found, and a sentence about each of the others.

    Parameters
    ----------
    found
        Decays, and what looks like some.
    quiet
        (c, n) what was recorded before the impact.
    heard_s
        Time over which they were fitted.
    sample_rate_hz
        Samples a second.
    """
    kept, told = [], []
    for mode, reason in zip(found, _reasons(found, quiet, heard_s, sample_rate_hz), strict=True):
        if reason is None:
            kept.append(mode)
        else:
            told.append(reason)
    return tuple(kept), told


def _reasons(found: Sequence[ModeEstimate], quiet: Real, heard_s: float, sample_rate_hz: float) -> list[str | None]:
    """Why each is no mode; None for one that is."""
    before = runs_before(quiet, found, sample_rate_hz)
    hum = [hz for hz in MAINS_HZ if any(b and is_harmonic(m, hz) for m, b in zip(found, before, strict=True))]
    reasons: list[str | None] = []
    for mode, runs in zip(found, before, strict=True):
        f, zeta = mode.frequency_hz.value, mode.damping_ratio
        if runs or (zeta.low <= 0 and any(is_harmonic(mode, hz) for hz in hum)):
            reasons.append(
                f"an oscillation at {f:.5g} Hz runs before the impact, too, as mains hum does: it is no mode and is "
                "left out"
            )
        elif zeta.value > APERIODIC:
            reasons.append(
                f"a decay within {1e3 / -mode.pole.real:.3g} ms that hardly oscillates is no mode and is left out: a "
                "sensor that is coupled for alternating signals shows one, and drift"
            )
        elif f > sample_rate_hz / 2:
            reasons.append(f"an oscillation at {f:.5g} Hz is above half the sampling rate and left out")
        elif zeta.low <= 0 and f * heard_s < TURNS:
            reasons.append(
                f"something goes on at {f:.3g} Hz for less than {TURNS:g} periods: it may be a drift and is left out"
            )
        else:
            reasons.append(None)
    return reasons
