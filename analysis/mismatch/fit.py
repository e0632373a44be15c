"""Full fits: the rig with any mechanisms in it, all constants, all impacts together.

Free are, for every impact, the modal amplitudes when its pulse has ended and the slow ringing of each channel; for
every load the constants that differ from load to load; for the session the declared constants within their
uncertainties and the mechanisms' parameters. Gauss and Newton's method; what belongs to one impact is eliminated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.baseline import Constants, Nuisance, Overdamped, Sensitivity, slope_columns
from analysis.mismatch.linear import linear_rigs
from analysis.mismatch.model import COMPETING_SUBSTEPS, SUBSTEPS, Model, Run, Variant, inward, outward
from analysis.mismatch.problem import Problem, Term
from analysis.mismatch.records import Record
from analysis.mismatch.response import Response, response
from sim_backend.arrangement import Arrangement

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

MOST_ITERATIONS = 25
TOGETHER = 8  # iterations in which constants and amplitudes are stepped together; then the amplitudes follow
CONVERGED = 0.02  # change of chi-squared below which a fit is done
LITTLE, LITTLE_SHARE = 5.0, 3e-3  # change of chi-squared below which a competing fit is done; share of the difference
HOPELESS, HOPELESS_AFTER = 1.3, 6  # objective over that to be beaten at which a competing fit is given up; steps
BEATEN, BEATEN_AFTER = 4.0, 5  # last steps' gains that may still come for a competing fit; steps from which on
AS_EXPECTED = 0.5  # share of its expected gain that a step must have for its slopes to be used once more
OVERSTATED = 2.0  # objective over that without a force law from which on the law begins weaker
WEAKER, MOST_WEAKENINGS = 0.3, 6  # factor, and beginnings
MOST_TRIES = 6  # of a step with more and more damping
SECOND_STEP = 0.05  # of differences, samples
LOG_STEP = 1.0  # by which the logarithm of a law's parameter changes at most in a step
MOST_SAMPLES = 0.5  # that a second blow may move in one step
LOAD_STEP = 1e-5  # of differences, relative
PARAMETER_STEP = 1e-4  # of differences, relative to the parameter (or its range where it is small)
EVALUATED, LINEARISED = 1.0, 2.0  # effort of a linear rig's residual and slopes, of a sample (1: a substep of a law)
AMPLITUDE_STEP = 1e-3  # of differences, relative to the record's largest amplitude


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    terms
        Mechanisms with their fitted values.
    arrangement
        Of the rig with the bodies and elements that they add.
    chi_squared
        Sum of squares of the whitened residuals; ``penalty`` is what the declared constants add to it.
    covariance
        Of the session's constants, those of each load, and the terms' parameters, in this order; zero where a fit
        with force laws only competed.
    term_covariances
        For each term: covariance (k, k) of its parameters (of the logarithm where one is fitted as such).
    amplitudes, coefficients
        Of each record: modal amplitudes, and all free coefficients.
    residuals
        Of each record (c, n), whitened.
    records
        What was fitted, with the time of the tap and of a second blow as they were found.
    substeps
        Of a sample, in which extra forces were computed: what is predicted with the fit is computed likewise.
    """

    problem: Problem
    terms: tuple[Term, ...]
    arrangement: Arrangement
    constants: Constants
    modes: tuple[Sensitivity, ...]
    responses: tuple[Response, ...]
    coefficients: tuple[Real, ...]
    amplitudes: tuple[Complex, ...]
    residuals: tuple[Real, ...]
    chi_squared: float
    penalty: float
    covariance: Real
    term_covariances: tuple[Real, ...]
    records: tuple[Record, ...]
    substeps: int = SUBSTEPS

    @property
    def objective(self) -> float:
        """What was minimised."""
        return self.chi_squared + self.penalty

    @property
    def only_laws(self) -> bool:
        """Whether force laws, and nothing else, act beside the linear rig."""
        return bool(self.terms) and all(t.mechanism.law is not None for t in self.terms)

    def sum_of_squares(self, records: Sequence[int]) -> float:
        """Sum of squares of the residuals of some records."""
        return float(sum(np.vdot(self.residuals[i], self.residuals[i]) for i in records))


