"""``hits``: which taps of a session are used and why the others are not; another choice, in a file of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from daq.errors import RecordingError
from daq.hits import BY_HAND as HAND_REASON
from daq.hits import COHERENCE, is_left_out, with_chosen
from daq.records import Impact, Session
from daq.session_file import read_session, write_session
from mesotap.answers.rounding import counted
from mesotap.commands.diagnose import file_of
from mesotap.commands.outputs import refuse_to_overwrite, write_json
from mesotap.commands.recordings import show_remarks
from mesotap.configuration.usual_recordings import refused_records
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape
from mesotap.session.hand_verdicts import BY_HAND, LONGEST_REASON, HandVerdict, with_hand_verdicts


@dataclass(frozen=True, slots=True)
class Choice:
    """What is asked for.

    Attributes
    ----------
    best
        Taps to use at each load, those whose ring-downs agree best; None to choose none.
    keep, drop
        Numbers of taps that are used, or not, for this ``reason``.
    undo
        Numbers of taps whose verdict by hand is taken back: each is again what it was before.
    reset
        Whether every earlier choice is undone first: the verdicts are then those of the recording.
    """

    best: int | None = None
    keep: Sequence[int] = ()
    drop: Sequence[int] = ()
    reason: str = ""
    undo: Sequence[int] = ()
    reset: bool = False

    @property
    def changes(self) -> bool:
        """Whether anything is asked for."""
        return self.best is not None or any((self.keep, self.drop, self.undo, self.reset))


def hits(file: Path, choice: Choice, output: Path | None, json_path: Path | None, console: Console) -> None:
    """Show the taps of a session and what was decided on each; write a session with another choice."""
    session = read_session(file_of(file))
    refused = refused_records(session)
    show_remarks(refused, console)
    if choice.changes:
        _refuse(session, choice, output)
        session = replace(session, impacts=tuple(chosen(session.impacts, choice)))
    elif output is not None:
        raise RecordingError("--output: nothing is to be written; say --best, --keep, --drop, --undo or --reset")
    if output is not None:
        refuse_to_overwrite(output)
        write_session(output, session)
    console.print(_table(session))
    for line in _too_few(session.impacts, choice.best):
        console.print(f"- {line}", highlight=False, soft_wrap=True)
    if output is not None:
        console.print(
            f"session file {escape(output)}; {escape(file)} is left as it is", highlight=False, soft_wrap=True
        )
    content: dict[str, Any] = {"source": str(file), "written": None if output is None else str(output)}
    content |= {"remarks": refused} if refused else {}
    write_json(json_path, content | {"taps": [_said(i) for i in session.impacts]})


def _refuse(session: Session, choice: Choice, output: Path | None) -> None:
    if output is None:
        raise RecordingError(
            "say where the session with this choice goes (--output NEW.h5): the file itself is left alone"
        )
    taps = {i.number: i for i in session.impacts}
    for number in (*choice.keep, *choice.drop, *choice.undo):
        if number not in taps:
            raise RecordingError(
                f"{session.source}: has no tap {number}; its {len(taps)} taps begin with {min(taps, default=0)}"
            )
    for number in choice.undo:
        if HAND_REASON not in taps[number].extra:
            raise RecordingError(f"{session.source}: nothing was decided by hand on tap {number} that could be undone")
    both = sorted(set(choice.keep) & set(choice.drop))
    if both:
        raise RecordingError(f"tap {both[0]} cannot be both kept and dropped")
    if both := sorted(set(choice.undo) & {*choice.keep, *choice.drop}):
        raise RecordingError(f"tap {both[0]}: --undo takes back what was decided, --keep and --drop decide: say one")
    reason = choice.reason.strip()
    if (choice.keep or choice.drop) and not 0 < len(reason) <= LONGEST_REASON:
        raise RecordingError(f"say why, in 1 to {LONGEST_REASON} characters: --reason TEXT; it is kept with each tap")


def chosen(impacts: Sequence[Impact], choice: Choice) -> list[Impact]:
    """Return impacts with a choice applied: a reset first, then undone and new verdicts by hand, then the best."""
    found = [_as_recorded(i) for i in impacts] if choice.reset else list(impacts)
    asked = {n: HandVerdict(n, n in choice.keep, choice.reason.strip()) for n in (*choice.keep, *choice.drop)}
    found = [_before_hands(i) if i.number in asked or i.number in choice.undo else i for i in found]
    found = with_hand_verdicts(found, [{"event": BY_HAND, **verdict.entry()} for verdict in asked.values()])
    return found if choice.best is None else with_chosen(found, choice.best)


def _before_hands(impact: Impact) -> Impact:
    """Return an impact as it was before a person decided on it."""
    if HAND_REASON not in impact.extra:
        return impact
    reason = str(impact.extra.get("overruled") or "")
    extra = {k: v for k, v in impact.extra.items() if k not in (HAND_REASON, "overruled")}
    return replace(impact, accepted=not reason, reject_reason=reason, extra=extra)


def _as_recorded(impact: Impact) -> Impact:
    """Return an impact with the verdict that it had when it was recorded."""
    impact = _before_hands(impact)
    extra = {k: v for k, v in impact.extra.items() if k != COHERENCE}
    if is_left_out(impact):
        return replace(impact, accepted=True, reject_reason="", extra=extra)
    return replace(impact, extra=extra)


def _too_few(impacts: Sequence[Impact], best: int | None) -> list[str]:
    """Say at which loads there was nothing to choose from: fewer good taps than were asked for."""
    said = []
    for load_set in sorted({i.load_set for i in impacts}) if best is not None else ():
        good = sum(i.accepted for i in impacts if i.load_set == load_set)
        if good < (best or 0):
            said.append(f"load {load_set + 1}: has {counted(good, 'good tap')}, fewer than --best {best}: all are used")
    return said


def _said(impact: Impact) -> dict[str, Any]:
    coherence = impact.extra.get(COHERENCE)
    return {
        "number": impact.number,
        "load_set": impact.load_set,
        "target_load_mn": impact.target_load_mn if impact.target_load_mn == impact.target_load_mn else None,
        "used": impact.accepted,
        "left_out": is_left_out(impact),
        "reason": impact.reject_reason or str(impact.extra.get(HAND_REASON) or ""),
        "lowest_coherence": coherence if isinstance(coherence, float) else None,
    }


def _table(session: Session) -> Table:
    table = Table(title="Taps")
    for name in ("tap", "load, mN", "used", "lacks in coherence"):
        table.add_column(name, justify="right")
    table.add_column("why", overflow="fold")
    for impact in session.impacts:
        said = _said(impact)
        coherence = said["lowest_coherence"]
        why = f"by hand: {said['reason']}" if impact.accepted and said["reason"] else said["reason"]
        table.add_row(
            str(impact.number),
            "" if said["target_load_mn"] is None else f"{impact.target_load_mn:.4g}",
            "yes" if impact.accepted else "left out" if said["left_out"] else "no",
            "" if coherence is None else f"{1 - coherence:.2g}",
            escape(why),
        )
    return table
