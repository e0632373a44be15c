"""The rig with any mechanisms in it: its modes at every load, and what the mechanisms add to a record."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from analysis.mismatch.baseline import Constants, Nuisance, Sensitivity, sensitivities
from analysis.mismatch.coordinates import Coordinates
from analysis.mismatch.linear import LinearRig
from analysis.mismatch.problem import Problem, Term, acted_on, law_parameters
from analysis.mismatch.records import Record
from analysis.mismatch.response import Response, response, responses, whiten
from sim_backend.arrangement import LOAD
from sim_backend.mechanisms.mechanism import Quantity
from sim_backend.modal_march import MEMORY, SLOTS, march, no_law, step_weights, waves

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

SUBSTEPS = 4
COMPETING_SUBSTEPS = 2  # while fits compete; the one that wins goes on with `SUBSTEPS`
UNMARCHED = 0.6  # effort of what a term without a force law adds, of a sample
TOGETHER = 32  # runs that are carried along in one call
BEYOND = 10  # samples that a record is continued at its ends for what a channel does to it
SPLINE = 5  # degree in which a tap's pulse is shifted by parts of a sample


@dataclass(frozen=True, slots=True)
class Variant:
    """With what a record is predicted."""

    terms: tuple[Term, ...]
    amplitudes: Complex
    values: dict[str, float]
    to: Response

    def before(self, lead_s: float) -> Variant:
        """Return the same with the modal amplitudes so much earlier."""
        return replace(self, amplitudes=self.amplitudes * np.exp(-lead_s * self.to.rig.poles))


Run = tuple[Record, Variant]
"""A record and with what it is predicted."""


class Model:
    """A problem with terms.

    Parameters
    ----------
    substeps
        Of a sample, in which extra forces are computed.
    """

    def __init__(self, problem: Problem, terms: Sequence[Term], substeps: int = SUBSTEPS):
        self.problem, self.terms, self.substeps = problem, tuple(terms), substeps
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

    def start_free(self) -> Real:
        """Values of the free parameters, as they are fitted, to begin with."""
        return np.array([inward(self.terms[i].values[q.name], q) for i, q in self.free])

    def with_free(self, free: Real) -> tuple[Term, ...]:
        """Terms with the values of the free parameters put in."""
        values = [dict(t.values) for t in self.terms]
        for (i, q), x in zip(self.free, free, strict=True):
            values[i][q.name] = outward(float(x), q)
        return tuple(replace(t, values=v) for t, v in zip(self.terms, values, strict=True))

    def modes(self, constants: Constants) -> tuple[list[Sensitivity], list[Response]]:
        """Return modes and responses at every load; no responses where the rig is linear."""
        problem = self.problem
        modes = [
            replace(s, tied=self._tied(constants.at(g), s.rig))
            for g, s in enumerate(sensitivities(constants, problem.analog, problem.recordings))
        ]
        made = [
            response(self.arrangement, constants.at(g), m.rig, problem.analog) if self.nonlinear else None
            for g, m in enumerate(modes)
        ]
        return modes, made  # type: ignore[return-value]

    def _tied(self, values: dict[str, float], rig: LinearRig) -> tuple[int, ...]:
        """Modes of bodies that are set going by the rig alone and too weak to be read record by record."""
        added = len(self.arrangement.bodies) - len(self.problem.arrangement.bodies)
        if not added or not any(t.mechanism.tied for t in self.terms):
            return ()
        size = np.abs(rig.shapes) * np.sqrt([[values[m]] for m in self.arrangement.masses])
        share = size[-added:].sum(axis=0) / size.sum(axis=0)
        return tuple(int(j) for j in np.argsort(-share)[:added])

    def extra(self, runs: Sequence[Run]) -> list[Real]:
        """Return for each run (c, n) what the terms add to the whitened record of the linear rig."""
        alike: dict[tuple[int, int], list[int]] = {}
        for i, (record, _) in enumerate(runs):
            alike.setdefault((record.y.shape[1], record.run_up), []).append(i)
        batches = [at[i : i + TOGETHER] for at in alike.values() for i in range(0, len(at), TOGETHER)]
        each = self.substeps if self.marched else UNMARCHED
        self.problem.effort.spent += each * sum(record.y.shape[1] for record, _ in runs)
        carried = self._carried([[runs[i] for i in at] for at in batches]) if self.marched else None
        found: list[Real] = [np.zeros(0)] * len(runs)
        for k, at in enumerate(batches):
            added = np.zeros((len(at), *runs[at[0]][0].y.shape)) if carried is None else carried[k]
            for out, i in zip(added, at, strict=True):
                self._struck_and_distorted(out, *runs[i])
            for i, one in zip(at, whiten(added, self.problem.recordings.noise), strict=True):
                found[i] = one
        return found

    def _carried(self, batches: Sequence[Sequence[Run]]) -> list[Real]:
        """Return for each batch (runs, c, n) what the laws' forces add, before whitening."""
        h = 1 / self.rate / self.substeps
        tasks: list[_Task] = []
        for runs in batches:
            record = runs[0][0]
            steps = (record.y.shape[1] - 1 + record.run_up) * self.substeps
            marched, used = self._march(runs, h, steps)
            tasks.append((marched, responses([v.to for _, v in runs], used, h, self.substeps), record.run_up))
        workers = min(len(os.sched_getaffinity(0)), len(tasks))
        if workers < 2:
            return [_carry(task) for task in tasks]
        with ThreadPoolExecutor(workers) as pool:  # compiled code lets go of the interpreter
            return list(pool.map(_carry, tasks))

    def _march(self, runs: Sequence[Run], h: float, steps: int) -> tuple[Callable[[], Real], list[int]]:
        """Return what computes the extra forces (runs, k, steps + 1) from the run-up on, and their k elements."""
        elements = self.arrangement.elements
        slots = [(i, e) for i, t in enumerate(self.terms) if t.mechanism.law for e in acted_on(t, self.arrangement)]
        slots.sort(key=lambda s: self.terms[s[0]].mechanism.last)
        if len(slots) > SLOTS:
            raise ValueError("more force laws than can act together")
        laws = [self.terms[i].mechanism.law for i, _ in slots] + [no_law] * (SLOTS - len(slots))
        acting = [e for _, e in slots] + [-1] * (SLOTS - len(slots))
        used = sorted({e for _, e in slots})
        place = np.array([used.index(e) if e >= 0 else -1 for e in acting])
        rows = [[law_parameters(v.terms[i], elements[e], v.values, r, h) for i, e in slots] for r, v in runs]
        p = np.zeros((len(runs), SLOTS, max(len(row) for row in rows[0])))
        for own, filled in zip(p, rows, strict=True):
            for row, numbers in zip(own, filled, strict=False):
                row[: len(numbers)] = numbers
        to = [v.to for _, v in runs]
        begun = [v.before(r.run_up / self.rate).amplitudes for r, v in runs]
        struck = [self._struck(r, v, h) for r, v in runs] if h > 0 else [(-1, 0 * v.amplitudes) for _, v in runs]
        given = (
            tuple(laws), place, p, np.stack([r.seen[used] for r in to]), np.stack([r.rate[used] for r in to]),
            np.stack([r.drive[used] for r in to]), step_weights(np.stack([r.rig.poles for r in to]), h),
            np.stack(begun), to[0].rig.weight, np.array([r.start_s - r.run_up / self.rate for r, _ in runs]), h, steps,
            np.zeros((SLOTS, MEMORY)), np.array([at for at, _ in struck]), np.stack([blow for _, blow in struck]),
        )  # fmt: skip
        return lambda: march(*given), used

    def forces(self, run: Run, samples: int) -> tuple[Real, list[int], float]:
        """Return the extra forces (k, n) along a record, their k elements and the time step.

        ``samples`` from where the record's run-up begins; a negative number goes back in time.
        """
        h = math.copysign(1 / self.rate / self.substeps, samples)
        marched, used = self._march([run], h, abs(samples) * self.substeps)
        return marched()[0], used, h

    def _struck(self, record: Record, variant: Variant, h: float) -> tuple[int, Complex]:
        """Return the step from the run-up's beginning on at which a second blow is over (-1: none), and its modes."""
        share = sum(next(iter(t.values.values())) for t in variant.terms if t.mechanism.blow)
        if not share:
            return -1, 0 * variant.amplitudes
        over = (second_over(record, self.rate) + record.run_up) / self.rate
        at = max(math.ceil(over / h), 1)
        return at, share * variant.amplitudes * np.exp(variant.to.rig.poles * (at * h - over))

    def _struck_and_distorted(self, added: Real, record: Record, variant: Variant) -> None:
        """Add (c, n) a second blow and what the sensor chain makes of the record."""
        to, amplitudes = variant.to, variant.amplitudes
        for term in variant.terms:
            if term.mechanism.blow:
                added += next(iter(term.values.values())) * struck_again(to, amplitudes, record, self.rate)
        distorted = [t for t in variant.terms if t.mechanism.distort is not None]
        if distorted:  # some look beyond the record's ends, where the modes ring as well
            begun = amplitudes * np.exp(-BEYOND / self.rate * to.rig.poles)
            clean = np.pad(added, ((0, 0), (BEYOND, BEYOND)), mode="edge")
            clean += rung(to, begun, 1 / self.rate, clean.shape[1])
            shown, inside = clean, slice(BEYOND, -BEYOND)
            for term in distorted:
                seen = self._seen(term, record, clean[:, inside])
                shown = term.mechanism.distort(shown, seen, self.rate)  # type: ignore[misc]
            added += (shown - clean)[:, inside]

    def _seen(self, term: Term, record: Record, clean: Real) -> dict[str, float]:
        """Values of a channel's distortion with the peak it is measured by."""
        own = max(float(np.abs(record.raw).max()), float(np.abs(clean).max()))
        whole = max(float(np.abs(r.raw).max()) for r in self.problem.recordings.records)
        return dict(term.values) | {"peak": whole if term.values.get("of_session") else own}


