"""The motion of a rig as its recordings show it, whatever forces act in it.

What a fit misses is smoothed as the answer of its linear rig to unknown forces on the bodies (Kalman's filter, Rauch's
smoother; the forces are Matern processes of order 3/2, whose size and corner likelihood chooses). The motion so found
owes nothing to a law: along it a law's force can be computed, and what the linear rig makes of that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numba import njit
from scipy.linalg import block_diag, expm

from analysis.mismatch.evidence.reconstruction import sampled
from sim_backend.arrangement import DERIVATIVES
from sim_backend.arrays import Real

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

SIZES: Final = (1e-3, 1e-2, 1e-1, 1.0, 10.0)  # of the unknown forces, over those of inertia in the fit's motion
CORNERS: Final = (1.0, 4.0)  # of their spectrum, over the highest mode
CHOOSING: Final = 2000  # samples, about the largest of what is missed, by which size and corner are chosen
LARGEST: Final = (
    6_000_000  # numbers of the smoother's matrices that are kept: of a longer recording its beginning counts
)
FAINT: Final = 1e-12  # variance that keeps what is constant from being known for certain


@dataclass(frozen=True, slots=True)
class LinearAnswer:
    """What channels of a linear rig show of forces on its bodies that go along straight lines between samples.

    Attributes
    ----------
    step, begin, end
        (s, s), (s, bodies): state after a sample, by the state, the forces before and after it.
    shows, at_once
        (channels, s), (channels, bodies): of the state and the forces, in the recordings' units.
    """

    step: Real
    begin: Real
    end: Real
    shows: Real
    at_once: Real

    def to(self, forces: Real, row: Real) -> Real:
        """Return (k, channels, n) what channels show of forces (k, n) on the bodies, along a row (bodies,)."""
        along = (np.ascontiguousarray(m @ row) for m in (self.begin, self.end, self.at_once))
        return np.asarray(_answered(self.step, self.shows, *along, np.ascontiguousarray(forces)), np.float64)

    def free(self, count: int) -> Real:
        """Return (s, channels, count) what channels show of each state at the first sample."""
        states, shown = np.eye(len(self.step)), np.empty((count, len(self.shows), len(self.step)))
        for n in range(count):
            shown[n] = self.shows @ states
            states = self.step @ states
        return np.asarray(shown.transpose(2, 1, 0))


@dataclass(frozen=True, slots=True)
class ShownMotion:
    """Along a recording, from its first fitted sample on: displacement, velocity, acceleration (n, bodies).

    Attributes
    ----------
    missed
        (channels, n) recording minus simulation, in the recordings' units.
    answer
        Of the linear rig.
    """

    displacement: Real
    velocity: Real
    acceleration: Real
    missed: Real
    answer: LinearAnswer


def shown_motion(fitted: SimulatedFit, number: int, share: float = 1.0) -> ShownMotion | None:
    """Return the motion that a share of a recording shows, from its beginning on; None where there is no such rig."""
    simulation, recorded = fitted.simulation, fitted.problem.recordings[number]
    begun = simulation.motion(fitted.x, fitted.own[number], number, recorded.fitted, False)
    if begun is None:
        return None
    rig = _Rig.of(fitted, number, begun.states)
    missed = -fitted.off(number)[0]
    count = min(math.ceil(share * missed.shape[1]), LARGEST // (2 * rig.states**2))
    missed = np.ascontiguousarray(missed[:, :count])
    loudest = int(np.argmax(np.convolve(np.sum(missed**2, axis=0), np.ones(min(CHOOSING, count)), "same")))
    about = slice(max(min(loudest - CHOOSING // 2, count - CHOOSING), 0), None)
    heard = missed[:, about][:, :CHOOSING]
    noise = max(fitted.problem.noise, FAINT)
    models = [rig.model(size, corner, missed) for corner in CORNERS for size in SIZES]
    best = max(models, key=lambda model: _likelihood(model, noise, heard))
    off = _smoothed(best.step, best.spread, best.shows, noise, best.start, missed.T.copy())[1] * best.unit
    n, states = rig.bodies, begun.states[:count]
    motion = states + off[:, : 2 * n]
    velocity = motion[:, n:]
    acceleration = np.gradient(velocity, 1 / recorded.rate_hz, axis=0)
    return ShownMotion(motion[:, :n], velocity, acceleration, missed, rig.answer())


@dataclass(frozen=True, slots=True)
class _Model:
    """``z' = step z + noise``, ``y = shows z + noise``, from sample to sample; ``unit`` of the states."""

    step: Real
    spread: Real
    shows: Real
    start: Real
    unit: Real


