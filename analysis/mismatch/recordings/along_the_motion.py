"""Force laws ranked by what a regression along the motion leaves of each: only what comes near the best is fitted.

The thresholds were chosen on rigs of decision 187, `LITTLE` on the Silverbox.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings
from analysis.mismatch.recordings.ranking import Ranking, with_time
from analysis.mismatch.recordings.regression import Regressed, Regression, of_elements, regression_of
from analysis.mismatch.score_test import Score
from sim_backend.learned.curves import CROWDS, DAMPING, OF_DEFLECTION, OF_RATE, POINTS, SLOPED, Curve, begin_values
from sim_backend.learned.families import CURVES
from sim_backend.learned.forms import LEARNED, Form
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism
from sim_backend.mechanisms.places import Place

STANDS_OUT: Final = 0.5  # of what no law leaves, that one must leave at most for the motion to tell laws apart
NEAR: Final = 2.0  # times the least that any law leaves, up to which a learned law is fitted
IN_REACH: Final = 4.0  # the same, of laws that are listed
LITTLE: Final = 0.02  # of what no law leaves: what is named and leaves less no curve displaces (Silverbox: 0.005)
LITTLE_OF_TWO: Final = 0.002  # the same, of two listed laws in an element
MOST: Final = 5  # laws that are fitted
PAIRS: Final = 3  # of listed laws in an element, that are bent
OTHERS: Final = 3  # of what is no force, that are fitted beside learned laws
NO_FINER: Final = 1.05  # times what a curve of more points leaves, up to which one of fewer is taken


def ranked_along(begun: SimulatedFit, known: Sequence[Mechanism], others: Ranking) -> Ranking:
    """Rank forces by what they leave along the motion shown, before all else; of learned laws curves among them.

    Parameters
    ----------
    others
        Ranking of the same by score tests, which stands where there is no such motion.
    """
    regression = regression_of(begun)
    if regression is None:
        return others
    learned = any(m.source == LEARNED for m in known)
    curves = any(isinstance(m, Curve) and m.source == LEARNED for m in known)  # one that was kept is listed
    found = [*laws_along(regression, known), *(curves_along(regression) if curves else [])]
    if min((one.left for one in found), default=math.inf) > STANDS_OUT * regression.without:
        return others
    times = NEAR if learned else IN_REACH
    # what goes with time and what goes with amplitude make up for each other along a decay
    apart = [[one for one in found if with_time(one.term.mechanism) is timed] for timed in (False, True)]
    near = [one for laws in apart for one in _within(laws, times)]
    no_forces = [s for s in others.scores[: others.finalists] if not isinstance(s[0].term.mechanism, ForceLaw)]
    by_key = {scores[0].term.key: scores[0] for scores in others.scores}
    forces = [(_score(regression, one, by_key.get(one.term.key)),) for one in near]
    first: list[tuple[Score, ...]] = [*forces, *(no_forces[:OTHERS] if learned else no_forces)]
    keys = {scores[0].term.key for scores in first}
    return Ranking((*first, *(s for s in others.scores if s[0].term.key not in keys)), len(first))


def _within(laws: Sequence[Regressed], times: float) -> list[Regressed]:
    """Return the laws that leave up to so many times the least, the best first."""
    ranked = sorted(laws, key=lambda one: one.left)
    return [one for one in ranked if one.left <= times * ranked[0].left][:MOST]


def one_law_tells(linear: SimulatedFit, known: Sequence[Mechanism], learned: Sequence[Mechanism]) -> bool:
    """Whether a single learned law leaves as little as noise along the motion, and far less than any other reason.

    These are: a force law that is listed, two of them in the same element, and other values of the rig's stiffnesses
    and dampings, whether declared or not.
    """
    regression, freed = regression_of(linear), Regression.of(linear, of_elements(linear.problem.arrangement))
    if regression is None or freed is None:
        return False
    noise = linear.problem.policy.unlike_noise * linear.problem.noise
    timeless = [m for m in learned if not (linear.problem.one_decay and with_time(m))]
    best = min([*laws_along(regression, timeless), *curves_along(regression)], key=lambda one: one.left, default=None)
    if best is None or best.left > noise:
        return False
    least = max(IN_REACH * best.left, LITTLE * regression.without)  # no listed law is quite that of a real rig
    if least >= min([freed.without, *(one.left for one in laws_along(regression, known))]):
        return False
    of_two = max(IN_REACH * best.left, noise, LITTLE_OF_TWO * regression.without)  # which bend further than one does
    return of_two < _two_of(regression, known, best.term.place)


def with_largest_fitted(linear: SimulatedFit) -> SimulatedRecordings:
    """Return the problem with recordings divided so that the largest motion that each shows is in a block that fits.

    A curve says nothing of motions beyond those that it was learned from.
    """
    problem, regression = linear.problem, regression_of(linear)
    if regression is None:
        return problem
    divided = []
    for recorded, motion in zip(problem.recordings, regression.motions, strict=True):
        sizes = np.abs(motion.displacement)
        largest = int(np.argmax(np.max(sizes / np.maximum(sizes.max(axis=0), 1e-300), axis=1)))
        divided.append(recorded.fitted_at(recorded.fitted.start + largest))
    same = all(new is old for new, old in zip(divided, problem.recordings, strict=True))
    return problem if same else replace(problem, recordings=tuple(divided))


def _two_of(regression: Regression, known: Sequence[Mechanism], place: Place) -> float:
    """Return what the best two listed laws leave together, in an element that moves as that of a place."""
    rig = regression.fitted.problem.arrangement
    row = rig.elements[place[0]].row
    trials = [
        Term(law, values, at) for law in known
        if isinstance(law, ForceLaw) and regression.fitted.problem.allows(law)
        for at in law.places(rig) if rig.elements[at[0]].row == row
        for values in law.trials(regression.fitted.problem.scale_of(regression.fitted, at[0]))
    ]  # fmt: skip
    bent = [one.term for one in laws_along(regression, known) if rig.elements[one.term.place[0]].row == row]
    pairs = [(a, b) for i, a in enumerate(bent) for b in [*bent[i + 1 :], *trials] if a.key != b.key]
    tried = [one for pair in pairs if (one := regression.regressed(*pair, bent=False)) is not None]
    best = sorted(tried, key=lambda one: one.left)[:PAIRS]
    found = [one.left for pair in best if (one := regression.regressed(*pair.terms)) is not None]
    return min(found, default=math.inf)


def laws_along(regression: Regression, known: Iterable[Mechanism]) -> list[Regressed]:
    """Return every force law of these in every place, as it fits best along the motion."""
    rig = regression.fitted.problem.arrangement
    laws = [m for m in known if isinstance(m, ForceLaw) and regression.fitted.problem.allows(m)]
    return [one for law in laws for place in law.places(rig) if (one := _best(regression, law, place)) is not None]


def _best(regression: Regression, law: ForceLaw, place: Place) -> Regressed | None:
    """Return a law bent as fits best, from the best of its trials as they are."""
    fitted = regression.fitted
    trials = law.trials(fitted.problem.scale_of(fitted, place[0]))
    tried = [r for values in trials if (r := regression.regressed(Term(law, values, place), bent=False)) is not None]
    return regression.regressed(min(tried, key=lambda r: r.left).term) if tried else None


def curves_along(regression: Regression) -> list[Regressed]:
    """Return curves of each kind in each element, of no more points than tell."""
    rig = regression.fitted.problem.arrangement
    found = [
        _curve(regression, kind, number, place)
        for kind in (OF_DEFLECTION, OF_RATE, DAMPING)
        for number, mechanism in enumerate(_forms(kind, "")[0].mechanisms)
        for place in mechanism.places(rig)
    ]
    return [one for one in found if one is not None]


def _curve(regression: Regression, kind: str, number: int, place: Place) -> Regressed | None:
    """Return the curve of a kind in a place with the fewest points that tell nearly as much as more of them.

    Parameters
    ----------
    number
        Of its mechanisms, without and with a preload, the one that acts there.
    """
    problem, elements = regression.fitted.problem, [regression.fitted.problem.arrangement.elements[e] for e in place]
    unknown = {p.name for p in problem.arrangement.parameters if math.isinf(p.uncertainty)}
    own = {e.stiffness if kind == OF_DEFLECTION else e.damping for e in elements}
    forms, reach = _forms(kind, "" if own <= unknown else SLOPED), regression.reach(place[0])
    force = problem.scale_of(regression.fitted, place[0]).force
    tried = [
        regression.regressed(Term(form.mechanisms[number], begin_values(form, *reach, force, crowded), place))
        for form in forms for crowded in CROWDS
    ]  # fmt: skip
    known = [one for one in tried if one is not None]
    least = min((one.left for one in known), default=math.inf)
    return next((one for one in known if one.left <= NO_FINER * least), None)


def _forms(kind: str, own: str) -> list[Form]:
    """Return the curves of a kind, with what is theirs at rest or without, from few points to many."""
    return [form for points in POINTS for form in CURVES if form.key == f"{kind}{own}_{points}"]


def _score(regression: Regression, one: Regressed, known: Score | None) -> Score:
    """Return the score of a law with the values that it has along the motion; ``known``: of a score test."""
    if known is not None:
        return replace(known, term=one.term, strength=1.0)
    return Score(one.term, regression.samples * math.log(regression.without / one.left), 1, 1.0, 0.0)
