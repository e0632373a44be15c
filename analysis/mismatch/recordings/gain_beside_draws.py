"""What a mechanism takes away of noise that inputs make, in units of what such noise makes it take away.

What a rig makes of its inputs' noise is slow and the same in all channels. Whitened channel by channel it is not white:
a mechanism that follows a little of it takes away several times as much as of white noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.linearised import covariance
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.held_out import normal_equations, whitened_errors
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from sim_backend.arrays import Real

USED = (FIT, CHOOSE)  # all that is not held out


def gain_beside_draws(before: SimulatedFit, after: SimulatedFit) -> float:
    """Return the chi-squared that a fit takes away beside another, in white noise that made it take away as much.

    Both are whitened as what the fit leaves, and followed to their least whitened squares in one linear step of all
    their numbers. Draws of the noise tell what the numbers of the mechanisms added last take away of it on average.
    """
    first, last = _Whitened.of(before, after), _Whitened.of(after, after)
    gain = (first.least - last.least) / (last.least / last.freedom)
    if not last.pulled.shape[1]:  # noise of the inputs makes next to nothing of what is left
        return gain
    kept = [p.scope != "mechanism" or p.owner < len(before.terms) for p in after.simulation.parameters]
    kept += [True] * (len(last.normal) - len(kept))
    by_noise = float(np.mean(last.explained()) - np.mean(last.explained(np.flatnonzero(kept))))
    return gain / max(by_noise / max(kept.count(False), 1), 1.0)


class _Whitened(NamedTuple):
    """The least sum of whitened squares of all that is not held out, its degrees of freedom, and normal equations.

    ``pulled`` is (k, draws), what a unit of each number has in common with draws of the noise.
    """

    least: float
    freedom: int
    normal: Real
    pulled: Real

    def explained(self, numbers: NDArray[np.intp] | slice = np.s_[:]) -> Real:
        """Return (draws,) the squares of draws that some numbers of the fit explain, all of them if not told."""
        normal, pulled = self.normal[numbers][:, numbers], self.pulled[numbers]
        return np.asarray(np.einsum("kd,kl,ld->d", pulled, covariance(normal), pulled, optimize=True), np.float64)

    @classmethod
    def of(cls, fitted: SimulatedFit, noise: SimulatedFit) -> _Whitened:
        """Follow a fit, whitened as what another one leaves."""
        whitened = [whitened_errors(fitted, number, noise) for number in range(len(fitted.own))]
        normal, pulled = normal_equations(fitted, whitened, USED)
        slope, samples, left = np.zeros(len(normal)), 0, fitted.penalty
        for errors in whitened:
            rows = errors.error[:, np.isin(errors.part, USED)].ravel()
            slope[errors.where] += errors.flat(USED) @ rows
            left, samples = left + float(rows @ rows), samples + rows.size
        for k, p in enumerate(fitted.simulation.parameters):
            slope[k] += 0.0 if p.prior is None else (fitted.x[k] - p.prior[0]) / p.prior[1] ** 2
        least = left - float(slope @ covariance(normal) @ slope)
        return cls(least, max(samples - len(normal), 1), normal, pulled)
