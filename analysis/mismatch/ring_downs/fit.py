"""Fits of ring-downs: where they begin, when they end, what is known of the parameters then."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.least_squares import Stopping, minimise
from analysis.mismatch.linearised import Evaluation, covariance
from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.added_response import AddedResponse
from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.model import COMPETING_SUBSTEPS, SUBSTEPS, RingDownModel
from analysis.mismatch.ring_downs.point import Point
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from sim_backend.arrays import Complex, Real
from sim_backend.mechanisms.kinds import AddedBody

MOST_ITERATIONS = 75  # along a bent valley many are needed; others end long before
COMPETING_ITERATIONS = 12  # of a fit while fits compete; the one that wins goes on
CONVERGED = 0.02  # change of chi-squared, over the reduced one where that is above 1, below which a fit is done


@dataclass(frozen=True, slots=True)
class Start:
    """Where a fit begins, and what of it stays.

    Attributes
    ----------
    held
        A fit whose constants and parameters are kept as they are: only what belongs to each impact is fitted (its
        constants too where they scatter).
    delays
        For a second impact: where it falls in each segment, in samples.
    amplitudes
        (p,) of each segment to start from; otherwise those that the linear rig would have.
    kept
        Names of constants of the rig that stay where they begin.
    """

    held: RingDownFit | None = None
    delays: Sequence[float] = ()
    amplitudes: Sequence[Complex] = ()
    kept: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Stop:
    """When a fit ends.

    Attributes
    ----------
    competing
        It is only compared with others: it ends where a step gains little beside the difference to what it began with,
        or to the objective ``against``.
    to_beat
        Objective of another fit: a competing one that comes nearer too slowly to reach it is given up.
    gain
        Fall of chi-squared, over the reduced one where that is above 1, below which it is done.
    known
        Whether it is asked how well its parameters are known.
    """

    iterations: int = MOST_ITERATIONS
    competing: bool = False
    against: float | None = None
    to_beat: float = math.inf
    gain: float = CONVERGED
    known: bool = True


FROM_THE_DECLARED, AT_THE_MINIMUM = Start(), Stop()


def fit(
    problem: RingDowns,
    terms: Sequence[Term] = (),
    begin: RingDownFit | None = None,
    start: Start = FROM_THE_DECLARED,
    stop: Stop = AT_THE_MINIMUM,
) -> RingDownFit:
    """Fit a model to impacts.

    Parameters
    ----------
    terms
        Mechanisms with starting values.
    begin
        A fit of the same segments to start from: its constants, and the steps of its extra forces if they are finer.

    Raises
    ------
    ValueError
        The terms cannot be joined with each other, or the rig has no modes that could be fitted.
    """
    held = start.held
    if held is not None:
        terms = held.terms
    finer = SUBSTEPS if begin is None else max(begin.substeps, SUBSTEPS)
    substeps = held.substeps if held is not None else COMPETING_SUBSTEPS if stop.competing else finer
    added = AddedResponse(problem, terms, substeps)
    segments = _delayed(problem, begin, start, added)
    rig, load, fixed = _constants_at_start(problem, added, begin, start)
    point = Point(rig, load, added.start_free(), tuple(np.zeros(0) for _ in segments), segments)
    model = RingDownModel(problem, added, fixed)
    against = stop.against if stop.against is not None or begin is None else begin.objective
    reference = against if stop.competing else None
    first = model.begin(point, start.amplitudes, math.inf if reference is None else reference)
    share = stop.gain / max(sum(s.y.size for s in segments), 1)
    stopping = Stopping(stop.iterations, stop.gain, share, reference=reference, to_beat=stop.to_beat)
    found, exact = minimise(model, first, stopping, problem.policy.race(), exact=bool(start.amplitudes))
    return _finished(model, found, exact, known=stop.known and (reference is None or not added.nonlinear))


def _delayed(problem: RingDowns, begin: RingDownFit | None, start: Start, added: AddedResponse) -> tuple[Segment, ...]:
    """Return the segments with the time of a second impact, where there is one."""
    segments = problem.experiment.segments
    if start.delays:
        return tuple(replace(s, second=float(d)) for s, d in zip(segments, start.delays, strict=True))
    if begin is not None and added.has_second_impact:
        return tuple(replace(s, second=b.second) for s, b in zip(segments, begin.segments, strict=True))
    return segments


def _constants_at_start(
    problem: RingDowns, added: AddedResponse, begin: RingDownFit | None, start: Start
) -> tuple[Real, Real, NDArray[np.bool_]]:
    """Return the constants to begin with, (k,) and (groups, m), and which of all common parameters stay."""
    names = [p.name for p in added.rig_parameters]
    rig, load = added.declared.copy(), np.array(problem.start, np.float64)
    if not added.terms:
        rig = np.array([problem.rig_start.get(p.name, p.value) for p in added.rig_parameters])
    if begin is not None:
        known = dict(zip(begin.constants.names()[0], begin.constants.rig, strict=True))
        rig = np.array([known.get(p.name, p.value) for p in added.rig_parameters])
        load = begin.constants.load.copy()
    fixed = np.zeros(rig.size + load.size + len(added.free), bool)
    if start.held is not None:
        rig, fixed[:] = start.held.constants.rig.copy(), True
        if problem.scattered:
            fixed[rig.size : rig.size + load.size] = False
        else:
            load = start.held.constants.load.copy()
    fixed[: rig.size] |= [name in start.kept for name in names]
    return rig, load, fixed


def _finished(model: RingDownModel, found: Evaluation[Point], exact: bool, known: bool) -> RingDownFit:
    """Return the fit; how well its parameters are ``known`` is only computed where it is asked for."""
    added, point = model.added, found.point
    spread = np.zeros((model.size, model.size))
    if known and not model.frozen:
        linear = model.linearised(found, exact, model.smooth)
        basis = np.eye(model.size)
        basis[: model.common, : model.common] = linear.basis
        spread = basis @ covariance(linear.normal) @ basis.T
    terms, covariances = [], []
    names = [p.name for p in added.rig_parameters]
    for i, term in enumerate(added.with_free(point.free)):
        own = [q for q in term.mechanism.parameters if q.name in term.values]
        if isinstance(term.mechanism, AddedBody):
            at = [names.index(q.name) for q in own]
            fitted = {q.name: float(v) for q, v in zip(own, point.rig[at], strict=True)}
            scale = np.where([q.log for q in own], 1 / np.maximum(np.abs(point.rig[at]), 1e-300), 1.0)
            terms.append(replace(term, values={**term.values, **fitted}))
        else:
            own_free = [(k, q) for k, q in enumerate(added.free) if q.owner == i]
            at = [model.at_free + k for k, _ in own_free]
            scale = np.array([1.0 if q.log else q.scale for _, q in own_free])
            terms.append(term)
        covariances.append(spread[np.ix_(at, at)] * np.outer(scale, scale))
    return RingDownFit(
        tuple(terms), added.arrangement, model.constants(point), found.residuals, found.objective - found.penalty,
        found.penalty, lambda: (spread, tuple(covariances)), model.problem, point.modes, point.to, point.coefficients,
        tuple(point.amplitudes), point.segments, added.substeps,
    )  # fmt: skip


def objective_with(fitted: RingDownFit, terms: Sequence[Term]) -> float:
    """Return the objective of a fit with other fixed values in its terms, all else as it is."""
    added = AddedResponse(fitted.problem, terms, fitted.substeps)
    model = RingDownModel(fitted.problem, added, np.ones(fitted.covariance.shape[0], bool))
    at = Point(
        fitted.constants.rig, fitted.constants.load, added.start_free(), fitted.coefficients, fitted.segments,
        fitted.modes, fitted.responses,
    )  # fmt: skip
    return model.evaluate(at).objective


def without_added(fitted: RingDownFit) -> RingDowns:
    """Return a fit's problem without what laws, second impacts and sensors added to the segments."""
    added = fitted.added().extra([fitted.run(i) for i in range(len(fitted.segments))])
    return fitted.problem.with_segments(
        [replace(s, y=s.y - own) for s, own in zip(fitted.segments, added, strict=True)]
    )
