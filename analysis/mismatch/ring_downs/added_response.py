"""The rig with any mechanisms in it: its modes at every load, and what the mechanisms add to a segment."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import make_interp_spline

from analysis.mismatch.parameters import FreeParameter, Term, with_values
from analysis.mismatch.problem import Constants
from analysis.mismatch.ring_downs.coordinates import Coordinates
from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.linear import LinearRig
from analysis.mismatch.ring_downs.modes import Sensitivity, sensitivities
from analysis.mismatch.ring_downs.response import Response, response, responses, whiten
from sim_backend.acting import extended, laws_in
from sim_backend.arrangement import LOAD
from sim_backend.arrays import Complex, Real
from sim_backend.mechanisms.kinds import AddedBody, AtRest, ChannelDistortion, ForceLaw, SecondImpact
from sim_backend.modal_response import waves
from sim_backend.propagate import Clock, Impact, Motion, Rigs, laws_of, propagate

if TYPE_CHECKING:
    from analysis.mismatch.ring_downs.problem import RingDowns


WITHOUT_LAWS = 0.6  # work of what a term without a force law adds, of a sample
TOGETHER = 32  # runs that are carried along in one call
BEYOND = 10  # samples that a segment is continued at its ends for what a channel does to it
SMOOTH = 0.02  # of the speed of an element after an impact, within which a jump is rounded off for its slopes
SPEED_S = np.arange(64) / 2.5e4  # when that speed is read, s
ONE_PULSE = 0.05  # relative distance of two modes within which a tap's pulse has one spectrum: of 0.3 ms at 5 kHz
SPLINE = 5  # degree in which a tap's pulse is shifted by parts of a sample


@dataclass(frozen=True, slots=True)
class Variant:
    """With what a segment is predicted."""

    terms: tuple[Term, ...]
    amplitudes: Complex
    values: dict[str, float]
    to: Response

    def before(self, lead_s: float) -> Variant:
        """Return the same with the modal amplitudes so much earlier."""
        return replace(self, amplitudes=self.amplitudes * np.exp(-lead_s * self.to.rig.poles))


Run = tuple[Segment, Variant]
"""A segment and with what it is predicted."""


class AddedResponse:
    """What terms add to the ring-downs of a rig, and the rig with the bodies that they add.

    Parameters
    ----------
    substeps
        Of a sample, in which extra forces are computed.
    """

    def __init__(self, problem: RingDowns, terms: Sequence[Term], substeps: int):
        self.problem, self.terms, self.substeps = problem, tuple(terms), substeps
        self.arrangement = arrangement = extended(problem.arrangement, terms)
        self.nuisance = problem.nuisance(terms)
        self.rate = problem.experiment.sample_rate_hz
        self.rig_parameters = [p for p in arrangement.parameters if p.scope != LOAD]
        self.declared = np.array([p.value for p in self.rig_parameters])
        self.precision = np.array([1 / p.uncertainty**2 for p in self.rig_parameters])
        names = [p.name for p in self.rig_parameters]
        positive = np.array([p.positive for p in self.rig_parameters], bool)
        self.coordinates = Coordinates(names, positive, terms, arrangement)
        self.free = [
            FreeParameter.of(q, i, t.values[q.name])
            for i, t in enumerate(terms)
            if t.nonlinear
            for q in t.mechanism.parameters
        ]
        self.propagated = any(isinstance(t.mechanism, ForceLaw) for t in terms)
        self.nonlinear = any(t.nonlinear for t in terms)
        self.peak = max((float(np.abs(r.raw).max()) for r in problem.experiment.segments), default=0.0)
        self.has_second_impact = any(isinstance(t.mechanism, SecondImpact) for t in terms)

    def start_free(self) -> Real:
        """Values of the free parameters, as they are fitted, to begin with."""
        return np.array([q.inward(self.terms[q.owner].values[q.name]) for q in self.free])

    def with_free(self, free: Real) -> tuple[Term, ...]:
        """Terms with the values of the free parameters put in."""
        return with_values(self.terms, self.free, free)

    def modes(self, constants: Constants) -> tuple[list[Sensitivity], list[Response]]:
        """Return modes and responses at every load; no responses where the rig is linear."""
        problem = self.problem
        modes = [
            self._locked(constants.at(g), s)
            for g, s in enumerate(sensitivities(constants, problem.analog, problem.experiment))
        ]
        made = [
            response(self.arrangement, constants.at(g), m.rig, problem.analog) if self.nonlinear else None
            for g, m in enumerate(modes)
        ]
        return modes, made  # type: ignore[return-value]

    def _locked(self, values: dict[str, float], s: Sensitivity) -> Sensitivity:
        """Return the modes with those phase-locked whose amplitudes are not read segment by segment.

        Bodies that the rig alone sets going are too weak for that, and ring with its lowest mode. Bodies of one
        mechanism that ring at nearly one frequency cannot be told apart in a segment: one pulse set them going, and its
        spectrum there, which is not known, is the same for all of them.
        """
        added = len(self.arrangement.bodies) - len(self.problem.arrangement.bodies)
        if not added:
            return s
        size = np.abs(s.rig.shapes) * np.sqrt([[values[m]] for m in self.arrangement.masses])
        share = size[-added:] / size.sum(axis=0)
        if any(t.phase_locked for t in self.terms):
            locked = tuple(int(j) for j in np.argsort(-share.sum(axis=0))[:added])
            found = replace(s, phase_locked=locked)
            return replace(found, rings_with=(found.reference,) * added)
        pairs = [pair for bodies in self._bodies_together(added) for pair in _of_one_pulse(s.rig, share, bodies)]
        return replace(s, phase_locked=tuple(j for j, _ in pairs), rings_with=tuple(j for _, j in pairs))

    def _bodies_together(self, added: int) -> list[list[int]]:
        """Return which of the added bodies are of one term, where it has several and does not ring as it will."""
        found, at, rig = [], 0, self.problem.arrangement
        for term in self.terms:
            if isinstance(term.mechanism, AddedBody):
                own = len(term.mechanism.extend(rig, term.values, term.place).bodies) - len(rig.bodies)
                if own > 1 and not term.freed:
                    found.append(list(range(at, at + own)))
                at += own
        return found if at == added else []

    def extra(self, runs: Sequence[Run]) -> list[Real]:
        """Return for each run (c, n) what the terms add to the whitened segment of the linear rig."""
        alike: dict[tuple[int, int], list[int]] = {}
        for i, (segment, _) in enumerate(runs):
            alike.setdefault((segment.y.shape[1], segment.run_up), []).append(i)
        batches = [at[i : i + TOGETHER] for at in alike.values() for i in range(0, len(at), TOGETHER)]
        each = self.substeps if self.propagated else WITHOUT_LAWS
        self.problem.budget.spent += each * sum(segment.y.shape[1] for segment, _ in runs)
        carried = self._carried([[runs[i] for i in at] for at in batches]) if self.propagated else None
        found: list[Real] = [np.zeros(0)] * len(runs)
        for k, at in enumerate(batches):
            added = np.zeros((len(at), *runs[at[0]][0].y.shape)) if carried is None else carried[k]
            for out, i in zip(added, at, strict=True):
                self._hit_again_and_distorted(out, *runs[i])
            for i, one in zip(at, whiten(added, self.problem.experiment.noise), strict=True):
                found[i] = one
        return found

    def _carried(self, batches: Sequence[Sequence[Run]]) -> list[Real]:
        """Return for each batch (runs, c, n) what the laws' forces add, before whitening."""
        h = 1 / self.rate / self.substeps
        tasks: list[_Task] = []
        for runs in batches:
            segment = runs[0][0]
            steps = (segment.y.shape[1] - 1 + segment.run_up) * self.substeps
            propagated, used = self._propagation(runs, h, steps)
            tasks.append((propagated, responses([v.to for _, v in runs], used, h, self.substeps), segment.run_up))
        workers = min(len(os.sched_getaffinity(0)), len(tasks))
        if workers < 2:
            return [_carry(task) for task in tasks]
        with ThreadPoolExecutor(workers) as pool:  # compiled code lets go of the interpreter
            return list(pool.map(_carry, tasks))

    def _propagation(self, runs: Sequence[Run], h: float, steps: int) -> tuple[Callable[[], Motion], list[int]]:
        """Return what computes the extra forces of k elements from the run-up on, and these elements."""
        arrangement = self.arrangement
        slots = laws_in(self.terms)
        used = sorted({e for *_, e in slots})
        elements = arrangement.elements

        def packed(segment: Segment, v: Variant) -> list[Real]:
            rest = {e: AtRest.of(elements[e], v.values, segment.preload_n) for e in used}
            return [m.packed(v.terms[i].values, rest[e], h) for i, m, e in slots]

        acting = [(m.law, used.index(e)) for _, m, e in slots]
        laws = laws_of(acting, [packed(*run) for run in runs], [m.jumps for _, m, _ in slots])
        values = {name: np.array([v.values[name] for _, v in runs]) for name in runs[0][1].values}
        mass, damping, stiffness = arrangement.matrices(values)
        rows = np.stack([arrangement.vector(elements[e].row, values) for e in used], axis=1)
        rigs = Rigs(mass, damping, stiffness, rows, np.zeros((*mass.shape, 0)))
        initial = [v.before(r.run_up / self.rate) for r, v in runs]
        start = np.stack([state_of(v.to.rig, v.amplitudes) for v in initial])
        clock = Clock(np.array([r.start_s - r.run_up / self.rate for r, _ in runs]), h, steps, 0)
        again = [self._second(r, v, h) if h > 0 else (-1, 0 * v.amplitudes) for r, v in runs]
        jumps = np.stack([state_of(v.to.rig, jump) for (_, jump), (_, v) in zip(again, runs, strict=True)])
        impact = Impact(np.array([at for at, _ in again]), jumps)
        return lambda: propagate(rigs, laws, start, clock, impact=impact), used

    def forces(self, run: Run, samples: int) -> tuple[Motion, list[int], float]:
        """Return the extra forces along a segment, their k elements and the time step.

        ``samples`` from where the segment's run-up begins; a negative number goes back in time.
        """
        h = math.copysign(1 / self.rate / self.substeps, samples)
        propagated, used = self._propagation([run], h, abs(samples) * self.substeps)
        return propagated(), used, h

    def _second(self, segment: Segment, variant: Variant, h: float) -> tuple[int, Complex]:
        """Return the step from the run-up's beginning on at which a second impact is over (-1: none), and its modes."""
        share = sum(t.values[t.mechanism.parameters[0].name] for t in variant.terms if _is_double_hit(t))
        if not share:
            return -1, 0 * variant.amplitudes
        over = (second_over(segment, self.rate) + segment.run_up) / self.rate
        at = max(math.ceil(over / h), 1)
        return at, share * variant.amplitudes * np.exp(variant.to.rig.poles * (at * h - over))

    def _hit_again_and_distorted(self, added: Real, segment: Segment, variant: Variant) -> None:
        """Add (c, n) a second impact and what the sensor chain makes of the segment."""
        to, amplitudes = variant.to, variant.amplitudes
        for term in variant.terms:
            if _is_double_hit(term):
                share = term.values[term.mechanism.parameters[0].name]
                added += share * second_impact(to, amplitudes, segment, self.rate)
        distorted = [(t, t.mechanism) for t in variant.terms if isinstance(t.mechanism, ChannelDistortion)]
        if distorted:  # some look beyond the segment's ends, where the modes ring as well
            initial = amplitudes * np.exp(-BEYOND / self.rate * to.rig.poles)
            clean = np.pad(added, ((0, 0), (BEYOND, BEYOND)), mode="edge")
            clean += rung(to, initial, 1 / self.rate, clean.shape[1])
            shown, inside = clean.copy(), slice(BEYOND, -BEYOND)
            for term, mechanism in distorted:
                values, rows = self._with_peak(term, segment, clean[:, inside]), list(term.place)
                shown[rows] = mechanism.distort(shown[rows], values, self.rate)
            added += (shown - clean)[:, inside]

    def _with_peak(self, term: Term, segment: Segment, clean: Real) -> dict[str, float]:
        """Values of a channel's distortion with the peak it is measured by."""
        if term.values.get("of_session"):
            return dict(term.values) | {"peak": self.peak}
        return dict(term.values) | {"peak": max(float(np.abs(segment.raw).max()), float(np.abs(clean).max()))}


