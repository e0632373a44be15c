"""A linear mixed model: how much specimens, sessions and loads scatter, and what groups differ by in spite of that.

``y = X beta + sum over components of Z_i u_i + e``, u_i normal with variance sigma_i^2, e of known covariance.
Variances by restricted maximum likelihood (Patterson, Thompson, 1971), intervals of contrasts by degrees of freedom
after Satterthwaite with the expected information (Fai, Cornelius, 1996), those of the scatters by the profile of the
likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from calibration.estimate import LEVEL, Estimate
from rig.errors import MesotapError

Real = NDArray[np.float64]
SMALLEST_SHARE = 1e-8  # of the data's variance; a scatter below it is none
LARGEST_SCATTER = 30.0  # times the data's standard deviation, where the search for the end of an interval stops
FEWEST_DOF = 1.0
MOST_ROWS = 1500  # numbers of one model: a step takes seconds by then


class TooFew(MesotapError, ValueError):
    """The data cannot tell these effects apart."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviation of a component with its 95 % interval; ``high`` is infinite where nothing bounds it."""

    name: str
    value: float
    low: float
    high: float
    levels: int


@dataclass(frozen=True, slots=True)
class MixedFit:
    """A fitted model: fixed effects with their covariance, and scatters."""

    beta: Real
    covariance: Real
    scatters: tuple[Scatter, ...]
    _parts: tuple[Real, ...]
    _design: Real
    _variances: Real
    _known: Real

    def contrast(self, weights: Sequence[float] | Real) -> Estimate:
        """Return ``weights @ beta`` with its standard error and Satterthwaite's degrees of freedom."""
        c = np.asarray(weights, dtype=np.float64)
        variance = float(c @ self.covariance @ c)
        return Estimate(float(c @ self.beta), math.sqrt(variance), self._dof(c, variance))

    def _dof(self, c: Real, variance: float) -> float:
        free = [i for i, v in enumerate(self._variances) if v > 0]
        if not free:
            return math.inf
        inverse = np.linalg.inv(_total(self._variances, self._parts, self._known))
        project = inverse - inverse @ self._design @ self.covariance @ self._design.T @ inverse
        along = [project @ self._parts[i] for i in free]
        information = np.array([[0.5 * np.sum(a * b.T) for b in along] for a in along])
        effect = self.covariance @ c
        seen = inverse @ self._design @ effect
        gradient = np.array([seen @ self._parts[i] @ seen for i in free])
        spread = float(gradient @ np.linalg.pinv(information) @ gradient)
        return max(2 * variance**2 / spread, FEWEST_DOF) if spread > 0 else math.inf


def fit_mixed(
    y: Real, design: Real, components: dict[str, Sequence[str]], known: Real | None = None, intervals: bool = True
) -> MixedFit:
    """Fit a mixed model.

    Parameters
    ----------
    y
        (n,) numbers.
    design
        (n, p) fixed effects, of full rank.
    components
        By name, the level of each row: rows of one level share an effect. Levels of their own for every row make
        that component what is left over.
    known
        (n, n) covariance of the errors of measurement, or (n,) variances; none by default.
    intervals
        Whether intervals of the scatters are wanted; they take most of the time.

    Raises
    ------
    TooFew
        There are not more numbers than fixed effects, the effects cannot be told apart, or there are too many numbers.
    """
    n, p = design.shape
    if n > MOST_ROWS:
        raise TooFew(f"{n} loads in one model are more than {MOST_ROWS}: ask for fewer sessions")
    if n <= p or np.linalg.matrix_rank(design) < p:
        raise TooFew("there are too few sessions to tell these groups and loads apart")
    error = np.zeros((n, n)) if known is None else np.diag(known) if known.ndim == 1 else np.array(known)
    parts = tuple(_same(levels) for levels in components.values())
    scale = float(np.var(y - design @ np.linalg.lstsq(design, y, rcond=None)[0])) or 1.0
    error = error + 1e-12 * scale * np.eye(n)
    start = np.full(len(parts), scale / max(len(parts), 1))
    variances = _maximised(y, design, parts, error, start, {})
    variances[variances < SMALLEST_SHARE * scale] = 0.0
    beta, covariance = _fixed(y, design, _total(variances, parts, error))
    scatters = tuple(
        _scatter(name, i, [*components.values()][i], (y, design, parts, error), variances, scale, intervals)
        for i, name in enumerate(components)
    )
    return MixedFit(beta, covariance, scatters, parts, design, variances, error)


