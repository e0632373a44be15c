"""The selection for impacts: with constants of its own for every impact where these scatter, without peculiar ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import pearsonr

from analysis.mismatch.answer import SetAside
from analysis.mismatch.chi_squared import evidence
from analysis.mismatch.problem import Constants, OnProgress
from analysis.mismatch.ring_downs.apart import (
    apart,
    follow_strength,
    hardest_of_their_loads,
    no_law_explains,
    set_aside,
    share_of,
    without,
)
from analysis.mismatch.ring_downs.fit import Start, Stop, fit
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.selection import Instead, Selection, State, select
from sim_backend.mechanisms.kinds import Mechanism

Found = tuple[Selection[RingDownFit], tuple[SetAside, ...]]
MOST_TESTS = 1e4  # more than a screening makes: by one p-value below the level over this its overall one is below, too


@dataclass(slots=True)
class _Begun:
    """Where a selection begins: the linear rig as fitted, screened when that is asked for first."""

    judge: ImpactJudge
    current: RingDownFit
    _state: State[RingDownFit] | None = None

    @classmethod
    def of(cls, judge: ImpactJudge) -> _Begun:
        """Fit the linear rig to what is not held out."""
        judge.on_progress("fitting the linear rig")
        return cls(judge, judge.baseline())

    @property
    def state(self) -> State[RingDownFit]:
        """The fit with the scores of all mechanisms."""
        if self._state is None:
            self.judge.on_progress("screening")
            self._state = State(self.current, self.judge.tested(self.current, self.judge.screen(self.current)))
        return self._state

    @property
    def consistent(self) -> bool:
        """Whether the linear rig will do; where that is plain without any mechanism's score, none is computed."""
        level = self.judge.problem.policy.level
        if self._state is None:
            plain, _ = self.judge.training.unmodelled(self.current)
            if min(plain, default=1.0) < level / MOST_TESTS:
                return False
        return self.state.screening.p_value >= level

    def selected(self, instead: Instead[RingDownFit] | None = None) -> Selection[RingDownFit]:
        """Return the selection from here."""
        return select(self.judge, self.state, instead=instead)


def select_for_impacts(
    problem: RingDowns,
    known: Sequence[Mechanism],
    on_progress: OnProgress,
    instead: Instead[RingDownFit] | None = None,
) -> Found:
    """Select mechanisms, and say which impacts were set aside because they show what no other one does.

    Few impacts are set aside where the linear rig explains all others and no law is near to what they show, unless they
    are the hardest of their loads; or where nothing explains them all, but something the others, and they are not the
    strongest. For ``instead`` see `select`.
    """
    begun = _begun(problem, known, on_progress)
    last = begun[-1]
    if last.consistent:
        return last.selected(), ()
    odd = apart(last.current)
    rest = without(problem, _names(last.current, odd)) if odd else None
    hard = hardest_of_their_loads(last.current, odd)
    if rest is not None and not hard and no_law_explains(last.current, last.state.screening, odd):
        on_progress("again, without what a few impacts alone show")
        others = _begun(rest, known, on_progress)[-1]
        if others.consistent:
            return others.selected(), set_aside(last.current, odd)
    found, ended, aside = _selected(begun, instead)
    judge = found.judge
    if isinstance(judge, ImpactJudge) and judge.lost_on_held_out(found):
        found = replace(found, chosen=None)
    if found.chosen is not None:
        return found, aside
    return _without_odd_ones(problem, known, on_progress, ended.best) or (found, ())


def _without_odd_ones(
    problem: RingDowns, known: Sequence[Mechanism], on_progress: OnProgress, best: RingDownFit
) -> Found | None:
    """Try again without the few impacts in which the best explanation leaves anything; None where that is no help.

    Impacts that are stronger than the others stay: what the rig does when tapped hard is no peculiarity. So do those
    beside which the others leave as much, little in each.
    """
    odd = apart(best)
    if odd and share_of(best, odd) < problem.policy.odd_share:
        return None
    rest = without(problem, _names(best, odd)) if odd and not follow_strength(best, odd) else None
    if rest is None:
        return None
    on_progress("again, without what a few impacts alone show")
    others = _begun(rest, known, on_progress)
    again = others[-1].selected() if others[-1].consistent else _selected(others)[0]
    explained = again.chosen is not None or others[-1].consistent
    return (again, set_aside(best, odd)) if explained else None


def _names(fitted: RingDownFit, numbers: Sequence[int]) -> set[str]:
    return {fitted.segments[i].name for i in numbers}


def _begun(problem: RingDowns, known: Sequence[Mechanism], on_progress: OnProgress) -> tuple[_Begun, ...]:
    """Return where a selection begins; the same with constants of its own for every impact where these scatter."""
    first = _Begun.of(ImpactJudge.of(problem, known, on_progress))
    if first.consistent or scattered(first.current) is None:
        return (first,)
    on_progress("again, with constants of its own for every impact")
    return first, _begun_for_each_impact(first.judge)


