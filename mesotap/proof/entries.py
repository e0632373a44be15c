"""One session of a proof with its truth and its answer, as the scores take it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mesotap.proof.generator.effects import LISTED

CONSISTENT, MISSING, NEW, UNEXPLAINED = "consistent", "missing_physics", "new_physics", "unexplained"
LEVEL = 0.01
"""Of the test: below this p-value something counts as detected."""


@dataclass(frozen=True, slots=True)
class Named:
    """A mechanism that an answer names, or a law that it learned.

    ``element`` is the rig's own name of where it acts; ``kind`` and ``exponents`` (95 % intervals) are those of a
    learned law.
    """

    id: str
    probability: float
    component: str
    alike: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float]]
    learned: bool = False
    element: str = ""
    kind: str = ""
    exponents: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Entry:
    """A session, what is hidden in it, and what was answered.

    Attributes
    ----------
    kind
        ``null``, ``single``, ``two``, ``excluded`` or ``outside``.
    effects, components, d_of_each
        What is hidden, where, and how much of each survives the refit.
    d
        Of all together.
    truth
        The whole of it.
    named
        Strongest first.
    heldout_rms
        Of the answer's best model, m/s2; ``knowing_rms`` that of a fit that knows the answer; NaN where unknown.
    likeness
        Cosine of what survives of the hidden effect with what would of the one named, where it was computed.
    limits
        Parameter and 95 % upper limit of each mechanism that is not named, by id.
    complete
        Stated probability that what is named, and nothing else, is there.
    element
        Where the answer locates what is missing: that of the first name, or else of the location; empty where it names
        none.
    channels
        Those of the location.
    """

    name: str
    kind: str
    effects: tuple[str, ...]
    components: tuple[str, ...]
    d: float
    d_of_each: tuple[float, ...]
    truth: Mapping[str, Any]
    verdict: str
    p_value: float
    located: str
    named: tuple[Named, ...]
    heldout_rms: float
    knowing_rms: float
    seconds: float
    likeness: float | None = None
    limits: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    complete: float = float("nan")
    element: str = ""
    channels: tuple[str, ...] = ()

    @property
    def detected(self) -> bool:
        """Whether the test says that something is missing."""
        return self.p_value < LEVEL

    @property
    def first(self) -> Named | None:
        """What was named first."""
        return self.named[0] if self.named else None

    @property
    def right(self) -> bool:
        """Whether the first name is that of something hidden."""
        return self.first is not None and self.first.id in self.effects

    @property
    def covered(self) -> bool:
        """Whether something hidden is named first or declared a look-alike of what is."""
        return self.first is not None and (self.right or bool(set(self.first.alike) & set(self.effects)))


def entry_of(name: str, truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Entry | None:
    """Return the entry of an answered session; None where there is no answer."""
    if "verdict" not in answer:
        return None
    effects = tuple(truth["kinds"])
    d = float(truth["d"])
    components = tuple(
        truth.get("classes") or truth.get("components") or (LISTED[e].component for e in effects if e in LISTED)
    )
    named = tuple(_named(m) for m in answer["mechanisms"])
    location = answer["location"] or {}
    fit = answer["fit"]
    after = fit["heldout_rms_after"]
    return Entry(
        name=name,
        kind=str(truth.get("kind") or ("null", "single", "two")[min(len(effects), 2)]),
        effects=effects,
        components=components,
        d=d,
        d_of_each=tuple(truth.get("d_of_each") or [d] * len(effects)),
        truth=truth,
        verdict=answer["verdict"],
        p_value=float(answer["p_value"]),
        located=str(location.get("component") or (named[0].component if named else "")),
        named=named,
        heldout_rms=float(fit["heldout_rms_before"] if after is None else after),
        knowing_rms=float(truth.get("knowing_rms", float("nan"))),
        seconds=float(answer["seconds"]),
        limits={u["id"]: (u["parameter"], float(u["value"])) for u in answer.get("upper_limits", ())},
        complete=float(answer.get("complete_probability", float("nan"))),
        element=(named[0].element if named else "") or str(location.get("element") or ""),
        channels=tuple(location.get("channels") or ()),
    )


def _named(m: Mapping[str, Any]) -> Named:
    intervals = {name: (float(v["low"]), float(v["high"])) for name, v in m["parameters"].items()}
    law = m.get("law") or {}
    return Named(
        m["id"],
        float(m["probability"]),
        m["where"],
        tuple(m["indistinguishable_from"]),
        intervals,
        learned=bool(m.get("learned")),
        element=str(m.get("element") or ""),
        kind=str(law.get("kind") or ""),
        exponents={k: (float(v["low"]), float(v["high"])) for k, v in (law.get("exponents") or {}).items() if v},
    )
