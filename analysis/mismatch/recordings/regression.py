"""Where a full fit may begin, and how much a force law may explain: a regression along the motion recordings show.

Along a motion that is known (`shown_motion`) every force has a course of its own, and what the linear rig makes of it
is its column; free constants, offsets and states have theirs. What a law leaves is then a matter of linear least
squares and of the few numbers that bend it. The motion has noise, so that this is a start and a ranking, no estimate.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.optimize import minimize

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.recordings.shown_motion import ShownMotion, shown_motion
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real
from sim_backend.force_law import MEMORY, along
from sim_backend.learned.curves import Curve
from sim_backend.mechanisms.kinds import AtRest, ForceLaw, Quantity

SAME: Final = 1e-10  # of a column, below which what is left beside others counts as nothing
EACH: Final = 40  # evaluations for each number that bends a law


@dataclass(frozen=True, slots=True)
class Regressed:
    """Laws that fit best along the shown motion, constants and first states beside them, and the mean square left."""

    terms: tuple[Term, ...]
    constants: dict[str, float]
    states: tuple[Real, ...]
    left: float

    @property
    def term(self) -> Term:
        """The last of them."""
        return self.terms[-1]


@dataclass(frozen=True, slots=True)
class Regression:
    """Of a fit: the motion of each recording, and what constants and states do along it.

    Attributes
    ----------
    missed
        (m,) in the recordings' units: where fitting looks, and one zero for each constant that is declared.
    basis
        (m, k) orthonormal, of all columns of the rig's own; ``weights`` (k, names and states) from the projections on
        them to the changes of the constants ``names`` and of the states (all recordings', at their first samples).
    used
        Of each recording, which samples of it count.
    """

    fitted: SimulatedFit
    motions: tuple[ShownMotion, ...]
    used: tuple[Real, ...]
    names: tuple[str, ...]
    missed: Real
    basis: Real
    weights: Real
    known: dict[tuple[object, ...], Regressed | None] = field(default_factory=dict, compare=False)

    @classmethod
    def of(cls, fitted: SimulatedFit, freed: Collection[str] = ()) -> Regression | None:
        """Return it; None where the recordings are of a band, or have no motion.

        Parameters
        ----------
        freed
            Constants that count as unknown: then none is held to what was declared.
        """
        problem = fitted.problem
        if problem.banded:
            return None
        found = [shown_motion(fitted, i, problem.looked_at) for i in range(len(fitted.own))]
        motions = tuple(m for m in found if m is not None and np.all(np.isfinite(m.displacement)))
        if len(motions) < len(found):
            return None
        used = tuple(
            r.part[r.fitted][: m.missed.shape[1]] == FIT for r, m in zip(problem.recordings, motions, strict=True)
        )
        free = {p.name: p for p in fitted.simulation.parameters if p.scope == "rig"}
        each = [_of_constants(fitted, number, motion, {*free, *freed}) for number, motion in enumerate(motions)]
        names = tuple(each[0])
        own = [motion.answer.free(motion.missed.shape[1])[:, :, at] for motion, at in zip(motions, used, strict=True)]
        rows = []
        for number, columns in enumerate(each):
            shown = [columns[name][:, used[number]].ravel() for name in names]
            size = int(used[number].sum()) * len(motions[number].missed)
            common = np.stack(shown, axis=1) if shown else np.zeros((size, 0))
            states = [np.zeros((size, len(o))) for o in own]
            states[number] = own[number].reshape(len(own[number]), -1).T
            rows.append(np.hstack([common, *states]))
        missed = [m.missed[:, at].ravel() for m, at in zip(motions, used, strict=True)]
        held = [(i, fitted.values[n], free[n]) for i, n in enumerate(names) if not freed and free[n].prior]
        for i, value, p in held:
            mean, error = p.prior or (0.0, 1.0)
            rows.append(np.zeros((1, rows[0].shape[1])))
            rows[-1][0, i] = np.sqrt(problem.noise) / (error * (abs(value) if p.log else p.scale))
            missed.append(rows[-1][:, i] * (p.outward(mean) - value))
        matrix = np.concatenate(rows)
        size = np.linalg.norm(matrix, axis=0)
        size[size == 0] = 1.0
        left, values, right = np.linalg.svd(matrix / size, full_matrices=False)
        kept = values > SAME * values.max(initial=0.0)
        back = right[kept] / values[kept, None] / size
        return cls(fitted, motions, used, names, np.concatenate(missed), left[:, kept], back)

    @property
    def without(self) -> float:
        """Return the mean square that the linear rig leaves along the shown motion."""
        return self._mean(self._beside(self.missed))

    @property
    def samples(self) -> int:
        """How many count, of all channels."""
        return sum(int(at.sum()) * len(m.missed) for at, m in zip(self.used, self.motions, strict=True))

    def regressed(self, *terms: Term, bent: bool = True) -> Regressed | None:
        """Return force laws with the strengths, and unless not ``bent`` all else, that fit best together.

        None where one of them is another mechanism, or has no force along this motion.
        """
        key = _key(terms, bent)
        if key not in self.known:
            found = self._regressed(terms, bent)
            self.known[key] = found
            if found is not None:
                self.known[_key(found.terms, bent)] = found
        return self.known[key]

    def reach(self, place: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return lowest and highest deformation (m) and rate (m/s) of an element where nothing is held out."""
        each = [self._along(number, place) for number in range(len(self.motions))]
        shown = [
            np.isin(r.part[r.fitted][: m.missed.shape[1]], (FIT, CHOOSE))
            for r, m in zip(self.fitted.problem.recordings, self.motions, strict=True)
        ]
        whole = (np.concatenate([rows[i][at] for rows, at in zip(each, shown, strict=True)]) for i in (0, 1))
        low, high = ((float(rows.min()), float(rows.max())) for rows in whole)
        return low, high

    def _regressed(self, terms: Sequence[Term], bent: bool) -> Regressed | None:
        if not all(isinstance(term.mechanism, ForceLaw) for term in terms):
            return None
        best = self._solved(terms)
        numbers = [
            (i, q) for i, term in enumerate(terms) if bent for q in term.mechanism.parameters
            if q.name not in _linear(term)
        ]  # fmt: skip
        if best is None or not numbers:
            return best
        begin = np.array([_inward(q, terms[i].values[q.name]) for i, q in numbers])

        def moved(x: Real) -> Regressed | None:
            values: list[dict[str, float]] = [{} for _ in terms]
            for (i, q), one in zip(numbers, x, strict=True):
                values[i][q.name] = _outward(q, float(one))
            return self._solved([term.within(v) for term, v in zip(terms, values, strict=True)])

        def left(x: Real) -> float:
            found = moved(x)
            return found.left if found is not None else 2 * self._mean(self.missed)

        nearest = minimize(
            left, begin, method="Nelder-Mead",
            options={
                "maxfev": EACH * len(numbers), "xatol": 1e-3, "fatol": 1e-4 * best.left,
                "initial_simplex": _about(begin),
            },
        )  # fmt: skip
        return moved(nearest.x) if nearest.fun < best.left else best

    def _solved(self, terms: Sequence[Term]) -> Regressed | None:
        """Return laws with the best values of what their forces are in proportion to, all else as it is."""
        units: list[tuple[int, str, float]] = []
        held: list[float] = []  # how far from zero each may well be
        columns, fixed = [], np.zeros(self.missed.size)
        for i, term in enumerate(terms):
            names = _linear(term)
            none = dict.fromkeys(names, 0.0)
            spread = term.mechanism.spread(term.values) if isinstance(term.mechanism, Curve) else {}
            for name in names:
                held.append(spread.get(name, math.inf))
                units.append((i, name, 1.0 if len(names) > 1 else term.values[name] or 1.0))
                columns.append(self._column(term.moved({**none, name: units[-1][2]})))
            if not names:
                fixed += self._column(term)
        matrix = np.stack(columns, axis=1) if columns else np.zeros((self.missed.size, 0))
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(fixed))):
            return None
        beside = self._beside(matrix)
        size = np.linalg.norm(beside, axis=0)
        told = size > SAME * np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        solved = np.zeros(size.size)
        if np.any(told):
            missed = self._beside(self.missed - fixed)
            prior = np.diag(math.sqrt(self.fitted.problem.noise) / np.array(held))[told][:, told]
            matrices = np.concatenate([beside[:, told], prior]) / size[told]
            target = np.concatenate([missed, np.zeros(len(prior))])
            solved[told] = np.linalg.lstsq(matrices, target, rcond=SAME)[0] / size[told]
        found = list(terms)
        for (i, name, unit), factor in zip(units, solved, strict=True):
            found[i] = found[i].within({name: float(factor) * unit})
        given = np.array([found[i].values[name] / unit for i, name, unit in units])
        off = self.missed - fixed - matrix @ given
        constants, states = self._moved(self.weights.T @ (self.basis.T @ off))
        return Regressed(tuple(found), constants, states, self._mean(self._beside(off)))

    def _moved(self, changes: Real) -> tuple[dict[str, float], tuple[Real, ...]]:
        """Return constants and each recording's first state (2n,) of the rig's own bodies, moved by their changes."""
        constants = dict(self.fitted.values)
        for name, change in zip(self.names, changes, strict=False):
            constants[name] = _within(self.fitted, name, constants[name] + float(change))
        n, whole = len(self.fitted.problem.arrangement.bodies), self.fitted.simulation.n
        each = changes[len(self.names) :].reshape(len(self.motions), 2, whole)[:, :, :n]
        return constants, tuple(self.fitted.state(i) + rows.ravel() for i, rows in enumerate(each))

    def _beside(self, rows: Real) -> Real:
        """Return what is left of rows (m, ...) beside all that the rig does by itself."""
        return np.asarray(rows - self.basis @ (self.basis.T @ rows), np.float64)

    def _mean(self, rows: Real) -> float:
        """Return the mean square, per sample that counts."""
        return float(np.vdot(rows, rows)) / self.samples

    def _along(self, number: int, place: int) -> tuple[Real, Real]:
        """Return (n,) deformation and rate of an element along a recording."""
        rig, motion = self.fitted.simulation.arrangement, self.motions[number]
        row = rig.vector(rig.elements[place].row, self.fitted.values)
        return motion.displacement @ row, motion.velocity @ row

    def _column(self, term: Term) -> Real:
        """Return (m,) what the linear rig makes of a law's force along the shown motion."""
        law, rig, values = term.mechanism, self.fitted.simulation.arrangement, self.fitted.values
        assert isinstance(law, ForceLaw)  # noqa: S101
        found = []
        for number, (motion, at) in enumerate(zip(self.motions, self.used, strict=True)):
            recorded = self.fitted.problem.recordings[number]
            shown = np.zeros(motion.missed.shape)
            for place in term.place:
                element = rig.elements[place]
                rest = AtRest.of(element, values, self.fitted.problem.rig.preload_n)
                p = law.packed(term.values, rest, 1 / recorded.rate_hz)
                d, v = self._along(number, place)
                force = along(law.law, p[None], d, v, recorded.fitted.start / recorded.rate_hz, p[3], np.zeros(MEMORY))
                shown += motion.answer.to(-force, rig.vector(element.row, values))[0]
            found.append(shown[:, at].ravel())
        column = np.concatenate(found)
        return np.concatenate([column, np.zeros(self.missed.size - column.size)])


