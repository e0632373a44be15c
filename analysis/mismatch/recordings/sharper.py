"""A force that jumps, tried to do so more abruptly: dry friction that holds a body does at any speed but none."""

from __future__ import annotations

from analysis.mismatch.recordings.fit import SimulatedFit, fit
from sim_backend.mechanisms.kinds import ForceLaw

SHARPER = 1000.0  # times slighter speed within which it then jumps


def sharper(found: SimulatedFit, to_beat: float) -> SimulatedFit:
    """Return a fit whose last mechanism jumps within a far slighter speed, if that explains more, else the fit itself."""
    last = found.terms[-1]
    rounding = last.mechanism.rounding if isinstance(last.mechanism, ForceLaw) else ""
    if rounding not in last.values:
        return found
    terms = (*found.terms[:-1], last.within({rounding: last.values[rounding] / SHARPER}))
    return min(found, fit(found.problem, terms, found, to_beat=to_beat), key=lambda f: f.scatter)
