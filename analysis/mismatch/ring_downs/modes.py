"""The linear rig as a function of its constants: what a segment of it is made of, and how each constant changes that.

Free in every segment are the modal amplitudes when the pulse has ended (the state of all bodies: no assumption on the
pulse is needed) and the slow ringing of each channel.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from analysis.mismatch.problem import Constants
from analysis.mismatch.ring_downs.experiment import PULSE_MIDDLE_S, Experiment, Segment
from analysis.mismatch.ring_downs.linear import LinearRig, linear_rigs
from sim_backend.arrays import Complex, Real
from sim_backend.modal_response import waves
from sim_backend.state_space import SMALL, StateSpace, pairs

TAP_WITHIN_S = 0.4e-3
KEPT = 64  # sets of columns
STEP = 1e-5  # relative step of the differences of poles and gains


class Overdamped(ValueError):
    """The rig has a mode that is about to stop oscillating: it cannot be differenced."""


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Modes at one load, and how poles and gains change with each constant (rig's first, then the load's).

    ``rings_with`` is, of each phase-locked mode, the one whose amplitude tells its own.
    """

    rig: LinearRig
    pole_slopes: Complex
    gain_slopes: Complex
    drive_slopes: Complex
    phase_locked: tuple[int, ...] = ()
    rings_with: tuple[int, ...] = ()

    @property
    def reference(self) -> int:
        """The lowest mode that is not phase_locked: its phase gives the time of the tap."""
        return next(j for j in range(len(self.rig.poles)) if j not in self.phase_locked)

    @property
    def coefficients(self) -> int:
        """Numbers that are free in a segment for the modes that are not phase_locked."""
        return int(sum(w for j, w in enumerate(self.rig.weight) if j not in self.phase_locked))

    def since_tap(self, amplitudes: Complex, segment: Segment) -> float:
        """Return how long before the segment's first sample the impact was that gave the reference mode its phase, s.

        Of the times that do so the one nearest to `PULSE_MIDDLE_S` after the trigger, at most `TAP_WITHIN_S` from it.
        """
        s, drive = self.rig.poles[self.reference], self.rig.drive[self.reference]
        usual = segment.start_s - PULSE_MIDDLE_S
        if abs(s.imag) <= SMALL * abs(s):
            return usual
        turned = amplitudes[self.reference] / drive * np.exp(-s * usual)
        moved = float(np.angle(turned**2)) / 2 / s.imag
        return usual + float(np.clip(moved, -TAP_WITHIN_S, TAP_WITHIN_S))

    def locked_ratios(self, since_tap_s: float) -> Complex:
        """Return (locked,) amplitudes of the phase-locked modes over those of the modes they ring with, after the tap.

        The tap gave all modes their amplitudes at once; a mode that cannot be read by itself is computed.
        """
        at, first = list(self.phase_locked), list(self.rings_with)
        share = self.rig.drive[at] / self.rig.drive[first]
        grown: Complex = share * np.exp((self.rig.poles[at] - self.rig.poles[first]) * since_tap_s)
        return grown

    def locked_slopes(self, since_tap_s: float) -> Complex:
        """Return (constants, phase_locked) the relative change of `locked_ratios` with each constant."""
        at, first, timing = list(self.phase_locked), list(self.rings_with), [self.reference]
        given = self.drive_slopes[:, timing] / self.rig.drive[timing]
        own = self.drive_slopes[:, at] / self.rig.drive[at] - self.drive_slopes[:, first] / self.rig.drive[first]
        # the tap's time follows from the reference's phase
        moved = -(given.imag + self.pole_slopes[:, timing].imag * since_tap_s) / self.rig.poles[timing].imag
        apart = self.rig.poles[at] - self.rig.poles[first]
        changed = self.pole_slopes[:, at] - self.pole_slopes[:, first]
        grown: Complex = own + changed * since_tap_s + apart * moved
        return grown


@dataclass(slots=True)
class _Made:
    """Columns, and the decomposition of them once it was asked for; ``owner`` keeps its identity from being reused."""

    owner: Sensitivity
    columns: Real
    basis: tuple[Real, Real] | None = None