def smooth(added: AddedResponse, substeps: int, runs: Sequence[Run]) -> AddedResponse:
    """Return the same in the steps in which slopes are taken: jumps rounded off to `SMOOTH` of the speed.

    The difference of two motions whose forces jump at slightly other times is noise where these times are not exact,
    and noise would count as information on what was moved.
    """
    terms = [_rounded(t, runs) for t in added.terms]
    same = substeps == added.substeps and all(a is b for a, b in zip(terms, added.terms, strict=True))
    return added if same else AddedResponse(added.problem, terms, substeps)


def _rounded(term: Term, runs: Sequence[Run]) -> Term:
    name = term.mechanism.rounding if isinstance(term.mechanism, ForceLaw) else ""
    if not name or not runs:
        return term
    speeds = [float(np.abs(v.to.motion(v.amplitudes, term.place[0], SPEED_S)[1]).max()) for _, v in runs]
    return term.moved({name: max(term.values[name], SMOOTH * float(np.median(speeds)))})


def _is_double_hit(term: Term) -> bool:
    return isinstance(term.mechanism, SecondImpact)


_Task = tuple[Callable[[], Motion], Callable[[Real, Real], Real], int]
"""What computes forces, what turns them into the channels' responses, and the samples of the run-up."""


def _carry(task: _Task) -> Real:
    propagated, responded, run_up = task
    motion = propagated()
    return responded(motion.forces, motion.bends)[:, :, run_up:]


