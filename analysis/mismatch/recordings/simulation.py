"""A described rig simulated along a recording, with any mechanisms in it, as a function of its free parameters."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import repeat
from typing import Final

import numpy as np
from scipy import signal

from analysis.mismatch.parameters import FreeParameter, Term, lines_of, with_values
from analysis.mismatch.recordings.channels import distort, memories, remembered, rows_of, shown_by, told_by
from analysis.mismatch.recordings.free_parameters import free_parameters
from analysis.mismatch.recordings.inputs import at_half_substeps, peaks_of
from analysis.mismatch.recordings.motion import Begun, Motion, Own, Place, Read, computed, with_impulse
from analysis.mismatch.recordings.recorded import Recorded, level
from analysis.mismatch.recordings.spread_impact import spread_of_impact
from analysis.mismatch.recordings.untold import SINGULAR, untold_offsets
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.acting import extended, laws_in, shaken
from sim_backend.arrangement import DERIVATIVES, Row
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AtRest, ChannelDistortion, ForceLaw, SecondImpact
from sim_backend.propagate import Clock, Division, Given, Rigs

Values = Mapping[str, float]

PER_PERIOD: Final = 56  # substeps in a period of the rig's highest mode, at least
FEWEST_SUBSTEPS, WITH_JUMPS = 3, 6  # the latter where dry friction turns at once, however slow the rig
MOST_SUBSTEPS: Final = 8
TOGETHER: Final = 200_000  # steps of motions that are computed together: some 10 MB
SHORTEST_FILTERED: Final = 60  # samples that a band's filter can be run over


class Simulation:
    """Recordings of one rig, simulated with terms.

    Parameters
    ----------
    constants
        Values of all the rig's constants, for scales and where they are not free.
    highest_hz
        Highest mode, which sets the substeps.
    like
        Another one of the same recordings: their inputs between samples serve again.
    """

    def __init__(
        self,
        rig: DescribedRig,
        recordings: Sequence[Recorded],
        constants: Values,
        highest_hz: float,
        terms: Sequence[Term] = (),
        like: Simulation | None = None,
    ):
        self.rig, self.recordings, self.terms = rig, tuple(recordings), tuple(terms)
        self.highest_hz = highest_hz
        self.arrangement = extended(rig.arrangement, terms)
        self.n = len(self.arrangement.bodies)
        self._shaken = shaken(rig.arrangement, terms)
        own = rig.arrangement.declared()  # those of added bodies are as the terms say
        self.constants = self.arrangement.declared() | {name: constants.get(name, v) for name, v in own.items()}
        self.lines, self.memories = lines_of(terms), memories(terms, any(r.free for r in recordings))
        self.struck = next((t.place[0] for t in terms if isinstance(t.mechanism, SecondImpact)), None)
        self.substeps = [self._substeps(r) for r in self.recordings]
        mass = self.arrangement.matrices(self.constants)[0]
        pushed = self.vectors(self.constants, mass).T
        self.untold = untold_offsets(rig, self.arrangement, self.constants, self.terms, list(pushed))
        self.parameters = tuple(free_parameters(self))
        kept = like.between if like is not None and (like.rig.hold, like.substeps) == (rig.hold, self.substeps) else ()
        # of each recording its inputs, and these at half substeps
        self.between: tuple[tuple[Real, Real], ...] = tuple(
            kept[i] if kept and kept[i][0] is r.inputs else (r.inputs, at_half_substeps(r.inputs, sub, rig.hold))
            for i, (r, sub) in enumerate(zip(self.recordings, self.substeps, strict=True))
        )
        self.divided: dict[int, tuple[slice, Division]] = {}
        self.rough: bool = like.rough if like else False  # for what a score test tries; see `roughly`
        kinds = [[(t.mechanism, t.place) for t in some] for some in (terms, () if like is None else like.terms)]
        self.steps: dict[int, Real] = dict(like.steps) if like and kinds[0] == kinds[1] else {}  # of differences

    @property
    def jumps(self) -> bool:
        """Whether a force at work jumps."""
        return any(isinstance(t.mechanism, ForceLaw) and t.mechanism.jumps for t in self.terms)

    def _substeps(self, recorded: Recorded) -> int:
        """Return the steps between two samples: one where the step is exact, of a linear rig under straight lines."""
        straight = recorded.free or self.rig.hold != "band-limited"
        if straight and self.struck is None and not laws_in(self.terms):
            return 1
        steps = math.ceil(PER_PERIOD * self.highest_hz / recorded.rate_hz)
        return min(max(steps, WITH_JUMPS if self.jumps else FEWEST_SUBSTEPS), MOST_SUBSTEPS)

    def with_terms(self, terms: Sequence[Term], constants: Values) -> Simulation:
        """Return a simulation of the same recordings with other mechanisms and starting values."""
        return Simulation(self.rig, self.recordings, constants, self.highest_hz, terms, self)

    def with_inputs(self, number: int, inputs: Real) -> Simulation:
        """Return a simulation with other inputs (inputs, n) of one recording; this one where they are the same."""
        if np.array_equal(inputs, self.recordings[number].inputs):
            return self
        found, recorded = copy.copy(self), replace(self.recordings[number], inputs=inputs)
        found.recordings = (*self.recordings[:number], recorded, *self.recordings[number + 1 :])
        moved = inputs, at_half_substeps(inputs, self.substeps[number], self.rig.hold)
        found.between = (*self.between[:number], moved, *self.between[number + 1 :])
        return found

    def own_scale(self, number: int, own: Own) -> Real:
        """Return (own.size,) how large displacements and speeds are, and one for each number of the tones."""
        recorded, seen = self.recordings[number], self.rig.seen[0]
        order = DERIVATIVES[seen.sensor.quantity]
        gain = abs(self.constants[seen.gain]) or 1.0
        reach = float(np.std(recorded.outputs[0])) / gain / (2 * math.pi * self.highest_hz) ** order
        size = max(float(np.abs(own.state[: self.n]).max()), reach, 1e-300)
        speed = max(float(np.abs(own.state[self.n :]).max()), size * 2 * math.pi * self.highest_hz)
        impact = [1 / (2 * math.pi * self.highest_hz), speed][: own.impact.size]
        force = float(np.mean(self.arrangement.matrices(self.constants)[0])) * speed * 2 * math.pi * self.highest_hz
        laws = [isinstance(self.terms[i].mechanism, ForceLaw) for i, _ in self.memories]
        memory = [force if law else level(recorded)[at] for law, (_, at) in zip(laws, self.memories, strict=True)]
        return np.concatenate([np.repeat([size, speed], self.n), np.ones(own.tones.size), impact, memory])

    def own(self, state: Real) -> Own:
        """Return what is a recording's own, for a state of the rig without the terms' bodies."""
        n, full = len(self.rig.arrangement.bodies) if state.size < 2 * self.n else self.n, np.zeros(2 * self.n)
        full[:n], full[self.n : self.n + n] = state[:n], state[n:]
        tones = np.zeros((len(self.rig.seen), 2 * len(self.lines)))
        return Own(full, tones, memory=np.zeros(len(self.memories)))

    def begin(self, last: Term | None = None) -> Real:
        """Return the starting point of a fit; ``last``: with other values of the last term's parameters."""
        values = {(i, name): v for i, t in enumerate(self.terms) for name, v in t.values.items()}
        moved = {} if last is None else {(len(self.terms) - 1, name): v for name, v in last.values.items()}

        def value(p: FreeParameter) -> float:
            key = (p.owner, p.name)
            if p.scope == "mechanism" and key in moved:
                return moved[key]
            return self.constants[p.name] if p.name in self.constants else values[key]

        return np.array([p.inward(value(p)) for p in self.parameters])

    def read(self, x: Real) -> tuple[dict[str, float], tuple[Term, ...]]:
        """Return constants and terms that the fit's numbers mean."""
        moved = zip(self.parameters, x.tolist(), strict=True)
        constants = {p.name: p.outward(value) for p, value in moved if p.name in self.constants}
        return self.constants | constants, with_values(self.terms, self.parameters, x)

    def run(
        self, x: Real, own: Own, number: int, whole: bool = False, samples: int | None = None
    ) -> tuple[Real, slice]:
        """Return what the channels (c, n) show along a recording, and of which of its samples.

        Parameters
        ----------
        whole
            From its first sample to its last, at rest under the mean input where the fit did not begin there; else
            what is fitted.
        samples
            So many only, or beyond what is fitted.
        """
        shown, at = self.runs([(x, own)], number, whole, samples)
        return shown[0], at

    def runs(
        self, places: Sequence[Place], number: int, whole: bool = False, samples: int | None = None
    ) -> tuple[Real, slice]:
        """Return (places, c, n) what `run` does, for several places at once."""
        at = self.span(number, whole, samples)
        many = max(TOGETHER // max((at.stop - at.start) * self.substeps[number], 1), 1)
        some = [places[first : first + many] for first in range(0, len(places), many)]
        none = np.zeros((0, len(self.rig.seen), at.stop - at.start))
        return np.concatenate([none, *(self._shown(few, number, at, whole) for few in some)]), at

    def _shown(self, places: Sequence[Place], number: int, at: slice, whole: bool) -> Real:
        """Return (places, c, n) what the channels show of motions."""
        recorded, first, last = self.recordings[number], at.start, at.stop
        out = np.full((len(places), len(self.rig.seen), last - first), np.nan)
        read = Read.of(self, places, recorded.rate_hz)
        if not read.runs.size:
            return out
        moved = self.motions(read, number, at, whole)
        distorted = any(isinstance(t.mechanism, ChannelDistortion) for t in self.terms)
        if recorded.free and distorted:  # some remember
            shown = np.empty((read.runs.size, *out.shape[1:]))
            for i, one in enumerate(read.one_by_one):
                earlier = moved[i].begun_earlier(*self.arrangement.matrices(one), recorded.rate_hz)
                rows = shown_by(self.rig.seen, self.arrangement, one, earlier)
                distort(rows, read.terms[i], recorded, self.recordings, at)
                shown[i] = rows[:, rows.shape[1] - (last - first) :]
        else:
            shown = shown_by(self.rig.seen, self.arrangement, read.constants, moved)
            for rows, terms in zip(shown, read.terms if distorted else (), strict=False):
                distort(rows, terms, recorded, self.recordings, at)
        for i, rows in enumerate(shown):
            own = read.own[i]
            if first == recorded.fitted.start and own.memory.size:
                seconds = np.arange(last - first) / recorded.rate_hz
                for channel, row in remembered(read.terms[i], self.memories, own.memory, seconds).items():
                    rows[channel] += row
            if self.lines:
                rows += own.tones @ self.waves(number, at)
            if self.struck is not None and own.impact.size and recorded.every > 1:
                begun = own.impact[0], own.impact[1] * np.eye(2 * self.n)[self.n + self.struck]
                rows += spread_of_impact(self.rig.seen, self.arrangement, read.one_by_one[i], begun, recorded, at)
            if recorded.band is not None and np.all(np.isfinite(rows)) and last - first > SHORTEST_FILTERED:
                rows[:] = signal.sosfiltfilt(recorded.band, rows, axis=1)
        out[read.runs] = shown
        return out

    def span(self, number: int, whole: bool, samples: int | None) -> slice:
        """Return the samples of a recording that are simulated."""
        recorded = self.recordings[number]
        first = 0 if whole else recorded.fitted.start
        last = recorded.samples if whole else recorded.fitted.stop
        return slice(first, last if samples is None else min(recorded.samples, first + samples))

    def waves(self, number: int, at: slice, lines: Sequence[float] | None = None) -> Real:
        """Return (2 lines, n) cosines and sines of the tones at some samples of a recording."""
        t = np.arange(at.start, at.stop) / self.recordings[number].rate_hz
        phase = 2 * np.pi * np.outer(self.lines if lines is None else lines, t)
        return np.stack([np.cos(phase), np.sin(phase)], axis=1).reshape(-1, t.size)

    def deformations(self, x: Real, own: Own, number: int) -> tuple[Real, Real]:
        """Return (elements, n) deformations and their rates along what is fitted of a recording."""
        moved = self.motion(x, own, number, self.recordings[number].fitted, False)
        if moved is None:
            return (np.zeros((len(self.arrangement.elements), 1)),) * 2
        rows = rows_of(self.arrangement, self.read(x)[0])
        return rows @ moved.states[:, : self.n].T, rows @ moved.states[:, self.n :].T

    def motion(
        self, x: Real, own: Own, number: int, at: slice, whole: bool, keeps_division: bool = False
    ) -> Motion | None:
        """Return the motion between two samples; None where there is no such rig."""
        read = Read.of(self, [(x, own)], self.recordings[number].rate_hz)
        return self.motions(read, number, at, whole, keeps_division)[0] if read.runs.size else None

    def motions(self, read: Read, number: int, at: slice, whole: bool, keeps_division: bool = False) -> Motion:
        """Return what `motion` does, of several runs at once."""
        recorded, sub = self.recordings[number], self.substeps[number]
        acting, h = laws_in(self.terms), 1 / recorded.rate_hz / sub
        bent = sorted({element for _, _, element in acting})  # the elements with more than spring and damper
        mass, damping, stiffness = read.matrices
        vectors = self.vectors(read.constants, mass)
        given, pushed = zip(*self._givens(read, number, at), strict=True)
        force = np.stack([u.T @ v.T for u, v in zip(pushed, vectors, strict=True)])
        if self.struck is not None and read.own[0].impact.size:
            struck = np.broadcast_to(np.eye(self.n)[self.struck, :, None], (*vectors.shape[:2], 1))
            vectors = np.concatenate([vectors, struck], axis=2)
        start = np.array([o.state for o in read.own])
        if whole and recorded.fitted.start > 0:
            each = zip(read.one_by_one, mass, stiffness, strict=True)
            start = np.array([self._at_rest(*one, number) for one in each])
        laws, told = [], not whole or recorded.fitted.start == 0  # what is left of the motion before
        for own, constants, terms in zip(read.own, read.one_by_one, read.terms, strict=True):
            rest = {e: AtRest.of(self.arrangement.elements[e], constants, self.rig.preload_n) for e in bent}
            left = dict(zip(self.memories, own.memory.tolist() if told else repeat(0.0), strict=False))
            values = [{**terms[i].values, **({m.carried: left[i, e]} if m.carried else {})} for i, m, e in acting]
            laws.append([m.packed(v, rest[e], h) for v, (_, m, e) in zip(values, acting, strict=True)])
        rigs = Rigs(mass, damping, stiffness, rows_of(self.arrangement, read.constants)[:, bent], vectors)
        clock = Clock(np.array([at.start / recorded.rate_hz]), h, (at.stop - 1 - at.start) * sub, sub)
        near, division = self.divided.get(number, (at, None))
        slots, jumps = [(m.law, bent.index(e)) for _, m, e in acting], [m.jumps for _, m, _ in acting]
        begun, followed = Begun(rigs, laws, given, start), division if near == at else None
        found = computed(begun, slots, jumps, clock, followed, keeps_division, recorded if self.rough else None)
        extra = np.zeros((*found.states.shape[:2], len(self.arrangement.elements)))
        extra[:, :, bent] = found.forces[:, :, ::sub].swapaxes(1, 2)
        return Motion(found.states, extra, force, found.division)

    def _givens(self, read: Read, number: int, at: slice) -> list[tuple[Given, Real]]:
        """Return the inputs of each run, a second impact's force with them; see `_given`."""
        known: dict[tuple[float, ...], tuple[Given, Real]] = {}
        impacts: dict[tuple[float, ...], Given] = {}
        out = []
        rate_hz, sub = self.recordings[number].rate_hz, self.substeps[number]
        for i, (constants, terms) in enumerate(zip(read.one_by_one, read.terms, strict=True)):
            told = [t.values for t in terms if isinstance(t.mechanism, ChannelDistortion) and t.mechanism.of == "input"]
            key = (*(constants[d.offset] for d in self.rig.drives), *(v for values in told for v in values.values()))
            if key not in known:
                known[key] = self._given(constants, terms, number, at)
            given, pushed = known[key]
            if self.struck is not None and read.own[i].impact.size:
                seconds, change = read.own[i].impact.tolist()
                size = float(read.matrices[0][i, self.struck]) * change * rate_hz * sub
                struck = (*key, seconds, size)
                if struck not in impacts:
                    impacts[struck] = with_impulse(given, (seconds * rate_hz - at.start) * sub, size)
                given = impacts[struck]
            out.append((given, pushed))
        return out

    def _given(self, constants: Values, terms: Sequence[Term], number: int, at: slice) -> tuple[Given, Real]:
        """Return the inputs over each step, and (inputs, n) at the samples."""
        sub = self.substeps[number]
        inputs, held = self._driven(constants, terms, number, at)
        pushed = inputs if held else inputs[:, :: 2 * sub]
        if self.rig.hold == "band-limited" and not self.recordings[number].free:
            # what is in between is raised against parabolas
            pushed, _ = self._driven(constants, terms, number, at, at_samples=True)
        if held:
            return Given(inputs[None], inputs[None], np.zeros_like(inputs)[None], sub), pushed
        begin, end = inputs[:, :-1:2], inputs[:, 2::2]
        return Given(begin[None], end[None], (2 * (begin + end) - 4 * inputs[:, 1::2])[None], 1), pushed

    def _at_rest(self, constants: Values, mass: Real, stiffness: Real, number: int) -> Real:
        recorded, force = self.recordings[number], np.zeros(self.n)
        for i, drive in enumerate(self.rig.drives):
            mean = constants[drive.gain] * (float(recorded.inputs[i].mean()) + constants[drive.offset])
            force += mean * self._pushed(drive.row, drive.base, constants, mass)
        state = np.zeros(2 * self.n)
        if np.linalg.cond(stiffness) < SINGULAR:
            state[: self.n] = np.linalg.solve(stiffness, force)
        return state

    def _pushed(self, row: Row, base: bool, constants: Values | Mapping[str, Real], mass: Real) -> Real:
        vector = self.arrangement.vector(row, constants)
        return np.asarray(-mass * (vector + self._shaken) if base else vector, np.float64)

    def vectors(self, constants: Values | Mapping[str, Real], mass: Real) -> Real:
        """Return (..., n, inputs) the forces on the bodies by a unit of each input."""
        pushed = [self._pushed(d.row, d.base, constants, mass) for d in self.rig.drives]
        gains = [np.asarray(constants[d.gain])[..., None] for d in self.rig.drives]
        found = [gain * vector for gain, vector in zip(gains, pushed, strict=True)]
        return np.stack(found, axis=-1) if found else np.zeros((*mass.shape, 0))

    def _driven(
        self, constants: Values, terms: Sequence[Term], number: int, at: slice, at_samples: bool = False
    ) -> tuple[Real, bool]:
        """Return the inputs between two samples, at half substeps or ``at_samples``, and whether they hold."""
        recorded, sub = self.recordings[number], self.substeps[number]
        held = at_samples or (self.rig.hold == "zero" and not recorded.free)
        size = at.stop - at.start if held else (at.stop - 1 - at.start) * 2 * sub + 1
        rows = np.zeros((len(self.rig.drives), size))
        for i, drive in enumerate(self.rig.drives):
            between = recorded.inputs[i] if at_samples else self.between[number][1][i]
            u = between[at] if held else between[at.start * 2 * sub :][:size]
            u = u + constants[drive.offset]
            for term in terms:
                m = term.mechanism
                if isinstance(m, ChannelDistortion) and m.of == "input" and i in term.place:
                    peaks = peaks_of([r.inputs[i] for r in told_by(term, recorded, self.recordings)])
                    u = m.distort(u[None], {**term.values, **peaks}, recorded.rate_hz * (1 if held else 2 * sub))[0]
            rows[i] = u
        return rows, held
