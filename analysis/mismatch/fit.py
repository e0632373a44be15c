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
from scipy.interpolate import make_interp_spline

from analysis.mismatch.baseline import Constants, Nuisance, Overdamped, Sensitivity, sensitivity, slope_columns
from analysis.mismatch.coordinates import Coordinates
from analysis.mismatch.linear import linear_rig
from analysis.mismatch.problem import Problem, Term, acted_on, law_parameters
from analysis.mismatch.records import Record
from analysis.mismatch.response import Response, response, responses, whiten
from sim_backend.arrangement import LOAD, Arrangement
from sim_backend.mechanisms.mechanism import Quantity
from sim_backend.modal_march import MEMORY, SLOTS, march, no_law, step_weights

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

MOST_ITERATIONS = 25
TOGETHER = 8  # iterations in which constants and amplitudes are stepped together; then the amplitudes follow
CONVERGED = 0.02  # change of chi-squared below which a fit is done
LITTLE, LITTLE_SHARE = 5.0, 3e-3  # change of chi-squared below which a competing fit is done; share of the difference
HOPELESS, HOPELESS_AFTER = 1.3, 6  # objective over that to be beaten at which a competing fit is given up; steps
AS_EXPECTED = 0.5  # share of its expected gain that a step must have for its slopes to be used once more
MOST_TRIES = 6  # of a step with more and more damping
SUBSTEPS = 4
SECOND_STEP = 0.05  # of differences, samples
MOST_SAMPLES = 0.5  # that a second blow may move in one step
SPLINE = 5  # degree in which a tap's pulse is shifted by parts of a sample
LOAD_STEP = 1e-5  # of differences, relative
PARAMETER_STEP = 1e-4  # of differences, relative to the parameter (or its range where it is small)
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
        Of the session's constants, those of each load, and the terms' parameters, in this order.
    term_covariances
        For each term: covariance (k, k) of its parameters (of the logarithm where one is fitted as such).
    amplitudes, coefficients
        Of each record: modal amplitudes, and all free coefficients.
    residuals
        Of each record (c, n), whitened.
    records
        What was fitted, with the time of the tap and of a second blow as they were found.
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


@dataclass(frozen=True, slots=True)
class _Variant:
    """With what a record is predicted."""

    terms: tuple[Term, ...]
    amplitudes: Complex
    values: dict[str, float]
    to: Response

    def before(self, lead_s: float) -> _Variant:
        """Return the same with the modal amplitudes so much earlier."""
        return replace(self, amplitudes=self.amplitudes * np.exp(-lead_s * self.to.rig.poles))