@dataclass(frozen=True, slots=True)
class _Rig:
    """A linear rig: slopes of its state by the state and by forces on the bodies, what channels show of these."""

    slopes: Real
    shown: Real
    reach: float
    speed: float
    force: Real
    highest: float
    rate_hz: float
    slow: bool

    @classmethod
    def of(cls, fitted: SimulatedFit, number: int, states: Real) -> _Rig:
        """Return the rig of a fit, of which motions (n, 2 bodies) are known."""
        rig, values, recorded = fitted.simulation.arrangement, fitted.values, fitted.problem.recordings[number]
        mass, damping, stiffness = rig.matrices(values)
        n = len(mass)
        motion = np.zeros((3, n, 3 * n))
        motion[0, :, :n] = motion[1, :, n : 2 * n] = np.eye(n)
        motion[2] = np.hstack([-stiffness / mass[:, None], -damping / mass[:, None], np.diag(1 / mass)])
        orders = [DERIVATIVES[s.quantity] for s in rig.sensors]
        rows = [
            values[c.gain] * (rig.vector(s.row, values) @ motion[k])
            for c, s, k in zip(fitted.simulation.rig.seen, rig.sensors, orders, strict=True)
        ]
        reach, speed = (max(float(np.abs(part).max()), 1e-300) for part in np.split(states, 2, axis=1))
        highest = 2 * math.pi * fitted.problem.highest_hz
        shown = np.array(rows) / recorded.unit[:, None]
        return cls(motion[1:].reshape(2 * n, 3 * n), shown, reach, speed, mass * highest * speed, highest,
                   recorded.rate_hz, min(orders) > 0)  # fmt: skip

    @property
    def bodies(self) -> int:
        """How many there are."""
        return len(self.force)

    @property
    def states(self) -> int:
        """Of the model: of the bodies, of the forces on them, of the channels' offsets."""
        return 4 * self.bodies + len(self.shown)

    def answer(self) -> LinearAnswer:
        """Return what it makes of forces."""
        n = self.bodies
        whole = np.zeros((4 * n, 4 * n))
        whole[: 2 * n, : 3 * n], whole[2 * n : 3 * n, 3 * n :] = self.slopes, np.eye(n) * self.rate_hz
        grown = expm(whole / self.rate_hz)
        step, end = np.ascontiguousarray(grown[: 2 * n, : 2 * n]), grown[: 2 * n, 3 * n :]
        shows, at_once = np.ascontiguousarray(self.shown[:, : 2 * n]), self.shown[:, 2 * n :]
        return LinearAnswer(step, grown[: 2 * n, 2 * n : 3 * n] - end, end, shows, at_once)

    def model(self, size: float, corner: float, missed: Real) -> _Model:
        """Return the rig under unknown forces of a size and a corner; beneath channels that have offsets.

        Where no channel shows a displacement the forces are rates of such processes: of what is slow these channels
        show nothing.
        """
        n, c = self.bodies, len(self.shown)
        turn = min(corner * self.highest, 0.5 * math.pi * self.rate_hz)
        forces = np.zeros((3 * n, 4 * n))
        forces[: 2 * n, : 2 * n] = np.eye(2 * n)
        first = 3 * n if self.slow else 2 * n
        forces[2 * n :, first : first + n] = np.eye(n)
        whole = np.zeros((4 * n, 4 * n))
        whole[: 2 * n] = self.slopes @ forces
        whole[2 * n : 3 * n, 3 * n :] = turn * np.eye(n)
        whole[3 * n :, 2 * n :] = np.hstack([-turn * np.eye(n), -2 * turn * np.eye(n)])
        unit = np.concatenate([np.full(n, self.reach), np.full(n, self.speed), np.tile(size * self.force, 2)])
        white = np.zeros((4 * n, 4 * n))
        white[3 * n :, 3 * n :] = 4 * turn * np.eye(n)  # unit variance of the scaled forces
        step, spread = sampled(whole * unit / unit[:, None], white, 1 / self.rate_hz)
        offsets = np.maximum(np.sqrt(np.mean(missed**2, axis=1)), 1e-300)
        return _Model(
            np.ascontiguousarray(block_diag(step, np.eye(c))),
            np.ascontiguousarray(block_diag(spread, FAINT * np.eye(c))),
            np.ascontiguousarray(np.hstack([self.shown @ forces * unit, np.diag(offsets)])),
            np.eye(4 * n + c),
            np.concatenate([unit, offsets]),
        )


