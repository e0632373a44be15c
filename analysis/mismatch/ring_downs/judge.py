"""Candidates judged by chi-squared, and by impacts that took no part in fitting."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.mismatch.chi_squared import evidence
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.problem import OnProgress, silent
from analysis.mismatch.ring_downs.apart import borne_out
from analysis.mismatch.ring_downs.candidates import (
    Begin,
    Steps,
    continued_candidate,
    converged,
    elsewhere,
    explains,
    fitted_candidate,
    lengthened_candidate,
    looked_for_again,
    screened_evidence,
    started,
    variants,
    with_stiffness,
    without_idle_ones,
)
from analysis.mismatch.ring_downs.continuation import declared_scales
from analysis.mismatch.ring_downs.first_look import FirstLook, Key, first_look
from analysis.mismatch.ring_downs.fit import Start, fit
from analysis.mismatch.ring_downs.held_out import held_out_afterwards, held_out_fit, split
from analysis.mismatch.ring_downs.order import Order, by_mechanism
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import (
    Candidate,
    Judge,
    LeftOver,
    Selection,
    State,
    name_of,
)
from sim_backend.mechanisms.kinds import AddedBody, Mechanism

MOST_TRIED = 4  # mechanisms that are fitted until two of them are admissible
RIVALS = 2  # mechanisms that a first step fits in full at least: the best and the runner-up

Candidates = tuple[Candidate[RingDownFit], ...]


@dataclass(frozen=True, slots=True)
class ImpactJudge(Judge[RingDownFit]):
    """See `Judge`.

    Attributes
    ----------
    held_out
        Numbers of the segments that take no part in fitting.
    hints
        Fits with constants of the training's groups: what they name is fitted in any case, from there as well.
    must_reach
        Objective that a first mechanism must reach; finite where it contests another, and a rough fit will do.
    learns
        Whether laws are learned: a first look is taken at those without a strength alone, which are the whole force.
    """

    problem: RingDowns
    training: RingDowns
    held_out: tuple[int, ...]
    known: Sequence[Mechanism]
    on_progress: OnProgress = silent
    hints: tuple[RingDownFit, ...] = ()
    must_reach: float = math.inf
    learns: bool = False

    @classmethod
    def of(cls, problem: RingDowns, known: Sequence[Mechanism], on_progress: OnProgress = silent) -> ImpactJudge:
        """Hold some of the impacts out."""
        training, held = split(problem)
        return cls(problem, problem.only(training), held, known, on_progress)

    def baseline(self) -> RingDownFit:
        """Return the linear rig fitted to the impacts that are not held out."""
        return fit(self.training)

    def candidates(self, state: State[RingDownFit]) -> Candidates:
        """Fit the best screened mechanisms in full, each with those already accepted."""
        current, policy = state.current, self.problem.policy
        contest = state.first and self.must_reach < math.inf
        order, linear = self._order(state), self._linear(state)
        found: list[Candidate[RingDownFit]] = []
        explained, best = False, 0.0
        tried: set[Key] = set()
        for score in order.ranked():
            key = score.term.key
            behind = explained and order.behind(key)
            fitted = {mechanism for mechanism, _ in tried} | {score.term.mechanism.id}
            enough = len(fitted) > (policy.finalists if explained or contest else policy.most_finalists)
            runner_up = state.first and not contest and _is_runner_up(current, score, found)
            wanted = key in order.hinted or runner_up or (key in order.look.worth_fitting() and not behind)
            idle = enough or behind or not order.promising(score, best) or self.exhausted()
            if tried and not wanted and idle:
                found.append(Candidate(score, None, screened_evidence(score)))
                continue
            self.on_progress(f"fitting {name_of(score.term.mechanism)}")
            tried.add(key)
            to_beat = math.inf if wanted and not behind else current.objective - policy.serious * best
            to_beat = min(to_beat, self.must_reach) if contest else to_beat
            begin = order.begin(key)
            if begin is not None:
                one = lengthened_candidate(current, score, begin, to_beat)
            else:
                starts = [order.hinted[key]] if key in order.hinted else []
                starts += [(started(s), linear) for s in variants(order.scores[key], policy.hopeful)]
                one = fitted_candidate(current, score, starts, to_beat)
            best = max(best, one.evidence)
            explained = explained or explains(current, one)
            found.append(one)
        if not contest:
            found = found if explained else self._by_continuation(current, found, order.look)
            found = self._from_elsewhere(current, found, {k: v for k, v in order.scores.items() if k in tried})
        found = [c for c in found if borne_out(current, c)]
        found.sort(key=lambda c: (c.fit is None, -with_stiffness(c)))
        return tuple(found)

    def _order(self, state: State[RingDownFit]) -> Order:
        """Return what there is to fit; of a strong effect a first look is taken where nothing is hinted at."""
        current, policy = state.current, self.problem.policy
        hinted = {t.key: (t, hint) for hint in self.hints for t in hint.terms} if state.first else {}
        if not state.first or hinted or current.reduced_chi_squared < policy.strong:
            return Order(by_mechanism(state, hinted), policy, hinted=hinted)
        self.on_progress("fitting force laws to the first milliseconds")
        scores = by_mechanism(state, every_law=not self.learns)
        seen = {k: v for k, v in scores.items() if not self.learns or v[0].term.mechanism.strength is None}
        return Order(scores, policy, first_look(current, seen))

    def _linear(self, state: State[RingDownFit]) -> RingDownFit:
        """Return the fit that laws begin with; where not all of a strong effect are looked at, with declared masses."""
        current = state.current
        if not (state.first and self.learns) or current.reduced_chi_squared < self.problem.policy.strong:
            return current
        masses = Start(kept=current.arrangement.force_scales)
        return fit(current.problem, begin=declared_scales(current), start=masses)

    def _by_continuation(
        self, current: RingDownFit, candidates: list[Candidate[RingDownFit]], look: FirstLook
    ) -> list[Candidate[RingDownFit]]:
        """Look for force laws by continuation, the best first, until one explains; for the best in any case."""
        out: list[Candidate[RingDownFit]] = []
        continued = 0
        for c in sorted(candidates, key=lambda c: (c.fit is None, look.left(c.score.term.key), -c.evidence)):
            law = c.fit is not None and c.fit.only_laws
            if law and not any(explains(current, o) for o in out) and not (continued and self.exhausted()):
                self.on_progress(f"fitting {name_of(c.mechanism)} by continuation")
                c, continued = continued_candidate(current, c), continued + 1
            out.append(c)
        return out

    def _from_elsewhere(
        self,
        current: RingDownFit,
        candidates: list[Candidate[RingDownFit]],
        by_id: Mapping[tuple[str, tuple[int, ...]], list[Score]],
    ) -> list[Candidate[RingDownFit]]:
        """Fit added bodies from further starts, where that could matter."""
        policy = self.problem.policy
        least = policy.hopeful * max((c.evidence for c in candidates if c.fit is not None), default=0.0)
        out = []
        for c in candidates:
            body = isinstance(c.mechanism, AddedBody) and c.mechanism.body is not None
            hopeful = c.fit is None or c.evidence > least
            if body and hopeful and c.score.term.key in by_id and not self.exhausted():
                self.on_progress(f"fitting {name_of(c.mechanism)} from elsewhere")
                starts = elsewhere(current, by_id[c.score.term.key])
                again = fitted_candidate(current, c.score, starts, current.objective - c.evidence)
                c = max(c, again, key=lambda one: one.evidence)
            out.append(c)
        return out

    def fitted_alone(self, baseline: RingDownFit, scores: Sequence[Score]) -> RingDownFit | None:
        """Return the full fit of a mechanism beside the linear rig."""
        starts: list[Begin] = [(started(s), baseline) for s in variants(scores, self.problem.policy.hopeful)]
        return fitted_candidate(baseline, scores[0], starts, math.inf).fit

    def to_the_end(self, fitted: RingDownFit) -> RingDownFit:
        """Return the fit once no step gains anything."""
        return converged(fitted)

    def accepts(
        self, state: State[RingDownFit], candidates: Sequence[Candidate[RingDownFit]]
    ) -> tuple[Candidate[RingDownFit] | None, Mapping[int, float]]:
        """Accept the best candidate if it has evidence enough, a further one only if held-out impacts agree."""
        best = candidates[0] if candidates else None
        if best is None or best.fit is None:
            return None, {}
        if state.first:
            return (best if with_stiffness(best) > self.problem.policy.first_gain else None), {}
        enough = with_stiffness(best) > self._least_gain(state) and self._better_held_out(state.current, best)
        return (best if enough else None), {}

    def _least_gain(self, state: State[RingDownFit]) -> float:
        """Return the evidence that a further mechanism must have: as below, or most of what is left (see `after`)."""
        policy = self.problem.policy
        return max(
            policy.least_gain, min(self._clear_gain(state), policy.most_of_the_rest * state.screening.unexplained)
        )

    def _clear_gain(self, state: State[RingDownFit]) -> float:
        """Return the gain from which on something may be left beside a further one: laws are never exactly right."""
        policy, left = self.problem.policy, state.screening.unexplained
        explained = state.steps[0].before.objective - state.current.objective
        too_much = left > policy.may_be_left(len(state.current.terms)) * (explained + left)
        return min(policy.least_share * explained, policy.most_of_the_rest * left if too_much else math.inf)

    def _better_held_out(self, before: RingDownFit, added: Candidate[RingDownFit]) -> bool:
        """Whether held-out impacts are predicted better."""
        if added.fit is None or not self.held_out:
            return False
        as_fine = replace(added.fit, substeps=max(added.fit.substeps, before.substeps))  # its steps are no reason
        return self.held_out_fit(as_fine).chi_squared < self.held_out_fit(before).chi_squared

    def after(self, state: State[RingDownFit], accepted: Candidate[RingDownFit]) -> tuple[State[RingDownFit], bool]:
        """Go on with the accepted fit and look at what it leaves; a further one that is small must leave nothing."""
        policy, before = self.problem.policy, state.current
        if accepted.fit is None:
            return state, False
        self.on_progress("fitting to the end")
        current = converged(accepted.fit)
        gained = before.objective - current.objective
        self.on_progress("looking at what is left")
        screening = self.screen(current)
        if screening.p_value < policy.level and len(current.terms) > 1:
            self.on_progress("looking for the earlier ones again")
            again = looked_for_again(current)
            if again is not current:
                current, screening = again, self.screen(again)
        if len(state.steps) > 1 and screening.p_value < policy.level and gained < self._clear_gain(state):
            refused = replace(state.steps[-1], accepted=None)
            return State(before, state.screening, (*state.steps[:-1], refused)), False
        # one more is looked for unless nothing is left, or too much even if every further one gained as much
        room = (policy.most_terms - len(current.terms)) * gained
        more = screening.p_value <= policy.level and screening.unexplained <= room
        self.training.budget.spent = 0.0  # each mechanism has a budget of its own
        return State(current, screening, state.steps), more

    def outcome(self, baseline: State[RingDownFit], state: State[RingDownFit]) -> Selection[RingDownFit]:
        """Return the selection; earlier mechanisms that gain little beside the later ones are left out."""
        if not state.steps:
            return self._ended(baseline, state)
        kept = state
        policy, first = self.problem.policy, state.steps[0]
        twice = 2 * policy.may_be_left(1) * first.screening.unexplained
        if state.screening.p_value > policy.level or state.screening.unexplained < twice:
            lean, steps = without_idle_ones(state.current, state.steps)
            if lean is not state.current:
                return self._ended(baseline, State(lean, self.screen(lean), steps))
        return self._ended(baseline, kept)

    def _ended(self, baseline: State[RingDownFit], state: State[RingDownFit]) -> Selection[RingDownFit]:
        """Return a selection that ends here: explained, or patched together."""
        policy, best, screening = self.problem.policy, state.current, state.screening
        left = screening.unexplained if baseline.screening.p_value < policy.level else 0.0
        explained = baseline.current.objective - best.objective
        share = left / max(explained + left, 1e-300)
        patched = screening.p_value < policy.level and share > policy.may_be_left(len(best.terms))
        unnamed = self._lead_of_the_unnamed(baseline, state)
        chosen = best if best.terms and not patched and unnamed < policy.unnamed else None
        over = LeftOver(left, screening.p_value, share, unnamed)
        return Selection(self, baseline.current, baseline.screening, state.steps, chosen, best, screening, over)

    def _lead_of_the_unnamed(self, baseline: State[RingDownFit], state: State[RingDownFit]) -> float:
        """Return by how much a single force without a name has more evidence than all that is named together."""
        named = self._explained(baseline.current, state.current, state.steps)
        return evidence(baseline.screening.free.best_alone, 0, 1) - named

    def _explained(self, baseline: RingDownFit, current: RingDownFit, steps: Steps) -> float:
        """Return the evidence of all mechanisms that were accepted in steps, together."""
        named = baseline.objective - current.objective
        accepted = [(s.accepted, s.before) for s in steps if s.accepted is not None]
        for place, (one, before) in enumerate(accepted):
            gain = before.objective - one.fit.objective if one.fit is not None else 0.0
            named -= gain - one.evidence + (self.problem.policy.least_gain if place else 0.0)
        return named

    def evidence_of(self, selection: Selection[RingDownFit]) -> float:
        """Return the evidence of all that a selection accepted."""
        return self._explained(selection.baseline, selection.best, selection.steps)

    def gained(self, before: RingDownFit, after: RingDownFit, parameters: int) -> float:
        """Return the evidence of a fit with so many parameters more than the one before."""
        return evidence(before.objective - after.objective, 0, parameters, self.problem.policy.parameter_cost)

    def knowing(
        self, known: Sequence[Mechanism], policy: SelectionPolicy, to_beat: RingDownFit | None = None
    ) -> ImpactJudge:
        """Return a judge of the same impacts that knows other mechanisms and has other thresholds."""
        reach = math.inf if to_beat is None else to_beat.objective + policy.parameter_cost
        problem = replace(self.problem, policy=policy)
        return replace(self, known=known, hints=(), must_reach=reach, learns=True, problem=problem)

    def another_first(self, candidates: Sequence[Candidate[RingDownFit]]) -> bool:
        """Whether the second candidate is nearly as good as the first."""
        first, second = candidates[:2]
        return second.fit is not None and second.evidence > self.problem.policy.hopeful * first.evidence

    def held_out_fit(self, fitted: RingDownFit) -> RingDownFit:
        """Return the fit to held-out impacts: only what belongs to each impact is fitted on them."""
        return held_out_fit(self.problem.only(self.held_out), fitted)

    def lost_on_held_out(self, selection: Selection[RingDownFit]) -> bool:
        """Whether what leaves something over is lost on held-out impacts: it only suits those it was fitted to."""
        policy, best = self.problem.policy, selection.chosen
        if best is None or selection.left.p_value > policy.level:
            return False
        after, before = self._held_out(best), self._held_out(selection.baseline)
        if after is None or before is None:
            return False
        missed = policy.left_over_held_out * (before.reduced_chi_squared - 1)
        return after.reduced_chi_squared > max(policy.strong, 1 + missed)

    def _held_out(self, fitted: RingDownFit) -> RingDownFit | None:
        """Return the same where each impact has constants of its own, too; None of a single impact."""
        return self.held_out_fit(fitted) if self.held_out else held_out_afterwards(fitted)

    def held_out_rms(self, fitted: RingDownFit) -> tuple[float, int]:
        """Return the rms of the residual on held-out impacts, m/s2, and how many they are; NaN where none is."""
        found = self._held_out(fitted)
        if found is None:
            return math.nan, 0
        mean = np.average(found.rms() ** 2, weights=[r.size for r in found.residuals])
        return math.sqrt(mean), len(found.residuals)


def _is_runner_up(current: RingDownFit, score: Score, found: Sequence[Candidate[RingDownFit]]) -> bool:
    """Whether a mechanism comes next while fewer than the best and its runner-up are fitted.

    A score test may promise less than half of what a full fit gains: what is told of the runner-up is its full fit.
    """
    tried = {c.id for c in found}
    if score.term.mechanism.id in tried or len(found) >= MOST_TRIED:
        return False
    return len({c.id for c in found if c.fit is not None and borne_out(current, c)}) < RIVALS
