"""Candidates judged by blocks of the recordings: some fit, others choose, others are held out.

Mechanisms are added as long as the choosing blocks get better by more than chance and by a share of all that the linear
rig missed; where a force of any shape would take away much of what they leave, nothing is named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.stats import t as student

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.problem import OnProgress, silent
from analysis.mismatch.recordings.along_the_motion import ranked_along
from analysis.mismatch.recordings.blocks import (
    chooses_no_worse,
    likelihood_ratio,
    mean_of,
    missed_still,
    over_noise,
    p_of_colour,
    predicts_no_better,
    ratio_in,
    share_by_scores,
)
from analysis.mismatch.recordings.costs import cost_of, lead_of, rings_at_a_harmonic
from analysis.mismatch.recordings.fit import NEAR_LINEAR, SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.fitted_once import FittedOnce
from analysis.mismatch.recordings.foot_or_mount import begun_from_another
from analysis.mismatch.recordings.free_force import free_share
from analysis.mismatch.recordings.gain_beside_draws import gain_beside_draws
from analysis.mismatch.recordings.held_out import FinalFits
from analysis.mismatch.recordings.joining import joined_to
from analysis.mismatch.recordings.linear_rig import linear_fit
from analysis.mismatch.recordings.made_ready import made_ready
from analysis.mismatch.recordings.other_rigs import begun_from_equal_rigs, likelier_rig
from analysis.mismatch.recordings.otherwise import Described, explained_otherwise
from analysis.mismatch.recordings.racing import Competition, converged, told_in_any_case, within_reach
from analysis.mismatch.recordings.ranking import Ranking, simplest, with_time
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.recordings.reweighing import exchanged, weighed_together, without_idle_ones
from analysis.mismatch.recordings.sharper import sharper
from analysis.mismatch.recordings.start_check import worse_than_zero
from analysis.mismatch.recordings.steady import SteadyFit, Sweep, fit_again, fit_sweeps
from analysis.mismatch.recordings.wrong_samples import without_wrong_samples
from analysis.mismatch.score_test import Score, Screening, screen
from analysis.mismatch.selection import Candidate, Judge, LeftOver, Selection, SelectionStep, State, started
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.kinds import AddedBody, Mechanism, SecondImpact

Candidates = tuple[Candidate[SimulatedFit], ...]


@dataclass(frozen=True, slots=True)
class BlockJudge(Judge[SimulatedFit]):
    """See `Judge`.

    Attributes
    ----------
    sweeps
        Steady responses of the same rig, amplitude without time; ``steady`` is the linear rig's fit to them.
    rival
        A fit that candidates have to reach to matter.
    """

    problem: SimulatedRecordings
    known: Sequence[Mechanism]
    on_progress: OnProgress = silent
    sweeps: tuple[Sweep, ...] = ()
    steady: SteadyFit | None = None
    rival: SimulatedFit | None = None
    screened: dict[tuple[int, int], tuple[SimulatedFit, Screening]] = field(default_factory=dict, compare=False)
    described: dict[int, tuple[SimulatedFit, Described]] = field(default_factory=dict, compare=False)
    finals: FinalFits = field(default_factory=FinalFits, compare=False)
    fitted: FittedOnce = field(default_factory=FittedOnce, compare=False)

    @classmethod
    def of(
        cls,
        problem: SimulatedRecordings,
        known: Sequence[Mechanism],
        on_progress: OnProgress = silent,
        sweeps: Sequence[Sweep] = (),
    ) -> BlockJudge:
        """Fit the linear rig to the sweeps, if there are any, and to the recordings, to know their noise."""
        steady = fit_sweeps(problem.rig, sweeps) if sweeps else None
        return cls(made_ready(problem, known), known, on_progress, tuple(sweeps), steady)

    def without_wrong_samples(self, beneath: SimulatedFit) -> BlockJudge:
        """Return a judge of the recordings without samples that are wrong beneath a fit; itself where none is."""
        recordings = without_wrong_samples(beneath, told=True)
        if all(new is old for new, old in zip(recordings, self.problem.recordings, strict=True)):
            return self
        problem = replace(self.problem, recordings=recordings)
        return BlockJudge.of(problem, self.known, self.on_progress, self.sweeps)

    def knowing(
        self, known: Sequence[Mechanism], policy: SelectionPolicy, to_beat: SimulatedFit | None = None
    ) -> BlockJudge:
        """Return a judge of the same blocks that knows other mechanisms and has other thresholds."""
        return replace(self, known=known, screened={}, problem=replace(self.problem, policy=policy), rival=to_beat)

    def gained(self, before: SimulatedFit, after: SimulatedFit, parameters: int) -> float:
        """Return the evidence of a fit with so many parameters more than the one before."""
        return likelihood_ratio(before, after, after) - self.problem.policy.parameter_cost * parameters

    def doubtful(self, selection: Selection[SimulatedFit]) -> bool:
        """Whether what is named leaves something beyond noise, and errors far over it."""
        policy = self.problem.policy
        return selection.left.p_value < policy.level and over_noise(selection.best) > policy.doubtful_over_noise

    def contested(self, selection: Selection[SimulatedFit]) -> bool:
        """Whether a learned law contests what is named: bodies, which make up for much, if they leave anything.

        And where they ring at a multiple of one of the rig's modes, as what a law that is not linear makes.
        """
        body = any(isinstance(t.mechanism, AddedBody) for t in selection.best.terms)
        left = body and selection.left.p_value < self.problem.policy.level
        return left or rings_at_a_harmonic(selection.best) or self.doubtful(selection)

    def lead(self, found: Selection[SimulatedFit], other: Selection[SimulatedFit]) -> float:
        """Return the evidence of one selection over another, of samples as independent as the better one leaves."""
        return lead_of(found.best, other.best)

    def together(self, before: SimulatedFit, candidates: Candidates) -> Candidates:
        """Weigh candidates that were fitted at different times by samples as independent as the best one leaves."""
        weighed = weighed_together(before, [(c.score, c.fit) for c in candidates if c.fit is not None])
        return (*weighed, *(c for c in candidates if c.fit is None))

    def hopeless(self, candidates: Sequence[Candidate[SimulatedFit]], named: Selection[SimulatedFit]) -> bool:
        """Whether no candidate that was fitted explains as much as what is named."""
        return all(lead_of(c.fit, named.best) < 0 for c in candidates if c.fit is not None)

    def evidence_of(self, selection: Selection[SimulatedFit]) -> float:
        """Return the evidence of all that a selection accepted."""
        parameters = sum(len(t.mechanism.parameters) for t in selection.best.terms)
        return self.gained(selection.baseline, selection.best, parameters)

    @property
    def training(self) -> SimulatedRecordings:  # type: ignore[override]
        """All of it: parts of the recordings take part."""
        return self.problem

    def baseline(self) -> SimulatedFit:
        """Return the linear rig fitted to the fitting blocks."""
        return self.fitted.once(None, (), math.inf, lambda: linear_fit(self.problem))

    def screen(self, fitted: SimulatedFit, known: Sequence[Mechanism] | None = None) -> Screening:
        """Score mechanisms against what a fit leaves, once."""
        known = self.known if known is None else known
        key = (id(fitted), len(known))  # of the known ones those with time are left out, or none
        if key not in self.screened:
            self.screened[key] = fitted, screen(self.problem, fitted, known)
        return self.screened[key][1]

    def tested(self, fitted: SimulatedFit, screening: Screening) -> Screening:
        """Return a screening whose p-value counts the final fit's errors on held-out blocks, and the colour of them."""
        share, final = self.problem.policy.held_out_share, self.finals.of(fitted)
        beyond = self.finals.errors(final).p_value, *p_of_colour(final)
        p_value = min(screening.p_value / (1 - share * len(beyond)), min(beyond) / share, 1.0)
        return replace(screening, p_value=p_value)

    def exhausted(self) -> bool:
        """A recording is simulated as long as it takes."""
        return False

    def candidates(self, state: State[SimulatedFit]) -> Candidates:
        """Fit the best screened mechanisms; those that rank first to all that is fitted, until they have converged."""
        policy = self.problem.policy
        begun, nearest = likelier_rig(self.problem, state.current, self.screen, self._joined_once)
        ranking = self._ranking(begun, state.screening if begun is state.current else self.screen(begun))
        if not begun.terms or begun.missed >= NEAR_LINEAR:  # beside what leaves little a score test is right, and quick
            ranking = ranked_along(begun, self._further(begun) if begun.terms else self.known, ranking)
        # far from the truth a score test says little of size and sign: what is small in it may be large in full
        competition = Competition(self.problem, begun, self.rival)
        fits = competition.run(ranking, nearest, self._joined_once, self.on_progress)
        fits = begun_from_another(self.problem, begun, fits)
        if not begun.terms:
            fits = begun_from_equal_rigs(self.problem, begun, fits, self.screen)
        found = weighed_together(state.current, fits)
        in_time = [i for i, c in enumerate(found) if told_in_any_case(self.problem, c.mechanism)]
        finer = {*within_reach(found, policy), *in_time[:1]}
        rough = [(c.score, c.fit) for c in found if c.fit is not None]
        fits = converged(rough, finer, in_time[:1], self._polished)
        unfitted: Candidates = tuple(Candidate(s[0], None, -math.inf) for s in ranking.scores[ranking.finalists :])
        return (*weighed_together(state.current, fits), *unfitted)

    def _ranking(self, current: SimulatedFit, screening: Screening) -> Ranking:
        """Return which mechanisms earn a fit beside what stands."""
        policy, unlike_noise = self.problem.policy, not current.as_noise
        # where most of what is missed is noise, a fit gains what its score says
        near_linear = policy.promising_by_blocks if unlike_noise else policy.close
        promising = near_linear if current.missed < NEAR_LINEAR else 0.0
        ranking = Ranking.of(screening.scores, policy, promising)
        if not unlike_noise:
            return ranking.of_at_least(policy.serious * policy.certain_by_blocks) if current.terms else ranking
        # a whitening that is made from the residual whitens away what it holds of a mechanism
        known = self._further(current) if current.terms else self.known
        plain = screen(replace(self.problem, plain=True), current, known, ranks=True)
        return Ranking.of(plain.scores, policy, promising).and_then(ranking, policy.finalists_by_blocks)

    def _joined_once(self, current: SimulatedFit, score: Score, to_beat: float = math.inf) -> SimulatedFit:
        def joined() -> SimulatedFit:
            return sharper(joined_to(self.problem, current, score, to_beat), to_beat)

        return self.fitted.once(current, (started(score),), to_beat, joined)

    def _polished(self, begun: SimulatedFit, to_beat: float) -> SimulatedFit:
        finer = partial(fit, self.problem, begun.terms, begun, fine=True, to_beat=to_beat)
        return self.fitted.once(begun, begun.terms, to_beat, finer)

    def fitted_alone(self, baseline: SimulatedFit, scores: Sequence[Score]) -> SimulatedFit | None:
        """Return the full fit of a mechanism beside the linear rig."""
        return joined_to(self.problem, baseline, scores[0])

    def to_the_end(self, fitted: SimulatedFit) -> SimulatedFit:
        """Return the fit to all that is not held out."""
        return self.finals.of(fitted)

    def accepts(
        self, state: State[SimulatedFit], candidates: Sequence[Candidate[SimulatedFit]]
    ) -> tuple[Candidate[SimulatedFit] | None, Mapping[int, float]]:
        """Accept the best candidate if the choosing blocks get better by more than chance.

        Where all there is is one decay, only what goes with amplitude; steady responses count as well.
        """
        one_decay = self.problem.one_decay
        allowed = [c for c in candidates if c.fit is not None and not (one_decay and with_time(c.mechanism))]
        steady: dict[int, float] = {}
        if self.sweeps and allowed:
            self.on_progress("holding the best against the steady responses")
            best_few = allowed[: self.problem.policy.held_against_sweeps]
            steady = {candidates.index(c): self.against_sweeps(c.fit) for c in best_few}
            allowed = [candidates[max(steady, key=lambda i: candidates[i].evidence + steady[i])]]
        best = simplest(allowed, self.problem.policy.learned_simpler) if allowed else None
        accepted = best is not None and best.fit is not None and self._better(state, best)
        return (best if accepted else None), steady

    def against_sweeps(self, fitted: SimulatedFit | None) -> float:
        """Return the evidence of a fit's mechanisms in the steady responses: how much better these are predicted."""
        if fitted is None or self.steady is None:
            return 0.0
        return len(self.sweeps) * math.log(self.steady.mean_square / self.with_terms(fitted.terms).mean_square)

    def with_terms(self, terms: Sequence[Term]) -> SteadyFit:
        """Return the fit of mechanisms to the sweeps, from the values they have; time changes nothing there."""
        return fit_again(self.problem.rig, self.sweeps, terms, self.steady)

    def _better(self, state: State[SimulatedFit], candidate: Candidate[SimulatedFit]) -> bool:
        """Whether choosing blocks got better by more than chance, and by enough of what the linear rig missed.

        Where hardly anything but noise is left then, or what another mechanism explains, it is enough that all blocks
        together got better by more than chance, and the choosing ones not worse; where there was hardly anything but
        noise before, it is asked as well.
        """
        policy, before, after = self.problem.policy, state.current.by_block(CHOOSE), candidate.losses
        base = state.steps[0].before.by_block(CHOOSE) if state.steps else before
        gained, missed = mean_of(before) - mean_of(after), mean_of(base) - mean_of(after)
        if candidate.fit is None or not self._beyond_noise_of_inputs(state.current, candidate.fit):
            return False
        chosen = ratio_in(CHOOSE, state.current, candidate.fit, candidate.fit)
        sure = policy.certain_by_blocks
        if candidate.evidence > sure and chooses_no_worse(state.current, candidate.fit):
            left = self.screen(candidate.fit, self._further(candidate.fit))
            if left.p_value >= policy.level or left.beyond_one < policy.left_over_blocks * candidate.evidence:
                return True
        if gained <= max(policy.least_share * missed, 0.0) or (state.current.as_noise and candidate.evidence <= sure):
            return False
        change = np.log(np.array(before) / np.array(after))
        spread = max(float(np.std(change, ddof=1)) / math.sqrt(change.size), 1e-300)
        return chosen > sure or float(student.sf(float(np.mean(change)) / spread, change.size - 1)) < policy.chance

    def _beyond_noise_of_inputs(self, current: SimulatedFit, fitted: SimulatedFit) -> bool:
        """Whether a mechanism is certain beside what inputs' noise makes, where hardly anything else is missed."""
        policy = self.problem.policy
        if not self.problem.draws(current) or not current.as_noise:
            return True
        return gain_beside_draws(current, fitted) - cost_of(fitted, fitted.terms[-1]) > policy.certain_by_blocks

    def _further(self, beside: SimulatedFit) -> list[Mechanism]:
        """Return what may be at work beside a fit: one second impact, and of one decay nothing that goes with time."""
        timeless = [m for m in self.known if not (self.problem.one_decay and with_time(m))]
        return [m for m in timeless if beside.simulation.struck is None or not isinstance(m, SecondImpact)]

    def after(self, state: State[SimulatedFit], accepted: Candidate[SimulatedFit]) -> tuple[State[SimulatedFit], bool]:
        """Look at what an accepted mechanism leaves; nothing further once that is noise, or near it and no share."""
        if accepted.fit is None:
            return state, False
        policy, base = self.problem.policy, mean_of(state.steps[0].before.by_block(CHOOSE))
        near_noise = over_noise(accepted.fit) <= policy.doubtful_over_noise
        linear = self.baseline()  # several mechanisms beside one that is worse than zero would take its place
        if (near_noise and mean_of(accepted.losses) < policy.least_share * base) or worse_than_zero(linear, linear):
            return State(accepted.fit, state.screening, state.steps), False
        self.on_progress("looking at what is left")
        current, steps = accepted.fit, state.steps
        left = self.screen(current, self._further(current))
        if left.p_value < policy.level:  # before something is added that makes up for a name that only resembles
            current, steps = exchanged(current, steps)
            if current is not accepted.fit:
                left = self.screen(current, self._further(current))
        last = FORM in accepted.score.term.values  # one law that is learned may be anything: there is no second
        return State(current, left, steps), left.p_value < policy.level and not last

    def outcome(self, baseline: State[SimulatedFit], state: State[SimulatedFit]) -> Selection[SimulatedFit]:
        """Return the selection: what goes with time may win, forces of any shape are tried beside it."""
        policy, steps, current = self.problem.policy, state.steps, state.current
        rival = self.rival_in_time(steps)
        if rival and rival.fit is not None and self._time_wins(current, rival):
            current, steps = rival.fit, (replace(steps[0], accepted=rival),)
        current, steps = exchanged(*without_idle_ones(current, steps))
        share, base, best = 0.0, mean_of(baseline.current.by_block(CHOOSE)), mean_of(current.by_block(CHOOSE))
        if steps and best > policy.left_over_blocks * base and self.screen(current).p_value < policy.level:
            self.on_progress("trying forces of any shape")
            share = free_share(baseline.current, current, self.problem)
        self.on_progress("fitting once more with all that is not held out")
        final, fitted = map(self.finals.of, (baseline.current, current))
        lost = bool(self.finals.worse_than_zero(final, fitted))  # what is named leaves most of it besides
        if fitted.terms and not lost:
            lost = explained_otherwise((baseline.current, current, final), self.screen, self.known, self.on_progress)
        if fitted.terms and lost:
            current, fitted, steps = baseline.current, final, ()
        last = self.tested(current, self.screen(fitted)) if fitted.terms else baseline.screening
        still = missed_still(final, fitted) if steps else 0.0
        mostly = still > policy.mostly_left and min(p_of_colour(fitted), default=1.0) < policy.level
        taken_away = share <= policy.left_over_blocks and not mostly
        chosen = fitted if fitted.terms and taken_away and not predicts_no_better(final, fitted) else None
        share = max(share, still) or (share_by_scores(baseline.current, current, last.unexplained) if steps else 0.0)
        over = LeftOver(last.unexplained, last.p_value, share)
        return Selection(self, final, baseline.screening, steps, chosen, fitted, last, over)

    def rival_in_time(self, steps: Sequence[SelectionStep[SimulatedFit]]) -> Candidate[SimulatedFit] | None:
        """Return the best candidate that goes with time, where amplitude and time are confounded."""
        first = steps[0].accepted if steps else None
        if not self.problem.one_decay or not steps or (first is not None and isinstance(first.mechanism, SecondImpact)):
            return None  # an impact goes with neither
        return next((c for c in steps[0].candidates if c.fit is not None and with_time(c.mechanism)), None)

    def _time_wins(self, current: SimulatedFit, rival: Candidate[SimulatedFit]) -> bool:
        """Whether a change with time explains more than what goes with amplitude; by far, where one decay is all."""
        losses, other = current.by_block(CHOOSE), mean_of(rival.losses)
        if not self.sweeps:
            return mean_of(losses) > self.problem.policy.in_time * other
        amplitude = len(losses) * math.log(mean_of(losses)) - self.against_sweeps(current)
        return amplitude > len(losses) * math.log(other) - self.against_sweeps(rival.fit)
