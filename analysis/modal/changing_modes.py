"""Modes that are not the same along a decay: by how much, so that their intervals contain it.

A joint that loosens, a contact that hardens or a sensor that saturates makes the frequency and the damping of a mode
others while it falls. One exponential then is between them, and its interval is that of a constant it is not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from analysis.modal.counted_modes import SUNK, CountedModes, differ, fitted_from
from analysis.modal.ring_down_model import Recorded

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

PARTS = (2, 4, 8, 16, 32, 64)  # of the decay, after which the modes are looked at once more
LATER = 1e-3  # chance of what a mode from a later sample on differs by, below which it changes
LEAST = 64  # samples of which modes are told


def changes_of(recorded: Recorded, decay: CountedModes, sample_rate_hz: float) -> tuple[Real, list[str]]:
    """Covariances (J, 2, 2) of the logarithms of sampled poles by what changes along a decay; and what is told of it.

    Parameters
    ----------
    recorded
        What was recorded, up to the end of the decay.
    decay
        Its modes.
    sample_rate_hz
        Samples a second.
    """
    here = np.log(decay.model.poles)
    length = decay.record.y.shape[1]
    changes = np.zeros(here.size, np.complex128)
    for part in PARTS:
        apart = length // part
        if apart < 1 or length - apart < LEAST:
            continue
        later = fitted_from(recorded, decay.start + apart, decay)
        if later is None:
            continue
        there = np.log(later.model.poles)
        limit = stats.chi2.isf(LATER, 2) * max(decay.rounding, later.rounding)
        for i, j in zip(*optimize.linear_sum_assignment(np.abs(here[:, None] - there)), strict=True):
            lost = -2 * here[i].real * apart
            if lost > SUNK or differ(decay, later, int(i), int(j)) < limit:
                continue
            changes[i] = max(changes[i], there[j] - here[i], key=abs)
    both = np.array([changes.real, changes.imag])
    return np.einsum("aj,bj->jab", both, both), _told(here, changes, sample_rate_hz)


def _told(s: Complex, changes: Complex, sample_rate_hz: float) -> list[str]:
    """One sentence about the modes that change."""
    each = []
    for i in np.flatnonzero(changes):
        first, last = s[i] * sample_rate_hz, (s[i] + changes[i]) * sample_rate_hz
        each.append(
            f"{abs(first) / (2 * np.pi):.5g} Hz (to {abs(last) / (2 * np.pi):.5g} Hz and "
            f"{-100 * last.real / abs(last):.3g} % of damping)"
        )
    if not each:
        return []
    return [f"modes that change along the decay, so that their intervals are wider: {', '.join(each)}"]
