"""An impact that nothing measured shows: a second one in free decays, a knock at a rig that is driven.

When it fell is looked for sample by sample: the response to an impact is the same one wherever it falls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import is_
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import oaconvolve
from scipy.stats import chi2

from analysis.mismatch.limits import upper_bound
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.impact_size import CLEAR, SAME_TO, Free, of_size_one
from analysis.mismatch.recordings.model import residual, side_by_side
from analysis.mismatch.recordings.motion import Own
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.recordings.signatures import noise_drawn
from analysis.mismatch.recordings.thinning import PER_PERIOD
from analysis.mismatch.score_test import Score
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import SecondImpact

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

LEAST_BEHIND: Final = 40  # samples of a recording, as it was taken, after a second impact; and a period in any case
LEAST_LEFT: Final = 1e-3  # share of its response that a rig without it could not show as well
TRIED: Final = 2  # times of a second impact from which it is fitted
LOOKED_AGAIN: Final = 3  # times that it is looked for beside the fit before
CLOSE_BY: Final = 2  # samples from a wrong one
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
    wrong
        (n,) chi-squared that one wrong sample of one channel would take away, there or close by.
    """

    gain: Real
    change: Real
    error: Real
    wrong: Real

    @property
    def struck(self) -> Real:
        """(bodies, n) the gain where it is more: a channel that jumps once and does not ring was not struck."""
        return np.where(self.gain > self.wrong, self.gain, 0.0)

    @property
    def choice(self) -> float:
        """Chi-squared that choosing among so many times takes."""
        return 2 * math.log(max(int(np.count_nonzero(self.gain[0])), 1))


def _along(fitted: SimulatedFit, number: int, plain: bool) -> _Along:
    """Return what a second impact on any of the rig's own bodies would explain at each sample of a recording."""
    free = Free.of(fitted, number, plain)
    simulation, bodies = fitted.simulation, len(fitted.problem.arrangement.bodies)
    behind, columns = max(LEAST_BEHIND // fitted.problem.recordings[number].every, PER_PERIOD), free.columns()
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    q = left[:, singular > SAME_TO * singular[0]]
    channels, samples = free.residual.shape
    flat = free.residual.ravel() - q @ (q.T @ free.residual.ravel())
    freedom = max(channels * np.count_nonzero(free.used) - q.shape[1], 1)
    variance = float(flat @ flat) / freedom
    rows = np.concatenate([flat[None], q.T]).reshape(-1, channels, samples)
    noise = None if plain or not fitted.problem.draws(fitted) else _draws(fitted, number, free, q)
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
        made = np.ones(samples) if noise is None else np.mean(_correlated(noise, h) ** 2, axis=0) / beside
        error = np.sqrt(variance * np.maximum(made, 1.0) / beside)
        found.append(((seen[0] / beside / np.maximum(error, 1e-300)) ** 2, seen[0] / beside * scale, error * scale))
    wrong = _wrong_samples(rows[:1], free) / max(variance, 1e-300)
    gains, changes, errors = (np.array(rows) for rows in zip(*found, strict=True))
    return _Along(gains, changes, errors, wrong)


def _draws(fitted: SimulatedFit, number: int, free: Free, q: Real) -> Real:
    """Return (draws, c, n) draws of noise beside what is free, as large as independent samples would be.

    That of measured inputs rings: at times it looks like an impact more often than independent samples do.
    """
    drawn = noise_drawn(fitted, number, free.residual.shape[1]) * free.used
    flat = drawn.reshape(len(drawn), -1)
    flat = flat - (flat @ q) @ q.T
    freedom = max(len(free.residual) * np.count_nonzero(free.used) - q.shape[1], 1)
    flat /= np.sqrt(np.mean(np.sum(flat**2, axis=1)) / freedom)
    return np.asarray(flat.reshape(drawn.shape), np.float64)


def _wrong_samples(left: Real, free: Free) -> Real:
    """Return (n,) the sum of squares that one wrong sample of one channel would take away, there or close by."""
    _, channels, samples = left.shape
    found, used = np.zeros(samples), np.broadcast_to(free.used, (1, channels, samples))
    for pulse in free.wrong:
        h = np.pad(pulse, ((0, 0), (0, samples)))[:, :samples]
        power = _correlated(used, h**2)[0]
        taken = _correlated(left, h)[0] ** 2 / np.maximum(power, LEAST_LEFT * power.max())
        found = np.maximum(found, taken)
    return np.asarray(maximum_filter1d(found, 2 * CLOSE_BY + 1), np.float64)


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
    net = np.array([[max(float(row.max()) - a.choice, 0.0) for row in a.struck] for a in along])
    body = int(np.argmax(net.sum(axis=0)))
    best = max(float(a.struck.max()) for a in along)
    tests = sum(np.count_nonzero(a.gain) for a in along)
    p_value = min(1.0, tests * float(chi2.sf(best, 1)))
    strength = max(_largest(fitted, mechanism, along, body))
    # what fell in a held-out stretch only the ringing after it shows, which whitening takes away
    unwhitened = along if plain else [_along(fitted, i, plain=True) for i in range(len(fitted.own))]
    bound = max(_largest(fitted, mechanism, [*along, *unwhitened], body, bounded=True))
    most = mechanism.parameters[0].high
    term = Term(mechanism, {name: min(strength, most)}, (body,))
    return Score(term, float(net[:, body].sum()), 1, strength, p_value, bound=bound if bound < most else math.nan)


def _largest(
    fitted: SimulatedFit, mechanism: SecondImpact, along: Sequence[_Along], body: int, bounded: bool = False
) -> list[float]:
    """Return the size of an impact at the likeliest time of each recording, or its upper bound."""
    found = []
    for number, a in enumerate(along):
        at, recorded = int(np.argmax(a.gain[body])), number % len(fitted.own)
        change, error = abs(float(a.change[body, at])), float(a.error[body, at])
        unit = of_size_one(fitted, mechanism, recorded, body, fitted.own[recorded])
        found.append((upper_bound(change, error) if bounded else change) / unit)
    return found


def where_it_fell(current: SimulatedFit, term: Term, refit: Callable[[SimulatedFit], SimulatedFit]) -> SimulatedFit:
    """Return the best fit with a second impact, from the times that explain most, looked for again beside each fit.

    Beside a rig that is far from the one recorded none is looked for.
    """
    begun = [] if current.far_off() else _begun(current, term)
    if not begun:
        return refit(current)
    best = min(side_by_side(refit, [(b,) for b in begun]), key=lambda f: f.scatter)
    for _ in range(LOOKED_AGAIN):
        bare = replace(best, own=tuple(replace(o, impact=np.zeros(0)) for o in best.own))
        again = min((refit(b) for b in _begun(bare, term)[:1]), key=lambda f: f.scatter, default=best)
        if not again.scatter < best.scatter:
            break
        best = again
    return on_the_right_side(best, refit)


def on_the_right_side(best: SimulatedFit, refit: Callable[[SimulatedFit], SimulatedFit]) -> SimulatedFit:
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
