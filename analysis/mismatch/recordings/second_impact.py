"""A second impact in free decays: when it fell, on which body, and how large it was beside the first.

When it fell is looked for sample by sample: the response to an impact is the same one wherever it falls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import is_
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.linalg import expm
from scipy.signal import oaconvolve
from scipy.stats import chi2

from analysis.mismatch.limits import upper_bound
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.model import residual, slopes, steps_of, ways
from analysis.mismatch.recordings.motion import GROWTH, Own, backwards
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, PER_PERIOD, Recorded
from analysis.mismatch.score_test import Score
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import SecondImpact

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

LEAST_BEHIND: Final = 40  # samples of a recording, as it was taken, after a second impact; and a period in any case
LEAST_LEFT: Final = 1e-3  # share of its response that a rig without it could not show as well
SAME_TO: Final = 1e-9  # of the largest singular value of what is free: less is no direction of its own
TRIED: Final = 2  # times of a second impact from which it is fitted
LOOKED_AGAIN: Final = 3  # times that it is looked for beside the fit before
CLEAR: Final = 4.0  # standard errors, beyond which an impact at any of some thousand samples is no chance
UNHEARD: Final = 0.05  # of a period, as fast as any: until then a first impact may not have been heard
STEP: Final = 1e-6  # of differences
BEYOND: Final = 0.02  # samples after one, or before the one before, that an impact is tried at


@dataclass(frozen=True, slots=True)
class _Along:
    """A second impact at every sample (n,) of a recording.

    Attributes
    ----------
    gain
        (bodies, n) chi-squared that it would take away.
    change, error
        (bodies, n) speed that it would add, m/s, and its standard error.
    """

    gain: Real
    change: Real
    error: Real

    @property
    def choice(self) -> float:
        """Chi-squared that choosing among so many times takes."""
        return 2 * math.log(max(int(np.count_nonzero(self.gain[0])), 1))


@dataclass(frozen=True, slots=True)
class _Free:
    """What is free in a recording: whitened changes, (c, n) each, of the constants and of its own numbers, masked."""

    constants: Real
    own: Real
    residual: Real
    used: Real
    scale: Real

    def columns(self) -> Real:
        """Return (c n, k) all of them, as they are used."""
        rows = np.concatenate([self.own, self.constants]) * self.used
        return rows.reshape(len(rows), -1).T

    @classmethod
    def of(cls, fitted: SimulatedFit, number: int, plain: bool = False) -> _Free:
        """Return what is free in a recording, whitened as its noise asks unless ``plain``."""
        simulation, own, recorded = fitted.simulation, fitted.own[number], fitted.problem.recordings[number]
        off, at = fitted.off(number)
        used = np.isin(recorded.part[at], (FIT, CHOOSE))
        noise, near = None if plain else fitted.noise(number), simulation.near(fitted.x, own, number)

        def white(y: Real) -> Real:
            return y if noise is None else noise.white(y)

        def changed(x: Real, moved: Own) -> Real:
            return white(residual(near, x, moved, number)[0] - off).ravel()

        scale, steps = simulation.own_scale(number, own), steps_of(simulation, fitted.x, own, number)
        common, begun = slopes(changed, fitted.x, own, steps, ways(simulation), scale)
        shape = (-1, *off.shape)
        return cls(
            common.T.reshape(shape), begun.T.reshape(shape), -white(off) * used, used.astype(np.float64), scale,
        )  # fmt: skip


def _along(fitted: SimulatedFit, number: int, plain: bool) -> _Along:
    """Return what a second impact on any of the rig's own bodies would explain at each sample of a recording."""
    free = _Free.of(fitted, number, plain)
    simulation, bodies = fitted.simulation, len(fitted.problem.arrangement.bodies)
    behind, columns = max(LEAST_BEHIND // fitted.problem.recordings[number].every, PER_PERIOD), free.columns()
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    q = left[:, singular > SAME_TO * singular[0]]
    channels, samples = free.residual.shape
    flat = free.residual.ravel() - q @ (q.T @ free.residual.ravel())
    variance = float(flat @ flat) / max(channels * np.count_nonzero(free.used) - q.shape[1], 1)
    rows = np.concatenate([flat[None], q.T]).reshape(-1, channels, samples)
    found = []
    for b in range(bodies):
        h = free.own[simulation.n + b]
        seen = _correlated(rows, h)
        power = _correlated(np.broadcast_to(free.used, (1, channels, samples)), h**2)[0]
        beside = power - np.sum(seen[1:] ** 2, axis=0)
        sound = beside > LEAST_LEFT * power.max()
        sound[[0]], sound[samples - behind :] = False, False
        beside = np.where(sound, beside, np.inf)
        scale = free.scale[simulation.n + b]
        gain = seen[0] ** 2 / beside / max(variance, 1e-300)
        found.append((gain, seen[0] / beside * scale, np.sqrt(variance / beside) * scale))
    return _Along(*(np.array(rows) for rows in zip(*found, strict=True)))


def _correlated(rows: Real, h: Real) -> Real:
    """Return (k, n) the products of rows (k, c, n) with a response (c, n) that begins at each sample."""
    samples = h.shape[1]
    parts = [oaconvolve(rows[:, c], h[c, ::-1][None], axes=1)[:, samples - 1 :] for c in range(len(h))]
    return np.asarray(np.sum(parts, axis=0), np.float64)


def second_impact_score(fitted: SimulatedFit, mechanism: SecondImpact, plain: bool = False) -> Score:
    """Score a second impact on the body, and in each decay at the time, that explain most.

    Its gain is what is left of chi-squared after the price of choosing the time. Beside a rig that is far from the one
    recorded there is none: how that one rings is not known.
    """
    name = mechanism.parameters[0].name
    if fitted.far_off():
        return Score(Term(mechanism, {name: 0.0}, (0,)), 0.0, 1, 0.0, 1.0)
    along = [_along(fitted, i, plain) for i in range(len(fitted.own))]
    net = np.array([[max(float(row.max()) - a.choice, 0.0) for row in a.gain] for a in along])
    body = int(np.argmax(net.sum(axis=0)))
    best = max(float(a.gain.max()) for a in along)
    tests = sum(np.count_nonzero(a.gain) for a in along)
    p_value = min(1.0, tests * float(chi2.sf(best, 1)))
    strength = max(_largest(fitted, along, body))
    # what fell in a held-out stretch only the ringing after it shows, which whitening takes away
    unwhitened = along if plain else [_along(fitted, i, plain=True) for i in range(len(fitted.own))]
    bound = max(_largest(fitted, [*along, *unwhitened], body, bounded=True))
    term = Term(mechanism, {name: min(strength, 1.0)}, (body,))
    return Score(term, float(net[:, body].sum()), 1, strength, p_value, bound=bound if bound < 1 else math.nan)


def _largest(fitted: SimulatedFit, along: Sequence[_Along], body: int, bounded: bool = False) -> list[float]:
    """Return the share of the first impact at the likeliest time of each recording, or its upper bound."""
    found = []
    for number, a in enumerate(along):
        at, recorded = int(np.argmax(a.gain[body])), number % len(fitted.own)
        change, error = abs(float(a.change[body, at])), float(a.error[body, at])
        rang_s = fitted.problem.recordings[recorded].rang_s
        first = _speed_begun(fitted, fitted.own[recorded].state, body, rang_s)
        found.append((upper_bound(change, error) if bounded else change) / first)
    return found


def where_it_fell(current: SimulatedFit, term: Term, refit: Callable[[SimulatedFit], SimulatedFit]) -> SimulatedFit:
    """Return the best fit with a second impact, from the times that explain most, looked for again beside each fit.

    Beside a rig that is far from the one recorded none is looked for.
    """
    begun = [] if current.far_off() else _begun(current, term)
    if not begun:
        return refit(current)
    best = min((refit(b) for b in begun), key=lambda f: f.scatter)
    for _ in range(LOOKED_AGAIN):
        bare = replace(best, own=tuple(replace(o, impact=np.zeros(0)) for o in best.own))
        again = min((refit(b) for b in _begun(bare, term)[:1]), key=lambda f: f.scatter, default=best)
        if not again.scatter < best.scatter:
            break
        best = again
    return _on_the_right_side(best, refit)


def _on_the_right_side(best: SimulatedFit, refit: Callable[[SimulatedFit], SimulatedFit]) -> SimulatedFit:
    """Return a fit whose impacts lie between the right samples: what one shows of a jump no slope foretells."""

    def missed(own: Own, number: int) -> float:
        off, at = residual(best.simulation, best.x, own, number)
        return float(np.sum(off[:, np.isin(best.problem.recordings[number].part[at], best.parts)] ** 2))

    def nearby(own: Own, recorded: Recorded) -> list[Own]:
        rate = recorded.rate_hz * recorded.every  # at which it was sampled
        beyond = ((math.floor(t * rate) - BEYOND, math.ceil(t * rate) + BEYOND) for t in own.impact[:1])
        return [own, *(replace(own, impact=np.array([t / rate, own.impact[1]])) for pair in beyond for t in pair)]

    tried = map(nearby, best.own, best.problem.recordings)
    own = tuple(min(some, key=lambda o: missed(o, i)) for i, some in enumerate(tried))
    return best if all(map(is_, own, best.own)) else min(best, refit(replace(best, own=own)), key=lambda f: f.scatter)


def fitted_where_struck(fitted: SimulatedFit) -> tuple[Recorded, ...]:
    """Return the recordings divided such that where a second impact seems to have fallen is fitted.

    It falls once: what is held out cannot be foretold where it fell, and what is fitted beside it tells only to within
    a period when that was.
    """
    found = []
    for number, recorded in enumerate(fitted.problem.recordings):
        along = _along(fitted, number, plain=True)
        at = int(np.argmax(along.gain.max(axis=0)))
        clear = float(along.gain[:, at].max()) > along.choice + CLEAR**2
        found.append(recorded.fitted_at(recorded.fitted.start + at) if clear else recorded)
    return tuple(found)


def _begun(fitted: SimulatedFit, term: Term) -> list[SimulatedFit]:
    """Return a fit with second impacts at the times that explain most of each recording, as it is and whitened.

    A whitening that is made from the residual whitens away much of what an impact does.
    """
    body, found = term.place[0], []
    for plain in (True, False):
        starts: list[list[Own]] = [[] for _ in range(TRIED)]
        for number, own in enumerate(fitted.own):
            a, recorded = _along(fitted, number, plain), fitted.problem.recordings[number]
            gain, apart = a.gain[body].copy(), max(int(recorded.rate_hz / fitted.problem.highest_hz), 1)
            for k in range(TRIED):
                at = int(np.argmax(gain))
                fell = at + recorded.fitted.start - 0.5 / recorded.every  # before the sample that shows it first
                impact = np.array([fell / recorded.rate_hz, a.change[body, at]])
                clear = gain[at] > a.choice
                starts[k].append(replace(own, impact=impact) if clear else starts[0][number] if k else own)
                gain[max(at - apart, 0) : at + apart + 1] = 0.0
        found += [replace(fitted, own=tuple(s)) for s in starts if any(o.impact.size for o in s)]
    return found


def _speed_begun(fitted: SimulatedFit, state: Real, body: int, before_s: float = 0.0) -> float:
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


@dataclass(frozen=True, slots=True)
class Struck:
    """A second impact in a recording: which one, when (s after its first sample), its share and standard error."""

    recording: int
    time_s: float
    share: float
    error: float


def struck(fitted: SimulatedFit, term: Term) -> list[Struck]:
    """Return the second impacts of a fit that stand out of the noise; all of them where none does.

    How large the first one was, the energy tells that the rig began with.
    """
    found = []
    for number, own in enumerate(fitted.own):
        if own.impact.size:
            share, error = _share_of(fitted, number, term.place[0])
            time_s = fitted.problem.recordings[number].start_s + float(own.impact[0])
            found.append(Struck(number, time_s, share, error))
    return [s for s in found if s.share > CLEAR * s.error] or found


def impulse_share(impacts: Sequence[Struck]) -> tuple[float, float]:
    """Return the impulse of a second impact over that of the first, and its standard error.

    The weighted mean of the recordings that have one, if they agree, else the largest.

    Examples
    --------
    >>> share, error = impulse_share([Struck(0, 0.1, 0.050, 0.003), Struck(1, 0.2, 0.054, 0.003)])
    >>> round(share, 4), round(error, 4)
    (0.052, 0.0021)
    >>> impulse_share([Struck(0, 0.1, 0.0009, 0.0001), Struck(1, 0.2, 0.17, 0.001)])
    (0.17, 0.001)
    """
    if not impacts:
        return 0.0, 0.0
    shares = np.array([s.share for s in impacts])
    weights = np.array([max(s.error, 1e-300) for s in impacts]) ** -2.0
    mean = float(np.average(shares, weights=weights))
    if np.all(np.abs(shares - mean) * np.sqrt(weights) < CLEAR):
        return mean, float(1 / math.sqrt(weights.sum()))
    largest = max(impacts, key=lambda s: s.share)
    return largest.share, largest.error


def said_of(impacts: Sequence[Struck], body: str) -> str:
    """Say what was struck, when, and what the size is over."""
    times = ", ".join(f"{i.time_s:.4g} s in recording {i.recording + 1} ({100 * i.share:.2g} %)" for i in impacts)
    size = f"over the impulse that alone would have given '{body}' the energy with which the decay began"
    return f" It struck '{body}' after {times}. Its size is {size}."


def _share_of(fitted: SimulatedFit, number: int, body: int) -> tuple[float, float]:
    """Return the share in one recording and its standard error."""
    own, free = fitted.own[number], _Free.of(fitted, number)

    def share(of: Own) -> float:
        return abs(float(of.impact[1])) / _speed_begun(fitted, of.state, body, fitted.problem.recordings[number].rang_s)

    columns, used = free.columns(), int(np.count_nonzero(free.used)) * len(free.residual)
    variance = float(np.sum(free.residual**2)) / max(used - columns.shape[1], 1)
    spread = np.linalg.pinv(columns.T @ columns, rcond=SAME_TO, hermitian=True)[: own.size, : own.size] * variance
    units = STEP * np.diag(free.scale)
    slope = np.array([(share(own.moved(unit / 2)) - share(own.moved(-unit / 2))) / STEP for unit in units])
    faded = _faded_where_unseen(fitted, number, free.used), _faded_until_loud(fitted, number, body)
    within = share(own) * math.hypot(*faded) / 2
    return share(own), math.sqrt(max(float(slope @ spread @ slope), 0.0) + within**2)


def _faded_until_loud(fitted: SimulatedFit, number: int, body: int) -> float:
    """Return by which share the motion fades before a first impact in the recording is heard."""
    rang_s, state = fitted.problem.recordings[number].rang_s, fitted.own[number].state
    begun, heard = (
        _speed_begun(fitted, state, body, s) for s in (rang_s, max(rang_s - UNHEARD / fitted.problem.highest_hz, 0.0))
    )
    return 1 - min(heard / begun, 1.0)


def _faded_where_unseen(fitted: SimulatedFit, number: int, used: Real) -> float:
    """Return by which share the motion fades over the held-out stretch in which a second impact lies, 0 in none.

    When it fell in that, what comes after tells only to within a period: earlier and stronger, or later and weaker.
    """
    recorded, own = fitted.problem.recordings[number], fitted.own[number]
    at = min(max(int(own.impact[0] * recorded.rate_hz) - recorded.fitted.start, 0), used.size - 1)
    seen = np.flatnonzero(used)
    first, last = seen[seen <= at].max(initial=0), seen[seen > at].min(initial=used.size - 1)
    moved = fitted.simulation.motion(fitted.x, replace(own, impact=np.zeros(0)), number, recorded.fitted, whole=False)
    if last - first < 2 or moved is None:
        return 0.0
    begun, ended = (_speed_begun(fitted, moved.states[i], 0) for i in (first, last))
    return 1 - min(ended / begun, 1.0)
