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
from analysis.mismatch.recordings.held_out import whitened_errors
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from sim_backend.arrays import Real


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
        size, samples, left = fitted.x.size + sum(o.size for o in fitted.own), 0, fitted.penalty
        normal, slope, pulled = np.zeros((size, size)), np.zeros(size), np.zeros((size, 0))
        for number in range(len(fitted.own)):
            errors = whitened_errors(fitted, number, noise)
            used, columns = np.isin(errors.part, (FIT, CHOOSE)), errors.flat((FIT, CHOOSE))
            rows, drawn = errors.error[:, used].ravel(), errors.drawn[:, :, used]
            pulled = pulled if pulled.size else np.zeros((size, len(drawn)))
            normal[np.ix_(errors.where, errors.where)] += columns @ columns.T
            slope[errors.where] += columns @ rows
            pulled[errors.where] += columns @ drawn.reshape(len(drawn), columns.shape[1]).T
            left, samples = left + float(rows @ rows), samples + rows.size
        for k, p in enumerate(fitted.simulation.parameters):
            if p.prior is not None:
                mean, error = p.prior
                normal[k, k] += 1 / error**2
                slope[k] += (fitted.x[k] - mean) / error**2
        return cls(left - float(slope @ covariance(normal) @ slope), max(samples - size, 1), normal, pulled)