class Nuisance:
    """Columns of one segment that every model leaves free: its modes' amplitudes and the filter's own ringing.

    Records of one load and one length share them, so they are kept.
    """

    def __init__(self, experiment: Experiment, ringing: Complex):
        self._rate = experiment.sample_rate_hz
        own = [m.ringing(self._rate) for m in experiment.noise]
        self._ringing = [np.append(ringing, [s] if np.isfinite(s) else []) for s in own]
        self._rung: dict[int, Real] = {}
        self._made: OrderedDict[tuple[int, int, float], _Made] = OrderedDict()

    def columns(self, s: Sensitivity, segment: Segment) -> Real:
        """Return (c, n, q): per pair of poles two columns, per real pole one, per filter pole one a channel.

        A phase_locked mode has no column of its own: it rings in those of the mode that it rings with.
        """
        return self._of(s, segment).columns

    def basis(self, s: Sensitivity, segment: Segment) -> tuple[Real, Real]:
        """Return the columns' QR decomposition, (c n, q) and (q, q)."""
        made = self._of(s, segment)
        if made.basis is None:
            made.basis = np.linalg.qr(made.columns.reshape(-1, made.columns.shape[-1]))
        return made.basis

    def _of(self, s: Sensitivity, segment: Segment) -> _Made:
        key = (id(s), segment.y.shape[1], segment.since_tap_s if s.phase_locked else 0.0)
        if key not in self._made:
            self._made[key] = _Made(s, self._columns(s, segment))
            if len(self._made) > KEPT:
                self._made.popitem(last=False)
        return self._made[key]

    def _columns(self, s: Sensitivity, segment: Segment) -> Real:
        modes, n = s.rig, segment.y.shape[1]
        shown = modes.gains[:, None, :] * waves(modes.poles, 1 / self._rate, n)
        if s.phase_locked:
            for j, with_, ratio in zip(s.phase_locked, s.rings_with, s.locked_ratios(segment.since_tap_s), strict=True):
                shown[:, :, with_] += ratio * shown[:, :, j]
        if n not in self._rung:
            self._rung[n] = self._ringing_columns(n)
        rung, modal = self._rung[n], s.coefficients
        out = np.empty((*shown.shape[:2], modal + rung.shape[2]))
        at = 0
        for j, w in enumerate(modes.weight):
            if j in s.phase_locked:
                continue
            out[:, :, at] = w * shown[:, :, j].real
            if w == 2.0:
                out[:, :, at + 1] = -w * shown[:, :, j].imag
            at += int(w)
        out[:, :, modal:] = rung
        return out

    def _ringing_columns(self, n: int) -> Real:
        """Return (c, n, k) of what rings by itself in each channel."""
        t = np.arange(n) / self._rate
        parts = []
        for c, ringing in enumerate(self._ringing):
            for pole, w in zip(ringing, pairs(ringing), strict=True):
                wave = np.exp(t * pole)
                for part in (wave.real, wave.imag)[: int(w)]:
                    column = np.zeros((len(self._ringing), n))
                    column[c] = part
                    parts.append(column)
        return np.stack(parts, axis=-1) if parts else np.zeros((len(self._ringing), n, 0))

    @staticmethod
    def amplitudes(s: Sensitivity, coefficients: Real, segment: Segment) -> Complex:
        """Return the complex modal amplitudes that coefficients of `columns` mean."""
        found, at = np.zeros(len(s.rig.poles), np.complex128), 0
        for j, w in enumerate(s.rig.weight):
            if j in s.phase_locked:
                continue
            found[j] = complex(coefficients[at], coefficients[at + 1] if w == 2.0 else 0.0)
            at += int(w)
        if s.phase_locked:
            found[list(s.phase_locked)] = found[list(s.rings_with)] * s.locked_ratios(segment.since_tap_s)
        return found

    def rung(self, s: Sensitivity, coefficients: Real) -> list[Complex]:
        """Return the complex amplitude in each channel of everything that rings by itself, (poles,) each."""
        at, found = s.coefficients, []
        for ringing in self._ringing:
            own = np.zeros(ringing.size, np.complex128)
            for i, w in enumerate(pairs(ringing)):
                own[i] = complex(coefficients[at], -coefficients[at + 1] if w == 2.0 else 0.0)
                at += int(w)
            found.append(own)
        return found


