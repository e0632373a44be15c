"""Taps that a person accepts or rejects by hand, with a reason that is kept.

The impact on disk keeps the program's own verdict. What was decided by hand is an entry of the journal, the last one on
a tap counts, and the session file holds its outcome: `reject_reason` begins with "by hand:", and an impact that was
accepted by hand keeps what spoke against it, and the person's reason, beside it (``hand_reason``, ``overruled``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from daq.records import Impact

IMPACT = "shot"
BY_HAND = "judged by hand"
"""Journal event: ``number``, ``accepted``, ``reason``."""

LONGEST_REASON = 200


@dataclass(frozen=True, slots=True)
class HandVerdict:
    """What a person decided on a tap.

    Attributes
    ----------
    number
        Of the impact.
    accepted
        Whether it is to be used.
    reason
        Why, in the person's words; never empty.
    """

    number: int
    accepted: bool
    reason: str

    def entry(self) -> dict[str, Any]:
        """What the journal says of it."""
        return {"number": self.number, "accepted": self.accepted, "reason": self.reason}

    def reject_reason(self) -> str:
        """What the session file gives as the reason; empty where the tap is accepted."""
        return "" if self.accepted else f"by hand: {self.reason}"


def decided(events: Iterable[dict[str, Any]]) -> dict[int, HandVerdict]:
    """Return the last verdict by hand on each impact that has one, by its number."""
    found = (e for e in events if e["event"] == BY_HAND)
    return {e["number"]: HandVerdict(e["number"], e["accepted"], e["reason"]) for e in found}


def verdicts_in(events: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the entries of the impacts with the verdict that counts, in their order."""
    by_hand = decided(events)
    entries = []
    for entry in events:
        if entry["event"] != IMPACT:
            continue
        verdict = by_hand.get(entry["number"])
        if verdict is not None:
            entry = {**entry, "accepted": verdict.accepted, "reject_reason": verdict.reject_reason()}
        entries.append(entry)
    return entries


def accepted_in(events: Sequence[dict[str, Any]]) -> list[int]:
    """Return the numbers of the impacts that count as accepted."""
    return [entry["number"] for entry in verdicts_in(events) if entry["accepted"]]


def with_hand_verdicts(impacts: Iterable[Impact], events: Iterable[dict[str, Any]]) -> list[Impact]:
    """Return the impacts as they count, verdicts by hand applied."""
    by_hand = decided(events)
    judged = []
    for impact in impacts:
        verdict = by_hand.get(impact.number)
        if verdict is not None:
            extra = {**impact.extra, "hand_reason": verdict.reason, "overruled": impact.reject_reason}
            impact = replace(impact, accepted=verdict.accepted, reject_reason=verdict.reject_reason(), extra=extra)
        judged.append(impact)
    return judged
