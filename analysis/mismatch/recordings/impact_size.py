"""How large impacts were that a fit holds: a second one beside the first, a knock by its impulse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.linalg import expm

from analysis.mismatch.recordings.model import residuals, slopes, steps_of, ways
from analysis.mismatch.recordings.motion import GROWTH, Own, Place, backwards
from analysis.mismatch.recordings.nearby import nearby
from analysis.mismatch.recordings.noise import AUTOREGRESSION
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import SecondImpact

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

SAME_TO: Final = 1e-9  # of the largest singular value of what is free: less is no direction of its own
CLEAR: Final = 4.0  # standard errors, beyond which an impact at any of some thousand samples is no chance
UNHEARD: Final = 0.05  # of a period, as fast as any: until then a first impact may not have been heard
STEP: Final = 1e-6  # of differences
PULSE: Final = 64  # samples, in which a whitened pulse is over


@dataclass(frozen=True, slots=True)
class Free:
    """What is free in a recording: whitened changes, (c, n) each, of the constants and of its own numbers, masked.

    And what a single wrong sample of each channel is, whitened, (c, c, k).
    """

    constants: Real
    own: Real
    residual: Real
    used: Real
    scale: Real
    wrong: Real

    def columns(self) -> Real:
        """Return (c n, k) all of them, as they are used."""
        rows = np.concatenate([self.own, self.constants]) * self.used
        return rows.reshape(len(rows), -1).T

    @classmethod
    def of(cls, fitted: SimulatedFit, number: int, plain: bool = False) -> Free:
        """Return what is free in a recording, whitened as its noise asks unless ``plain``."""
        simulation, own, recorded = fitted.simulation, fitted.own[number], fitted.problem.recordings[number]
        off, at = fitted.off(number)
        used = np.isin(recorded.part[at], (FIT, CHOOSE))
        noise, near = None if plain else fitted.noise(number), nearby(simulation, fitted.x, own, number)

        def white(y: Real) -> Real:
            return y if noise is None else noise.white(y)

        def changed(places: Sequence[Place]) -> Real:
            return np.array([white(y - off) for y in residuals(near, places, number)[0]])

        scale, steps = simulation.own_scale(number, own), steps_of(simulation, fitted.x, own, number)
        common, begun = slopes(changed, fitted.x, own, steps, ways(simulation), scale)
        shape = (-1, *off.shape)
        return cls(
            common.T.reshape(shape), begun.T.reshape(shape), -white(off) * used, used.astype(np.float64), scale,
            np.array([white(pulse)[:, AUTOREGRESSION:] for pulse in _pulses(len(off))]),
        )  # fmt: skip


def _pulses(channels: int) -> Real:
    """Return (c, c, k) one in a sample of each channel in turn, after those that a whitening begins with."""
    out = np.zeros((channels, channels, AUTOREGRESSION + PULSE))
    out[range(channels), range(channels), AUTOREGRESSION] = 1.0
    return out


def speed_begun(fitted: SimulatedFit, state: Real, body: int, before_s: float = 0.0) -> float:
    """Return how fast (m/s) an impact on a body alone would leave it, that put as much energy into the linear rig.

    As it was some time before it had this state; what has died out by then cannot be told.
    """
    mass, damping, stiffness = fitted.problem.arrangement.matrices(fitted.values)
    n, m = mass.size, fitted.simulation.n
    back = backwards(mass, damping, stiffness)
    growth = float(np.linalg.eigvals(back).real.max())
    before_s = min(before_s, math.log(GROWTH) / growth) if growth > 0 else before_s
    x, v = np.split(expm(back * before_s) @ np.concatenate([state[:n], state[m : m + n]]), 2)
    return math.sqrt(max(float(x @ stiffness @ x + v**2 @ mass), 1e-300) / float(mass[body]))


def of_size_one(fitted: SimulatedFit, mechanism: SecondImpact, number: int, body: int, own: Own) -> float:
    """Return the speed (m/s) that an impact of size one gives a body.

    That of a knock has an impulse of 1 N s, a second one the energy with which the recording began.
    """
    if mechanism.driven:
        return 1 / float(fitted.problem.arrangement.matrices(fitted.values)[0][body])
    return speed_begun(fitted, own.state, body, fitted.problem.recordings[number].rang_s)


@dataclass(frozen=True, slots=True)
class Struck:
    """An impact in a recording: which one, when (s after its first sample), its size and standard error."""

    recording: int
    time_s: float
    size: float
    error: float


def struck(fitted: SimulatedFit, mechanism: SecondImpact, body: int) -> list[Struck]:
    """Return the impacts on a body in a fit that stand out of the noise; all of them where none does."""
    found = []
    for number, own in enumerate(fitted.own):
        if own.impact.size:
            time_s = fitted.problem.recordings[number].start_s + float(own.impact[0])
            found.append(Struck(number, time_s, *_size_of(fitted, number, mechanism, body)))
    return [s for s in found if s.size > CLEAR * s.error] or found


def together(impacts: Sequence[Struck]) -> tuple[float, float]:
    """Return the size of impacts and its standard error.

    The weighted mean of the recordings that have one, if they agree, else the largest.

    Examples
    --------
    >>> size, error = together([Struck(0, 0.1, 0.050, 0.003), Struck(1, 0.2, 0.054, 0.003)])
    >>> round(size, 4), round(error, 4)
    (0.052, 0.0021)
    >>> together([Struck(0, 0.1, 0.0009, 0.0001), Struck(1, 0.2, 0.17, 0.001)])
    (0.17, 0.001)
    """
    if not impacts:
        return 0.0, 0.0
    sizes = np.array([s.size for s in impacts])
    weights = np.array([max(s.error, 1e-300) for s in impacts]) ** -2.0
    mean = float(np.average(sizes, weights=weights))
    if np.all(np.abs(sizes - mean) * np.sqrt(weights) < CLEAR):
        return mean, float(1 / math.sqrt(weights.sum()))
    largest = max(impacts, key=lambda s: s.size)
    return largest.size, largest.error


def said_of(impacts: Sequence[Struck], mechanism: SecondImpact, body: str, unit: str) -> str:
    """Say what was struck, when, and what the size is over; ``unit`` is that of an impulse."""

    def size(of: Struck) -> str:
        return f"{of.size:.3g} {unit}" if mechanism.driven else f"{100 * of.size:.2g} %"

    times = ", ".join(f"{i.time_s:.4g} s in recording {i.recording + 1} ({size(i)})" for i in impacts)
    said = f" It struck '{body}' after {times}."
    if mechanism.driven:
        return said
    size_of = f"over the impulse that alone would have given '{body}' the energy with which the decay began"
    return f"{said} Its size is {size_of}."


def _size_of(fitted: SimulatedFit, number: int, mechanism: SecondImpact, body: int) -> tuple[float, float]:
    """Return the size of the impact in one recording and its standard error."""
    own, free = fitted.own[number], Free.of(fitted, number)

    def size(of: Own) -> float:
        return abs(float(of.impact[1])) / of_size_one(fitted, mechanism, number, body, of)

    columns, used = free.columns(), int(np.count_nonzero(free.used)) * len(free.residual)
    variance = float(np.sum(free.residual**2)) / max(used - columns.shape[1], 1)
    spread = np.linalg.pinv(columns.T @ columns, rcond=SAME_TO, hermitian=True)[: own.size, : own.size] * variance
    units = STEP * np.diag(free.scale)
    slope = np.array([(size(own.moved(unit / 2)) - size(own.moved(-unit / 2))) / STEP for unit in units])
    loud = 0.0 if mechanism.driven else _faded_until_loud(fitted, number, body)
    within = size(own) * math.hypot(_faded_where_unseen(fitted, number, body, free.used), loud) / 2
    return size(own), math.sqrt(max(float(slope @ spread @ slope), 0.0) + within**2)


def _faded_until_loud(fitted: SimulatedFit, number: int, body: int) -> float:
    """Return by which share the motion fades before a first impact in the recording is heard."""
    rang_s, state = fitted.problem.recordings[number].rang_s, fitted.own[number].state
    begun, heard = (
        speed_begun(fitted, state, body, s) for s in (rang_s, max(rang_s - UNHEARD / fitted.problem.highest_hz, 0.0))
    )
    return 1 - min(heard / begun, 1.0)


def _faded_where_unseen(fitted: SimulatedFit, number: int, body: int, used: Real) -> float:
    """Return by which share an impact's response fades over the held-out stretch in which it lies, 0 in none.

    When it fell in that, what comes after tells only to within a period: earlier and stronger, or later and weaker.
    """
    recorded, own, n = fitted.problem.recordings[number], fitted.own[number], fitted.simulation.n
    at = min(max(int(own.impact[0] * recorded.rate_hz) - recorded.fitted.start, 0), used.size - 1)
    seen = np.flatnonzero(used)
    first, last = seen[seen <= at].max(initial=0), seen[seen > at].min(initial=used.size - 1)
    if last - first < 2:
        return 0.0
    begun = own.impact[1] * np.eye(2 * n)[n + body]
    return 1 - min(speed_begun(fitted, begun, body, -(last - first) / recorded.rate_hz) / abs(own.impact[1]), 1.0)