def state_of(rig: LinearRig, amplitudes: Complex) -> Real:
    """Return (2 n,) displacements (m) and velocities (m/s) of modes with these amplitudes."""
    own = rig.weight * amplitudes
    return np.concatenate([(rig.shapes @ own).real, (rig.shapes @ (rig.poles * own)).real])


def second_over(segment: Segment, sample_rate_hz: float) -> float:
    """Return where in a segment the second impact is over, samples."""
    return segment.second + segment.since_tap_s * sample_rate_hz


def second_impact(to: Response, amplitudes: Complex, segment: Segment, sample_rate_hz: float) -> Real:
    """Return (c, n) the response to a second impact as large as the first, m/s2 before whitening.

    While its pulse acts it is what the channels showed while the first one did; afterwards the modes ring as fitted.
    """
    n, k = segment.y.shape[1], segment.pulse.shape[1]
    late = second_over(segment, sample_rate_hz)
    at = np.arange(n) - late
    out = np.zeros((len(to.rig.filtered), n))
    first = min(max(math.ceil(late), 0), n)  # sample from which on the modes ring
    initial = amplitudes * np.exp((first - late) / sample_rate_hz * to.rig.poles)
    out[:, first:] = rung(to, initial, 1 / sample_rate_hz, n - first)
    acts = (at < 0) & (at > -k)
    if np.any(acts):
        shown = np.concatenate([segment.pulse, rung(to, amplitudes, 1 / sample_rate_hz, SPLINE)], axis=1)
        out[:, acts] = shown @ _shifted(k, float(late), n)
    return out


