"""Every mechanism that took part in the selection: what it gains, and why it is or is not named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from analysis.mismatch.remainder import count_words, p_words
from analysis.mismatch.ring_downs.candidates import with_stiffness
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.selection import Candidate, Selection
from mesotap.answers.diagnosis_page import Table
from mesotap.answers.diagnosis_text import words
from mesotap.answers.rounding import UNKNOWN
from mesotap.report.typesetting import prose
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism

UNSEEN = "ring-downs do not show it"


@dataclass(frozen=True, slots=True)
class Row:
    """A mechanism's row; gains are chi-squared taken away, None where there is none."""

    id: str
    component: str
    screened: float | None
    p_value: float | None
    fitted: float | None
    evidence: float | None
    outcome: str
    named: bool


def candidates(selection: Selection[RingDownFit], known: Mapping[str, tuple[Mechanism, ...]]) -> list[Row]:
    """Return a row for every mechanism that took part: those named first, then by what they took away."""
    named = {s.accepted.id: place for place, s in enumerate(selection.steps, start=1) if s.accepted is not None}
    first = selection.steps[0] if selection.steps else None
    tried = {c.id: c for c in reversed(first.candidates)} if first is not None else {}
    best = first.candidates[0] if first is not None and first.candidates else None
    scores: dict[str, tuple[float, float]] = {}
    for score in first.screening.scores if first is not None else ():
        name = score.term.mechanism.id
        if name not in scores or score.gain > scores[name][0]:
            scores[name] = score.gain, score.p_value
    rows = []
    learned = {c.id: (c.mechanism,) for c in tried.values() if c.id not in known}
    for name, family in {**known, **learned}.items():
        tried_one = tried.get(name)
        gain, p = scores.get(name, (None, None))
        fitted = tried_one.fit if tried_one is not None else None
        rows.append(
            Row(
                name,
                family[0].component or _component(tried_one, selection),
                gain,
                p,
                None if fitted is None else selection.baseline.objective - fitted.objective,
                None if tried_one is None or fitted is None else tried_one.evidence,
                _outcome(name, tried_one, p, best, named, selection),
                name in named and selection.chosen is not None,
            )
        )
    return sorted(rows, key=lambda r: (not r.named, r.fitted is None, -(r.fitted or 0.0), -(r.screened or 0.0)))


def _component(learned: Candidate[RingDownFit] | None, selection: Selection[RingDownFit]) -> str:
    """Return of which part of the rig a learned law is."""
    if learned is None or not isinstance(learned.mechanism, ForceLaw):
        return "learned"
    return selection.problem.arrangement.elements[learned.score.term.place[0]].component


def _outcome(
    name: str,
    tried_one: Candidate[RingDownFit] | None,
    p: float | None,
    best: Candidate[RingDownFit] | None,
    named: Mapping[str, int],
    selection: Selection[RingDownFit],
) -> str:
    if name in named:
        if selection.chosen is None:
            return "the best there is, but it leaves too much over to be named"
        return "named" if named[name] == 1 else f"named in step {named[name]}, beside what was named before"
    if p is None:
        return UNSEEN if selection.steps else "not needed"
    if tried_one is not None and tried_one.fit is not None and best is not None:
        return _beside(tried_one, best)
    if p > selection.problem.policy.level:
        return f"nothing of it in the residual (p = {p:.2g})"
    if best is not None:
        promised = UNKNOWN if tried_one is None else count_words(tried_one.evidence)
        has = f"{words(best.id)} fitted has {count_words(best.evidence)}"
        return f"not fitted: score test promises {promised}, {has}"
    return "not fitted"


def _beside(one: Candidate[RingDownFit], best: Candidate[RingDownFit]) -> str:
    """Say what decided against a candidate that was fitted; how k_c grows with the load counts, too."""
    own, first = with_stiffness(one), with_stiffness(best)
    said = f"fitted: {count_words(first - own)} less than {words(best.id)}"
    against = one.evidence - own
    return f"{said}, {count_words(against)} of it by how k_c grows with the load" if against >= 1 else said


def candidate_table(selection: Selection[RingDownFit], known: Mapping[str, tuple[Mechanism, ...]]) -> Table:
    """Return the rows as a table of the page."""
    rows = tuple(
        (
            Markup("<strong>{}</strong>").format(c.id) if c.named else c.id,
            c.component,
            _whole(c.screened),
            UNKNOWN if c.p_value is None else prose(p_words(c.p_value).removeprefix("p = ").removeprefix("p ")),
            _whole(c.fitted),
            _whole(c.evidence),
            prose(c.outcome),
        )
        for c in candidates(selection, known)
    )
    caption = (
        "All mechanisms: chi-squared that each takes away by its score test and by its fit, evidence (what is left "
        "of that beyond what its free parameters take away by chance), and why it is or is not named. A fit that "
        "cannot reach the best any more is given up: it would take away at least what is given. The "
        f"overall test has the level {100 * selection.problem.policy.level:.0f} %."
    )
    headings = ("Mechanism", "Component", "Score test", "p", "Fit", "Evidence", "Outcome")
    return Table(caption, headings, rows, (0, 1, 6))


def considered(selection: Selection[RingDownFit], known: Mapping[str, tuple[Mechanism, ...]]) -> str:
    """Say that no mechanism had to be fitted, and which there were; empty where some were."""
    if selection.steps:
        return ""
    return (
        f"What {selection.problem.linear} leaves is noise by the overall test, at the level of "
        f"{100 * selection.problem.policy.level:.0f} %; so none of the {len(known)} mechanisms that took part had to "
        f"be fitted: {', '.join(sorted(known))}."
    )


def _whole(value: float | None) -> str:
    return UNKNOWN if value is None else prose(count_words(value))
