"""Whether declared look-alikes are some: the cosine of what survives of both, by the generator's own means."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from daq.durable import write_whole
from mesotap.campaigns.campaign import OnProgress
from mesotap.proof.entries import Entry
from mesotap.proof.generator.effects import LISTED
from mesotap.proof.generator.scenarios import draw_scenarios, likeness


def with_likeness(
    entries: Sequence[Entry], seed: int, sessions: int, only: str | None, kept: Path, on_progress: OnProgress
) -> list[Entry]:
    """Return the entries with the likeness of name and truth, where only a declared look-alike makes a name right.

    What was computed is kept in the file ``kept``.
    """
    known: dict[str, float] = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    scenarios = {scenario.name: scenario for scenario in draw_scenarios(seed, sessions, only)}
    owed = [
        (e, e.first.id)
        for e in entries
        if e.kind == "single" and e.covered and not e.right and e.first is not None and e.first.id in LISTED
    ]
    out = {e.name: e for e in entries}
    on_progress(0, len(owed))
    for done, (e, name) in enumerate(owed, start=1):
        key = f"{e.name} {name}"
        if key not in known:
            known[key] = likeness(seed, scenarios[e.name], name)
            write_whole(kept, (json.dumps(known, indent=1) + "\n").encode())
        out[e.name] = replace(e, likeness=known[key])
        on_progress(done, len(owed))
    return list(out.values())
