"""Residuals and derivatives of ring-downs, as the least-squares solver asks for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.elimination import solved
from analysis.mismatch.linearised import Evaluation, Linearisation, Tangent
from analysis.mismatch.problem import Constants
from analysis.mismatch.ring_downs.added_response import AddedResponse, Run, Variant, smooth
from analysis.mismatch.ring_downs.common_scale import growth, undetermined_mass, without_scale
from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.linear import linear_rigs
from analysis.mismatch.ring_downs.modes import Nuisance, Overdamped, Sensitivity, constant_steps, slope_columns
from analysis.mismatch.ring_downs.point import Point
from analysis.mismatch.ring_downs.response import response
from sim_backend.arrays import Complex, Real

if TYPE_CHECKING:
    from analysis.mismatch.ring_downs.problem import RingDowns

SUBSTEPS = 4
COMPETING_SUBSTEPS = 2  # while fits compete; the one that wins goes on with `SUBSTEPS`
TOGETHER = 8  # iterations in which constants and amplitudes are stepped together; then the amplitudes follow
OVERSTATED = 2.0  # objective over that without a force law from which on the law begins weaker
WEAKER, MOST_WEAKENINGS = 0.3, 6  # factor, and beginnings
SECOND_STEP = 0.05  # of differences, samples
LOG_STEP = 1.0  # by which the logarithm of a law's parameter changes at most in a step
MOST_SAMPLES = 0.5  # that a second impact may move in one step
PARAMETER_STEP = 1e-4  # of differences, relative to the parameter (or its range where it is small)
EVALUATED, LINEARISED = 1.0, 2.0  # work of a linear rig's residual and slopes, of a sample (1: a substep of a law)
AMPLITUDE_STEP = 1e-3  # of differences, relative to the segment's largest amplitude


def alike(a: Sensitivity, b: Sensitivity) -> bool:
    """Whether as many modes oscillate in both, so that the same coefficients belong to them."""
    locked = (a.phase_locked, a.rings_with) == (b.phase_locked, b.rings_with)
    return locked and np.array_equal(a.rig.weight, b.rig.weight)


class RingDownModel:
    """Ring-downs with terms; see `analysis.mismatch.least_squares.Fitted`.

    Parameters
    ----------
    fixed
        (k,) which of the common parameters stay as they are.
    """

    def __init__(self, problem: RingDowns, added: AddedResponse, fixed: NDArray[np.bool_]):
        self.problem, self.added, self.fixed = problem, added, fixed
        self.frozen = bool(fixed.all())
        self.approximates = self.reuses = added.nonlinear
        self.bends, self.settles = bool(added.coordinates.bodies) and not added.nonlinear, False
        self.common = len(added.rig_parameters)
        self.groups, self.each = problem.start.shape
        self.at_free = self.common + self.groups * self.each
        self.size = self.at_free + len(added.free)
        self.moving = np.flatnonzero(~fixed[: self.common + self.each])  # of the constants, those of a load alike
        self.mass = undetermined_mass(added)
        self.coarse = self.smooth = added

    def begin(self, point: Point, amplitudes: Sequence[Complex], without: float) -> Evaluation[Point]:
        """Return where the fit begins.

        A force law whose screened strength makes all far worse than it is ``without`` begins weaker: the constants that
        are to change with it have not yet done so.
        """
        modes, to = self.added.modes(self.constants(point))
        point = replace(point, modes=tuple(modes), to=tuple(to))
        last = len(self.added.terms) - 1
        name = self.added.terms[last].mechanism.strength if self.added.terms else None
        strength = [(k, q) for k, q in enumerate(self.added.free) if q.owner == last and q.name == name]
        for tries_left in reversed(range(MOST_WEAKENINGS)):
            found = self.evaluate(self._amplitudes_first(point, amplitudes))
            if not tries_left or not strength or found.objective <= OVERSTATED * without:
                break
            free = point.free.copy()
            for k, q in strength:
                free[k] = q.inward(q.outward(free[k]) * WEAKER)
            point = replace(point, free=free)
        if self.added.propagated:  # a step need not know its slopes as well as the fit's end its value
            runs = self._runs(found.point, found.point.amplitudes, self.added)
            self.coarse = smooth(self.added, COMPETING_SUBSTEPS, runs)
            self.smooth = smooth(self.added, self.added.substeps, runs)
        return found

    def constants(self, point: Point) -> Constants:
        """Return the rig's constants."""
        return Constants(self.added.arrangement, point.rig, point.load)

    def _amplitudes_first(self, point: Point, amplitudes: Sequence[Complex] = ()) -> Point:
        """Return the point with each segment's own coefficients fitted again, by linear least squares."""
        linear = [s.y for s in point.segments]
        if amplitudes and self.added.nonlinear:
            added = self.added.extra(self._runs(point, amplitudes, self.added))
            linear = [y - own for y, own in zip(linear, added, strict=True)]
        coefficients = []
        for y, segment in zip(linear, point.segments, strict=True):
            q, r = self.added.nuisance.basis(point.modes[segment.group], segment)
            coefficients.append(solved(r, q.T @ y.ravel(), rcond=1e-12))
        return replace(point, coefficients=tuple(coefficients)).timed()

    def _runs(self, point: Point, amplitudes: Sequence[Complex], added: AddedResponse) -> list[Run]:
        """Return with what each segment is predicted."""
        terms, constants = added.with_free(point.free), self.constants(point)
        values = [constants.at(g) for g in range(self.groups)]
        return [
            (s, Variant(terms, a, values[s.group], point.to[s.group]))
            for s, a in zip(point.segments, amplitudes, strict=True)
        ]

    def evaluate(self, point: Point) -> Evaluation[Point]:
        """Return the residuals at a point."""
        added = self.added
        self.problem.budget.spent += EVALUATED * self.problem.samples
        extra = [np.zeros_like(s.y) for s in point.segments]
        if added.nonlinear:
            extra = added.extra(self._runs(point, point.amplitudes, added))
        residuals = tuple(
            s.y - added.nuisance.columns(point.modes[s.group], s) @ c - own
            for s, c, own in zip(point.segments, point.coefficients, extra, strict=True)
        )
        penalty = float(added.precision @ (point.rig - added.declared) ** 2)
        total = sum(float(np.vdot(r, r)) for r in residuals) + penalty
        return Evaluation(replace(point, added=tuple(extra)), total, penalty, residuals)

    def linearise(self, at: Evaluation[Point], exact: bool) -> Linearisation:
        """Return the derivatives of all segments; those of what the terms add are computed coarsely."""
        return self.linearised(at, exact, self.coarse)

    def linearised(self, at: Evaluation[Point], exact: bool, added: AddedResponse) -> Linearisation:
        """Return the derivatives of all segments; with ``exact`` what the terms add changes with the modes too.

        Unless it is slight: then that change matters neither to the steps nor to what is known in the end.
        """
        self.problem.budget.spent += LINEARISED * self.problem.samples
        point, free = at.point, len(added.free)
        exact = exact and not point.slight
        normal = np.zeros((self.size, self.size))
        tangents: list[Tangent] = []
        basis = added.coordinates.basis(point.rig)
        runs = self._runs(point, point.amplitudes, added) if self.added.nonlinear else []
        extra = point.added if added is self.added or not runs else tuple(added.extra(runs))
        changed = self._changed(point, runs, extra, added, exact)
        delayed = self._delayed(runs, extra, added) if added.has_second_impact else []
        for i, (segment, a) in enumerate(zip(point.segments, point.amplitudes, strict=True)):
            s = point.modes[segment.group]
            own = added.nuisance.columns(s, segment)
            slopes = slope_columns(s, a, segment, added.rate)
            changes = changed[i] if changed else np.zeros((*segment.y.shape, 0))
            if exact and changed:
                own, slopes = own.copy(), slopes.copy()
                modal = changes.shape[2] - free - self.moving.size
                own[:, :, :modal] += changes[:, :, free : free + modal]
                slopes[:, :, self.moving] += changes[:, :, free + modal :]
            slopes[:, :, : self.common] = slopes[:, :, : self.common] @ basis
            common = np.concatenate([slopes, changes[:, :, :free]], axis=2).reshape(segment.y.size, -1)
            if self.mass is not None:
                grown = growth(added, basis, point.rig, point.load[segment.group], point.free)
                common = without_scale(common, grown, self.mass)
            if added.has_second_impact:
                own = np.concatenate([own, delayed[i][:, :, None]], axis=2)
            kept = not (exact and changed) and not added.has_second_impact
            known = added.nuisance.basis(s, segment) if kept else None
            at_load = self.common + segment.group * self.each
            where = np.r_[: self.common, at_load : at_load + self.each, self.at_free : self.at_free + free]
            tangent = Tangent.of(where, own.reshape(segment.y.size, -1), common, known)
            normal[np.ix_(where, where)] += tangent.common.T @ tangent.common
            tangents.append(tangent)
        normal[: self.common, : self.common] += basis.T @ np.diag(added.precision) @ basis
        return Linearisation(basis, normal, tuple(tangents))

    def prior_slope(self, at: Evaluation[Point], basis: Real) -> Real:
        """Return half the negative slope of the declared constants' penalty."""
        out = np.zeros(self.size)
        out[: self.common] = -basis.T @ (self.added.precision * (at.point.rig - self.added.declared))
        return out

    def bounds(self, at: Evaluation[Point]) -> tuple[Real, Real]:
        """Return how far the terms' parameters may go in a step."""
        lowest, highest = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for k, q in enumerate(self.added.free):
            x, most = at.point.free[k], LOG_STEP if q.log else math.inf
            low, high = q.bounds
            lowest[self.at_free + k], highest[self.at_free + k] = max(low - x, -most), min(high - x, most)
        return lowest, highest

    def moved(self, at: Evaluation[Point], step: Real, own: Sequence[Real], iteration: int) -> Evaluation[Point] | None:
        """Return the evaluation after a step; None where the rig has no such modes there."""
        here = self._stepped(at.point, step, own)
        if not self._sensible(here):
            return None
        if not self.frozen:
            try:
                modes, to = self.added.modes(self.constants(here))
            except (Overdamped, np.linalg.LinAlgError):
                return None
            if not modes or not all(map(alike, at.point.modes, modes)):
                return None
            here = replace(here, modes=tuple(modes), to=tuple(to))
        if iteration > TOGETHER and self.added.coordinates.bodies and not self.added.nonlinear:
            # modes that turn into each other make a step of the amplitudes a bad guess
            return self.evaluate(self._amplitudes_first(here))
        return self.evaluate(here.timed())

    def _stepped(self, point: Point, step: Real, own: Sequence[Real]) -> Point:
        added = self.added
        rig = added.coordinates.moved(point.rig, step[: self.common])
        load = point.load + step[self.common : self.at_free].reshape(self.groups, self.each)
        free = point.free + step[self.at_free :]
        free = np.array([q.inward(q.outward(x)) for x, q in zip(free, added.free, strict=True)])
        coefficients, segments = [], []
        for segment, c, change in zip(point.segments, point.coefficients, own, strict=True):
            if added.has_second_impact:
                later = float(np.clip(change[-1], -MOST_SAMPLES, MOST_SAMPLES))
                segment, change = replace(segment, second=segment.second + later), change[:-1]
            coefficients.append(c + change)
            segments.append(segment)
        return replace(point, rig=rig, load=load, free=free, coefficients=tuple(coefficients), segments=tuple(segments))

    def _sensible(self, point: Point) -> bool:
        """Whether masses and stiffnesses are such that the rig can be solved."""
        values = np.concatenate([point.rig, point.load.ravel(), point.free])
        names = [p.name for p in self.added.rig_parameters]
        heavy = all(point.rig[names.index(m)] > 0 for m in self.added.arrangement.masses if m in names)
        return bool(np.all(np.isfinite(values)) and heavy and np.all(point.load[:, :1] > 0))

    @staticmethod
    def _delayed(runs: Sequence[Run], extra: Sequence[Real], added: AddedResponse) -> list[Real]:
        """Return for every segment (c, n) how it changes with the time of the second impact, per sample."""
        later = [(replace(s, second=s.second + SECOND_STEP), here) for s, here in runs]
        return [(a - b) / SECOND_STEP for a, b in zip(added.extra(later), extra, strict=True)]

    def _changed(
        self, point: Point, runs: Sequence[Run], extra: Sequence[Real], added: AddedResponse, exact: bool
    ) -> list[Real]:
        """Return for every segment (c, n, k) how what the terms add changes with the numbers they depend on.

        With their parameters; where slopes are exact, with the modes' coefficients and the rig's constants too.
        """
        nearby = self._nearby(point) if exact and runs else []
        steps: list[list[_Step]] = []
        for (segment, here), c in zip(runs, point.coefficients, strict=bool(runs)):
            own = self._parameter_steps(point.free, here, added)
            if exact:
                own += _amplitude_steps(segment, c, point.modes[segment.group], here)
                own += _constant_steps(nearby[segment.group], segment, c, here)
            steps.append(own)
        moved = [(segment, v) for (segment, _), own in zip(runs, steps, strict=True) for _, v in own]
        predicted = iter(added.extra(moved))
        return [
            np.stack([(next(predicted) - base) / step for step, _ in own], axis=-1)
            if own else np.zeros((*base.shape, 0))
            for base, own in zip(extra, steps, strict=bool(runs))
        ]  # fmt: skip

    def _nearby(self, point: Point) -> list[list[tuple[float, Sensitivity, Variant]]]:
        """Return for every load, and every constant that is free there, a step and the rig with that step made."""
        problem, constants = self.problem, self.constants(point)
        noise, rate = problem.experiment.noise, problem.experiment.sample_rate_hz
        found: list[list[tuple[float, Sensitivity, Variant]]] = [[] for _ in point.modes]
        at, steps = constants.stacked(), constant_steps(constants)
        for k in self.moving.tolist():
            name = list(at)[k]
            moved = at | {name: at[name] + steps[:, k]}
            rigs = linear_rigs(constants.arrangement, moved, problem.analog, noise, rate)
            for g, (s, rig) in enumerate(zip(point.modes, rigs, strict=True)):
                values = {n: float(v[g]) for n, v in moved.items()}
                to = response(constants.arrangement, values, rig, problem.analog)
                variant = Variant((), np.zeros(0, np.complex128), values, to)
                found[g].append((float(steps[g, k]), replace(s, rig=rig), variant))
        return found

    def _parameter_steps(self, free: Real, here: Variant, added: AddedResponse) -> list[_Step]:
        """Return steps of the free parameters of the terms."""
        steps = []
        for k, q in enumerate(self.added.free):
            x = free.copy()
            step = PARAMETER_STEP * (1.0 if q.log else max(abs(x[k]), PARAMETER_STEP * q.span))
            if abs(q.outward(x[k] + step) - q.outward(x[k])) < 1e-300:
                step = -step
            x[k] += step
            steps.append((step, replace(here, terms=added.with_free(x))))
        return steps


_Step = tuple[float, Variant]
"""A step of a number, and with what a segment is predicted after it."""


def _amplitude_steps(segment: Segment, c: Real, s: Sensitivity, here: Variant) -> list[_Step]:
    """Return steps of the coefficients that stand for a mode."""
    step = AMPLITUDE_STEP * float(np.abs(c[: s.coefficients]).max())
    moved = c + step * np.eye(s.coefficients, c.size)
    return [(step, replace(here, amplitudes=Nuisance.amplitudes(s, row, segment))) for row in moved]


def _constant_steps(
    nearby: Sequence[tuple[float, Sensitivity, Variant]], segment: Segment, c: Real, here: Variant
) -> list[_Step]:
    """Return steps of the rig's constants, the load's among them."""
    return [
        (step, replace(v, terms=here.terms, amplitudes=Nuisance.amplitudes(s, c, segment))) for step, s, v in nearby
    ]
