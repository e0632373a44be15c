"""What a recording's residual is compared with in a score test, whitened by an autoregression of the residual."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal
from scipy.linalg import solve_toeplitz

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Columns
from analysis.mismatch.recordings.model import STEP, residual, slopes
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, level
from analysis.mismatch.recordings.simulation import Own
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import Tones

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit


AUTOREGRESSION = 16  # order of the noise model
LEAST_NOISE = 1e-5  # of a channel's rms, that a recording is believed to have
MOST_CORRELATED = 0.05  # correlation of a residual that still counts when standard errors are widened


def columns_of(fitted: SimulatedFit, number: int, terms: Sequence[Term], ringing: Sequence[Term]) -> Columns:
    """Return what a recording's residual is compared with; held-out samples take no part."""
    simulation, recorded = fitted.simulation, fitted.problem.recordings[number]
    own = fitted.own[number]
    off, at = fitted.off(number)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    filters = [_whitening(np.where(used, row, 0.0)) for row in off]

    def white(y: Real) -> Real:
        return np.concatenate([signal.lfilter(a, [1.0], row)[used] for a, row in zip(filters, y, strict=True)])

    def changed(x: Real, moved: Own) -> Real:
        return white(residual(simulation, x, moved, number)[0] - off)

    def made(term: Term) -> Real:
        other = simulation.with_terms((*fitted.terms, term), fitted.values)
        state = replace(other.own(fitted.state(number)), tones=own.tones)
        return white(residual(other, other.begin(), state, number)[0] - off)

    def rings(index: int) -> tuple[Real, Real]:
        term, none = ringing[index], np.zeros((0, int(used.sum()) * len(off)))
        if isinstance(term.mechanism, Tones):
            waves = simulation.waves(number, at, term.mechanism.lines(term.values))
            rows = [white(np.where(np.arange(len(off))[:, None] == c, w, 0.0)) for c in range(len(off)) for w in waves]
            return np.array(rows), np.zeros(none.shape[1])
        return none, made(term)

    steps = STEP * np.maximum(1.0, np.abs(fitted.x))
    common, own_slopes = slopes(changed, fitted.x, own, steps, simulation.own_scale(number, own))
    q, _ = np.linalg.qr(own_slopes)
    columns = np.array([made(t) for t in terms]).reshape(len(terms), len(own_slopes)).T
    return Columns(np.arange(fitted.x.size), common, columns, -white(off), q, rings)


def noise_of(fitted: SimulatedFit, number: int) -> Real:
    """Return (c,) the rms of what cannot be predicted of a recording's residual, in the channels' units."""
    recorded = fitted.problem.recordings[number]
    off, at = fitted.error(number)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    found = np.array([innovation_rms(np.where(used, row, 0.0)) for row in off]) / math.sqrt(float(np.mean(used)))
    return np.asarray(np.maximum(found, LEAST_NOISE * level(recorded)), np.float64)


def _whitening(row: Real) -> Real:
    """Return the filter that makes a residual white, and its variance one: channels and recordings differ in noise."""
    return autoregression(row) / max(innovation_rms(row), 1e-300)


def correlation(row: Real) -> float:
    """Return samples over independent ones, of a residual that is no white noise."""
    r = signal.correlate(row - row.mean(), row - row.mean(), method="fft")[row.size - 1 :]
    r = r / r[0] if r[0] > 0 else np.ones(1)
    end = int(np.argmax(np.abs(r) < MOST_CORRELATED)) or r.size
    return max(1.0, 1 + 2 * float(np.sum(r[1 : max(4 * end, 2)] ** 2)))


def autoregression(row: Real) -> Real:
    """Return the whitening filter of a signal (n,), by Yule and Walker's equations."""
    n = row.size
    power = np.abs(np.fft.rfft(row, 2 ** math.ceil(math.log2(2 * n)))) ** 2
    r = np.fft.irfft(power)[: AUTOREGRESSION + 1] / n
    if not r[0] > 0:
        return np.ones(1)
    r[0] *= 1 + 1e-9
    return np.concatenate([[1.0], -solve_toeplitz(r[:-1], r[1:])])


def innovation_rms(row: Real) -> float:
    """Return the rms of what an autoregression cannot predict of a signal (n,)."""
    a = autoregression(row)
    return float(np.std(signal.lfilter(a, [1.0], row)[AUTOREGRESSION:]))
