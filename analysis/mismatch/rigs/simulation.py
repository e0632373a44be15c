"""The described rig simulated along a recording, with any mechanisms in its elements, as a function of free numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.mismatch.rigs.described import DescribedRig
from analysis.mismatch.rigs.recorded import Recorded
from sim_backend.forced_march import exact_step, forced_march
from sim_backend.mechanisms.mechanism import AtRest, Mechanism, Quantity
from sim_backend.modal_march import MEMORY, SLOTS, no_law

Real = NDArray[np.float64]
Values = Mapping[str, float]

PER_PERIOD: Final = 56  # substeps in a period of the rig's highest mode, at least
FEWEST_SUBSTEPS: Final = 3  # dry friction turns at once, however slow the rig
MOST_SUBSTEPS: Final = 8
MIRRORED: Final = 64  # samples put before and after an input so that its interpolation does not ring
LAW_PARAMETERS: Final = 20
ORDER: Final = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, slots=True)
class Placed:
    """A mechanism at work in one element, channel or input of the rig, by number, with values of its parameters."""

    mechanism: Mechanism
    values: Values
    place: int

    def moved(self, values: Values) -> Placed:
        """Return the same mechanism with other values."""
        return replace(self, values={**self.values, **values})


@dataclass(frozen=True, slots=True)
class Knob:
    """A number that is fitted: the fit sees ``x`` with ``value = scale * exp(x)`` or ``scale * x``.

    ``prior`` is its declared value and standard error in ``x``; None where nothing is known.
    """

    name: str
    unit: str
    scale: float
    log: bool
    low: float = -math.inf
    high: float = math.inf
    prior: tuple[float, float] | None = None

    def outward(self, x: float) -> float:
        """Return the value."""
        return self.scale * math.exp(min(x, 300.0)) if self.log else self.scale * x

    def inward(self, value: float) -> float:
        """Return the number that the fit sees."""
        return math.log(max(value / self.scale, 1e-300)) if self.log else value / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Range of x."""
        if self.log:
            low = math.log(self.low / self.scale) if self.low > 0 else -math.inf
            return low, math.log(self.high / self.scale) if math.isfinite(self.high) else math.inf
        return tuple(sorted((self.low / self.scale, self.high / self.scale)))  # type: ignore[return-value]


