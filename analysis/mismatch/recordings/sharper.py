"""A force that jumps, tried to do so more abruptly: dry friction that holds a body does at any speed but none."""

from __future__ import annotations

from analysis.mismatch.recordings.fit import SimulatedFit, fit
from sim_backend.mechanisms.kinds import ForceLaw

SHARPER = 10.0  # times slighter a speed, within which it jumps, that is worth another fit


def sharper(found: SimulatedFit, to_beat: float) -> SimulatedFit:
    """Return a fit whose last mechanism jumps as abruptly as any trial, if that explains more; else the fit itself."""
    last = found.terms[-1]
    name = last.mechanism.rounding if isinstance(last.mechanism, ForceLaw) else ""
    if name not in last.values:
        return found
    sharpest = min(trial[name] for trial in last.mechanism.trials(found.problem.scale_of(found, last.place[0])))
    if last.values[name] < SHARPER * sharpest:
        return found
    terms = (*found.terms[:-1], last.within({name: sharpest}))
    return min(found, fit(found.problem, terms, found, to_beat=to_beat), key=lambda f: f.scatter)