def _begun_for_each_impact(judge: ImpactJudge) -> _Begun:
    return _Begun.of(ImpactJudge.of(judge.problem.per_impact_constants(), judge.known, judge.on_progress))


def _selected(
    begun: tuple[_Begun, ...],
    instead: Instead[RingDownFit] | None = None,
) -> tuple[Selection[RingDownFit], Selection[RingDownFit], tuple[SetAside, ...]]:
    """Select with constants of each load first, then with those of each impact.

    Returns
    -------
    tuple
        What counts, the last selection, and impacts that were set aside.
    """
    plain = begun[0].selected(instead)
    if plain.chosen is not None:
        again, aside = _refined(begun, plain, plain.chosen)
        return again, again, aside
    if len(begun) == 1 or not _may_be_scatter(plain):
        return plain, plain, ()
    again = begun[-1].selected()
    # where nothing is named, what is said is said of the linear rig that explains more: scatter is not missing physics
    return (again if again.chosen is not None or again.p_value > plain.p_value else plain), again, ()


def _refined(begun: tuple[_Begun, ...], plain: Selection[RingDownFit], chosen: RingDownFit) -> Found:
    """Select again where what a named mechanism leaves may be scatter of the constants, or peculiar to few impacts.

    A strong effect hides both at first.
    """
    judge = begun[0].judge
    problem, level = judge.problem, judge.problem.policy.level
    if plain.left.p_value >= level:
        return plain, ()
    own = scattered(chosen)
    last = own or chosen
    odd = apart(last)
    rest = without(problem, _names(last, odd)) if odd and not follow_strength(last, odd) else None
    if own is None and rest is None:
        return plain, ()
    if own is None:
        judge.on_progress("again, without what a few impacts alone show")
        other = _Begun.of(ImpactJudge.of(rest or problem, judge.known, judge.on_progress))
    elif rest is None and len(begun) > 1:
        other = begun[1]
    else:
        judge.on_progress("again, with constants of its own for every impact")
        other = _begun_for_each_impact(replace(judge, problem=rest or problem))
    hint = replace(chosen, constants=_own_constants(other.judge.problem, chosen, own))
    again = select(replace(other.judge, hints=(hint,)), other.state)
    better = again.chosen is not None and again.left.p_value > plain.left.p_value
    return (again, set_aside(last, odd) if rest is not None else ()) if better else (plain, ())


def scattered(baseline: RingDownFit) -> RingDownFit | None:
    """Return the fit with constants of every impact where they differ at a load by more than noise, and by chance.

    That is not missing physics: what differs must not follow the strength of the tap.
    """
    policy, segments = baseline.problem.policy, baseline.problem.experiment.segments
    free, gained = _freed(baseline)
    if free is None or gained < policy.scatter_evidence:
        return None
    stiffness = np.log(free.constants.load[:, 0])
    strength = np.array([math.log(float(np.abs(a).max())) for a in free.amplitudes])
    for group in range(len(baseline.constants.load)):
        at = [i for i, s in enumerate(segments) if s.group == group]
        stiffness[at] -= stiffness[at].mean()
        strength[at] -= strength[at].mean()
    return free if float(pearsonr(stiffness, strength).pvalue) > policy.level else None


def _may_be_scatter(plain: Selection[RingDownFit]) -> bool:
    """Whether constants of every impact take a good part of what a selection leaves: all is worth another look then."""
    _, gained = _freed(plain.best)
    return gained > plain.problem.policy.scatter_share * plain.left.chi_squared


def _freed(fitted: RingDownFit) -> tuple[RingDownFit | None, float]:
    """Return a fit with constants of its own for every impact, and its evidence; None and 0 where it has them."""
    if fitted.constants.load.shape[1] == 0 or fitted.problem.scattered:
        return None, 0.0
    start = Start(amplitudes=fitted.amplitudes if fitted.nonlinear else ())
    problem = fitted.problem.per_impact_constants()
    begin = replace(fitted, constants=_own_constants(problem, fitted))
    free = fit(problem, fitted.terms, begin, start, Stop(known=False))
    freed = (len(fitted.segments) - len(fitted.constants.load)) * fitted.constants.load.shape[1]
    return free, evidence(fitted.objective - free.objective, freed)


def _own_constants(problem: RingDowns, *fits: RingDownFit | None) -> Constants:
    """Return constants for every group of a problem: of its impact where the last fit has it, else of its load."""
    known = [f for f in fits if f is not None]
    of_load = {s.preload_n: f.constants.load[s.group] for f in known for s in f.segments}
    of_impact = {s.name: f.constants.load[s.group] for f in known for s in f.segments}
    load = {s.group: of_impact.get(s.name, of_load[s.preload_n]) for s in problem.experiment.segments}
    return replace(known[-1].constants, load=np.array([load[g] for g in range(len(load))]))
