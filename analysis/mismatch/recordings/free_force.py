"""Forces of any shape beside what is named, fitted in full: what they would still take away."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from analysis.mismatch.free_form import free_places, joint_term
from analysis.mismatch.recordings.blocks import mean_of
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.recorded import CHOOSE
from sim_backend.force_law import SLOTS
from sim_backend.mechanisms.kinds import ForceLaw

FREE_PLACES: Final = 2  # elements in which forces of any shape are tried together


def free_share(base: SimulatedFit, current: SimulatedFit, problem: SimulatedRecordings) -> float:
    """Return which share of all that mechanisms and forces of any shape explain, these explain beside the mechanisms.

    By the mean square of the choosing blocks, weighed as noise where what is left is as good as that.
    """
    laws = sum(len(t.place) for t in current.terms if isinstance(t.mechanism, ForceLaw))
    rig = problem.arrangement
    places = free_places(rig)[: min(FREE_PLACES, SLOTS - laws)]
    added = [joint_term(rig, p, problem.scale_of(current, p)) for p in places]
    if not added:
        return 0.0
    found = fit(replace(problem, looked_at=1.0), (*current.terms, *added), current)
    noise = current if current.as_noise else None
    before, best, free = (mean_of(f.by_block(CHOOSE, noise)) for f in (base, current, found))
    return max(best - free, 0.0) / max(before - min(free, best), 1e-300)
