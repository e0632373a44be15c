"""Recordings made ready to be judged, from what the linear rig leaves of them: put right, divided anew, weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.mismatch.recordings.blocks import fitted_where_odd
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings
from analysis.mismatch.recordings.impact_over import after_the_impact, is_free
from analysis.mismatch.recordings.input_noise import with_likeliest_inputs
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.noise import noise_of
from analysis.mismatch.recordings.ranking import share_that_tells
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.recordings.second_impact import fitted_where_struck
from analysis.mismatch.recordings.wrong_samples import without_wrong_samples
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import Mechanism, SecondImpact

LATER: Final = 3  # times that decays begin later, while they do not yet begin free


def made_ready(problem: SimulatedRecordings, known: Sequence[Mechanism]) -> SimulatedRecordings:
    """Return a problem whose recordings hold no samples that are wrong by themselves, in units of their noise.

    Where something happens once it is fitted, not held out.
    """
    linear = _begun_free(linear_fit(problem))
    linear = _fitted_to(without_wrong_samples(linear), linear)
    linear = _fitted_to(with_likeliest_inputs(linear), linear)
    recordings = linear.problem.recordings
    struck = any(isinstance(m, SecondImpact) and linear.problem.allows(m) for m in known) and not linear.far_off()
    recordings = fitted_where_struck(linear) if struck else recordings
    linear = _fitted_to(fitted_where_odd(linear, recordings), linear)
    return replace(weighed(linear), looked_at=share_that_tells(linear))


def _begun_free(linear: SimulatedFit) -> SimulatedFit:
    """Return the fit to decays that begin when impacts are over; the same where beginning later does not cure them."""
    begun, problem = linear, linear.problem
    for _ in range(LATER):
        recordings = after_the_impact(begun)
        if all(new is old for new, old in zip(recordings, begun.problem.recordings, strict=True)):
            break
        anew = problem_of(problem.rig, recordings)
        begun = linear_fit(replace(anew, policy=problem.policy, budget=problem.budget))
    return begun if is_free(begun) else linear


def weighed(by: SimulatedFit) -> SimulatedRecordings:
    """Return a fit's problem with residuals in units of the noise that it leaves, and with its constants and states.

    A loud recording has little noise beside what it shows and a faint one much, and so have channels.
    """
    units = [noise_of(r, *by.error(i)) for i, r in enumerate(by.problem.recordings)]
    recordings = tuple(replace(r, unit=unit) for r, unit in zip(by.problem.recordings, units, strict=True))
    states = tuple(by.state(i) for i in range(len(by.own)))
    noise = 1 + _made_by_inputs(by, units)
    return replace(by.problem, recordings=recordings, constants=by.values, states=states, noise=noise)


def _made_by_inputs(fitted: SimulatedFit, units: Sequence[Real]) -> float:
    """Return the mean square of what noise of the inputs makes and a fit leaves, in units (c,) of each recording."""
    made = []
    for number, (recorded, unit) in enumerate(zip(fitted.problem.recordings, units, strict=True)):
        driven = fitted.noise(number).driven
        made.append(0.0 if driven is None else float(np.mean(driven.power * (recorded.unit / unit) ** 2)))
    return float(np.average(made, weights=[rows.size for rows in fitted.residuals]))


def _fitted_to(recordings: Sequence[Recorded], linear: SimulatedFit) -> SimulatedFit:
    """Return the linear rig's fit to recordings, where these are other ones than it was fitted to."""
    problem = linear.problem
    if all(new is old for new, old in zip(recordings, problem.recordings, strict=True)):
        return linear
    return linear_fit(replace(problem, recordings=tuple(recordings)))
