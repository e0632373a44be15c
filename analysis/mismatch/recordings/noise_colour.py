"""Whether what a fit leaves has the colour of a sensor's noise: even, or falling evenly from low frequencies on.

An autoregression of many samples foretells whatever rings, the rig's own motion with it: whitened by it a mismatch that
no listed mechanism makes looks like noise. Sensors' noise does not ring. Spectra are compared by Whittle's likelihood
(Ark. Mat. 2 (1953) 423).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2

from analysis.mismatch.recordings.blocks import over_noise
from analysis.mismatch.recordings.recorded import UNUSED
from sim_backend.arrays import Real

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

BANDS: Final = 24  # of a spectrum, at most
LINES: Final = 20  # of a band, at least
BEGUN: Final = (0.5, 0.9, 0.99)  # correlations of neighbouring samples that the fit of a spectrum begins with
NUMBERS: Final = 3  # that such a spectrum is described by


def p_of_colour(fitted: SimulatedFit) -> tuple[float, ...]:
    """Return the p-value of `p_of_sensor_noise` where held-out errors are far over noise; nothing elsewhere."""
    far = over_noise(fitted) > fitted.problem.policy.slow_over_noise
    return (p_of_sensor_noise(fitted),) if far else ()


def p_of_sensor_noise(fitted: SimulatedFit) -> float:
    """Return the p-value of what a fit leaves being white noise and noise that falls evenly with frequency.

    What noise of the inputs makes is taken out first. 1 where recordings are too short to tell.
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
    return float(chi2.sf(total, dof)) if dof else 1.0


def _excess(row: Real) -> tuple[float, int]:
    """Return by how much the likelihood of a signal (n,) grows with a factor for each band, twice, and how many."""
    window = np.hanning(row.size)
    power = np.abs(np.fft.rfft((row - row.mean()) * window)) ** 2 / np.sum(window**2)
    lines = np.arange(2, power.size - 1, 2)  # every other one: neighbouring ones are correlated by the window
    bands = min(BANDS, lines.size // LINES)
    if bands <= NUMBERS or not np.all(power[lines] > 0):
        return 0.0, 0
    over = power[lines] / _likeliest(power[lines], 2 * math.pi * lines / row.size)
    each = [(band.size, float(band.mean())) for band in np.array_split(over, bands)]
    return 2 * sum(n * (mean - 1 - math.log(mean)) for n, mean in each), bands - NUMBERS


def _likeliest(power: Real, omega: Real) -> Real:
    """Return the spectrum of white and of first-order noise that is likeliest to have made a power (lines,)."""
    size = float(power.mean())

    def spectrum(x: NDArray[np.float64]) -> Real:
        white, slow, correlated = math.exp(min(x[0], 50)), math.exp(min(x[1], 50)), math.tanh(x[2])
        fall = (1 - correlated) ** 2 / (1 - 2 * correlated * np.cos(omega) + correlated**2)
        return np.asarray(size * (white + slow * fall), np.float64)

    def cost(x: NDArray[np.float64]) -> float:
        made = spectrum(x)
        return float(np.sum(np.log(made) + power / made))

    low = math.log(max(float(np.median(power[power.size // 2 :])) / size, 1e-12))
    high = math.log(max(float(power[:LINES].mean()) / size, 1e-12))
    starts = [np.array([low, high, math.atanh(r)]) for r in BEGUN]
    found = [minimize(cost, x, method="Nelder-Mead", options={"maxiter": 600}) for x in starts]
    return spectrum(min(found, key=lambda f: f.fun).x)
