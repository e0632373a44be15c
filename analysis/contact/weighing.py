"""Candidate explanations of a quantity measured against load, weighed by their exact marginal likelihood.

A candidate predicts y(P) with up to three unknown parameters and tolerances. Logarithms of measured over predicted
are independent and normal, with the variance of each point's own error and one scatter sigma that all points share,
unknown too: what setting a load anew does to a contact. One point in twenty stands apart, with a far larger scatter,
so that no single load decides. All unknowns have proper priors, named with their ranges, and the integral over them
is done on a grid, so that nothing is approximated but the integral itself. A candidate's probability is its integral
over the sum of all, each as likely beforehand: one with more freedom pays for what it could have said and did not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

FloatArray = NDArray[np.float64]
LEVEL = 0.95
SMALLEST_SCATTER, LARGEST_SCATTER = 0.003, 0.2  # of the scatter that the points share, relative; log-uniform
SCATTER_NODES = 21
APART_PROBABILITY = 0.05  # beforehand, that a point stands apart
APART_SCATTER = 2.0  # what it then scatters by, in units of the largest shared scatter
NODES = {0: 1, 1: 61, 2: 37, 3: 19}  # a parameter, by how many of them are free
TOLERANCE_NODES = 21
LAYERS = 3  # grids, each around what the one before left of the probability
HOPELESS = 50.0  # a residual so large that its density is nothing, yet finite
NEGLIGIBLE = 14.0  # of log density beneath the highest
TOLERANCE_REACH = 3.5  # standard deviations of a tolerance that are integrated over
NOT_TOLD_APART = math.log(20.0)  # of marginal likelihoods, in either direction


@dataclass(frozen=True, slots=True)
class Parameter:
    """An unknown number and what is known of it beforehand.

    Attributes
    ----------
    name, unit
        For tables.
    low, high
        Range of the prior.
    logarithmic
        Whether the prior is uniform in the logarithm.
    tolerance
        Standard deviation of a normal prior about the middle of the range (of the logarithm where that is what is
        uniform); None for a uniform one. A tolerance is not counted as freedom of the candidate.
    """

    name: str
    unit: str
    low: float
    high: float
    logarithmic: bool = True
    tolerance: float | None = None

    def nodes(self, low: float, high: float, count: int) -> FloatArray:
        """Return (count,) nodes, ends included, spaced as the prior is."""
        return np.geomspace(low, high, count) if self.logarithmic else np.linspace(low, high, count)

    def log_prior(self, value: FloatArray) -> FloatArray:
        """Return the log density at ``value``, per unit of the coordinate in which the prior is uniform."""
        ends = np.array([self.low, self.high])
        x, (low, high) = (np.log(value), np.log(ends)) if self.logarithmic else (value, ends)
        if self.tolerance is None:
            return np.full(np.shape(x), -math.log(high - low))
        z = (x - (low + high) / 2) / self.tolerance
        return np.asarray(-(z**2) / 2 - math.log(self.tolerance * math.sqrt(2 * math.pi)), dtype=np.float64)


def tolerance(name: str, relative: float) -> Parameter:
    """Return a factor near one, known beforehand to ``relative`` (one standard deviation of its logarithm)."""
    reach = math.exp(TOLERANCE_REACH * relative)
    return Parameter(name, "", 1 / reach, reach, tolerance=relative)


Prediction = Callable[..., FloatArray]


@dataclass(frozen=True, slots=True)
class Candidate:
    """An explanation.

    Attributes
    ----------
    id, statement
        A short name, and what it says, in a sentence.
    parameters
        Its unknowns.
    predict
        y of the loads (n,), N, and of each parameter, (g, 1): (g, n), in the unit of what was measured.
    """

    id: str
    statement: str
    parameters: tuple[Parameter, ...]
    predict: Prediction


@dataclass(frozen=True, slots=True)
class Known:
    """A parameter afterwards: median and 95 % interval; whether an end is only that of the prior."""

    parameter: Parameter
    value: float
    low: float
    high: float
    open_below: bool
    open_above: bool


@dataclass(frozen=True, slots=True)
class Weighed:
    """A candidate held against the points.

    Attributes
    ----------
    candidate
        Which.
    log_evidence
        Log marginal likelihood.
    probability
        Among all that were weighed together.
    aicc
        Akaike's criterion corrected for few points; infinite where there are too few for it.
    parameters, scatter
        What is known of them afterwards; the scatter is relative.
    most_probable
        Values of the parameters where the posterior is highest, in their order.
    prediction
        (n,) at the loads, the mean of the logarithm over all that is unknown.
    residual
        (n,) log of measured over ``prediction``.
    apart
        (n,) probability that the point stands apart from the others.
    left_out_error
        (n,) log of measured over what the other points predict there.
    left_out_log_density
        Sum over the points of the log density at which the others predict them.
    indistinguishable_from
        Candidates whose marginal likelihoods are within a factor of 20.
    """

    candidate: Candidate
    log_evidence: float
    probability: float
    aicc: float
    parameters: tuple[Known, ...]
    scatter: Known
    most_probable: tuple[float, ...]
    prediction: FloatArray
    residual: FloatArray
    apart: FloatArray
    left_out_error: FloatArray
    left_out_log_density: float
    indistinguishable_from: tuple[str, ...] = ()

    def curve(self, load: FloatArray) -> FloatArray:
        """Return the prediction at loads (m,), N, with the most probable parameters, (m,)."""
        predicted = self.candidate.predict(np.asarray(load, float), *(np.array([[v]]) for v in self.most_probable))
        return np.asarray(np.broadcast_to(predicted, (1, len(load)))[0], dtype=np.float64)

    @property
    def left_out_rms(self) -> float:
        """Root mean square of the error at the point left out, relative, over all points."""
        return float(np.sqrt(np.mean(self.left_out_error**2)))

    @property
    def left_out_rms_together(self) -> float:
        """The same over the points that rather do not stand apart."""
        kept = self.apart < 0.5
        return float(np.sqrt(np.mean(self.left_out_error[kept] ** 2))) if kept.any() else math.nan


def what_is_missed(best: Weighed, load: FloatArray, expected: float) -> str:
    """Say what an explanation leaves unexplained.

    Parameters
    ----------
    best
        The explanation.
    load
        (n,) loads, N.
    expected
        Relative scatter that the errors of the points account for.
    """
    s = best.scatter
    apart = [
        f"{1e3 * P:.4g} mN (measured {_above(r)}; {percent(p)})"
        for P, r, p in zip(load, best.residual, best.apart, strict=True)
        if p > 0.5
    ]
    kept = np.where(best.apart <= 0.5, np.abs(best.residual), 0.0)
    worst = int(kept.argmax())
    return (
        "What it still misses: "
        + (f"{', '.join(apart)} stands apart; " if apart else "")
        + f"{percent(s.value)} of scatter between the {'other ' if apart else ''}loads "
        f"({percent(s.low)} to {percent(s.high)}), where the errors of the points account for {percent(expected)}; "
        f"the worst of them is {1e3 * load[worst]:.4g} mN, measured {_above(best.residual[worst])}."
    )


def _above(log_residual: float) -> str:
    off = math.expm1(log_residual)
    return f"{percent(abs(off))} {'above' if off > 0 else 'below'}"


def percent(share: float) -> str:
    """Write a share in % with two digits."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def weigh(
    load: FloatArray,
    measured: FloatArray,
    relative_error: FloatArray,
    candidates: Sequence[Candidate],
    largest_scatter: float = LARGEST_SCATTER,
) -> list[Weighed]:
    """Weigh candidates against measured points.

    Parameters
    ----------
    load
        (n,) loads, N, n at least 3.
    measured
        (n,) what was measured, above zero.
    relative_error
        (n,) standard error of each over its value, known beforehand; the load's goes in here too.
    candidates
        What may explain them. One that has no finite prediction anywhere is left out.
    largest_scatter
        Upper end of the prior of the scatter that the points share.

    Returns
    -------
    list of Weighed
        Most probable first.

    Examples
    --------
    >>> P = np.array([0.1, 0.2, 0.4, 0.8])
    >>> root = Candidate("cube root", "k_c grows with the cube root of the load", (), lambda P: 1e6 * np.cbrt(P)[None])
    >>> same = Candidate("constant", "k_c is the same at every load", (), lambda P: np.full((1, P.size), 6e5))
    >>> [w.candidate.id for w in weigh(P, 1e6 * np.cbrt(P), np.full(4, 0.01), [same, root])]
    ['cube root', 'constant']
    """
    P, y, error = (np.asarray(x, dtype=np.float64) for x in (load, measured, relative_error))
    if len(P) < 3 or not (y > 0).all() or not (P > 0).all():
        raise ValueError("three points or more, with loads and values above zero, can be weighed")
    scatter = Parameter("scatter", "", SMALLEST_SCATTER, largest_scatter)
    each = [w for candidate in candidates if (w := _weigh_one(P, np.log(y), error, candidate, scatter)) is not None]
    evidence = np.array([w.log_evidence for w in each])
    probability = np.exp(evidence - special.logsumexp(evidence)) if each else evidence
    result = []
    for i in np.argsort(-evidence):
        near = [j for j in np.argsort(-evidence) if j != i and abs(evidence[j] - evidence[i]) < NOT_TOLD_APART]
        names = tuple(each[j].candidate.id for j in near)
        result.append(replace(each[i], probability=float(probability[i]), indistinguishable_from=names))
    return result


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """Nodes of all unknowns but the scatter, flattened.

    Coordinates (d, g), log weights with the prior (g,), log density of the tolerances against their middle (g,).
    """

    axes: tuple[FloatArray, ...]
    coordinates: FloatArray
    log_weight: FloatArray
    log_tolerance: FloatArray