class Simulation:
    """Recordings of one rig, simulated.

    Parameters
    ----------
    constants
        Values of all the rig's constants, for scales and where they are not free.
    highest_hz
        Highest mode, which sets the substeps.
    states
        For each recording the state (2n,) at the beginning of what is fitted.
    terms
        Mechanisms at work.
    """

    def __init__(
        self,
        rig: DescribedRig,
        recordings: Sequence[Recorded],
        constants: Values,
        highest_hz: float,
        states: Sequence[Real],
        terms: Sequence[Placed] = (),
    ):
        self.rig, self.recordings, self.terms = rig, tuple(recordings), tuple(terms)
        self.constants = dict(constants)
        self.states = tuple(np.array(s, np.float64) for s in states)
        self.highest_hz = highest_hz
        arrangement = rig.arrangement
        self.n = len(arrangement.bodies)
        self.substeps = [
            min(max(math.ceil(PER_PERIOD * highest_hz / r.rate_hz), FEWEST_SUBSTEPS), MOST_SUBSTEPS)
            for r in self.recordings
        ]
        self.knobs = self._knobs()
        self._inputs = [self._between(r, s) for r, s in zip(self.recordings, self.substeps, strict=True)]

    def with_terms(self, terms: Sequence[Placed], constants: Values, states: Sequence[Real]) -> Simulation:
        """Return a simulation of the same recordings with other mechanisms and starting values."""
        other = object.__new__(Simulation)
        other.rig, other.recordings, other.terms = self.rig, self.recordings, tuple(terms)
        other.constants, other.states = dict(constants), tuple(states)
        other.highest_hz, other.n, other.substeps = self.highest_hz, self.n, self.substeps
        other._inputs = self._inputs
        other.knobs = other._knobs()
        return other

    def _knobs(self) -> tuple[Knob, ...]:
        found = []
        offsets = self._offset_scale()
        for p in self.rig.arrangement.parameters:
            if p.uncertainty == 0.0:
                continue
            value = self.constants[p.name]
            scale = abs(value) if value else (abs(p.value) if math.isfinite(p.value) and p.value else 1.0)
            prior, low = None, -math.inf
            if p.name in offsets:  # weakly held: a linear rig cannot tell an input's offset from its sensor's
                scale = offsets[p.name]
                prior = (0.0, 1.0)
            elif math.isfinite(p.uncertainty):
                inner = math.log(p.value / scale) if p.positive else p.value / scale
                prior = (inner, p.uncertainty / (p.value if p.positive else scale))
            elif p.unit == "N s/m":
                low = 0.0
            found.append(Knob(p.name, p.unit, scale, p.positive, low, prior=prior))
        for i, (r, state) in enumerate(zip(self.recordings, self.states, strict=True)):
            size = max(float(np.abs(state[: self.n]).max()), self._reach(r))
            speed = max(float(np.abs(state[self.n :]).max()), size * 2 * math.pi * self.highest_hz)
            found += [Knob(f"state {i} {j}", "", size if j < self.n else speed, False) for j in range(2 * self.n)]
        for k, term in enumerate(self.terms):
            for q in term.mechanism.parameters:
                found.append(_term_knob(k, q, term.values[q.name]))
        return tuple(found)

    def _offset_scale(self) -> dict[str, float]:
        """Return how large offsets may well be: as large as what they are added to."""
        sizes = {}
        for i, drive in enumerate(self.rig.drives):
            sizes[drive.offset] = max(_rms(self.recordings[0].inputs[i]), 1e-300)
        for c, seen in enumerate(self.rig.seen):
            sizes[seen.offset] = max(_rms(self.recordings[0].outputs[c]), 1e-300)
        return sizes

    def _reach(self, recorded: Recorded) -> float:
        """Return a size of the displacements."""
        seen = self.rig.seen[0]
        order = ORDER[seen.sensor.quantity]
        gain = abs(self.constants[seen.gain]) or 1.0
        size = float(np.std(recorded.outputs[0])) / gain / (2 * math.pi * self.highest_hz) ** order
        return max(size, 1e-300)

    def begin(self) -> Real:
        """Return the starting point of a fit."""
        found = []
        names = {p.name for p in self.rig.arrangement.parameters}
        states = np.concatenate(list(self.states)) if self.states else np.zeros(0)
        at = 0
        for knob in self.knobs:
            if knob.name in names:
                found.append(knob.inward(self.constants[knob.name]))
            elif knob.name.startswith("state"):
                found.append(float(states[at]) / knob.scale)
                at += 1
            else:
                k, _, name = knob.name.partition(":")
                found.append(knob.inward(self.terms[int(k)].values[name]))
        return np.array(found)

    def read(self, x: Real) -> tuple[dict[str, float], list[Real], tuple[Placed, ...]]:
        """Return constants, states and terms that the fit's numbers mean."""
        constants = dict(self.constants)
        states = [s.copy() for s in self.states]
        changed: list[dict[str, float]] = [{} for _ in self.terms]
        for knob, value in zip(self.knobs, x.tolist(), strict=True):
            if knob.name in constants:
                constants[knob.name] = knob.outward(value)
            elif knob.name.startswith("state"):
                _, i, j = knob.name.split()
                states[int(i)][int(j)] = knob.outward(value)
            else:
                k, _, name = knob.name.partition(":")
                changed[int(k)][name] = knob.outward(value)
        return constants, states, tuple(t.moved(c) for t, c in zip(self.terms, changed, strict=True))

    def run(self, x: Real, number: int, whole: bool = False, samples: int | None = None) -> tuple[Real, slice]:
        """Return what the channels (c, n) show along a recording, and of which of its samples.

        Parameters
        ----------
        whole
            From its first sample to its last, at rest under the mean input where the fit did not begin there; else
            what is fitted.
        samples
            So many only.
        """
        recorded = self.recordings[number]
        first, last = self._range(recorded, whole, samples)
        constants, _, terms = self.read(x)
        marched = self._march(x, number, first, last, whole)
        if marched is None:
            return np.full((len(self.rig.seen), last - first), np.nan), slice(first, last)
        shown = self._shown(constants, *marched, self.substeps[number])
        for term in terms:
            m = term.mechanism
            if m.distort is not None and not m.drives:
                peak = float(np.abs(recorded.outputs[term.place]).max())
                row = shown[term.place : term.place + 1]
                shown[term.place] = m.distort(row, {**term.values, "peak": peak}, recorded.rate_hz)[0]
        if recorded.band is not None and np.all(np.isfinite(shown)) and shown.shape[1] > 60:
            shown = signal.sosfiltfilt(recorded.band, shown, axis=1)
        return shown, slice(first, last)

    def motion(self, x: Real, number: int) -> tuple[Real, Real]:
        """Return (elements, n) deformations and their rates along what is fitted of a recording."""
        recorded = self.recordings[number]
        marched = self._march(x, number, recorded.fitted.start, recorded.fitted.stop, False)
        if marched is None:
            return (np.zeros((len(self.rig.arrangement.elements), 1)),) * 2
        constants = self.read(x)[0]
        rows = self._rows(constants)
        states = marched[0]
        return rows @ states[:, : self.n].T, rows @ states[:, self.n :].T

    def extra_force(self, x: Real, number: int) -> Real:
        """Return (elements, n) what the mechanisms add to the elements' forces along what is fitted of a recording."""
        recorded = self.recordings[number]
        marched = self._march(x, number, recorded.fitted.start, recorded.fitted.stop, False)
        return np.zeros((len(self.rig.arrangement.elements), 1)) if marched is None else marched[1].T

    def _range(self, recorded: Recorded, whole: bool, samples: int | None) -> tuple[int, int]:
        first = 0 if whole else recorded.fitted.start
        last = recorded.samples if whole else recorded.fitted.stop
        return first, last if samples is None else min(last, first + samples)

    def _rows(self, constants: Values) -> Real:
        arrangement = self.rig.arrangement
        return np.array([arrangement.vector(e.row, constants) for e in arrangement.elements]).reshape(-1, self.n)

    def _march(self, x: Real, number: int, first: int, last: int, whole: bool) -> tuple[Real, Real, Real, bool] | None:
        """Return states and extra forces at the samples, the inputs' forces and whether they are held; None: no rig."""
        constants, states, terms = self.read(x)
        recorded, sub = self.recordings[number], self.substeps[number]
        mass, damping, stiffness = self.rig.arrangement.matrices(constants)
        if not self._sensible(mass, damping, stiffness, recorded.rate_hz):
            return None
        h = 1 / recorded.rate_hz / sub
        force, held = self._force(constants, mass, terms, number, first, last)
        start = states[number]
        if whole and recorded.fitted.start > 0:
            start = self._at_rest(constants, mass, stiffness, terms, number)
        step = exact_step(mass, damping, stiffness, h)
        laws, element, p = self._laws(terms, constants, h)
        seen, extra = forced_march(
            laws, element, p, self._rows(constants), step.transition, step.begin, step.end, force, held, start,
            first / recorded.rate_hz, h, sub, np.zeros((SLOTS, MEMORY)),
        )  # fmt: skip
        return seen, extra, force, held

    def _sensible(self, mass: Real, damping: Real, stiffness: Real, rate: float) -> bool:
        """Whether the rig can be stepped at all: the extra forces aside, no mode faster than the sampling allows."""
        if not (np.all(np.isfinite(mass)) and np.all(mass > 0) and np.all(np.isfinite(stiffness))):
            return False
        fastest = math.sqrt(float(np.abs(stiffness / mass[:, None]).sum(axis=1).max()))
        return fastest < 40 * rate and float(np.abs(damping / mass[:, None]).sum(axis=1).max()) < 100 * rate

    def _at_rest(self, constants: Values, mass: Real, stiffness: Real, terms: Sequence[Placed], number: int) -> Real:
        recorded = self.recordings[number]
        force = np.zeros(self.n)
        for i, drive in enumerate(self.rig.drives):
            mean = constants[drive.gain] * (float(recorded.inputs[i].mean()) + constants[drive.offset])
            force += mean * self._pushed(drive.row, drive.base, constants, mass)
        state = np.zeros(2 * self.n)
        if np.linalg.cond(stiffness) < 1e9:
            state[: self.n] = np.linalg.solve(stiffness, force)
        return state

    def _pushed(self, row: tuple[tuple[str, float | str], ...], base: bool, constants: Values, mass: Real) -> Real:
        vector = self.rig.arrangement.vector(row, constants)
        return np.asarray(-mass * vector if base else vector, np.float64)

    def _between(self, recorded: Recorded, sub: int) -> Real:
        """Return the inputs at the substeps (at the samples where they are held)."""
        if recorded.free or self.rig.hold == "zero":
            return recorded.inputs
        samples = recorded.samples
        at = np.arange((samples - 1) * sub + 1)
        if self.rig.hold == "first":
            return np.array([np.interp(at / sub, np.arange(samples), u) for u in recorded.inputs])
        return np.array([_band_limited(u, sub)[: at.size] for u in recorded.inputs])

    def _force(
        self, constants: Values, mass: Real, terms: Sequence[Placed], number: int, first: int, last: int
    ) -> tuple[Real, bool]:
        """Return the forces on the bodies between two samples, and whether they are held."""
        recorded, sub = self.recordings[number], self.substeps[number]
        held = self.rig.hold == "zero" and not recorded.free
        size = last - first if held else (last - 1 - first) * sub + 1
        force = np.zeros((size, self.n))
        for i, drive in enumerate(self.rig.drives):
            u = self._inputs[number][i][first:last] if held else self._inputs[number][i][first * sub :][:size]
            u = u + constants[drive.offset]
            for term in terms:
                m = term.mechanism
                if m.distort is not None and m.drives and term.place == i:
                    peak = float(np.abs(recorded.inputs[i]).max())
                    u = m.distort(u[None], {**term.values, "peak": peak}, recorded.rate_hz)[0]
            force += np.outer(u, constants[drive.gain] * self._pushed(drive.row, drive.base, constants, mass))
        return force, held

    def _laws(self, terms: Sequence[Placed], constants: Values, h: float):  # type: ignore[no-untyped-def]
        laws: list[Any] = []
        element, p = np.full(SLOTS, -1, np.int64), np.zeros((SLOTS, LAW_PARAMETERS))
        for term in terms:
            if term.mechanism.law is None:
                continue
            k = len(laws)
            e = self.rig.arrangement.elements[term.place]
            rest = AtRest(
                0.0, constants[e.stiffness] if e.stiffness else 0.0, constants[e.damping] if e.damping else 0.0
            )
            given = [0.0, rest.stiffness, rest.damping, h, *term.mechanism.constants(term.values, rest)]
            p[k, : len(given)] = given
            element[k] = term.place
            laws.append(term.mechanism.law)
        return (*laws, *[no_law] * (SLOTS - len(laws))), element, p

    def _shown(self, constants: Values, states: Real, extra: Real, force: Real, held: bool, sub: int) -> Real:
        n, arrangement = self.n, self.rig.arrangement
        mass, damping, stiffness = arrangement.matrices(constants)
        x, v = states[:, :n], states[:, n:]
        shown = np.empty((len(self.rig.seen), len(states)))
        acceleration: Real | None = None
        for c, seen in enumerate(self.rig.seen):
            row = arrangement.vector(seen.sensor.row, constants)
            if seen.sensor.quantity == "acceleration":
                if acceleration is None:
                    at_samples = force if held else force[::sub]
                    with np.errstate(over="ignore", invalid="ignore"):
                        acceleration = (
                            at_samples - x @ stiffness.T - v @ damping.T - extra @ self._rows(constants)
                        ) / mass
                moved = acceleration @ row
            else:
                moved = (x if seen.sensor.quantity == "displacement" else v) @ row
            with np.errstate(over="ignore", invalid="ignore"):  # of a mechanism that runs away: it counts as lost
                shown[c] = constants[seen.gain] * moved + constants[seen.offset]
        return shown


def _term_knob(number: int, q: Quantity, value: float) -> Knob:
    scale = abs(value) or max(abs(q.low), abs(q.high)) if math.isfinite(q.high) and abs(q.high) < 1e20 else abs(value)
    return Knob(f"{number}:{q.name}", q.unit, scale or 1.0, q.log, q.low, q.high)


def _band_limited(u: Real, sub: int) -> Real:
    """Return an input at the substeps, such that straight lines between them have its spectrum up to half the rate."""
    long = np.concatenate([2 * u[0] - u[MIRRORED:0:-1], u, 2 * u[-1] - u[-2 : -MIRRORED - 2 : -1]])
    size = _fast_length(long.size)
    long = np.concatenate([long, np.linspace(long[-1], long[0], size - long.size + 2)[1:-1]])
    spectrum = np.fft.rfft(long) / np.sinc(np.fft.rfftfreq(size) / sub) ** 2
    return np.asarray(signal.resample(np.fft.irfft(spectrum, size), size * sub)[MIRRORED * sub :], np.float64)


def _rms(row: Real) -> float:
    return float(np.sqrt(np.mean(row**2)))


def _fast_length(size: int) -> int:
    from scipy.fft import next_fast_len

    return int(next_fast_len(size + 1, real=True))
