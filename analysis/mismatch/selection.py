"""Forward selection: which mechanisms, if any, made the recordings what they are.

Screened by score tests, the best candidates fitted in full, further ones added one by one as long as recordings that
took no part in fitting get better. What is then left over is tested once more against forces of any shape: where much
is left, nothing listed is right. How a candidate is judged is an argument: by chi-squared and held-out impacts
(`impact_judge`), or by held-out blocks of a recording (`block_judge`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.problem import FitOf, OnProgress, Problem
from analysis.mismatch.score_test import Score, Screening, screen
from sim_backend.mechanisms.kinds import AddedBody, Mechanism, SecondImpact, Tones


@dataclass(frozen=True, slots=True, eq=False)
class Candidate(Generic[FitOf]):
    """A mechanism that was fitted in full with those already accepted, or only screened (``fit`` None).

    Attributes
    ----------
    evidence
        Chi-squared that it takes away less what its free numbers take away by chance; of one that was only screened,
        what its score promises.
    own
        Numbers of it that are free in the segments, all together.
    losses
        Mean square on each block that chooses, where blocks do.
    """

    score: Score
    fit: FitOf | None
    evidence: float
    own: int = 0
    losses: tuple[float, ...] = ()

    @property
    def id(self) -> str:
        """Name of the mechanism."""
        return self.score.term.mechanism.id

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""
        return self.score.term.mechanism


@dataclass(frozen=True, slots=True)
class SelectionStep(Generic[FitOf]):
    """What stood before a step, all candidates (best first), and which one was accepted.

    ``steady`` holds, where there are steady responses, the evidence of candidates against them, by place.
    """

    before: FitOf
    screening: Screening
    candidates: tuple[Candidate[FitOf], ...]
    accepted: Candidate[FitOf] | None
    steady: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LeftOver:
    """What the best explanation leaves.

    Attributes
    ----------
    chi_squared, p_value
        Beyond chance, and its p-value.
    share
        Of all that the linear rig missed.
    unnamed
        Evidence of the best single force or channel that has no name, less that of all mechanisms accepted.
    """

    chi_squared: float
    p_value: float
    share: float
    unnamed: float = -math.inf


@dataclass(frozen=True, slots=True)
class Selection(Generic[FitOf]):
    """Outcome.

    Attributes
    ----------
    p_value
        That the linear rig with its constants refitted made the recordings.
    baseline
        The linear rig, fitted to what is not held out.
    chosen
        The fit with the accepted mechanisms; None where the linear rig will do or nothing explains.
    best
        The best fit there is, even if it does not explain enough, and the screening of what it leaves.
    judge
        What judged, with what it held out.
    """

    judge: Judge[FitOf]
    baseline: FitOf
    screening: Screening
    steps: tuple[SelectionStep[FitOf], ...]
    chosen: FitOf | None
    best: FitOf
    last_screening: Screening
    left: LeftOver

    @property
    def p_value(self) -> float:
        """That the linear rig made the recordings."""
        return self.screening.p_value

    @property
    def accepted(self) -> tuple[SelectionStep[FitOf], ...]:
        """The steps in which a mechanism was accepted."""
        return tuple(s for s in self.steps if s.accepted is not None)

    @property
    def problem(self) -> Problem[FitOf]:
        """What was fitted."""
        return self.judge.problem


@dataclass(frozen=True, slots=True)
class State(Generic[FitOf]):
    """Where a selection is: the fit so far, what screening it gave, the steps that led to it."""

    current: FitOf
    screening: Screening
    steps: tuple[SelectionStep[FitOf], ...] = ()

    @property
    def first(self) -> bool:
        """Whether nothing has been looked for yet."""
        return not self.steps


class Judge(ABC, Generic[FitOf]):
    """How candidates are fitted and judged.

    Attributes
    ----------
    problem
        All the recordings, those that are held out too.
    training
        What is fitted.
    """

    problem: Problem[FitOf]
    training: Problem[FitOf]
    known: Sequence[Mechanism]
    on_progress: OnProgress

    @abstractmethod
    def baseline(self) -> FitOf:
        """Return the linear rig fitted to what is not held out."""

    @abstractmethod
    def candidates(self, state: State[FitOf]) -> tuple[Candidate[FitOf], ...]:
        """Return the mechanisms that come next, the best of them fitted in full, best first."""

    @abstractmethod
    def accepts(
        self, state: State[FitOf], candidates: Sequence[Candidate[FitOf]]
    ) -> tuple[Candidate[FitOf] | None, Mapping[int, float]]:
        """Return the candidate that is accepted, if any, and the steady responses' evidence."""

    @abstractmethod
    def after(self, state: State[FitOf], accepted: Candidate[FitOf]) -> tuple[State[FitOf], bool]:
        """Return the state with a mechanism accepted, and whether a further one is looked for."""

    @abstractmethod
    def outcome(self, baseline: State[FitOf], state: State[FitOf]) -> Selection[FitOf]:
        """Return a selection that ends here: explained, or not."""

    @abstractmethod
    def fitted_alone(self, baseline: FitOf, scores: Sequence[Score]) -> FitOf | None:
        """Return the full fit of one mechanism beside the linear rig, from its scores; None if not admissible."""

    @abstractmethod
    def knowing(
        self, known: Sequence[Mechanism], policy: SelectionPolicy, to_beat: FitOf | None = None
    ) -> Judge[FitOf]:
        """Return a judge of the same recordings that knows other mechanisms and has other thresholds.

        Fits that cannot reach the one that is to be beaten may be given up.
        """

    @abstractmethod
    def gained(self, before: FitOf, after: FitOf, parameters: int) -> float:
        """Return the evidence of a fit over one before that has so many parameters less."""

    def doubtful(self, selection: Selection[FitOf]) -> bool:
        """Whether what is named leaves so much that it may be something else."""
        return selection.left.p_value < self.problem.policy.level

    def contested(self, selection: Selection[FitOf]) -> bool:
        """Whether a learned law contests what is named."""
        return self.doubtful(selection)

    @abstractmethod
    def evidence_of(self, selection: Selection[FitOf]) -> float:
        """Return the evidence of all mechanisms that a selection accepted, over the linear rig."""

    def lead(self, found: Selection[FitOf], other: Selection[FitOf]) -> float:
        """Return the evidence of what one selection accepted over what another one did."""
        return self.evidence_of(found) - self.evidence_of(other)

    def together(self, before: FitOf, candidates: tuple[Candidate[FitOf], ...]) -> tuple[Candidate[FitOf], ...]:
        """Return the candidates of a step with evidence that compares, the best first; those without a fit last."""
        return tuple(sorted(candidates, key=lambda c: (c.fit is None, -c.evidence)))

    def hopeless(self, candidates: Sequence[Candidate[FitOf]], named: Selection[FitOf]) -> bool:
        """Whether no candidate that was fitted explains as much as what is named."""
        best = max((c.evidence for c in candidates if c.fit is not None), default=-math.inf)
        return best < self.evidence_of(named)

    @abstractmethod
    def to_the_end(self, fitted: FitOf) -> FitOf:
        """Return a candidate's fit as the fit of what is named is made, so that their held-out errors compare."""

    def tested(self, fitted: FitOf, screening: Screening) -> Screening:
        """Return a screening whose p-value counts what was held out, too, where errors on that have a test."""
        return screening

    def another_first(self, candidates: Sequence[Candidate[FitOf]]) -> bool:
        """Whether the second candidate is so good that it is tried in the place of a first that led to nothing."""
        return False

    def exhausted(self) -> bool:
        """Whether the compute budget is spent."""
        return self.training.exhausted()

    def screen(self, fitted: FitOf, known: Sequence[Mechanism] | None = None) -> Screening:
        """Score all mechanisms against what a fit leaves."""
        return screen(self.training, fitted, self.known if known is None else known)