def _same(levels: Sequence[str]) -> Real:
    _, number = np.unique(np.asarray(levels), return_inverse=True)
    return np.asarray(number[:, None] == number[None, :], dtype=np.float64)


def _total(variances: Real, parts: Sequence[Real], known: Real) -> Real:
    total = known.copy()
    for variance, part in zip(variances, parts, strict=True):
        total += variance * part
    return total


def _fixed(y: Real, design: Real, total: Real) -> tuple[Real, Real]:
    weighted = np.linalg.solve(total, design)
    covariance = np.linalg.inv(design.T @ weighted)
    return covariance @ (weighted.T @ y), covariance


def _deviance(y: Real, design: Real, total: Real) -> float:
    """Minus twice the restricted log likelihood, without its constant."""
    try:
        root = np.linalg.cholesky(total)
    except np.linalg.LinAlgError:
        return math.inf
    whitened = np.linalg.solve(root, np.column_stack([design, y]))
    _, upper = np.linalg.qr(whitened)
    p = design.shape[1]
    logs = 2 * float(np.sum(np.log(np.diag(root)))) + 2 * float(np.sum(np.log(np.abs(np.diag(upper)[:p]))))
    return logs + float(upper[p, p] ** 2)


def _maximised(y: Real, design: Real, parts: Sequence[Real], known: Real, start: Real, fixed: dict[int, float]) -> Real:
    """Return the variances of greatest restricted likelihood, those in ``fixed`` held."""
    free = [i for i in range(len(parts)) if i not in fixed]
    variances = np.array(start, dtype=np.float64)
    for i, value in fixed.items():
        variances[i] = value
    if not free:
        return variances

    def deviance(roots: Real) -> float:
        variances[free] = roots**2
        return _deviance(y, design, _total(variances, parts, known))

    best, found = math.inf, np.sqrt(variances[free])
    for share in (1.0, 0.01):
        begun = np.sqrt(np.maximum(start[free], 1e-12)) * np.sqrt(share)
        done = optimize.minimize(deviance, begun, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-6})
        if done.fun < best:
            best, found = float(done.fun), np.abs(done.x)
    variances[free] = found**2
    return variances


def _scatter(
    name: str,
    i: int,
    levels: Sequence[str],
    data: tuple[Real, Real, tuple[Real, ...], Real],
    variances: Real,
    scale: float,
    interval: bool,
) -> Scatter:
    """Return a component's scatter, its interval by the profile of the likelihood and chi-squared."""
    y, design, parts, known = data
    value, count = math.sqrt(variances[i]), len(set(levels))
    if not interval:
        return Scatter(name, value, math.nan, math.nan, count)
    least = _deviance(y, design, _total(variances, parts, known))
    allowed = float(stats.chi2.ppf(LEVEL, 1))
    start = np.maximum(variances, 1e-4 * scale)

    def beyond(sigma: float) -> float:
        held = _maximised(y, design, parts, known, start, {i: sigma**2})
        return _deviance(y, design, _total(held, parts, known)) - least - allowed

    far = LARGEST_SCATTER * math.sqrt(scale)
    low = 0.0 if value == 0 or beyond(0.0) < 0 else float(optimize.brentq(beyond, 0.0, value, xtol=1e-4 * value))
    high = math.inf if beyond(far) < 0 else float(optimize.brentq(beyond, value, far, xtol=1e-4 * far))
    return Scatter(name, value, low, high, count)