def regression_of(fitted: SimulatedFit) -> Regression | None:
    """Return the regression along the motion that a fit's recordings show, computed once; None where there is none."""
    if not fitted.along:
        fitted.along.append(Regression.of(fitted))
    found: Regression | None = fitted.along[0]
    return found


def _of_constants(fitted: SimulatedFit, number: int, motion: ShownMotion, free: Collection[str]) -> dict[str, Real]:
    """Return (channels, n) what channels show of a unit more of each constant that is free, along a shown motion."""
    simulation, values = fitted.simulation, fitted.values
    rig, recorded = simulation.arrangement, fitted.problem.recordings[number]
    mass = rig.matrices(values)[0]
    forces: dict[str, list[tuple[Real, Real]]] = {}
    for element in rig.elements:
        row = rig.vector(element.row, values)
        forces.setdefault(str(element.stiffness), []).append((-(motion.displacement @ row), row))
        forces.setdefault(str(element.damping), []).append((-(motion.velocity @ row), row))
    at, count = recorded.fitted, motion.missed.shape[1]
    inertia = motion.acceleration.copy()
    for i, (drive, vector) in enumerate(zip(simulation.rig.drives, simulation.vectors(values, mass).T, strict=True)):
        u = recorded.inputs[i, at][:count] + values[drive.offset]
        forces.setdefault(drive.gain, []).append((u / values[drive.gain], vector))
        forces.setdefault(drive.offset, []).append((np.ones(count), vector))
        if drive.base:
            inertia -= np.outer(u, vector / mass)
    for i, name in enumerate(rig.masses):
        forces.setdefault(name, []).append((-inertia[:, i], np.eye(len(mass))[i]))
    found = {
        name: np.asarray(sum(motion.answer.to(force[None], row)[0] for force, row in those))
        for name, those in forces.items() if name in free
    }  # fmt: skip
    for c, seen in enumerate(simulation.rig.seen):
        shown = np.zeros_like(motion.missed)
        if seen.offset in free:
            shown[c] = 1 / recorded.unit[c]
            found[seen.offset] = shown.copy()
        if seen.gain in free:
            shown[c] = (recorded.outputs[c, at][:count] - values[seen.offset]) / values[seen.gain] / recorded.unit[c]
            found[seen.gain] = shown
    return found