def slow_filter_poles(highpass_hz: float, order: int) -> Complex:
    """Return zero (an offset) and the poles of the declared Butterworth high-pass, 1/s."""
    if not np.isfinite(highpass_hz) or order < 1:
        return np.zeros(1, np.complex128)
    angles = np.pi * (2 * np.arange(order) + order + 1) / (2 * order)
    s = 2 * np.pi * highpass_hz * np.exp(1j * angles)
    upper: Complex = s[s.imag > -1e-9 * np.abs(s)]
    return np.append(0.0, upper)


def sensitivities(constants: Constants, analog: StateSpace, experiment: Experiment) -> list[Sensitivity]:
    """Solve for the modes at every load and difference them with respect to every constant; no mode is phase_locked."""
    names = [name for scope in constants.names() for name in scope]
    groups, count = len(constants.load), len(names)
    at = np.stack(list(constants.stacked().values()), axis=1)
    step = constant_steps(constants)
    moves = np.concatenate([np.zeros((1, count)), np.eye(count), -np.eye(count)])
    values = at[:, None] + moves * step[:, None]  # (groups, 1 + 2 count, count)
    by_name = dict(zip(names, values.reshape(-1, count).T, strict=True))
    rigs = linear_rigs(constants.arrangement, by_name, analog, experiment.noise, experiment.sample_rate_hz)
    found = []
    for g in range(groups):
        middle, *moved = rigs[g * len(moves) : (g + 1) * len(moves)]
        up, down = moved[:count], moved[count:]
        for i, (a, b) in enumerate(zip(up, down, strict=True)):
            if not all(np.array_equal(moved.weight, middle.weight) for moved in (a, b)):
                raise Overdamped(f"a mode stops oscillating where {names[i]} is {at[g, i]:g}")
        twice = 2 * step[g]
        found.append(
            Sensitivity(
                middle,
                np.array([a.poles - b.poles for a, b in zip(up, down, strict=True)]) / twice[:, None],
                np.array([a.gains - b.gains for a, b in zip(up, down, strict=True)]) / twice[:, None, None],
                np.array([a.drive - b.drive for a, b in zip(up, down, strict=True)]) / twice[:, None],
            )
        )
    return found


def constant_steps(constants: Constants) -> Real:
    """Return (groups, constants) the steps of differences with respect to each constant."""
    declared = {p.name: abs(p.value) or 1.0 for p in constants.arrangement.parameters}  # size of what may be zero
    sizes = [np.maximum(np.abs(at), declared[name]) for name, at in constants.stacked().items()]
    return STEP * np.stack(sizes, axis=1)


def slope_columns(s: Sensitivity, amplitudes: Complex, segment: Segment, sample_rate_hz: float) -> Real:
    """Return (c, n, k): what a unit change of each constant does to a segment with these modal amplitudes."""
    t = np.arange(segment.y.shape[1]) / sample_rate_hz
    rung = waves(s.rig.poles, 1 / sample_rate_hz, t.size) * (s.rig.weight * amplitudes)
    # d(g b e^(s t)) = (dg + g db / b + g t ds) b e^(s t)
    relative = s.gain_slopes.copy()
    if s.phase_locked:
        relative[:, :, list(s.phase_locked)] += (
            s.rig.gains[:, list(s.phase_locked)] * s.locked_slopes(segment.since_tap_s)[:, None, :]
        )
    growing = s.rig.gains[None] * s.pole_slopes[:, None, :]
    shape = (relative.shape[0], relative.shape[1], t.size)
    fixed_part = (relative.reshape(-1, rung.shape[1]) @ rung.T).real.reshape(shape)
    growing_part = (growing.reshape(-1, rung.shape[1]) @ rung.T).real.reshape(shape)
    columns: Real = np.moveaxis(fixed_part + growing_part * t, 0, -1)
    return columns