_Task = tuple[Callable[[], Real], Callable[[Real], Real], int]
"""What computes forces, what turns them into the channels' responses, and the samples of the run-up."""


def _carry(task: _Task) -> Real:
    marched, responded, run_up = task
    return responded(marched())[:, :, run_up:]


def second_over(record: Record, sample_rate_hz: float) -> float:
    """Return where in a record the second blow is over, samples."""
    return record.second + record.since_tap_s * sample_rate_hz


def struck_again(to: Response, amplitudes: Complex, record: Record, sample_rate_hz: float) -> Real:
    """Return (c, n) the response to a second blow as large as the first, m/s2 before whitening.

    While its pulse acts it is what the channels showed while the first one did; afterwards the modes ring as fitted.
    """
    n, k = record.y.shape[1], record.pulse.shape[1]
    late = second_over(record, sample_rate_hz)
    at = np.arange(n) - late
    out = np.zeros((len(to.rig.filtered), n))
    first = min(max(math.ceil(late), 0), n)  # sample from which on the modes ring
    begun = amplitudes * np.exp((first - late) / sample_rate_hz * to.rig.poles)
    out[:, first:] = rung(to, begun, 1 / sample_rate_hz, n - first)
    acts = (at < 0) & (at > -k)
    if np.any(acts):
        shown = np.concatenate([record.pulse, rung(to, amplitudes, 1 / sample_rate_hz, SPLINE)], axis=1)
        out[:, acts] = shown @ _shifted(k, float(late), n)
    return out


def rung(to: Response, amplitudes: Complex, h: float, n: int) -> Real:
    """Return (c, n) what the channels show of modes left to themselves with these amplitudes, before whitening."""
    shown: Real = (to.rig.filtered * (to.rig.weight * amplitudes) @ waves(to.rig.poles, h, n).T).real
    return shown


@lru_cache(maxsize=4)  # the variants of a record follow each other
def _shifted(k: int, late: float, n: int) -> Real:
    """Return (k + SPLINE, m) the spline through samples from -k on, at those of n samples where the pulse acts."""
    at = np.arange(n) - late
    spline = make_interp_spline(np.arange(-k, SPLINE), np.eye(k + SPLINE), k=SPLINE)
    return np.asarray(spline(at[(at < 0) & (at > -k)])).T


def inward(value: float, q: Quantity) -> float:
    """Return a parameter as it is fitted."""
    return float(np.log(value)) if q.log else float(value)


def outward(x: float, q: Quantity) -> float:
    """Return a parameter from what is fitted, within its bounds."""
    value = float(np.exp(x)) if q.log else x
    return min(max(value, q.low), q.high)
