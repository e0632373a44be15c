"""Recordings made ready to be judged, from what the linear rig leaves of them: put right, divided anew, weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.mismatch.recordings.blocks import fitted_where_odd
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings, linear_fit
from analysis.mismatch.recordings.input_noise import with_likeliest_inputs
from analysis.mismatch.recordings.ranking import share_that_tells
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.recordings.second_impact import fitted_where_struck
from analysis.mismatch.recordings.wrong_samples import without_wrong_samples
from sim_backend.mechanisms.kinds import Mechanism, SecondImpact


def made_ready(problem: SimulatedRecordings, known: Sequence[Mechanism]) -> SimulatedRecordings:
    """Return a problem whose recordings hold no samples that are wrong by themselves, in units of their noise.

    Where something happens once it is fitted, not held out.
    """
    linear = linear_fit(problem)
    linear = _fitted_to(without_wrong_samples(linear), linear)
    linear = _fitted_to(with_likeliest_inputs(linear), linear)
    recordings = linear.problem.recordings
    struck = any(isinstance(m, SecondImpact) and linear.problem.allows(m) for m in known) and not linear.far_off()
    recordings = fitted_where_struck(linear) if struck else recordings
    linear = _fitted_to(fitted_where_odd(linear, recordings), linear)
    return replace(linear.problem.weighed(linear), looked_at=share_that_tells(linear))


def _fitted_to(recordings: Sequence[Recorded], linear: SimulatedFit) -> SimulatedFit:
    """Return the linear rig's fit to recordings, where these are other ones than it was fitted to."""
    problem = linear.problem
    if all(new is old for new, old in zip(recordings, problem.recordings, strict=True)):
        return linear
    return linear_fit(replace(problem, recordings=tuple(recordings)))