class _Model:
    """A problem with terms: predicts, differences and steps."""

    def __init__(self, problem: Problem, terms: Sequence[Term]):
        self.problem, self.terms = problem, tuple(terms)
        arrangement = problem.arrangement
        for term in terms:
            if term.mechanism.extend is not None:
                arrangement = term.mechanism.extend(arrangement, term.values)
        self.arrangement = arrangement
        lines = [hz for t in terms if t.mechanism.lines is not None for hz in t.mechanism.lines(t.values)]
        slow = np.append(problem.slow, 2j * np.pi * np.array(lines)) if lines else problem.slow
        self.nuisance = Nuisance(problem.recordings, slow)
        self.rate = problem.recordings.sample_rate_hz
        self.rig_parameters = [p for p in arrangement.parameters if p.scope != LOAD]
        self.declared = np.array([p.value for p in self.rig_parameters])
        self.precision = np.array(
            [1 / p.uncertainty**2 if np.isfinite(p.uncertainty) else 0.0 for p in self.rig_parameters]
        )
        names = [p.name for p in self.rig_parameters]
        self.coordinates = Coordinates(names, np.array([p.positive for p in self.rig_parameters], bool), terms)
        self.free: list[tuple[int, Quantity]] = [
            (i, q) for i, t in enumerate(terms) if t.nonlinear for q in t.mechanism.parameters
        ]
        self.marched = any(t.mechanism.law is not None for t in terms)
        self.nonlinear = any(t.nonlinear for t in terms)
        self.strikes_twice = any(t.mechanism.blow for t in terms)
        self.substeps = SUBSTEPS

    def start_free(self) -> Real:
        return np.array([_inward(self.terms[i].values[q.name], q) for i, q in self.free])

    def with_free(self, free: Real) -> tuple[Term, ...]:
        """Terms with the values of the free parameters put in."""
        values = [dict(t.values) for t in self.terms]
        for (i, q), x in zip(self.free, free, strict=True):
            values[i][q.name] = _outward(float(x), q)
        return tuple(replace(t, values=v) for t, v in zip(self.terms, values, strict=True))

    def constants(self, state: _State) -> Constants:
        return Constants(self.arrangement, state.rig, state.load)

    def modes(self, constants: Constants) -> tuple[list[Sensitivity], list[Response]]:
        problem = self.problem
        modes = [
            sensitivity(constants, g, problem.analog, problem.recordings, self.tied(constants.at(g)))
            for g in range(len(constants.load))
        ]
        made = [
            response(self.arrangement, constants.at(g), m.rig, problem.analog) if self.nonlinear else None
            for g, m in enumerate(modes)
        ]
        return modes, made  # type: ignore[return-value]

    def tied(self, values: dict[str, float]) -> tuple[int, ...]:
        """Modes of bodies that are set going by the rig alone and too weak to be read record by record."""
        added = len(self.arrangement.bodies) - len(self.problem.arrangement.bodies)
        if not added or not any(t.mechanism.tied for t in self.terms):
            return ()
        rig = linear_rig(self.arrangement, values, self.problem.analog, self.problem.recordings.noise, self.rate)
        size = np.abs(rig.shapes) * np.sqrt([[values[m]] for m in self.arrangement.masses])
        share = size[-added:].sum(axis=0) / size.sum(axis=0)
        return tuple(int(j) for j in np.argsort(-share)[:added])

    def extra(self, record: Record, variants: Sequence[_Variant]) -> Real:
        """Return (variants, c, n) what the terms add to the whitened record of the linear rig."""
        samples = record.y.shape[1]
        added = np.zeros((len(variants), *record.y.shape))
        if self.marched:
            h = 1 / self.rate / self.substeps
            steps = (samples - 1 + record.run_up) * self.substeps
            forces, used = self.forces(record, [v.before(record.run_up / self.rate) for v in variants], h, steps)
            added += responses([v.to for v in variants], used, forces, h, self.substeps)[:, :, record.run_up :]
        for out, variant in zip(added, variants, strict=True):
            self._struck_and_distorted(out, record, variant)
        return whiten(added, self.problem.recordings.noise)

    def _struck_and_distorted(self, added: Real, record: Record, variant: _Variant) -> None:
        """Add (c, n) a second blow and what the sensor chain makes of the record."""
        to, amplitudes = variant.to, variant.amplitudes
        for term in variant.terms:
            if term.mechanism.blow:
                added += next(iter(term.values.values())) * struck_again(to, amplitudes, record, self.rate)
        distorted = [t for t in variant.terms if t.mechanism.distort is not None]
        if distorted:
            t = np.arange(added.shape[1]) / self.rate
            waves = np.exp(np.outer(t, to.rig.poles)) * (to.rig.weight * amplitudes)
            clean = (to.rig.filtered @ waves.T).real + added
            shown = clean
            for term in distorted:
                shown = term.mechanism.distort(shown, self._seen(term, record, clean), self.rate)  # type: ignore[misc]
            added += shown - clean

    def forces(self, record: Record, variants: Sequence[_Variant], h: float, steps: int) -> tuple[Real, list[int]]:
        """Return the extra forces (variants, k, steps + 1) of k elements from a record's run-up on (back for h < 0)."""
        elements = self.arrangement.elements
        slots = [(i, e) for i, t in enumerate(self.terms) if t.mechanism.law for e in acted_on(t, self.arrangement)]
        slots.sort(key=lambda s: self.terms[s[0]].mechanism.last)
        if len(slots) > SLOTS:
            raise ValueError("more force laws than can act together")
        laws = [self.terms[i].mechanism.law for i, _ in slots] + [no_law] * (SLOTS - len(slots))
        acting = [e for _, e in slots] + [-1] * (SLOTS - len(slots))
        used = sorted({e for _, e in slots})
        place = np.array([used.index(e) if e >= 0 else -1 for e in acting])
        rows = [[law_parameters(v.terms[i], elements[e], v.values, record, h) for i, e in slots] for v in variants]
        p = np.zeros((len(variants), SLOTS, max(len(row) for row in rows[0])))
        for own, filled in zip(p, rows, strict=True):
            for row, numbers in zip(own, filled, strict=False):
                row[: len(numbers)] = numbers
        to = [v.to for v in variants]
        found = march(
            tuple(laws), place, p, np.stack([r.seen[used] for r in to]), np.stack([r.rate[used] for r in to]),
            np.stack([r.drive[used] for r in to]), step_weights(np.stack([r.rig.poles for r in to]), h),
            np.stack([v.amplitudes for v in variants]), to[0].rig.weight,
            record.start_s - record.run_up / self.rate, h, steps, np.zeros((SLOTS, MEMORY)),
        )  # fmt: skip
        return found, used

    def _seen(self, term: Term, record: Record, clean: Real) -> dict[str, float]:
        """Values of a channel's distortion with the peak it is measured by."""
        own = max(float(np.abs(record.raw).max()), float(np.abs(clean).max()))
        whole = max(float(np.abs(r.raw).max()) for r in self.problem.recordings.records)
        return dict(term.values) | {"peak": whole if term.values.get("of_session") else own}

    def residual(
        self,
        number: int,
        state: _State,
        terms: tuple[Term, ...],
        modes: Sensitivity,
        to: Response,
        values: dict[str, float],
    ) -> tuple[Real, Real]:
        """Return residual and what the terms added, (c, n) each."""
        record = state.records[number]
        columns = self.nuisance.columns(modes, record)
        coefficients = state.coefficients[number]
        added = np.zeros_like(record.y)
        if self.nonlinear:
            amplitudes = Nuisance.amplitudes(modes, coefficients, record)
            added = self.extra(record, [_Variant(terms, amplitudes, values, to)])[0]
        return record.y - columns @ coefficients - added, added


