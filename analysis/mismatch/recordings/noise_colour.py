"""Whether what a fit leaves has the colour of a sensor's noise: it does not rise and fall with frequency.

An autoregression of many samples foretells whatever rings, the rig's own motion with it: whitened by it a mismatch that
no listed mechanism makes looks like noise. Sensors' noise does not ring: white, pink, drifting and differentiated, its
spectrum goes one way. Spectra are compared by Whittle's likelihood (Ark. Mat. 2 (1953) 423), the likeliest one that
goes one way by isotonic regression (Barlow, Bartholomew, Bremner and Brunk, Statistical Inference under Order
Restrictions, 1972).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.stats import chi2

from analysis.mismatch.recordings.recorded import UNUSED
from sim_backend.arrays import Real

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

LINES: Final = 8  # of a band of the spectrum, at least
WIDE: Final = 0.25  # of the frequency where it begins, that a band is wide
FEWEST: Final = 4  # bands that tell anything


def p_of_sensor_noise(fitted: SimulatedFit) -> float:
    """Return the p-value of what a fit leaves being noise whose spectrum goes one way, in each channel.

    What noise of the inputs makes is taken out first. Of such noise it is as small as it says, or less often; NaN where
    recordings are too short to tell, or nothing moves.
    """
    total, dof = 0.0, 0
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.off(number)
        driven = fitted.noise(number).driven
        rows = off if driven is None else driven(off)
        (used,) = np.nonzero(recorded.part[at] != UNUSED)
        for row in rows[:, used[0] : used[-1] + 1]:
            excess, free = _excess(row)
            total, dof = total + excess, dof + free
    return float(chi2.sf(total, dof)) if dof else math.nan


def _excess(row: Real) -> tuple[float, int]:
    """Return by how much the likelihood of a signal (n,) grows where bands may have any power, twice; and how many."""
    window = np.hanning(row.size)
    power = np.abs(np.fft.rfft((row - row.mean()) * window)) ** 2 / np.sum(window**2)
    lines = power[2:-1:2]  # every other one: neighbouring ones are correlated by the window
    edges = [0]
    while (after := edges[-1] + max(LINES, round(WIDE * edges[-1]))) + LINES <= lines.size:
        edges.append(after)
    bands = len(edges)
    if bands < FEWEST or not np.all(lines > 0):
        return 0.0, 0
    size, mean = np.array([(band.size, band.mean()) for band in np.split(lines, edges[1:])]).T
    both = (isotonic_regression(mean, weights=size, increasing=up).x for up in (False, True))
    return min(2 * float(np.sum(size * (np.log(one / mean) + mean / one - 1))) for one in both), bands - 1
