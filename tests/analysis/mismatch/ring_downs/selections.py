"""Real fits of a small session, dressed with the numbers that a test is about."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.mismatch.ring_downs.fit import RingDownFit, RingDowns, fit
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.score_test import FreeForm, Score, Screening
from analysis.mismatch.selection import Candidate, SelectionStep, State
from sim_backend.mechanisms.kinds import Mechanism
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import at_work


@functools.cache
def small() -> RingDowns:
    """Four impacts of a linear rig at three loads."""
    return problem_of(session_of(with_law(), noise=0.02)).only((0, 3, 5, 10))


@functools.cache
def linear() -> RingDownFit:
    return fit(small())


def with_objective(objective: float, *names: str) -> RingDownFit:
    """Return the linear fit as if it had these terms and left this objective."""
    terms = tuple(at_work(name) for name in names)
    return replace(linear(), terms=terms, chi_squared=objective, penalty=0.0)


def screening(unexplained: float = 0.0, p_value: float = 0.0, alone: float = 0.0) -> Screening:
    """Return what a screening says that scored no mechanism."""
    free = FreeForm(unexplained, 2, p_value, {}, alone)
    return Screening((), p_value, (), np.zeros((0, 0)), free, unexplained)


def scored(name: str, gain: float, strength: float = 1.0) -> Score:
    return Score(at_work(name), gain, 1, strength, 0.0)


def accepted(
    name: str, before: RingDownFit, after: RingDownFit, evidence: float, seen: Screening | None = None
) -> SelectionStep[RingDownFit]:
    """Return a step that accepted a mechanism."""
    candidate = Candidate(scored(name, evidence), after, evidence)
    return SelectionStep(before, seen or screening(), (candidate,), candidate)


@dataclass(frozen=True, slots=True)
class Scripted(ImpactJudge):
    """Judges as impacts are judged, but is told what screening and fitting give.

    Attributes
    ----------
    seen
        What every screening says.
    ranked
        The candidates of every step after the first; ``asked`` counts how often they were asked for.
    """

    seen: Screening = field(default_factory=screening)
    ranked: tuple[Candidate[RingDownFit], ...] = ()
    asked: list[int] = field(default_factory=list)

    def screen(self, fitted: RingDownFit, known: Sequence[Mechanism] | None = None) -> Screening:
        return self.seen

    def candidates(self, state: State[RingDownFit]) -> tuple[Candidate[RingDownFit], ...]:
        self.asked.append(len(state.steps))
        return self.ranked

    def held_out_fit(self, fitted: RingDownFit) -> RingDownFit:
        return fitted


def scripted(
    seen: Screening | None = None, ranked: tuple[Candidate[RingDownFit], ...] = (), held_out: tuple[int, ...] = ()
) -> Scripted:
    return Scripted(small(), small(), held_out, (), seen=seen or screening(), ranked=ranked)