def extra_forces(fitted: Fit, number: int, samples: int) -> tuple[Real, list[int], float]:
    """Return the extra forces (k, n) along a record of a fit, their k elements and the time step.

    ``samples`` from where the record's run-up begins; a negative number goes back in time.
    """
    model = _Model(fitted.problem, fitted.terms)
    record = fitted.records[number]
    to = fitted.responses[record.group]
    h = math.copysign(1 / model.rate / model.substeps, samples)
    variant = _Variant(fitted.terms, fitted.amplitudes[number], fitted.constants.at(record.group), to)
    begun = variant.before(record.run_up / model.rate)
    forces, used = model.forces(record, [begun], h, abs(samples) * model.substeps)
    return forces[0], used, h


def struck_again(to: Response, amplitudes: Complex, record: Record, sample_rate_hz: float) -> Real:
    """Return (c, n) the response to a second blow as large as the first, m/s2 before whitening.

    While its pulse acts it is what the channels showed while the first one did; afterwards the modes ring as fitted.
    """
    n, k = record.y.shape[1], record.pulse.shape[1]
    late = record.second + record.since_tap_s * sample_rate_hz  # of the second blow after the first, samples
    at = np.arange(n) - late
    rings = at >= 0
    waves = np.exp(np.outer(at[rings] / sample_rate_hz, to.rig.poles)) * (to.rig.weight * amplitudes)
    out = np.zeros((len(to.rig.filtered), n))
    out[:, rings] = (to.rig.filtered @ waves.T).real
    acts = ~rings & (at > -k)
    if np.any(acts):
        more = np.exp(np.outer(np.arange(SPLINE) / sample_rate_hz, to.rig.poles)) * (to.rig.weight * amplitudes)
        shown = np.concatenate([record.pulse, (to.rig.filtered @ more.T).real], axis=1)
        spline = make_interp_spline(np.arange(-k, SPLINE), shown, k=SPLINE, axis=1)
        out[:, acts] = spline(at[acts])
    return out


def alike(a: Sensitivity, b: Sensitivity) -> bool:
    """Whether as many modes oscillate in both, so that the same coefficients belong to them."""
    return np.array_equal(a.rig.weight, b.rig.weight) and a.tied == b.tied


def _inward(value: float, q: Quantity) -> float:
    return float(np.log(value)) if q.log else float(value)


