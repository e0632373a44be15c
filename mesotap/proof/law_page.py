"""The sections of a proof's page on laws that nobody listed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from mesotap.proof import law_scores
from mesotap.proof.entries import Entry
from mesotap.proof.generator.effects import OUTSIDE
from mesotap.proof.scores import Count

Share = Callable[[Count], str]
Table = Callable[[Sequence[str], Sequence[Sequence[str]]], str]

INTRODUCTION = """A listed mechanism counts as right where it has the very same equations as what is hidden; which these
are is said below. Where an answer names an element or channels, these are held against the truth, and otherwise the
class of the component. The kind of the law is asked of all sessions of the grade, `unexplained` ones included."""


def scored(entries: Sequence[Entry]) -> dict[str, Any]:
    """Return the scores of effects outside the list as JSON types but for the counts."""
    return {
        "goals": [asdict(g) for g in law_scores.goals(entries)],
        "effects": [asdict(line) for line in law_scores.of_effects(entries)],
        "false_laws": asdict(law_scores.false_laws(entries)),
    }


def section(entries: Sequence[Entry], share: Share, table: Table) -> str:
    """Return the section; empty where no truth tells of a law. ``share`` and ``table`` write a count and a table."""
    lines = law_scores.of_effects([e for e in entries if law_scores.hidden_law(e)])
    if not lines:
        return ""
    reached = [(g.name, g.of, share(g.reached), f"{100 * g.goal:.0f} %") for g in law_scores.goals(entries)]
    false = law_scores.false_laws(entries)
    said = [
        (
            line.effect, f"{line.grade:g}", str(line.sessions), str(line.new), str(line.unexplained), str(line.named),
            str(line.otherwise), str(line.consistent), str(line.wrongly_stated), str(line.placed),
            str(line.of_right_kind), str(line.as_good),
        )
        for line in lines
    ]  # fmt: skip
    headings = (
        "effect", "d", "sessions", "`new_physics`", "`unexplained`", "same equations named", "other name",
        "`consistent`", "other name above 0.9", "place right", "kind right", "error within 1.05",
    )  # fmt: skip
    hidden = {line.effect for line in lines}
    same = [
        (name, e.nature.kind, ", ".join(e.nature.same), e.nature.why)
        for name, e in OUTSIDE.items()
        if name in hidden and e.nature is not None and e.nature.same
    ]
    parts = [
        "## Laws that nobody listed",
        INTRODUCTION,
        table(("what", "of", "reached", "goal"), reached),
        f"A law was learned where nothing is hidden in {share(false.of_nothing)}, and of a listed mechanism in "
        f"{share(false.of_listed)}.",
        table(headings, said),
    ]
    if same:
        parts += [table(("effect", "kind", "listed mechanisms of the same equations", "because"), same)]
    return "\n\n".join(parts)
