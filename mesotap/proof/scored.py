"""The scores of a proof as JSON types: `scores.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from mesotap.proof import law_page, scores
from mesotap.proof.entries import Entry, Named
from mesotap.proof.scores import Count


def scored(entries: Sequence[Entry], failures: Mapping[str, str]) -> dict[str, Any]:
    """Return all scores as JSON types; shares come with their 95 % intervals."""
    lines, brier = scores.calibration(entries)
    held = scores.held_out(entries)
    covering = scores.coverage(entries)
    answer = {
        "format": "mesotap-proof",
        "version": 1,
        "sessions": len(entries),
        "failures": dict(failures),
        "nulls": asdict(scores.nulls(entries)),
        "single": [asdict(g) for g in scores.by_grade(entries)],
        "excluded": [asdict(g) for g in scores.unlisted(entries, "excluded")],
        "outside": [asdict(g) for g in scores.unlisted(entries, "outside")],
        "laws": law_page.scored(entries),
        "two": asdict(scores.pairs(entries)),
        "coverage": [asdict(c) for c in covering],
        "coverage_together": asdict(scores.together(covering)),
        "upper_limits": [{"grade": g, **asdict(count)} for g, count in scores.limits(entries)],
        "complete": completeness(entries),
        "calibration": [asdict(r) for r in lines],
        "brier": brier,
        "held_out": {"median": held.median, "within": asdict(held.within), "ratios": held.ratios},
        "confusion": scores.confusion(entries),
        "seconds": seconds(entries),
        "entries": [_line(e) for e in entries],
    }
    out: dict[str, Any] = _plain(answer)
    return out


def _plain(value: Any) -> Any:
    """Return JSON types; counts get their share and interval, what is no number becomes null."""
    if isinstance(value, dict):
        out = {k: _plain(v) for k, v in value.items()}
        if set(value) == {"hits", "of"}:
            count = Count(value["hits"], value["of"])
            out |= {"share": _plain(count.share), "interval": list(count.interval)}
        return out
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _line(e: Entry) -> dict[str, Any]:
    return {
        "session": e.name,
        "kind": e.kind,
        "hidden": list(e.effects),
        "d": e.d,
        "d_of_each": list(e.d_of_each),
        "verdict": e.verdict,
        "p_value": e.p_value,
        "located": e.located,
        "named": [_named(m) for m in e.named],
        "likeness": e.likeness,
        "heldout_over_knowing": e.heldout_rms / e.knowing_rms if e.knowing_rms > 0 else None,
        "seconds": e.seconds,
    }


def _named(m: Named) -> dict[str, Any]:
    out: dict[str, Any] = {"id": m.id, "probability": m.probability, "alike": list(m.alike)}
    if m.learned:
        out |= {"learned": True, "kind": m.kind, "element": m.element, "exponents": dict(m.exponents)}
    return out


def seconds(entries: Sequence[Entry]) -> dict[str, float]:
    """Return how long a diagnosis took, s."""
    if not entries:
        return {"median": math.nan, "largest": math.nan}
    taken = [e.seconds for e in entries]
    return {"median": float(np.median(taken)), "largest": max(taken)}


def completeness(entries: Sequence[Entry]) -> dict[str, float | None]:
    """Return mean stated probability of completeness, how often it was so, and Brier's score."""
    stated = [(e.complete, scores.complete(e)) for e in entries if math.isfinite(e.complete)]
    if not stated:
        return {"stated": None, "true": None, "brier": None}
    count = len(stated)
    return {
        "stated": sum(p for p, _ in stated) / count,
        "true": sum(right for _, right in stated) / count,
        "brier": sum((p - right) ** 2 for p, right in stated) / count,
    }