def screened_baseline(judge: Judge[FitOf]) -> State[FitOf]:
    """Fit the linear rig to what is not held out and screen all mechanisms."""
    judge.on_progress("fitting the linear rig")
    fitted = judge.baseline()
    judge.on_progress("screening")
    return State(fitted, judge.tested(fitted, judge.screen(fitted)))


Instead = Callable[[Selection[FitOf]], Selection[FitOf] | None]
"""From a selection that does not explain to another one that does, or None."""


def select(
    judge: Judge[FitOf],
    baseline: State[FitOf],
    candidates: tuple[Candidate[FitOf], ...] | None = None,
    instead: Instead[FitOf] | None = None,
) -> Selection[FitOf]:
    """Find the mechanisms that the recordings hold beyond the linear rig.

    Where what seemed best at first leads to no explanation, what was nearly as good is tried in its place.

    Parameters
    ----------
    candidates
        For the first place, where they are fitted already.
    instead
        Asked where one and two mechanisms do not explain, before more are looked for.
    """
    if baseline.screening.p_value >= judge.problem.policy.level:
        return judge.outcome(baseline, baseline)
    candidates = judge.candidates(baseline) if candidates is None else candidates
    found = _forward(judge, baseline, candidates, instead=instead)
    if found.chosen is None and len(candidates) > 1 and not judge.exhausted() and judge.another_first(candidates):
        judge.on_progress(f"again, with {name_of(candidates[1].mechanism)} first")
        again = _forward(judge, baseline, candidates[1:])
        found = found if again.chosen is None else again
    return found


