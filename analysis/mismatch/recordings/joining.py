"""A mechanism fitted to recordings together with what stands already: where such fits begin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import NEAR_LINEAR, SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.model import Point, SimulationModel, side_by_side
from analysis.mismatch.recordings.motion import continued
from analysis.mismatch.recordings.recorded import FIT
from analysis.mismatch.recordings.regression import regression_of
from analysis.mismatch.recordings.second_impact import where_it_fell
from analysis.mismatch.recordings.signatures import weakened
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import started
from sim_backend.learned.curves import is_curve
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, SecondImpact

STRONGEST_START, WEAKEST_START = 30.0, 0.1  # trial strengths that a fit begins with at most and at least
LIGHTEST_START = 1e4  # the same, of a frame, whose trial is so many times as heavy as the rig
SHARES: Final = (1.0, 0.5, 0.25, 0.125, 0.0625)  # of the strength that a score test finds, that a fit may begin with
BODY_SHARES: Final = tuple(0.25**i for i in range(6))  # the same, of a body that is added
ASTRAY: Final = (
    4.0  # times what is left without a mechanism, beyond which a start with it is too strong (rig of decision 161)
)

Start = tuple[SimulatedRecordings, Sequence[Term], SimulatedFit | None, bool]
"""What is fitted with which terms, the fit it begins from, and whether its phase is followed from the beginning on."""


def joined_to(
    problem: SimulatedRecordings, current: SimulatedFit, score: Score, to_beat: float = math.inf
) -> SimulatedFit:
    """Fit a mechanism together with what stands already, from several starts.

    A fit that comes too slowly nearer to an objective ``to_beat`` is given up.
    """
    strongest = STRONGEST_START if score.term.mechanism.strength else LIGHTEST_START
    term = started(score, WEAKEST_START, strongest)
    if isinstance(term.mechanism, SecondImpact):
        terms = (*current.terms, term)
        return where_it_fell(current, term, lambda begun: fit(problem, terms, begun, to_beat=to_beat))
    far = current.missed >= NEAR_LINEAR  # what stands has lost the phase somewhere along the recording
    shown = along_the_motion(problem, current, term) if far or is_curve(term) else None
    if shown is not None and is_curve(term):
        begun = [shown]
    else:
        full, weaker = (*current.terms, term), (*current.terms, not_astray(problem, current, term))
        begun = [(problem, weaker, current, False)]
        if isinstance(term.mechanism, AddedBody) and any(r.free for r in problem.recordings):
            # at its full strength it changes frequencies: the phase is followed from the beginning on
            begun.append((problem, full, current, True))
        if far:
            staged = (problem, weaker, current, True)
            begun += [shown] if shown is not None else [staged] if begun[-1] != staged else []

    def fitted(
        of: SimulatedRecordings, terms: Sequence[Term], begin: SimulatedFit | None, staged: bool
    ) -> SimulatedFit:
        return fit(of, terms, begin, staged=staged, to_beat=to_beat)

    return min(side_by_side(fitted, begun), key=lambda f: f.scatter)


def along_the_motion(problem: SimulatedRecordings, current: SimulatedFit, term: Term) -> Start | None:
    """Return the start that a regression along the motion shown gives; None where it explains nothing more."""
    if not isinstance(term.mechanism, ForceLaw):
        return None
    regression = regression_of(current)
    found = None if regression is None else regression.regressed(term)
    if regression is None or found is None or found.left >= regression.without:
        return None
    begin = replace(problem, constants=found.constants, states=found.states)
    return begin, (*current.terms, found.term), None, False


def not_astray(problem: SimulatedRecordings, current: SimulatedFit, term: Term) -> Term:
    """Return a force law or an added body with so much of its strength that the motion is still near the recordings.

    A score test is to first order. A spring that softens as much as it says may have no place of rest any more, and
    from where a motion has run away no slope leads back; on a frame that gives way, the rig is out of phase before long
    in a recording with little noise.
    """
    shares = BODY_SHARES if isinstance(term.mechanism, AddedBody) else SHARES
    weaker = [_lighter(term, share) or weakened(term, share) for share in shares]
    tried = [t for t in weaker if t is not None]
    if not tried:
        return term
    simulation = current.simulation.with_terms((*current.terms, term), current.values)
    states = [current.state(i) for i in range(len(current.own))]
    own = continued(simulation, states, current.simulation, current.own)
    model = SimulationModel(simulation, own, (FIT,), problem.looked_at)
    points = [np.clip(simulation.begin(t), model.low, model.high) for t in tried]
    squares = [np.sum(model.used([(x, o) for x in points], i) ** 2, axis=(1, 2)) for i, o in enumerate(own)]
    without = SimulationModel(current.simulation, current.own, (FIT,), problem.looked_at)
    before = without.evaluate(Point(current.x, current.own)).objective
    near = np.flatnonzero(np.sum(squares, axis=0) <= ASTRAY * before)
    return tried[near[0] if near.size else -1]


def _lighter(term: Term, share: float) -> Term | None:
    """Return an added body with a share of its effect: lighter, or heavier if it is what a rig stands on."""
    mechanism = term.mechanism
    if not isinstance(mechanism, AddedBody) or not mechanism.body or not term.phase_locked:
        return None
    factor = share if mechanism.strength in mechanism.body else 1 / share
    return term.within({name: factor * term.values[name] for name in mechanism.body})