def _likelihood(model: _Model, noise: float, y: Real) -> float:
    found = float(_smoothed(model.step, model.spread, model.shows, noise, model.start, y.T.copy(), False)[0])
    return found if math.isfinite(found) else -math.inf


_njit: Any = njit(cache=True, nogil=True)


@_njit
def _smoothed(step, spread, shows, noise, start, y, back=True):  # type: ignore[no-untyped-def]
    """Log likelihood, and means (n, states) given all samples (n, channels); only the former unless ``back``."""
    count, channels = y.shape
    size = len(step)
    kept = count if back else 0
    ahead, ahead_spread = np.zeros((kept, size)), np.zeros((kept, size, size))
    mean, mean_spread = np.zeros((kept, size)), np.zeros((kept, size, size))
    turned = np.ascontiguousarray(step.T)
    z, p, likelihood = np.zeros(size), start.copy(), 0.0
    for i in range(count):
        if back:
            ahead[i], ahead_spread[i] = z, p
        for k in range(channels):
            across = p @ shows[k]
            variance = shows[k] @ across + noise
            off = y[i, k] - shows[k] @ z
            likelihood -= 0.5 * (off * off / variance + math.log(variance))
            z = z + across * (off / variance)
            p = p - np.outer(across, across) / variance
        p = 0.5 * (p + p.T)
        if back:
            mean[i], mean_spread[i] = z, p
        z, p = step @ z, (step @ p) @ turned + spread
    for j in range(kept - 1):
        i = kept - 2 - j
        held = ahead_spread[i + 1] + 1e-14 * np.trace(ahead_spread[i + 1]) / size * np.eye(size)
        gain = np.ascontiguousarray(np.linalg.solve(held, step @ mean_spread[i]).T)
        mean[i] += gain @ (mean[i + 1] - ahead[i + 1])
    return likelihood, mean


@_njit
def _answered(step, shows, begin, end, at_once, forces):  # type: ignore[no-untyped-def]
    """See `LinearAnswer.to`."""
    size, channels = len(step), len(shows)
    runs, count = forces.shape
    out = np.zeros((runs, channels, count))
    z, moved = np.zeros(size), np.zeros(size)
    for j in range(runs):
        z[:] = 0.0
        for i in range(count):
            f = forces[j, i]
            for k in range(channels):
                seen = at_once[k] * f
                for s in range(size):
                    seen += shows[k, s] * z[s]
                out[j, k, i] = seen
            if i + 1 < count:
                g = forces[j, i + 1]
                for s in range(size):
                    total = begin[s] * f + end[s] * g
                    for r in range(size):
                        total += step[s, r] * z[r]
                    moved[s] = total
                z[:] = moved
    return out