def go_on(judge: Judge[FitOf], baseline: State[FitOf], state: State[FitOf]) -> Selection[FitOf]:
    """Look for what is at work beside the mechanisms of a state."""
    return _forward(judge, baseline, (), state)


def _forward(
    judge: Judge[FitOf],
    baseline: State[FitOf],
    candidates: tuple[Candidate[FitOf], ...],
    begun: State[FitOf] | None = None,
    instead: Instead[FitOf] | None = None,
) -> Selection[FitOf]:
    """Take the best candidate, then what is best beside it, as long as that pays."""
    state, more = begun or baseline, True
    while more and len(state.current.terms) < judge.problem.policy.most_terms:
        if instead is not None and len(state.current.terms) == judge.problem.policy.few_terms:
            other, instead = instead(judge.outcome(baseline, state)), None
            if other is not None:
                return other
        if not state.first:
            if judge.exhausted():
                break
            candidates = judge.candidates(state)
        accepted, steady = judge.accepts(state, candidates)
        step = SelectionStep(state.current, state.screening, candidates, accepted, steady)
        state = State(state.current, state.screening, (*state.steps, step))
        if accepted is None:
            break
        state, more = judge.after(state, accepted)
    found = judge.outcome(baseline, state)
    other = instead(found) if instead is not None and found.chosen is None else None
    return found if other is None else other


def name_of(mechanism: Mechanism) -> str:
    """Return what progress calls a mechanism."""
    return mechanism.id.replace("_", " ")


def started(score: Score, weakest: float = 1e-6, strongest: float = math.inf) -> Term:
    """Return the screened term with the strength that the score test found, in trial strengths between the two given.

    Mass, stiffness and damping of an added body grow together; one without a strength has it in its inverse mass.
    """
    term, mechanism = score.term, score.term.mechanism
    if isinstance(mechanism, SecondImpact | Tones):
        return term
    found = score.strength or 1.0
    factor = math.copysign(min(max(abs(found), weakest), strongest), found)
    strength, body = mechanism.strength, mechanism.body if isinstance(mechanism, AddedBody) else None
    if strength is None:
        if body is None or not term.phase_locked:
            return term
        return term.within({name: term.values[name] / abs(factor) for name in body})
    log = next(q.log for q in mechanism.parameters if q.name == strength)
    if body is not None and strength in body:
        return term.within({name: term.values[name] * abs(factor) for name in body})
    return term.within({strength: term.values[strength] * (abs(factor) if log else factor)})