def _grid(candidate: Candidate, box: Sequence[tuple[float, float]]) -> _Grid:
    count = NODES[sum(p.tolerance is None for p in candidate.parameters)]
    axes, weights, penalties = [], [], []
    for parameter, (low, high) in zip(candidate.parameters, box, strict=True):
        nodes = parameter.nodes(low, high, TOLERANCE_NODES if parameter.tolerance is not None else count)
        x = np.log(nodes) if parameter.logarithmic else nodes
        trapezoid = np.gradient(x)
        trapezoid[[0, -1]] /= 2
        axes.append(nodes)
        prior = parameter.log_prior(nodes)
        weights.append(np.log(trapezoid) + prior)
        penalties.append(prior - prior.max())
    if not axes:
        return _Grid((), np.empty((0, 1)), np.zeros(1), np.zeros(1))
    coordinates = np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")])
    return _Grid(tuple(axes), coordinates, _sum_over(weights), _sum_over(penalties))


def _sum_over(axes: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(sum(m.ravel() for m in np.meshgrid(*axes, indexing="ij")), dtype=np.float64)


def _scatter_nodes(scatter: Parameter) -> tuple[FloatArray, FloatArray]:
    """Nodes and their log weights, (s,) each; the weights include the prior."""
    nodes = scatter.nodes(scatter.low, scatter.high, SCATTER_NODES)
    weight = np.full(SCATTER_NODES, 1 / (SCATTER_NODES - 1))
    weight[[0, -1]] /= 2
    return nodes, np.log(weight)


def _residuals(P: FloatArray, log_y: FloatArray, grid: _Grid, candidate: Candidate) -> FloatArray:
    """Log of measured over predicted, (g, n); a hopeless one where there is no prediction."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        predicted = np.log(candidate.predict(P, *(c[:, None] for c in grid.coordinates)))
    residual = log_y - np.broadcast_to(predicted, (grid.coordinates.shape[1], len(P)))
    return np.where(np.isfinite(residual), residual, HOPELESS)


def _log_densities(residual: FloatArray, error: FloatArray, scatter: Parameter) -> tuple[FloatArray, FloatArray]:
    """Log density of each point at each node, (g, s, n), and the scatter's log weights (s,)."""
    nodes, log_weight = _scatter_nodes(scatter)
    r2 = residual[:, None, :] ** 2
    together = math.log1p(-APART_PROBABILITY) + _log_normal(r2, nodes[:, None] ** 2 + error**2)
    return np.logaddexp(together, _log_apart(r2, error, scatter)), log_weight


def _log_apart(r2: FloatArray, error: FloatArray, scatter: Parameter) -> FloatArray:
    """Log density of a squared residual that stands apart, with the log of how likely that is."""
    return math.log(APART_PROBABILITY) + _log_normal(r2, (APART_SCATTER * scatter.high) ** 2 + error**2)


def _log_normal(r2: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(-r2 / (2 * variance) - 0.5 * np.log(2 * np.pi * variance), dtype=np.float64)


def _weigh_one(
    P: FloatArray, log_y: FloatArray, error: FloatArray, candidate: Candidate, scatter: Parameter
) -> Weighed | None:
    box = [(p.low, p.high) for p in candidate.parameters]
    grid = _grid(candidate, box)
    for _ in range(LAYERS - 1 if box else 0):
        kept = _kept(P, log_y, error, candidate, grid, scatter)
        box = [_around(axis, kept, i) for i, axis in enumerate(grid.axes)]
        grid = _grid(candidate, box)
    residual = _residuals(P, log_y, grid, candidate)
    if (residual == HOPELESS).any(axis=1).all():
        return None
    density, of_scatter = _log_densities(residual, error, scatter)
    total = density.sum(-1)
    joint = total + of_scatter + grid.log_weight[:, None]
    log_evidence = float(special.logsumexp(joint))
    posterior = np.exp(joint - log_evidence)
    free = sum(p.tolerance is None for p in candidate.parameters)
    left_out, log_density = np.empty(len(P)), 0.0
    for i in range(len(P)):
        predicts = residual[:, i] != HOPELESS
        rest = special.logsumexp(joint[predicts] - density[predicts, :, i], axis=1)
        norm = special.logsumexp(rest)
        left_out[i] = np.exp(rest - norm) @ residual[predicts, i]
        log_density += float(log_evidence - norm)
    mean_residual = posterior.sum(axis=1) @ residual
    of_apart = np.exp(_log_apart(residual[:, None, :] ** 2, error, scatter) - density)
    return Weighed(
        candidate=candidate,
        log_evidence=log_evidence,
        probability=math.nan,
        aicc=_aicc(float((total + grid.log_tolerance[:, None]).max()), free + 1, len(P)),
        parameters=tuple(
            _known(p, axis, _marginal(posterior.sum(axis=1), grid, i))
            for i, (p, axis) in enumerate(zip(candidate.parameters, grid.axes, strict=True))
        ),
        scatter=_known(scatter, _scatter_nodes(scatter)[0], posterior.sum(axis=0)),
        most_probable=tuple(float(c) for c in grid.coordinates[:, int(posterior.sum(axis=1).argmax())]),
        prediction=np.exp(log_y - mean_residual),
        residual=mean_residual,
        apart=np.einsum("gs,gsn->n", posterior, of_apart),
        left_out_error=left_out,
        left_out_log_density=log_density,
    )


def _kept(
    P: FloatArray, log_y: FloatArray, error: FloatArray, candidate: Candidate, grid: _Grid, scatter: Parameter
) -> NDArray[np.bool_]:
    """Nodes, shaped as the grid, at which all points together, or all but one, leave some probability."""
    density, of_scatter = _log_densities(_residuals(P, log_y, grid, candidate), error, scatter)
    total = density.sum(-1)
    kept = np.zeros(len(grid.log_weight), bool)
    for view in (total, *(total - density[..., i] for i in range(len(P)))):
        log_posterior = special.logsumexp(view + of_scatter, axis=1) + grid.log_weight
        kept |= log_posterior > log_posterior.max() - NEGLIGIBLE
    return kept.reshape([len(axis) for axis in grid.axes])


def _around(axis: FloatArray, kept: NDArray[np.bool_], index: int) -> tuple[float, float]:
    """Ends of the kept stretch of an axis, one node wider on either side."""
    others = tuple(i for i in range(kept.ndim) if i != index)
    inside = np.flatnonzero(kept.any(axis=others))
    return float(axis[max(inside[0] - 1, 0)]), float(axis[min(inside[-1] + 1, len(axis) - 1)])


def _marginal(posterior: FloatArray, grid: _Grid, index: int) -> FloatArray:
    shaped = posterior.reshape([len(a) for a in grid.axes])
    return np.asarray(shaped.sum(axis=tuple(i for i in range(shaped.ndim) if i != index)))


def _known(parameter: Parameter, nodes: FloatArray, mass: FloatArray) -> Known:
    """Quantiles of the marginal, each node's mass spread evenly over its cell."""
    x = np.log(nodes) if parameter.logarithmic else nodes
    edges = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
    cumulative = np.concatenate([[0.0], np.cumsum(mass / mass.sum())])
    low, middle, high = np.interp([(1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2], cumulative, edges)
    if parameter.logarithmic:
        low, middle, high = np.exp([low, middle, high])
    density = mass / np.diff(edges)
    wide = (density > 0.05 * density.max()) & (parameter.tolerance is None)
    return Known(
        parameter,
        float(middle),
        float(low),
        float(high),
        open_below=bool(wide[0] and math.isclose(nodes[0], parameter.low, abs_tol=1e-12)),
        open_above=bool(wide[-1] and math.isclose(nodes[-1], parameter.high)),
    )


def _aicc(log_likelihood: float, unknowns: int, points: int) -> float:
    if points <= unknowns + 1:
        return math.inf
    return 2 * unknowns - 2 * log_likelihood + 2 * unknowns * (unknowns + 1) / (points - unknowns - 1)
