"""A quantity that wanders, observed now and then: its value in between, and how far it may have gone."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from calibration.estimate import LEVEL

FloatArray = NDArray[np.float64]

DECLARED_DOF = 10.0  # how much a declared drift weighs, in increments that were seen: it is known to a quarter
ASSUMED_DOF = 0.25  # and one that is only assumed, beside errors of prediction from neighbours
FEWEST_BETWEEN = 3  # observations between first and last from which they are held against their neighbours
CORRELATED = 1.94  # neighbouring such errors of a walk share increments: 1 + 2 (4/9 + 1/36), the sum of rho^2
_INNER = math.erf(math.sqrt(0.5))  # the probability of one standard deviation
_QUANTILES = 600  # points at which a mixture of normals is evaluated
_DOFS = np.geomspace(1.0, 200.0, 60)
_REACH_RATIO = special.stdtrit(_DOFS, 0.5 + LEVEL / 2) / special.stdtrit(_DOFS, 0.5 + _INNER / 2)
_RANGE, _GRID = 1e6, 121  # rates that are considered, about the declared one and what was seen


class RandomWalk:
    """A random walk of unknown rate, seen with noise.

    Its increments over a time h have the variance D h. D has a prior times the likelihood of what was observed, the
    unknown level left out (REML). Between observations the walk is predicted by ordinary kriging; its error, a mixture
    of normals of all D, is given as the Student's t that has the same 68 and 95 %. The prior of a rate that is known
    beforehand with so many degrees of freedom is a scaled inverse chi-squared distribution; where only its order is
    assumed, sqrt(D) is uniform below it and log D uniform above.

    How far the prediction may be off is judged by how well observations are predicted from their neighbours, where
    there are at least `FEWEST_BETWEEN` between the first and the last: of a walk that gives the same D, of a drift that
    is smooth, as a warming rig's, a smaller one.

    Parameters
    ----------
    hours
        (n,) times of the observations.
    values
        (n,) what was observed.
    noise
        (n,) variance of each observation.
    prior_rate
        Standard deviation of an increment in an hour as known beforehand; zero: nothing is known of it.
    prior_dof
        Degrees of freedom of that knowledge; None: no more than its order is assumed.
    seen_elsewhere
        Log-likelihood of (r,) variances of an increment in an hour from other evidence, or None.

    Examples
    --------
    >>> walk = RandomWalk([0.0, 2.0], [1.0, 1.0], [0.0, 0.0], 0.1, 10.0)
    >>> walk.weights(0.5)
    array([0.75, 0.25])
    """

    def __init__(
        self,
        hours: ArrayLike,
        values: ArrayLike,
        noise: ArrayLike,
        prior_rate: float,
        prior_dof: float | None,
        seen_elsewhere: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        self._seen_elsewhere = seen_elsewhere
        self._hours = np.asarray(hours, dtype=np.float64)
        self._noise = np.asarray(noise, dtype=np.float64)
        values = np.asarray(values, dtype=np.float64)
        self._gamma = np.abs(self._hours[:, None] - self._hours[None, :]) / 2
        self.rate_variance, self.dof = self._posterior(values, prior_rate**2, prior_dof)
        self._error_rate = self.rate_variance
        if len(values) >= FEWEST_BETWEEN + 2:
            known = ASSUMED_DOF if prior_dof is None else prior_dof
            self._error_rate, self.dof = self._left_out(values, prior_rate**2, known)

    def weights(self, hour: float) -> FloatArray:
        """(n,) weights of the observations in the prediction at a time; they sum to one."""
        n = len(self._hours)
        if n == 1:
            return np.ones(1)
        system = np.zeros((n + 1, n + 1))
        rate, longest = self.rate_variance, max(float(np.max(self._gamma)), 1e-12)
        noisiest = float(np.max(self._noise))
        if rate == 0.0 and noisiest == 0.0:
            rate = 1.0  # a walk that does not move, seen without noise, is predicted as any other
        scale = max(rate * longest, noisiest)
        system[:n, :n] = (rate * self._gamma - np.diag(self._noise)) / scale
        system[n, :n] = system[:n, n] = 1.0
        right = np.append(rate * np.abs(hour - self._hours) / 2 / scale, 1.0)
        solution: FloatArray = np.linalg.lstsq(system, right, rcond=None)[0]
        return solution[:n]

    def variance(self, hour: float) -> float:
        """Variance of the walk about its prediction at a time, the noise of the observations left out."""
        w = self.weights(hour)
        unit = 2 * w @ (np.abs(hour - self._hours) / 2) - w @ self._gamma @ w
        return self._error_rate * max(float(unit), 0.0)

    def _left_out(self, values: FloatArray, known: float, prior_dof: float) -> tuple[float, float]:
        """D by the errors of predicting each observation from its two neighbours, and its degrees of freedom."""
        order = np.argsort(self._hours)
        t, y, noise = self._hours[order], values[order], self._noise[order]
        before, after = t[1:-1] - t[:-2], t[2:] - t[1:-1]
        whole = np.maximum(before + after, 1e-12)
        share = before / whole
        error = y[1:-1] - (1 - share) * y[:-2] - share * y[2:]
        by_noise = noise[1:-1] + (1 - share) ** 2 * noise[:-2] + share**2 * noise[2:]
        unit = before * after / whole
        if not np.sum(unit) > 0:
            return self.rate_variance, self.dof
        rate = max(float(np.sum(error**2 - by_noise) / np.sum(unit)), 0.0)
        dof = len(error) / CORRELATED
        return (prior_dof * known + dof * rate) / (prior_dof + dof), max(prior_dof + dof, 1.0)

    def _posterior(self, values: FloatArray, known: float, prior_dof: float | None) -> tuple[float, float]:
        """D of the walk's errors and their degrees of freedom."""
        n = len(values)
        span = float(np.ptp(self._hours)) if n > 1 else 0.0
        if n < 2 or span == 0.0:
            return known, max(prior_dof or 0.0, 1.0) if known > 0 else math.inf
        order = np.argsort(self._hours)
        seen = float(np.sum(np.diff(values[order]) ** 2)) / span
        if known == 0.0:
            by_noise = float(np.sum(self._noise[order][1:] + self._noise[order][:-1])) / span
            rate = max(seen - by_noise, 0.0)
            return rate, n - 1.0 if rate > 0 else math.inf
        rates = max(seen, known) * np.geomspace(1 / _RANGE, _RANGE, _GRID)
        log = self._likelihood(values[order], order, rates)
        if prior_dof is None:
            log += 0.5 * (np.log(rates / known) - np.log1p(rates / known))
        else:
            log -= prior_dof / 2 * (np.log(rates) + known / rates)
        if self._seen_elsewhere is not None:
            log += self._seen_elsewhere(rates)
        p = np.exp(log - log.max())
        return _as_students(rates, p / p.sum())

    def _likelihood(self, values: FloatArray, order: NDArray[np.intp], rates: FloatArray) -> FloatArray:
        """(r,) log of the restricted likelihood of (r,) rates: increments are normal, their level unknown."""
        n = len(values)
        difference = np.diff(np.eye(n), axis=0)
        noise = difference @ np.diag(self._noise[order]) @ difference.T
        covariance = rates[:, None, None] * np.diag(np.diff(self._hours[order])) + noise
        # two observations at one time, without noise, say nothing of the rate
        least = 1e-12 * np.trace(covariance, axis1=1, axis2=2) / (n - 1)
        covariance += least[:, None, None] * np.eye(n - 1)
        increments = difference @ values
        squares = np.linalg.solve(covariance, np.broadcast_to(increments[:, None], (len(rates), n - 1, 1)))[..., 0]
        return np.asarray(-0.5 * (squares @ increments) - 0.5 * np.linalg.slogdet(covariance)[1], dtype=np.float64)


def _as_students(variances: FloatArray, probabilities: FloatArray) -> tuple[float, float]:
    """Squared scale and degrees of freedom of the Student's t that has the 68 and 95 % of a mixture of normals.

    Of a scaled inverse chi-squared distribution of variances that is the mixture itself. No fewer than one degree of
    freedom: then the 95 % are right, and the 68 % too wide.
    """
    std = np.sqrt(variances)
    x = np.geomspace(1e-2 * std[0], 1e2 * std[-1], _QUANTILES)
    inside = 2 * special.ndtr(x[:, None] / std) @ probabilities - 1
    inner, outer = np.exp(np.interp((_INNER, LEVEL), inside, np.log(x)))
    dof = float(np.interp(outer / inner, _REACH_RATIO[::-1], _DOFS[::-1]))
    return float(outer / special.stdtrit(dof, 0.5 + LEVEL / 2)) ** 2, dof