def _key(terms: Sequence[Term], bent: bool) -> tuple[object, ...]:
    return bent, *((term.key, tuple(sorted(term.values.items()))) for term in terms)


def _linear(term: Term) -> tuple[str, ...]:
    """Return the parameters that a law's force is in proportion to."""
    law = term.mechanism
    if isinstance(law, Curve):
        return law.weights
    return () if law.strength is None else (law.strength,)


def _about(begin: Real) -> Real:
    """Return (k + 1, k) the points that a search begins with."""
    return np.vstack([begin, begin + 0.3 * np.eye(begin.size)])


def _inward(q: Quantity, value: float) -> float:
    return float(np.log(max(value, 1e-300))) if q.log else value


def _outward(q: Quantity, value: float) -> float:
    return float(np.exp(min(value, 300.0))) if q.log else value


def _within(fitted: SimulatedFit, name: str, value: float) -> float:
    """Return a constant's value, or the one that it had where the new one is none that it may have."""
    p = next((p for p in fitted.simulation.parameters if p.name == name), None)
    if p is None or (p.log and value <= 0):
        return fitted.values[name]
    return max(value, p.low)


def of_elements(rig: Arrangement) -> list[str]:
    """Return the stiffnesses and dampings of a rig, each once."""
    return list(dict.fromkeys(n for e in rig.elements for n in (e.stiffness, e.damping) if n))
