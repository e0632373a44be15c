"""What a recording's residual is compared with in a score test, whitened as its noise asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Columns
from analysis.mismatch.recordings.model import residual, slopes, step_of
from analysis.mismatch.recordings.noise import NoiseModel
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.recordings.simulation import Own
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import Tones

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit


def columns_of(fitted: SimulatedFit, number: int, terms: Sequence[Term], ringing: Sequence[Term]) -> Columns:
    """Return what a recording's residual is compared with; held-out samples take no part."""
    simulation, recorded = fitted.simulation, fitted.problem.recordings[number]
    own = fitted.own[number]
    off, at = fitted.off(number)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    noise = NoiseModel.of(fitted.problem.rig, fitted.values, recorded, (off, used))

    def white(y: Real) -> Real:
        return noise.white(y)[:, used].ravel()

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

    forward = np.ones(fitted.x.size)
    scale = simulation.own_scale(number, own)
    common, own_slopes = slopes(changed, fitted.x, own, step_of(simulation), forward, scale)
    q, _ = np.linalg.qr(own_slopes)
    columns = np.array([made(t) for t in terms]).reshape(len(terms), len(own_slopes)).T
    return Columns(np.arange(fitted.x.size), common, columns, -white(off), q, rings)
