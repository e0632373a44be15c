"""The linear rig fitted to recordings, from starting values for what nobody knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.mismatch.recordings.fit import NEAR_LINEAR, SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.recordings.start_values import start_values, with_first_states
from analysis.mismatch.rig_description import DescribedRig


def problem_of(rig: DescribedRig, recordings: Sequence[Recorded]) -> SimulatedRecordings:
    """Return the problem of recordings of a described rig, with starting values for what nobody knows.

    Raises
    ------
    AnalysisError
        The rig as described cannot have made them.
    """
    found, highest = start_values(rig, list(recordings))
    first, *rivals = with_first_states(rig, recordings, found, highest)
    return SimulatedRecordings(rig, tuple(recordings), first[0], highest, first[1], rivals=tuple(rivals))


def linear_fit(problem: SimulatedRecordings) -> SimulatedFit:
    """Return the linear rig fitted to the fitting blocks."""
    starts = [problem, *(replace(problem, constants=c, states=s) for c, s in problem.rivals)]
    nearest = min((fit(s) for s in starts), key=lambda f: f.objective) if len(starts) > 1 else None
    begun = fit(problem, begin=nearest, fine=True)
    follows = begun.missed >= NEAR_LINEAR and any(r.free for r in problem.recordings)
    return min(begun, fit(problem, staged=True, fine=True), key=lambda f: f.objective) if follows else begun