def rung(to: Response, amplitudes: Complex, h: float, n: int) -> Real:
    """Return (c, n) what the channels show of modes left to themselves with these amplitudes, before whitening."""
    shown: Real = (to.rig.filtered * (to.rig.weight * amplitudes) @ waves(to.rig.poles, h, n).T).real
    return shown


@lru_cache(maxsize=4)  # the variants of a segment follow each other
def _shifted(k: int, late: float, n: int) -> Real:
    """Return (k + SPLINE, m) the spline through samples from -k on, at those of n samples where the pulse acts."""
    at = np.arange(n) - late
    spline = make_interp_spline(np.arange(-k, SPLINE), np.eye(k + SPLINE), k=SPLINE)
    return np.asarray(spline(at[(at < 0) & (at > -k)])).T


def _of_one_pulse(rig: LinearRig, share: Real, bodies: Sequence[int]) -> list[tuple[int, int]]:
    """Return modes of these added bodies, each with the one that it rings with: of those near it the most driven one.

    ``share`` (added bodies, modes) is the part that each has in each mode.
    """
    own = np.argsort(-share[list(bodies)].sum(axis=0))[: len(bodies)]
    oscillating = [int(j) for j in own if rig.weight[j] == 2.0]
    first = max(oscillating, key=lambda j: abs(rig.drive[j]), default=None)
    if first is None:
        return []
    at = rig.poles[first].imag
    return [(j, first) for j in sorted(oscillating) if j != first and abs(rig.poles[j].imag - at) < ONE_PULSE * at]