@dataclass(frozen=True, slots=True)
class _State:
    rig: Real
    load: Real
    free: Real
    coefficients: tuple[Real, ...]
    records: tuple[Record, ...]


def extra_forces(fitted: Fit, number: int, samples: int) -> tuple[Real, list[int], float]:
    """Return the extra forces (k, n) along a record of a fit, their k elements and the time step.

    ``samples`` from where the record's run-up begins; a negative number goes back in time.
    """
    return Model(fitted.problem, fitted.terms, fitted.substeps).forces(_run(fitted, number), samples)


def _run(fitted: Fit, number: int) -> Run:
    record = fitted.records[number]
    values, to = fitted.constants.at(record.group), fitted.responses[record.group]
    return record, Variant(fitted.terms, fitted.amplitudes[number], values, to)


def alike(a: Sensitivity, b: Sensitivity) -> bool:
    """Whether as many modes oscillate in both, so that the same coefficients belong to them."""
    return np.array_equal(a.rig.weight, b.rig.weight) and a.tied == b.tied


def fit(
    problem: Problem,
    terms: Sequence[Term] = (),
    begin: Fit | None = None,
    held: Fit | None = None,
    delays: Sequence[float] = (),
    most_iterations: int = MOST_ITERATIONS,
    amplitudes: Sequence[Complex] = (),
    kept: Sequence[str] = (),
    competing: bool = False,
    to_beat: float = math.inf,
) -> Fit:
    """Fit a model.

    Parameters
    ----------
    terms
        Mechanisms with starting values.
    begin
        A fit of the same records to start from (its constants and amplitudes).
    held
        A fit whose constants and parameters are kept as they are: only what belongs to each impact is fitted (its
        constants too where they scatter).
    delays
        For a second blow: where it falls in each record, in samples, to begin with.
    amplitudes
        (p,) of each record to start from; otherwise those that the linear rig would have.
    kept
        Names of constants of the rig that stay where they begin.
    competing
        The fit is only compared with others: it ends where a step gains little beside the difference to ``begin``.
    to_beat
        Objective of another fit: a competing one that comes nearer too slowly to reach it is given up.
    """
    if held is not None:
        terms = held.terms
    substeps = held.substeps if held is not None else COMPETING_SUBSTEPS if competing else SUBSTEPS
    model = Model(problem, terms, substeps)
    records = problem.recordings.records
    if delays:
        records = tuple(replace(r, second=float(d)) for r, d in zip(records, delays, strict=True))
    elif begin is not None and model.strikes_twice:
        records = tuple(replace(r, second=b.second) for r, b in zip(records, begin.records, strict=True))
    rig, load = model.declared.copy(), np.array(problem.start, np.float64)
    if not terms:
        rig = np.array([problem.rig_start.get(p.name, p.value) for p in model.rig_parameters])
    if begin is not None:
        known = dict(zip(begin.constants.names()[0], begin.constants.rig, strict=True))
        rig = np.array([known.get(p.name, p.value) for p in model.rig_parameters])
        load = begin.constants.load.copy()
    fixed = np.zeros(rig.size + load.size + len(model.free), bool)
    if held is not None:
        rig, fixed[:] = held.constants.rig.copy(), True
        if problem.scattered:
            fixed[rig.size : rig.size + load.size] = False
        else:
            load = held.constants.load.copy()
    fixed[: rig.size] |= [p.name in kept for p in model.rig_parameters]
    free = model.start_free()
    state = _State(rig, load, free, tuple(np.zeros(0) for _ in records), records)
    reference = begin.objective if competing and begin is not None else None
    return _Solver(model, fixed).solve(state, most_iterations, amplitudes, reference, to_beat)


def relieved_of_laws(fitted: Fit) -> Problem:
    """Return a fit's problem without what laws, second blows and sensors added to the records."""
    runs = [_run(fitted, i) for i in range(len(fitted.records))]
    added = Model(fitted.problem, fitted.terms, fitted.substeps).extra(runs)
    records = tuple(replace(r, y=r.y - own) for r, own in zip(fitted.records, added, strict=True))
    return replace(fitted.problem, recordings=replace(fitted.problem.recordings, records=records))


