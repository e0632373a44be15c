"""`mesotap reanalyze`: sessions again with this version; older answers stay, and what changed is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from analysis.modal.exponentials import FitFailure
from analysis.session import AnalysisError
from daq.errors import RecordingError
from daq.records import Session
from mesotap.answers.results_files import results_json
from mesotap.answers.rounding import counted, significant
from mesotap.catalogue.entry import UNREADABLE, Entry
from mesotap.catalogue.indexing import update
from mesotap.catalogue.listing import copies
from mesotap.catalogue.reanalysis import Reanalysis, reanalysed
from mesotap.catalogue.store import Catalogue
from mesotap.commands.answers import analysed
from mesotap.commands.catalog import Asked, look_up
from mesotap.commands.files import config_for
from mesotap.commands.outputs import write_json
from mesotap.commands.recordings import opened_session
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

MOST_SHOWN = 60
NO_SESSION = "no session"


def reanalyze(
    what: Asked, config_path: Path | None, changes: Sequence[str], json_path: Path | None, console: Console
) -> None:
    """Analyse the sessions that are asked for again, and say what changed and what may have changed it."""
    found = look_up(what, console)
    told: list[dict[str, Any]] = []
    refusals: list[str] = []
    twice = copies(found.found)
    for number, entry in enumerate(found.found, start=1):
        if entry.path in twice:
            told.append(_told(entry, "copy", reason=f"has the content of {twice[entry.path]}"))
            continue
        try:
            console.print(f"{number} of {len(found.found)}: {escape(entry.path)}", highlight=False, soft_wrap=True)
            made = _one(entry, config_path, changes, console)
        except (RecordingError, AnalysisError, FitFailure) as error:
            refusals.append(f"{entry.path}: {error}" if not str(error).startswith(entry.path) else str(error))
            told.append(_told(entry, "refused", reason=str(error)))
            continue
        if made is None:
            told.append(_told(entry, NO_SESSION, reason="a recording of another rig; mesotap analyze finds its modes"))
            continue
        status = "first" if not made.older else "changed" if made.changes else "unchanged"
        told.append(_told(entry, status, made))
    for entry in found.not_judged:
        told.append(_told(entry, "not judged", reason=f"{entry.state}: {entry.reason}"))
    within = [Path(entry.path) for entry in found.found if Path(entry.path).exists()]
    if within:
        with Catalogue(found.index) as catalogue:
            update(catalogue, within)
    _show(told, console)
    write_json(json_path, {"format": "mesotap-reanalysis", "version": 1, "sessions": told})
    if told and all(one["status"] == NO_SESSION for one in told):
        refusals.append("nothing that was asked for is a session of the tester")
    if refusals:
        raise RecordingError("; ".join(refusals))


def _one(entry: Entry, config_path: Path | None, changes: Sequence[str], console: Console) -> Reanalysis | None:
    """Analyse a session again; None where the file is a recording of another rig, in which there is nothing to do."""
    if entry.state in UNREADABLE:
        raise RecordingError(f"{entry.state}: {entry.reason}")
    path = Path(entry.path)
    session = opened_session(path, console)
    if not isinstance(session, Session) or not session.rig.is_tester:
        return None
    config = config_for(session, config_path, changes, console)
    return reanalysed(path, session.software, config, lambda: results_json(analysed(session, config, console)))


def _told(entry: Entry, status: str, made: Reanalysis | None = None, reason: str = "") -> dict[str, Any]:
    told = {"path": entry.path, "name": entry.name, "status": status, "reason": reason}
    if made is None:
        return {**told, "answer": None, "older": None, "done": False, "changes": [], "causes": {}}
    return {
        **told,
        "answer": str(made.answer),
        "older": made.older or None,
        "done": made.done,
        "changes": [asdict(change) for change in made.changes],
        "causes": made.causes,
    }


def _show(told: list[dict[str, Any]], console: Console) -> None:
    done = sum(one["done"] for one in told)
    shown = Table(title=f"{done} of {counted(len(told), 'session')} analysed now; older answers are where they were")
    for heading in (
        "session",
        "outcome",
        "numbers changed",
        "beyond their intervals",
        "largest change",
        "what differs",
    ):
        shown.add_column(heading)
    for one in told[:MOST_SHOWN]:
        beyond = sum(change["beyond"] is True for change in one["changes"])
        differs = [f"{what}: {how}" for what, how in one["causes"].items() if not how.startswith("the same")]
        cells = (str(len(one["changes"])), str(beyond), _largest(one["changes"]))
        outcome = f"{one['status']}: {one['reason']}" if one["reason"] else one["status"]
        shown.add_row(
            escape(one["name"]), escape(outcome), *cells, escape("; ".join(differs) if one["changes"] else "")
        )
    console.print(shown)
    if len(told) > MOST_SHOWN:
        console.print(f"... and {len(told) - MOST_SHOWN} more; --json has all", highlight=False)


def _largest(changes: list[dict[str, Any]]) -> str:
    """The change that is largest in terms of its former interval."""
    sized = [(abs(c["new"] - c["old"]) / c["old_half_width"], c) for c in changes if c["old_half_width"]]
    if not sized:
        return ""
    size, most = max(sized, key=lambda pair: pair[0])
    percent = f", {100 * (most['new'] / most['old'] - 1):+.2g} %" if most["old"] else ""
    return f"{most['quantity']} at load {most['load_set'] + 1}: {significant(size, 2)} of half its interval{percent}"
