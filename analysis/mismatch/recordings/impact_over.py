"""Free decays in which the impact has not ended at their largest deflection: they begin once it has.

A soft hammer touches for some milliseconds, and what an accelerometer shows may be largest while it does. The rig is
not free then: a simulation from a free state misses the first samples by far more than the following ones.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import f as f_distribution

from analysis.mismatch.recordings.recorded import FEWEST, Recorded, divided
from sim_backend.arrays import Real

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

FIRST: Final = 8  # samples of a decay that are held against the following ones
AFTER: Final = 100  # of these
MORE: Final = 4.0  # times the mean square of the following ones, as it is and whitened, that the first ones have
BY_CHANCE: Final = 1e-6  # and with which probability by chance at most
MOST_LATER: Final = 0.1  # of a recording, by which it may begin later


def after_the_impact(linear: SimulatedFit) -> tuple[Recorded, ...]:
    """Return the recordings that the linear rig was fitted to; decays in which it was still struck begin later.

    By as long again as the rig took from silence to its largest deflection; where there is no silence before, nothing
    tells that it was struck.
    """
    return tuple(_after(linear, number, r) for number, r in enumerate(linear.problem.recordings))


def _excess(linear: SimulatedFit, number: int) -> float:
    """Return the mean square of the first samples over that of the following ones; 1 where by chance.

    As it is or whitened, whichever is less: what another mechanism makes ring from the first sample on is not foretold
    there either.
    """
    off = linear.off(number)[0]
    ratios = [_ratio(off), _ratio(linear.noise(number).white(off))]
    sizes = off[:, :FIRST].size, off[:, FIRST : FIRST + AFTER].size
    return min(ratios) if float(f_distribution.sf(ratios[1], *sizes)) < BY_CHANCE else 1.0


def _ratio(rows: Real) -> float:
    return float(np.mean(rows[:, :FIRST] ** 2) / max(float(np.mean(rows[:, FIRST : FIRST + AFTER] ** 2)), 1e-300))


def _may_be_struck(recorded: Recorded) -> bool:
    """Whether it is a decay with silence before it that was neither filtered nor divided by hand."""
    silence = (recorded.start_s - recorded.rang_s) * recorded.rate_hz >= 1
    return recorded.free and silence and recorded.band is None and not recorded.stretches


def _after(linear: SimulatedFit, number: int, recorded: Recorded) -> Recorded:
    later = math.ceil(recorded.rang_s * recorded.rate_hz)
    too_late = later > MOST_LATER * recorded.samples or recorded.samples - later < FEWEST
    if not _may_be_struck(recorded) or later < 1 or too_late or _excess(linear, number) < MORE:
        return recorded
    begun = recorded.start_s + later / recorded.rate_hz
    rows = np.ascontiguousarray(recorded.outputs[:, later:]), np.ascontiguousarray(recorded.inputs[:, later:])
    cut = divided(recorded.source, (recorded.rate_hz, begun), rows, (None, 0), linear.problem.rig)
    rang = recorded.rang_s + later / recorded.rate_hz
    wrong = tuple(w for w in recorded.wrong if w.time_s >= begun)
    return replace(cut, every=recorded.every, rang_s=rang, wrong=wrong, struck=recorded.struck + later)


def is_free(linear: SimulatedFit) -> bool:
    """Whether no decay that may have been struck is missed by more at its beginning than afterwards."""
    return all(_excess(linear, i) < MORE for i, r in enumerate(linear.problem.recordings) if _may_be_struck(r))