_Found = tuple[float, float, list[Real], list[Real]]
"""Objective, its part of the declared constants, and of each record the residual and what the terms added."""


@dataclass(frozen=True, slots=True)
class _Tangent:
    """Slopes of a record: of its own coefficients ``q @ r``, of the common ones at ``where`` ``q @ cross + common``."""

    where: NDArray[np.intp]
    q: Real
    r: Real
    cross: Real
    common: Real


@dataclass(frozen=True, slots=True)
class _Slopes:
    """Of all records: coordinates of the constants, normal matrix and each record's part."""

    basis: Real
    normal: Real
    tangents: tuple[_Tangent, ...]


class _Solver:
    """Gauss-Newton with damping; the columns of each record's own coefficients are projected out."""

    def __init__(self, model: Model, fixed: NDArray[np.bool_]):
        self.model, self.fixed, self.frozen = model, fixed, bool(fixed.all())
        self.common = len(model.rig_parameters)
        self.groups, self.each = model.problem.start.shape
        self.size = self.common + self.groups * self.each + len(model.free)
        self.exact = False
        # a step need not know its slopes as well as the fit's end its value
        self.coarse = Model(model.problem, model.terms, COMPETING_SUBSTEPS) if model.marched else model

    def solve(
        self,
        state: _State,
        most_iterations: int,
        amplitudes: Sequence[Complex],
        reference: float | None,
        to_beat: float,
    ) -> Fit:
        """Step until nothing is gained; where a fit competes with that of the objective ``reference``, nothing much."""
        model = self.model
        modes, to = model.modes(self._constants(state))
        self.exact = bool(amplitudes)
        state, found = self._first(state, modes, to, amplitudes, math.inf if reference is None else reference)
        damping, stalled, iteration, gain = 0.0, 0, 0, math.inf
        slopes: _Slopes | None = None
        while iteration < most_iterations:
            fresh = slopes is None
            if reference is not None and iteration >= HOPELESS_AFTER and found[0] > HOPELESS * reference:
                break
            if reference is not None and iteration >= BEATEN_AFTER and found[0] - BEATEN * gain > to_beat:
                break
            if slopes is None:
                slopes = self._linearise(state, modes, to, found, self.coarse)
                iteration += 1
            gradient, targets = self._against(slopes, state, found[2])
            accepted = False
            for _ in range(MOST_TRIES if fresh else 1):
                step = self._step(slopes.normal, gradient, damping, state.free)
                trial = self._tried(self._moved(state, step, slopes, targets), modes, to, iteration > TOGETHER)
                if trial is not None and trial[3][0] <= found[0] + 1e-6:
                    accepted = True
                    break
                damping = max(10 * damping, 1e-3)
                if damping > 1e5:
                    break
            if not accepted:
                if not fresh:
                    slopes, damping = None, 0.0
                    continue
                if model.nonlinear and not self.exact:
                    self.exact, damping, slopes = True, 0.0, None
                    continue
                break
            before, expected = found[0], float(gradient @ step) + sum(float(t @ t) for t in targets)
            state, modes, to, found = trial  # type: ignore[misc]
            gain = before - found[0]
            as_expected = self.exact and damping == 0 and gain > AS_EXPECTED * expected
            damping = 0.0 if damping < 1e-2 else damping / 10
            little = 0.0 if reference is None else min(LITTLE_SHARE * abs(reference - found[0]), LITTLE)
            if gain < max(CONVERGED, little):
                if fresh or as_expected:
                    stalled += 1
                if stalled >= (2 if model.nonlinear and not self.exact else 1):
                    break
            elif model.nonlinear and not self.exact and gain > 0 and iteration > 4:
                self.exact = True
            if not as_expected:
                slopes = None
        return self._finished(state, modes, to, found, known=reference is None or not model.nonlinear)

    def _tried(
        self, state: _State, modes: list[Sensitivity], to: list[Response], late: bool
    ) -> tuple[_State, list[Sensitivity], list[Response], _Found] | None:
        """Evaluate a trial state; ``modes`` and ``to`` are the last ones. None where it has no such modes."""
        if not self._sensible(state):
            return None
        new, new_to = self._modes(state, modes, to)
        if not new or not all(map(alike, modes, new)):
            return None
        if late and self.model.coordinates.bodies and not self.model.nonlinear:
            # modes that turn into each other make a step of the amplitudes a bad guess
            state = self._first_amplitudes(state, new, new_to, ())
        else:
            state = self._timed(state, new)
        return state, new, new_to, self._evaluate(state, new, new_to)

    def _modes(
        self, state: _State, modes: list[Sensitivity], to: list[Response]
    ) -> tuple[list[Sensitivity], list[Response]]:
        """Modes and responses of a trial state, none where there are none; ``modes`` and ``to`` are the last ones."""
        if self.frozen:
            return modes, to
        try:
            return self.model.modes(self._constants(state))
        except Overdamped:
            return [], []

    @staticmethod
    def _timed(state: _State, modes: list[Sensitivity]) -> _State:
        """Let the phase of the lowest mode say when each tap struck."""
        records = tuple(
            replace(r, tap_s=r.start_s - modes[r.group].since_tap(Nuisance.amplitudes(modes[r.group], c, r), r))
            for r, c in zip(state.records, state.coefficients, strict=True)
        )
        return replace(state, records=records)

    def _sensible(self, state: _State) -> bool:
        """Whether masses and stiffnesses are such that the rig can be solved."""
        values = np.concatenate([state.rig, state.load.ravel(), state.free])
        masses = self.model.arrangement.masses
        names = [p.name for p in self.model.rig_parameters]
        heavy = all(state.rig[names.index(m)] > 0 for m in masses if m in names)
        return bool(np.all(np.isfinite(values)) and heavy and np.all(state.load[:, 0] > 0))

    def _first(
        self, state: _State, modes: list[Sensitivity], to: list[Response], amplitudes: Sequence[Complex], without: float
    ) -> tuple[_State, _Found]:
        """Return where the fit begins.

        A force law whose screened strength makes all far worse than it is ``without`` begins weaker: the constants that
        are to change with it have not yet done so.
        """
        last = len(self.model.terms) - 1
        strength = [
            (k, q) for k, (i, q) in enumerate(self.model.free)
            if i == last and q.name == self.model.terms[i].mechanism.strength
        ]  # fmt: skip
        for tries_left in reversed(range(MOST_WEAKENINGS)):
            begun = self._first_amplitudes(state, modes, to, amplitudes)
            found = self._evaluate(begun, modes, to)
            if not tries_left or not strength or found[0] <= OVERSTATED * without:
                break
            free = state.free.copy()
            for k, q in strength:
                free[k] = inward(outward(free[k], q) * WEAKER, q)
            state = replace(state, free=free)
        return begun, found

    def _first_amplitudes(
        self, state: _State, modes: list[Sensitivity], to: list[Response], amplitudes: Sequence[Complex]
    ) -> _State:
        linear = [r.y for r in state.records]
        if amplitudes and self.model.nonlinear:
            added = self.model.extra(self._runs(state, to, amplitudes))
            linear = [y - own for y, own in zip(linear, added, strict=True)]
        coefficients: list[Real] = []
        for y, record in zip(linear, state.records, strict=True):
            q_, r_ = self.model.nuisance.basis(modes[record.group], record)
            coefficients.append(np.asarray(np.linalg.lstsq(r_, q_.T @ y.ravel(), rcond=1e-12)[0], np.float64))
        return self._timed(replace(state, coefficients=tuple(coefficients)), modes)

    def _constants(self, state: _State) -> Constants:
        return Constants(self.model.arrangement, state.rig, state.load)

    @staticmethod
    def _amplitudes(state: _State, modes: Sequence[Sensitivity]) -> list[Complex]:
        """Return the modal amplitudes of every record."""
        return [
            Nuisance.amplitudes(modes[r.group], c, r) for r, c in zip(state.records, state.coefficients, strict=True)
        ]

    def _runs(self, state: _State, to: Sequence[Response], amplitudes: Sequence[Complex]) -> list[Run]:
        """Return with what each record is predicted."""
        terms, constants = self.model.with_free(state.free), self._constants(state)
        values = [constants.at(g) for g in range(self.groups)]
        return [
            (r, Variant(terms, a, values[r.group], to[r.group])) for r, a in zip(state.records, amplitudes, strict=True)
        ]

    def _evaluate(self, state: _State, modes: list[Sensitivity], to: list[Response]) -> _Found:
        model = self.model
        model.problem.effort.spent += EVALUATED * model.problem.samples
        added = [np.zeros_like(r.y) for r in state.records]
        if model.nonlinear:
            added = model.extra(self._runs(state, to, self._amplitudes(state, modes)))
        residuals = [
            r.y - model.nuisance.columns(modes[r.group], r) @ c - own
            for r, c, own in zip(state.records, state.coefficients, added, strict=True)
        ]
        penalty = float(model.precision @ (state.rig - model.declared) ** 2)
        return sum(float(np.vdot(r, r)) for r in residuals) + penalty, penalty, residuals, added

    def _linearise(
        self, state: _State, modes: list[Sensitivity], to: list[Response], found: _Found, model: Model
    ) -> _Slopes:
        """Return the slopes of all records; those of what the terms add are computed as ``model`` does."""
        model.problem.effort.spent += LINEARISED * model.problem.samples
        free = len(model.free)
        normal = np.zeros((self.size, self.size))
        tangents: list[_Tangent] = []
        at_free = self.common + self.groups * self.each
        basis = model.coordinates.basis(state.rig)
        runs = self._runs(state, to, self._amplitudes(state, modes))
        added = found[3] if model.substeps == self.model.substeps or not runs else model.extra(runs)
        changed = self._changed(state, modes, runs, added, model)
        delayed = self._delayed(runs, added, model) if model.strikes_twice else []
        for i, ((record, here), changes) in enumerate(zip(runs, changed, strict=True)):
            s, n = modes[record.group], record.y.size
            own = model.nuisance.columns(s, record)
            slopes = slope_columns(s, here.amplitudes, record, model.rate)
            if self.exact:
                own, slopes = own.copy(), slopes.copy()
                modal = changes.shape[2] - free - self.each
                own[:, :, :modal] += changes[:, :, free : free + modal]
                slopes[:, :, self.common :] += changes[:, :, free + modal :]
            slopes[:, :, : self.common] = slopes[:, :, : self.common] @ basis
            common = np.concatenate([slopes, changes[:, :, :free]], axis=2).reshape(n, -1)
            if model.strikes_twice:
                own = np.concatenate([own, delayed[i][:, :, None]], axis=2)
            kept = not self.exact and not model.strikes_twice
            q_, r_ = model.nuisance.basis(s, record) if kept else np.linalg.qr(own.reshape(n, -1))
            cross = q_.T @ common
            common = common - q_ @ cross
            at_load = self.common + record.group * self.each
            where = np.r_[: self.common, at_load : at_load + self.each, at_free : at_free + free]
            normal[np.ix_(where, where)] += common.T @ common
            tangents.append(_Tangent(where, q_, r_, cross, common))
        normal[: self.common, : self.common] += basis.T @ np.diag(model.precision) @ basis
        return _Slopes(basis, normal, tuple(tangents))

    @staticmethod
    def _delayed(runs: Sequence[Run], added: Sequence[Real], model: Model) -> list[Real]:
        """Return for every record (c, n) how it changes with the time of the second blow, per sample."""
        later = [(replace(r, second=r.second + SECOND_STEP), here) for r, here in runs]
        return [(a - b) / SECOND_STEP for a, b in zip(model.extra(later), added, strict=True)]

    def _changed(
        self, state: _State, modes: list[Sensitivity], runs: Sequence[Run], added: Sequence[Real], model: Model
    ) -> list[Real]:
        """Return for every record (c, n, k) how what the terms add changes with the numbers they depend on.

        With their parameters; where slopes are exact, with the modes' coefficients and the load's constants too.
        """
        nearby = self._nearby(state, modes) if self.exact else []
        steps: list[list[float]] = []
        moved: list[Run] = []
        for (record, here), c in zip(runs, state.coefficients, strict=True):
            own, variants = self._parameter_steps(state.free, here)
            if self.exact:
                for more in (
                    self._amplitude_steps(record, c, modes[record.group], here),
                    self._load_steps(nearby[record.group], record, c, here),
                ):
                    own, variants = own + more[0], variants + more[1]
            steps.append(own)
            moved += [(record, v) for v in variants]
        predicted = iter(model.extra(moved))
        return [
            np.stack([(next(predicted) - base) / step for step in own], axis=-1) if own else np.zeros((*base.shape, 0))
            for base, own in zip(added, steps, strict=True)
        ]

    def _against(self, slopes: _Slopes, state: _State, residuals: Sequence[Real]) -> tuple[Real, list[Real]]:
        """Return the gradient, and what of each record's residual its own columns can take up."""
        gradient, targets = np.zeros(self.size), []
        for tangent, residual in zip(slopes.tangents, residuals, strict=True):
            gradient[tangent.where] += tangent.common.T @ residual.ravel()
            targets.append(tangent.q.T @ residual.ravel())
        gradient[: self.common] -= slopes.basis.T @ (self.model.precision * (state.rig - self.model.declared))
        return gradient, targets

    def _nearby(self, state: _State, modes: list[Sensitivity]) -> list[list[tuple[float, Sensitivity, Variant]]]:
        """Return for every load, and every constant that it has of its own, a step and the rig with that step made."""
        model, problem = self.model, self.model.problem
        noise, rate = problem.recordings.noise, problem.recordings.sample_rate_hz
        found: list[list[tuple[float, Sensitivity, Variant]]] = [[] for _ in modes]
        for k in range(self.each):
            load = state.load.copy()
            steps = LOAD_STEP * np.maximum(np.abs(load[:, k]), LOAD_STEP)
            load[:, k] += steps
            constants = Constants(model.arrangement, state.rig, load)
            rigs = linear_rigs(model.arrangement, constants.stacked(), problem.analog, noise, rate)
            for g, (s, rig) in enumerate(zip(modes, rigs, strict=True)):
                values = constants.at(g)
                to = response(model.arrangement, values, rig, problem.analog)
                variant = Variant((), np.zeros(0, np.complex128), values, to)
                found[g].append((float(steps[g]), replace(s, rig=rig), variant))
        return found

    def _parameter_steps(self, free: Real, here: Variant) -> tuple[list[float], list[Variant]]:
        """Return a step of each free parameter of the terms, and what it leads to."""
        steps, variants = [], []
        for k, (_, q) in enumerate(self.model.free):
            x = free.copy()
            step = PARAMETER_STEP * max(abs(x[k]), PARAMETER_STEP * abs(q.high - q.low) if not q.log else 1.0)
            if abs(outward(x[k] + step, q) - outward(x[k], q)) < 1e-300:
                step = -step
            x[k] += step
            steps.append(step)
            variants.append(replace(here, terms=self.model.with_free(x)))
        return steps, variants

    @staticmethod
    def _amplitude_steps(record: Record, c: Real, s: Sensitivity, here: Variant) -> tuple[list[float], list[Variant]]:
        """Return a step of each coefficient that stands for a mode, and what it leads to."""
        modal = s.coefficients
        step = AMPLITUDE_STEP * float(np.abs(c[:modal]).max())
        variants = []
        for j in range(modal):
            moved = c.copy()
            moved[j] += step
            variants.append(replace(here, amplitudes=Nuisance.amplitudes(s, moved, record)))
        return [step] * modal, variants

    @staticmethod
    def _load_steps(
        nearby: Sequence[tuple[float, Sensitivity, Variant]], record: Record, c: Real, here: Variant
    ) -> tuple[list[float], list[Variant]]:
        """Return a step of each constant of the load, and what it leads to."""
        amplitudes = [Nuisance.amplitudes(s, c, record) for _, s, _ in nearby]
        variants = [replace(v, terms=here.terms, amplitudes=a) for (_, _, v), a in zip(nearby, amplitudes, strict=True)]
        return [step for step, _, _ in nearby], variants

    def _step(self, normal: Real, gradient: Real, damping: float, free: Real) -> Real:
        """Return the damped step; parameters of laws that it would lead too far end there, and the others know it."""
        step = np.zeros(self.size)
        if self.frozen:
            return step
        at_free = self.size - free.size
        lowest, highest = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for k, (_, q) in enumerate(self.model.free, at_free):
            x = free[k - at_free]
            most = LOG_STEP if q.log else math.inf
            lowest[k], highest[k] = max(inward(q.low, q) - x, -most), min(inward(q.high, q) - x, most)
        open_ = ~self.fixed
        while open_.any():
            at, ended = np.flatnonzero(open_), np.flatnonzero(~open_)
            scale = np.sqrt(np.maximum(np.diag(normal)[at], 1e-300))
            scaled = normal[np.ix_(at, at)] / np.outer(scale, scale) + damping * np.eye(at.size)
            left = gradient[at] - normal[np.ix_(at, ended)] @ step[ended]
            step[at] = np.linalg.lstsq(scaled, left / scale, rcond=1e-13)[0] / scale
            beyond = at[(step[at] < lowest[at]) | (step[at] > highest[at])]
            if beyond.size == 0:
                break
            step[beyond] = np.clip(step[beyond], lowest[beyond], highest[beyond])
            open_[beyond] = False
        return step

    def _moved(self, state: _State, step: Real, slopes: _Slopes, targets: Sequence[Real]) -> _State:
        model = self.model
        rig = model.coordinates.moved(state.rig, step[: self.common])
        load = state.load + step[self.common : self.common + self.groups * self.each].reshape(self.groups, self.each)
        free = state.free + step[self.common + self.groups * self.each :]
        free = np.array([inward(outward(x, q), q) for x, (_, q) in zip(free, model.free, strict=True)])
        coefficients, records = [], []
        for record, c, own, target in zip(state.records, state.coefficients, slopes.tangents, targets, strict=True):
            change = np.linalg.lstsq(own.r, target - own.cross @ step[own.where], rcond=1e-12)[0]
            if model.strikes_twice:
                later = float(np.clip(change[-1], -MOST_SAMPLES, MOST_SAMPLES))
                record, change = replace(record, second=record.second + later), change[:-1]
            coefficients.append(c + change)
            records.append(record)
        return _State(rig, load, free, tuple(coefficients), tuple(records))

    def _finished(self, state: _State, modes: list[Sensitivity], to: list[Response], found: _Found, known: bool) -> Fit:
        """Return the fit; how well its parameters are ``known`` is only computed where it is asked for."""
        model = self.model
        covariance = np.zeros((self.size, self.size))
        if known and not self.frozen:
            normal = self._linearise(state, modes, to, found, model).normal
            scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
            covariance = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale)
            basis = np.eye(self.size)
            basis[: self.common, : self.common] = model.coordinates.basis(state.rig)
            covariance = basis @ covariance @ basis.T
        terms, covariances = [], []
        names = [p.name for p in model.rig_parameters]
        at_free = self.common + self.groups * self.each
        for i, term in enumerate(model.with_free(state.free)):
            own = [q for q in term.mechanism.parameters if q.name in term.values]
            if term.mechanism.extend is not None:
                at = [names.index(q.name) for q in own]
                fitted = {q.name: float(v) for q, v in zip(own, state.rig[at], strict=True)}
                scale = np.where([q.log for q in own], 1 / np.maximum(np.abs(state.rig[at]), 1e-300), 1.0)
                terms.append(replace(term, values={**term.values, **fitted}))
            else:
                at = [at_free + k for k, (j, _) in enumerate(model.free) if j == i]
                scale = np.ones(len(at))
                terms.append(term)
            covariances.append(covariance[np.ix_(at, at)] * np.outer(scale, scale))
        return Fit(
            model.problem, tuple(terms), model.arrangement, self._constants(state), tuple(modes), tuple(to),
            state.coefficients, tuple(self._amplitudes(state, modes)), tuple(found[2]), found[0] - found[1], found[1],
            covariance, tuple(covariances), state.records, model.substeps,
        )  # fmt: skip
