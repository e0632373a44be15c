"""A described rig simulated along a recording, with any mechanisms in it, as a function of its free parameters."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy import signal

from analysis.mismatch.parameters import FreeParameter, Term, lines_of, with_values
from analysis.mismatch.recordings.channels import distort, memories, remembered, rows_of, shown_by, told_by
from analysis.mismatch.recordings.free_parameters import free_parameters
from analysis.mismatch.recordings.inputs import at_half_substeps, peaks_of
from analysis.mismatch.recordings.motion import Begun, Motion, Own, Place, computed, sensible, with_impulse
from analysis.mismatch.recordings.recorded import Recorded, level
from analysis.mismatch.recordings.spread_impact import spread_of_impact
from analysis.mismatch.recordings.untold import SINGULAR, untold_offsets
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.acting import extended, laws_in, shaken
from sim_backend.arrangement import DERIVATIVES, Row
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AtRest, ChannelDistortion, ForceLaw, SecondImpact
from sim_backend.propagate import Clock, Division, Given, Rigs
from sim_backend.propagate import Motion as Propagated

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
        self.constants = {**self.arrangement.declared(), **constants}
        self.lines = lines_of(terms)
        self.struck = next((t.place[0] for t in terms if isinstance(t.mechanism, SecondImpact)), None)
        self.substeps = [self._substeps(r) for r in self.recordings]
        mass = self.arrangement.matrices(self.constants)[0]
        pushed = self._vectors(self.constants, mass).T
        self.untold = untold_offsets(rig, self.arrangement, self.constants, self.terms, list(pushed))
        self.parameters = tuple(free_parameters(self))
        kept = like.between if like is not None and (like.rig.hold, like.substeps) == (rig.hold, self.substeps) else ()
        # of each recording its inputs, and these at half substeps
        self.between: tuple[tuple[Real, Real], ...] = tuple(
            kept[i] if kept and kept[i][0] is r.inputs else (r.inputs, at_half_substeps(r.inputs, sub, rig.hold))
            for i, (r, sub) in enumerate(zip(self.recordings, self.substeps, strict=True))
        )
        self.divided: dict[int, tuple[slice, Division]] = {}
        self.steps: dict[int, Real] = {} if like is None else dict(like.steps)  # of differences, where a force jumps

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
        memory = level(recorded)[[channel for channel, _ in memories(self.terms)]][: own.memory.size]
        return np.concatenate([np.repeat([size, speed], self.n), np.ones(own.tones.size), impact, memory])

    def own(self, state: Real) -> Own:
        """Return what is a recording's own, for a state of the rig without the terms' bodies."""
        n, full = len(self.rig.arrangement.bodies) if state.size < 2 * self.n else self.n, np.zeros(2 * self.n)
        full[:n], full[self.n : self.n + n] = state[:n], state[n:]
        memory = 0 if any(r.free for r in self.recordings) else len(memories(self.terms))
        return Own(full, np.zeros((len(self.rig.seen), 2 * len(self.lines))), memory=np.zeros(memory))

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
        shown: list[Real] = []
        for some in (places[first : first + many] for first in range(0, len(places), many)):
            moved = self.motions(some, number, at, whole)
            shown += [self._shown(place, number, at, motion) for place, motion in zip(some, moved, strict=True)]
        return np.array(shown), at

    def _shown(self, place: Place, number: int, at: slice, moved: Motion | None) -> Real:
        """Return what the channels (c, n) show of a motion."""
        recorded, (x, own), first, last = self.recordings[number], place, at.start, at.stop
        if moved is None:
            return np.full((len(self.rig.seen), last - first), np.nan)
        constants, terms = self.read(x)
        if recorded.free and any(isinstance(t.mechanism, ChannelDistortion) for t in terms):  # some remember
            moved = moved.begun_earlier(*self.arrangement.matrices(constants), recorded.rate_hz)
        shown = shown_by(self.rig.seen, self.arrangement, constants, moved)
        if np.all(np.isfinite(shown)):
            distort(shown, terms, recorded, self.recordings)
        shown = shown[:, shown.shape[1] - (last - first) :]
        if first == recorded.fitted.start:
            shown += remembered(terms, own.memory, len(shown), np.arange(last - first) / recorded.rate_hz)
        if self.lines:
            shown += own.tones @ self.waves(number, at)
        if self.struck is not None and own.impact.size and recorded.every > 1:
            begun = own.impact[1] * np.eye(2 * self.n)[self.n + self.struck]
            shown += spread_of_impact(self.rig.seen, self.arrangement, constants, (own.impact[0], begun), recorded, at)
        if recorded.band is not None and np.all(np.isfinite(shown)) and shown.shape[1] > SHORTEST_FILTERED:
            shown = signal.sosfiltfilt(recorded.band, shown, axis=1)
        return np.asarray(shown, np.float64)

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
        return self.motions([(x, own)], number, at, whole, keeps_division)[0]

    def motions(
        self, places: Sequence[Place], number: int, at: slice, whole: bool, keeps_division: bool = False
    ) -> list[Motion | None]:
        """Return what `motion` does, for several places at once."""
        recorded, sub = self.recordings[number], self.substeps[number]
        acting = laws_in(self.terms)
        bent = sorted({element for _, _, element in acting})  # the elements with more than spring and damper
        known: dict[tuple[float, ...], tuple[Given, Real]] = {}
        begun = [self._begun(place, number, at, whole, bent, known) for place in places]
        clock = Clock(
            np.array([at.start / recorded.rate_hz]), 1 / recorded.rate_hz / sub, (at.stop - 1 - at.start) * sub, sub
        )
        near, division = self.divided.get(number, (at, None))
        slots = [(m.law, bent.index(element)) for _, m, element in acting]
        there = [one for one in begun if one is not None]
        followed = division if near == at else None
        found = iter(computed(there, slots, [m.jumps for _, m, _ in acting], clock, followed, keeps_division))
        return [None if one is None else self._moved(one, next(found), bent, sub) for one in begun]

    def _moved(self, begun: Begun, found: Propagated, bent: Sequence[int], sub: int) -> Motion:
        extra = np.zeros((len(found.states[0]), len(self.arrangement.elements)))
        extra[:, bent] = found.forces[0, :, ::sub].T
        return Motion(found.states[0], extra, begun.force, found.division)

    def _begun(
        self, place: Place, number: int, at: slice, whole: bool, bent: Sequence[int],
        known: dict[tuple[float, ...], tuple[Given, Real]],
    ) -> Begun | None:  # fmt: skip
        """Return what a motion is computed from, None where there is no such rig; ``known`` are inputs of others."""
        (x, own), recorded, sub = place, self.recordings[number], self.substeps[number]
        constants, terms = self.read(x)
        mass, damping, stiffness = self.arrangement.matrices(constants)
        if not sensible(mass, damping, stiffness, recorded.rate_hz):
            return None
        vectors, h = self._vectors(constants, mass), 1 / recorded.rate_hz / sub
        told = [t.values for t in terms if isinstance(t.mechanism, ChannelDistortion) and t.mechanism.of == "input"]
        key = (*(constants[d.offset] for d in self.rig.drives), *(v for values in told for v in values.values()))
        if key not in known:
            known[key] = self._given(constants, terms, number, at)
        given, pushed = known[key]
        force = pushed.T @ vectors.T
        if self.struck is not None and own.impact.size:
            substep, change = (own.impact[0] * recorded.rate_hz - at.start) * sub, own.impact[1] / h
            given = with_impulse(given, substep, mass[self.struck] * change)
            vectors = np.column_stack([vectors, np.eye(self.n)[self.struck]])
        start = own.state
        if whole and recorded.fitted.start > 0:
            start = self._at_rest(constants, mass, stiffness, number)
        rigs = Rigs(
            mass[None], damping[None], stiffness[None], rows_of(self.arrangement, constants)[None, bent], vectors[None]
        )
        rest = [AtRest.of(element, constants, self.rig.preload_n) for element in self.arrangement.elements]
        laws = [m.packed(terms[i].values, rest[e], h) for i, m, e in laws_in(terms)]
        return Begun(rigs, laws, given, start, force)

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
        recorded = self.recordings[number]
        force = np.zeros(self.n)
        for i, drive in enumerate(self.rig.drives):
            mean = constants[drive.gain] * (float(recorded.inputs[i].mean()) + constants[drive.offset])
            force += mean * self._pushed(drive.row, drive.base, constants, mass)
        state = np.zeros(2 * self.n)
        if np.linalg.cond(stiffness) < SINGULAR:
            state[: self.n] = np.linalg.solve(stiffness, force)
        return state

    def _pushed(self, row: Row, base: bool, constants: Values, mass: Real) -> Real:
        vector = self.arrangement.vector(row, constants)
        return np.asarray(-mass * (vector + self._shaken) if base else vector, np.float64)

    def _vectors(self, constants: Values, mass: Real) -> Real:
        """Return (n, inputs) the forces on the bodies by a unit of each input."""
        pushed = [constants[d.gain] * self._pushed(d.row, d.base, constants, mass) for d in self.rig.drives]
        return np.array(pushed).reshape(-1, self.n).T

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
