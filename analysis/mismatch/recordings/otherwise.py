"""Whether the rig with another constant, or with inputs held otherwise, explains as well as what is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import get_args

from analysis.mismatch.problem import OnProgress
from analysis.mismatch.recordings.blocks import mean_of
from analysis.mismatch.recordings.fit import SimulatedFit, fit, problem_of
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.recordings.start_check import better_unknown, with_unknown
from analysis.mismatch.rig_description import Hold
from analysis.mismatch.score_test import Screening

CONSTANTS = 2  # that are tried with other values where the rig as described misses most
HOPELESS = 1.5  # times the mean square of what is named, from which a rough fit will not come down to that
AS_WELL = 4.0  # mean square over that of what is named, up to which another constant explains as well


def constant_explains(linear: SimulatedFit, named: SimulatedFit, on_progress: OnProgress) -> bool:
    """Whether a declared constant is so wrong that the linear rig with another value does as well as what is named.

    Only asked where the rig as described misses most of the motion.
    """
    if not linear.far_off():
        return False
    on_progress("trying the rig with other constants")
    problem = linear.problem
    for name in list(better_unknown(problem))[:CONSTANTS]:
        other = problem_of(with_unknown(problem.rig, name), problem.recordings)
        losses = fit(replace(other, policy=problem.policy)).by_block(CHOOSE)
        if mean_of(losses) < AS_WELL * mean_of(named.by_block(CHOOSE)):
            return True
    return False


def hold_that_explains(
    linear: SimulatedFit,
    screen: Callable[[SimulatedFit], Screening],
    on_progress: OnProgress,
    named: SimulatedFit | None = None,
) -> SimulatedFit | None:
    """Return the linear rig with inputs that do between samples what leaves nothing beyond noise; None if none does.

    And predicts the choosing blocks no worse than what is ``named``, or than the rig as described.

    Parameters
    ----------
    screen
        What gives the scores of all mechanisms beside a fit.
    """
    rig, level = linear.problem.rig, linear.problem.policy.level
    if not rig.drives:
        return None
    on_progress("trying inputs that are held otherwise")
    for hold in get_args(Hold):
        if hold != rig.hold:
            other = replace(linear.problem, rig=replace(rig, hold=hold))
            best = mean_of((linear if named is None else named).by_block(CHOOSE))
            found = fit(other, (), linear)
            if mean_of(found.by_block(CHOOSE)) > HOPELESS * best:
                continue
            found = fit(other, (), found, fine=True)
            if mean_of(found.by_block(CHOOSE)) <= best and screen(found).p_value >= level:
                return found
    return None
