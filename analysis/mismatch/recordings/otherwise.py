"""Whether the rig described otherwise explains as well as what is named: a constant, how inputs are held, a contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from analysis.mismatch.account import Otherwise
from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import OnProgress
from analysis.mismatch.recordings.blocks import mean_of
from analysis.mismatch.recordings.costs import lead_of
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.joining import joined_to
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.recordings.regression import Regression, of_elements
from analysis.mismatch.recordings.start_check import better_unknown, declared, with_unknown
from analysis.mismatch.rig_description import Hold
from analysis.mismatch.score_test import Score, Screening, screen
from sim_backend.force_law import MEMORY, along
from sim_backend.mechanisms.kinds import AtRest, ForceLaw, Mechanism

CONSTANTS = 2  # that are tried with other values where the rig as described misses most
HOPELESS = 1.5  # times the mean square of what is named, from which a rough fit will not come down to that
TURNED = 3  # laws that are fitted in a contact whose bodies are named in the other order
POINTS = 24  # of a cycle along which a law is looked at, and its amplitude over the deflection under the preload
REACH = 2.0
ROUNDING = 1e-9  # of a law's largest force
AS_WELL = 4.0  # mean square over that of what is named, up to which another constant explains as well

Described = Otherwise[SimulatedFit] | None


def explained_otherwise(
    fits: tuple[SimulatedFit, SimulatedFit, SimulatedFit],
    screened: Callable[[SimulatedFit], Screening],
    known: Sequence[Mechanism],
    on_progress: OnProgress,
) -> bool:
    """Whether the rig described otherwise explains as well as what is named.

    Parameters
    ----------
    fits
        The linear rig's that the selection began with, that of what is named, and the linear rig's final one.
    screened
        What gives the scores of all mechanisms beside a fit.
    """
    before, named, linear = fits
    described = hold_that_explains(linear, screened, on_progress, named)
    if described is None and (screened(named).p_value < linear.problem.policy.level or _bends_in_contact(named)):
        described = contact_turned_round(linear, known, on_progress, named)
    described = described or constant_that_explains(linear, screened, on_progress, named)
    return described is not None or constant_explains(before, named, on_progress)


def constant_explains(linear: SimulatedFit, named: SimulatedFit, on_progress: OnProgress) -> bool:
    """Whether a declared constant is so wrong that the linear rig with another value does as well as what is named.

    Only asked where the rig as described misses most of the motion, and of constants whose other values may explain
    along it.
    """
    if not linear.far_off():
        return False
    problem = linear.problem
    among = [name for name in declared(problem.rig) if may_explain(name, linear, named)]
    if among:
        on_progress("trying the rig with other constants")
    for name in list(better_unknown(problem, among))[:CONSTANTS]:
        other = problem_of(with_unknown(problem.rig, name), problem.recordings)
        losses = fit(replace(other, policy=problem.policy)).by_block(CHOOSE)
        if mean_of(losses) < AS_WELL * mean_of(named.by_block(CHOOSE)):
            return True
    return False


def may_explain(name: str, linear: SimulatedFit, named: SimulatedFit) -> bool:
    """Whether another value of a constant may leave as little as what is named: along the motion shown, if any is."""
    regression = Regression.of(linear, [name])
    most = max(named.scatter, linear.problem.policy.unlike_noise * linear.problem.noise)
    return regression is None or regression.without <= AS_WELL * most


def constant_that_explains(
    linear: SimulatedFit,
    screened: Callable[[SimulatedFit], Screening],
    on_progress: OnProgress,
    named: SimulatedFit | None = None,
) -> Described:
    """Return the linear rig with one declared stiffness or damping left unknown, if that leaves nothing; else None.

    And explains no worse than what is ``named``, for which free parameters cost. Tried only where other values of all
    of them explain along the motion that the recordings show.
    """
    problem, freed = linear.problem, Regression.of(linear, of_elements(linear.problem.arrangement))
    if freed is None or freed.without > problem.policy.unlike_noise * problem.noise:
        return None
    exact = {p.name for p in problem.arrangement.parameters if p.uncertainty == 0}
    constants = dict.fromkeys(n for e in problem.arrangement.elements for n in (e.stiffness, e.damping) if n in exact)
    if constants:
        on_progress("trying the rig with other constants")
    for name in constants:
        other = replace(problem_of(with_unknown(problem.rig, str(name)), problem.recordings), policy=problem.policy)
        found = fit(replace(other, noise=problem.noise, noise_known=problem.noise_known), fine=True)
        if screened(found).p_value >= problem.policy.level and not _worse(found, named):
            value = found.values[str(name)]
            return Otherwise(f"leaves the {name} unknown, which is then {value:.5g}", found)
    return None


def hold_that_explains(
    linear: SimulatedFit,
    screened: Callable[[SimulatedFit], Screening],
    on_progress: OnProgress,
    named: SimulatedFit | None = None,
) -> Described:
    """Return the linear rig with inputs that do between samples what leaves nothing beyond noise; None if none does.

    And predicts the choosing blocks no worse than what is ``named``, or than the rig as described.

    Parameters
    ----------
    screened
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
            if mean_of(found.by_block(CHOOSE)) <= best and screened(found).p_value >= level:
                return Otherwise(f"says 'recording: {{hold: {hold}}}'", found)
    return None


