"""The same question under several lists of explanations and priors: does a spring in series take part?

A probability of an explanation is one among those that were thought of, each as likely beforehand as somebody made it.
What is said of them is therefore said as a range over lists that are all reasonable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.contact.weighing import Weighed, percent

SERIES = "series_compliance"
ADDED = ("unloading", "fractal", "moving_mass")  # beginnings of what the first list did not have
LAWS = ("power_law", "fractal", f"fractal+{SERIES}")  # of which no theory of asperities is a part
BY_WORKS = {
    "load": ("adhesion", "carried_load"),
    "amplitude": ("amplitude",),
    "mass": ("moving_mass", "roughness+moving_mass"),
    "shape of the samples": ("misalignment", "crowned_flats"),
    "a power of the load": ("power_law", "fractal"),
    "surfaces other than measured": ("roughness", "plasticity", "asperities", "unloading_hardness",
                                     "unloading_share", "unloading_roughness"),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class UnderList:
    """What one list with its priors says.

    Attributes
    ----------
    name, statement
        Of the list.
    explanations
        How many it has.
    spring
        Probability that a spring in series takes part.
    best, best_probability
        The most probable explanation.
    """

    name: str
    statement: str
    explanations: int
    spring: float
    best: str
    best_probability: float

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return {
            "list": self.name,
            "statement": self.statement,
            "explanations": self.explanations,
            "spring_in_series": self.spring,
            "most_probable": self.best,
            "most_probable_probability": self.best_probability,
        }


def takes_part(name: str) -> bool:
    """Whether a spring in series takes part in the explanation of this id."""
    return SERIES in name.split("+")


def in_first_list(name: str) -> bool:
    """Whether the explanation of this id was in the first list."""
    return not any(part.startswith(ADDED) for part in name.split("+"))


def cause(name: str) -> str:
    """Return what an explanation blames: one of a few causes, all springs together being one."""
    if takes_part(name):
        return "a spring in series"
    return next((said for said, ids in BY_WORKS.items() if name in ids), "theory as it stands")


def under_lists(wide: Sequence[Weighed], reviewed: Sequence[Weighed]) -> tuple[UnderList, ...]:
    """Return what each list says.

    Parameters
    ----------
    wide, reviewed
        The first list weighed with the wide priors, all explanations with the reviewed ones
        (`analysis.contact.changes`). Without the former there is one list less.
    """

    def seen(name: str) -> bool:
        return name.startswith("unloading") or name in LAWS

    said = "theories of loading, each with or without a spring"
    return (
        *([_under("first list, wide priors", said, wide)] if wide else []),
        _under("first list, reviewed priors", f"{said}, in the ranges that physics leaves", reviewed, in_first_list),
        _under("all, reviewed priors", "with unloading, fractal surfaces and moving mass beside them", reviewed),
        _under(
            "causes alike",
            "the same, each cause as likely as another beforehand, all that have a spring being one",
            reviewed,
            by_cause=True,
        ),
        _under(
            "unloading or a power law",
            "only what a ring-down can see where asperities have yielded, each cause as likely as another",
            reviewed,
            seen,
            by_cause=True,
        ),
    )


def _under(
    name: str,
    statement: str,
    weighed: Sequence[Weighed],
    kept: Callable[[str], bool] = lambda name: True,
    by_cause: bool = False,
) -> UnderList:
    of = [w for w in weighed if kept(w.candidate.id)]
    logs = np.array([w.log_evidence for w in of])
    causes = [cause(w.candidate.id) if by_cause else "" for w in of]
    chance = np.exp(logs - logs.max()) / [causes.count(one) for one in causes]
    chance /= chance.sum()
    best = int(chance.argmax())
    spring = float(sum(p for p, w in zip(chance, of, strict=True) if takes_part(w.candidate.id)))
    return UnderList(name, statement, len(of), spring, of[best].candidate.id, float(chance[best]))


def spring_sentence(lists: Sequence[UnderList]) -> str:
    """Say how probable a spring in series is, over all lists."""
    low, high = min(lists, key=lambda u: u.spring), max(lists, key=lambda u: u.spring)
    return (
        f"Whether a spring in series takes part depends on the list: its probability is {percent(low.spring)} "
        f"({low.name}) to {percent(high.spring)} ({high.name}) under {len(lists)} lists of explanations and priors."
    )