def _outward(x: float, q: Quantity) -> float:
    value = float(np.exp(x)) if q.log else x
    return min(max(value, q.low), q.high)


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
    """
    if held is not None:
        terms = held.terms
    model = _Model(problem, terms)
    records = problem.recordings.records
    if delays:
        records = tuple(replace(r, second=float(d)) for r, d in zip(records, delays, strict=True))
    elif begin is not None and model.strikes_twice:
        records = tuple(replace(r, second=b.second) for r, b in zip(records, begin.records, strict=True))
    rig, load = model.declared.copy(), np.array(problem.start, np.float64)
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
    return _Solver(model, fixed).solve(state, most_iterations, amplitudes, reference)


def relieved_of_laws(fitted: Fit) -> Problem:
    """Return a fit's problem without what laws, second blows and sensors added to the records."""
    model = _Model(fitted.problem, fitted.terms)
    records = []
    for record, amplitudes in zip(fitted.records, fitted.amplitudes, strict=True):
        variant = _Variant(fitted.terms, amplitudes, fitted.constants.at(record.group), fitted.responses[record.group])
        records.append(replace(record, y=record.y - model.extra(record, [variant])[0]))
    return replace(fitted.problem, recordings=replace(fitted.problem.recordings, records=tuple(records)))


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

    def __init__(self, model: _Model, fixed: NDArray[np.bool_]):
        self.model, self.fixed, self.frozen = model, fixed, bool(fixed.all())
        self.common = len(model.rig_parameters)
        self.groups, self.each = model.problem.start.shape
        self.size = self.common + self.groups * self.each + len(model.free)
        self.exact = False

    def solve(self, state: _State, most_iterations: int, amplitudes: Sequence[Complex], reference: float | None) -> Fit:
        """Step until nothing is gained; where a fit competes with that of the objective ``reference``, nothing much."""
        model = self.model
        constants = model.constants(state)
        modes, to = model.modes(constants)
        self.exact = bool(amplitudes)
        state = self._first_amplitudes(state, modes, to, amplitudes)
        found = self._evaluate(state, modes, to)
        damping, stalled, iteration = 0.0, 0, 0
        slopes: _Slopes | None = None
        while iteration < most_iterations:
            fresh = slopes is None
            if reference is not None and iteration >= HOPELESS_AFTER and found[0] > HOPELESS * reference:
                break
            if slopes is None:
                slopes = self._linearise(state, modes, to, found)
                iteration += 1
            gradient, targets = self._against(slopes, state, found[2])
            accepted = False
            for _ in range(MOST_TRIES if fresh else 1):
                step = self._step(slopes.normal, gradient, damping)
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
        return self._finished(state, modes, to, found, slopes)

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
            return self.model.modes(self.model.constants(state))
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

    def _first_amplitudes(
        self, state: _State, modes: list[Sensitivity], to: list[Response], amplitudes: Sequence[Complex]
    ) -> _State:
        model = self.model
        terms = model.with_free(state.free)
        coefficients: list[Real] = []
        for i, record in enumerate(state.records):
            g = record.group
            q_, r_ = model.nuisance.basis(modes[g], record)
            y = record.y
            if amplitudes and model.nonlinear:
                variant = _Variant(terms, amplitudes[i], model.constants(state).at(g), to[g])
                y = y - model.extra(record, [variant])[0]
            coefficients.append(np.asarray(np.linalg.lstsq(r_, q_.T @ y.ravel(), rcond=1e-12)[0], np.float64))
        return self._timed(replace(state, coefficients=tuple(coefficients)), modes)

    def _evaluate(self, state: _State, modes: list[Sensitivity], to: list[Response]) -> _Found:
        model = self.model
        terms = model.with_free(state.free)
        constants = model.constants(state)
        values = [constants.at(g) for g in range(self.groups)]
        residuals, added, total = [], [], 0.0
        for i, record in enumerate(state.records):
            g = record.group
            r, a = model.residual(i, state, terms, modes[g], to[g], values[g])
            residuals.append(r)
            added.append(a)
            total += float(np.vdot(r, r))
        off = state.rig - model.declared
        penalty = float(model.precision @ off**2)
        return total + penalty, penalty, residuals, added

    def _linearise(self, state: _State, modes: list[Sensitivity], to: list[Response], found: _Found) -> _Slopes:
        model = self.model
        constants = model.constants(state)
        normal = np.zeros((self.size, self.size))
        terms = model.with_free(state.free)
        tangents = []
        at_free = self.common + self.groups * self.each
        values = [constants.at(g) for g in range(self.groups)]
        nearby = self._nearby(state, modes) if self.exact else []
        basis = model.coordinates.basis(state.rig)
        for i, record in enumerate(state.records):
            g = record.group
            s, residual, base = modes[g], found[2][i], found[3][i]
            columns = model.nuisance.columns(s, record)
            c = state.coefficients[i]
            here = _Variant(terms, Nuisance.amplitudes(s, c, record), values[g], to[g])
            slopes = slope_columns(s, here.amplitudes, record, model.rate)
            steps, variants = self._parameter_steps(state.free, here)
            if self.exact:
                for more in self._amplitude_steps(record, c, s, here), self._load_steps(nearby[g], record, c, here):
                    steps, variants = steps + more[0], variants + more[1]
            changes = model.extra(record, variants) - base if variants else np.zeros((0, *base.shape))
            changes = np.moveaxis(changes / np.array(steps)[:, None, None], 0, -1)
            free = len(model.free)
            if self.exact:
                columns, slopes = columns.copy(), slopes.copy()
                modal = changes.shape[2] - free - self.each
                columns[:, :, :modal] += changes[:, :, free : free + modal]
                slopes[:, :, self.common :] += changes[:, :, free + modal :]
            slopes[:, :, : self.common] = slopes[:, :, : self.common] @ basis
            tangent = np.concatenate([slopes, changes[:, :, :free]], axis=2).reshape(residual.size, -1)
            if model.strikes_twice:
                later = replace(record, second=record.second + SECOND_STEP)
                delayed = (model.extra(later, [here])[0] - base) / SECOND_STEP
                columns = np.concatenate([columns, delayed[:, :, None]], axis=2)
            kept = not self.exact and not model.strikes_twice
            q_, r_ = model.nuisance.basis(s, record) if kept else np.linalg.qr(columns.reshape(residual.size, -1))
            cross = q_.T @ tangent
            tangent = tangent - q_ @ cross
            where = np.r_[
                np.arange(self.common),
                self.common + g * self.each + np.arange(self.each),
                at_free + np.arange(free),
            ]
            normal[np.ix_(where, where)] += tangent.T @ tangent
            tangents.append(_Tangent(where, q_, r_, cross, tangent))
        normal[: self.common, : self.common] += basis.T @ np.diag(model.precision) @ basis
        return _Slopes(basis, normal, tuple(tangents))

    def _against(self, slopes: _Slopes, state: _State, residuals: Sequence[Real]) -> tuple[Real, list[Real]]:
        """Return the gradient, and what of each record's residual its own columns can take up."""
        gradient, targets = np.zeros(self.size), []
        for tangent, residual in zip(slopes.tangents, residuals, strict=True):
            gradient[tangent.where] += tangent.common.T @ residual.ravel()
            targets.append(tangent.q.T @ residual.ravel())
        gradient[: self.common] -= slopes.basis.T @ (self.model.precision * (state.rig - self.model.declared))
        return gradient, targets

    def _nearby(self, state: _State, modes: list[Sensitivity]) -> list[list[tuple[float, Sensitivity, _Variant]]]:
        """Return for every load, and every constant that it has of its own, a step and the rig with that step made."""
        model = self.model
        found: list[list[tuple[float, Sensitivity, _Variant]]] = [[] for _ in modes]
        for k in range(self.each):
            load = state.load.copy()
            steps = LOAD_STEP * np.maximum(np.abs(load[:, k]), LOAD_STEP)
            load[:, k] += steps
            constants = Constants(model.arrangement, state.rig, load)
            for g, s in enumerate(modes):
                values = constants.at(g)
                problem = model.problem
                noise, rate = problem.recordings.noise, problem.recordings.sample_rate_hz
                rig = linear_rig(model.arrangement, values, problem.analog, noise, rate)
                to = response(model.arrangement, values, rig, problem.analog)
                moved = replace(s, rig=rig)
                found[g].append((float(steps[g]), moved, _Variant((), np.zeros(0, np.complex128), values, to)))
        return found

    def _parameter_steps(self, free: Real, here: _Variant) -> tuple[list[float], list[_Variant]]:
        """Return a step of each free parameter of the terms, and what it leads to."""
        steps, variants = [], []
        for k, (_, q) in enumerate(self.model.free):
            x = free.copy()
            step = PARAMETER_STEP * max(abs(x[k]), PARAMETER_STEP * abs(q.high - q.low) if not q.log else 1.0)
            if abs(_outward(x[k] + step, q) - _outward(x[k], q)) < 1e-300:
                step = -step
            x[k] += step
            steps.append(step)
            variants.append(replace(here, terms=self.model.with_free(x)))
        return steps, variants

    @staticmethod
    def _amplitude_steps(record: Record, c: Real, s: Sensitivity, here: _Variant) -> tuple[list[float], list[_Variant]]:
        """Return a step of each coefficient that stands for a mode, and what it leads to."""
        modal = int(sum(w for j, w in enumerate(s.rig.weight) if j not in s.tied))
        step = AMPLITUDE_STEP * float(np.abs(c[:modal]).max())
        variants = []
        for j in range(modal):
            moved = c.copy()
            moved[j] += step
            variants.append(replace(here, amplitudes=Nuisance.amplitudes(s, moved, record)))
        return [step] * modal, variants

    @staticmethod
    def _load_steps(
        nearby: Sequence[tuple[float, Sensitivity, _Variant]], record: Record, c: Real, here: _Variant
    ) -> tuple[list[float], list[_Variant]]:
        """Return a step of each constant of the load, and what it leads to."""
        amplitudes = [Nuisance.amplitudes(s, c, record) for _, s, _ in nearby]
        variants = [replace(v, terms=here.terms, amplitudes=a) for (_, _, v), a in zip(nearby, amplitudes, strict=True)]
        return [step for step, _, _ in nearby], variants

    def _step(self, normal: Real, gradient: Real, damping: float) -> Real:
        step = np.zeros(self.size)
        if self.frozen:
            return step
        at = np.flatnonzero(~self.fixed)
        scale = np.sqrt(np.maximum(np.diag(normal)[at], 1e-300))
        scaled = normal[np.ix_(at, at)] / np.outer(scale, scale) + damping * np.eye(at.size)
        step[at] = np.linalg.lstsq(scaled, gradient[at] / scale, rcond=1e-13)[0] / scale
        return step

    def _moved(self, state: _State, step: Real, slopes: _Slopes, targets: Sequence[Real]) -> _State:
        model = self.model
        rig = model.coordinates.moved(state.rig, step[: self.common])
        load = state.load + step[self.common : self.common + self.groups * self.each].reshape(self.groups, self.each)
        free = state.free + step[self.common + self.groups * self.each :]
        for k, (_, q) in enumerate(model.free):
            if q.log:
                free[k] = min(max(free[k], state.free[k] - 1.0), state.free[k] + 1.0)
            free[k] = _inward(_outward(free[k], q), q)
        coefficients, records = [], []
        for record, c, own, target in zip(state.records, state.coefficients, slopes.tangents, targets, strict=True):
            change = np.linalg.lstsq(own.r, target - own.cross @ step[own.where], rcond=1e-12)[0]
            if model.strikes_twice:
                later = float(np.clip(change[-1], -MOST_SAMPLES, MOST_SAMPLES))
                record, change = replace(record, second=record.second + later), change[:-1]
            coefficients.append(c + change)
            records.append(record)
        return _State(rig, load, free, tuple(coefficients), tuple(records))

    def _finished(
        self, state: _State, modes: list[Sensitivity], to: list[Response], found: _Found, slopes: _Slopes | None
    ) -> Fit:
        model = self.model
        covariance = np.zeros((self.size, self.size))
        if not self.frozen:
            normal = (slopes or self._linearise(state, modes, to, found)).normal
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
        amplitudes = tuple(
            Nuisance.amplitudes(modes[r.group], c, r) for r, c in zip(state.records, state.coefficients, strict=True)
        )
        return Fit(
            model.problem, tuple(terms), model.arrangement, model.constants(state), tuple(modes), tuple(to),
            state.coefficients, amplitudes, tuple(found[2]), found[0] - found[1], found[1], covariance,
            tuple(covariances), state.records,
        )  # fmt: skip