def contact_turned_round(
    linear: SimulatedFit, known: Sequence[Mechanism], on_progress: OnProgress, named: SimulatedFit | None = None
) -> Described:
    """Return what explains with the bodies of a preloaded contact named in the other order; None where nothing does.

    Whether its deformation is its approach follows from that order and from which way the sensors count. It explains no
    worse than what is ``named``, for which free parameters cost.
    """
    problem, laws = linear.problem, [m for m in known if isinstance(m, ForceLaw) and m.preloaded]
    rig, elements = problem.rig, problem.arrangement.elements
    for i, e in enumerate(elements):
        row = tuple((body, -c) for body, c in e.row if not isinstance(c, str))
        if not e.preload or len(row) < len(e.row):
            continue
        on_progress(f"trying the bodies of the {e.name} in the other order")
        turned = replace(rig.arrangement, elements=(*elements[:i], replace(e, row=row), *elements[i + 1 :]))
        other = replace(problem, rig=replace(rig, arrangement=turned))
        begun = fit(other, (), linear, fine=True)
        best: dict[str, Score] = {}
        rest = AtRest.of(e, begun.values, rig.preload_n)
        for score in screen(other, begun, laws).scores:
            if score.term.place == (i,) and not _alike_both_ways(score.term, rest):
                best.setdefault(score.term.mechanism.id, score)
        for name, score in list(best.items())[:TURNED]:
            found = joined_to(other, begun, score)
            found = fit(other, found.terms, found, fine=True)
            if screen(other, found, known).p_value >= problem.policy.level and not _worse(found, named):
                said = f"names the bodies of the {e.name} in the other order: it is {name.replace('_', ' ')} there"
                return Otherwise(said, found, e)
    return None


def _bends_in_contact(fitted: SimulatedFit) -> bool:
    """Whether a preloaded contact bears a force that no law of contacts has, as one turned round would seem to."""
    elements = fitted.problem.arrangement.elements
    laws = [(t.mechanism, t.place) for t in fitted.terms]
    return any(isinstance(m, ForceLaw) and not m.preloaded and any(elements[i].preload for i in at) for m, at in laws)


def _alike_both_ways(term: Term, rest: AtRest) -> bool:
    """Whether the force of a law is the same the other way round: then nothing hangs by the order of the bodies."""
    law, angle = term.mechanism, 2 * np.pi * np.arange(POINTS) / POINTS
    assert isinstance(law, ForceLaw)  # noqa: S101
    reach = REACH * rest.preload / max(rest.stiffness, 1e-300)
    d, v, p = reach * np.sin(angle), reach * np.cos(angle), law.packed(term.values, rest, 1.0 / POINTS)[None]
    (there,), (back,) = (along(law.law, p, s * d, s * v, 0.0, 1.0 / POINTS, np.zeros(MEMORY)) for s in (1.0, -1.0))
    return bool(np.abs(there + back).max() <= ROUNDING * np.abs(there).max())


def _worse(found: SimulatedFit, named: SimulatedFit | None) -> bool:
    return named is not None and lead_of(found, named) < 0
