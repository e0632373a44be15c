"""`mesotap compare`: sessions against each other, and groups of them by a mixed model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from analysis.mixed_model import TooFew
from daq.errors import RecordingError
from daq.records import Session
from mesotap.answers.results_files import results_json
from mesotap.answers.rounding import counted, significant
from mesotap.catalogue.answers_beside import result_files
from mesotap.catalogue.comparing import CLOSE, Difference, comparison_json, differences
from mesotap.catalogue.curves import DAMPING, STIFFNESS, Compared, compared_from, read_compared
from mesotap.catalogue.groups import GroupAnswer, Member, compare_groups, groups_json
from mesotap.catalogue.reading import content_of
from mesotap.commands.answers import analysed
from mesotap.commands.files import config_for
from mesotap.commands.outputs import make_ready, write_json
from mesotap.commands.recordings import SESSION_FILE, opened_session
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

BY = ("session", "specimen", "title", "operator")
FIGURES = (".svg", ".pdf", ".png")
MOST_SHOWN = 40
SHORT = {STIFFNESS: "k_c, ratio", DAMPING: "zeta2, difference in %"}


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is compared and how: ``by`` what the sessions are put in groups."""

    sessions: Sequence[Path]
    by: str = "session"
    figure: Path | None = None


def compare(wanted: Wanted, json_path: Path | None, console: Console) -> None:
    """Compare sessions, print the differences, draw the figure."""
    if wanted.by not in BY:
        raise RecordingError(f"--by {wanted.by}: allowed are {', '.join(BY)}")
    if wanted.figure is not None:
        refuse_figure(wanted.figure)
    paths = wanted.sessions if wanted.by == "session" else _without_copies(wanted.sessions, console)
    members = read_members(paths, wanted.by, console)
    if len(members) < 2:
        raise RecordingError("name two sessions at least to compare")
    sessions = [member.session for member in members]
    answer = comparison_json(sessions)
    if wanted.by == "session":
        found = differences(sessions)
        if not found:
            raise RecordingError(f"no two of these sessions have loads within {CLOSE:.0%} of each other to compare")
        _show(found, console)
    else:
        answer["groups"] = _by_groups(members, answer, console)
    for session in sessions:
        if session.drifted:
            said = f"{session.name}: the strain gauge drifted: its loads, and what is compared at them, are in doubt"
            console.print(f"- {escape(said)}", highlight=False)
    if wanted.figure is not None:
        from mesotap.report.figures._compared import compared_figure
        from mesotap.report.figures._files import save

        drawn = [(_label(m, wanted.by), m.group, m.session.drifted, m.session.loads) for m in members]
        save(compared_figure(drawn), wanted.figure)
        console.print(f"figure {escape(wanted.figure)}", highlight=False, soft_wrap=True)
    write_json(json_path, answer)


def _without_copies(paths: Sequence[Path], console: Console) -> list[Path]:
    """Return sessions without those that have the content of an earlier one: in a group they would count twice."""
    first: dict[str, Path] = {}
    kept = []
    for path in paths:
        place = _place(path)
        content = content_of(place)
        if content in first and place != _place(first[content]):
            said = f"- {escape(path)}: is a copy of {escape(first[content])} and left out"
            console.print(said, highlight=False, soft_wrap=True)
            continue
        if content and place.exists():
            first.setdefault(content, path)
        kept.append(path)
    return kept


def read_members(paths: Sequence[Path], by: str, console: Console) -> list[Member]:
    """Return sessions with their groups; one without results is analysed now, and nothing is written.

    Raises
    ------
    RecordingError
        One of them is no session of the tester, or named twice.
    """
    places = [_place(path) for path in paths]
    if len(set(places)) < len(places):
        twice = next(path for path in places if places.count(path) > 1)
        raise RecordingError(f"{twice}: is named twice: nothing differs from itself")
    members = [_member(path, by, console) for path in places]
    names = [member.session.name for member in members]
    return [
        replace(m, session=replace(m.session, name=str(p)), group=str(p) if by == "session" else m.group)
        if names.count(m.session.name) > 1
        else m
        for m, p in zip(members, paths, strict=True)
    ]


def _place(path: Path) -> Path:
    """Return a session's folder for the file in it, and else what is named."""
    resolved = path.resolve()
    return resolved.parent if resolved.name == SESSION_FILE else resolved


def _member(path: Path, by: str, console: Console) -> Member:
    found = opened_session(path, console)
    if not isinstance(found, Session) or not found.rig.is_tester:
        raise RecordingError(f"{path}: is not a session of the tester")
    config = config_for(found, None, (), console)
    compared: Compared
    if result_files(path):
        compared = read_compared(path, config)
    else:
        compared = compared_from(results_json(analysed(found, config, console)), config, str(path), path.name)
    specimen = found.specimen or compared.path
    group = compared.name if by == "session" else getattr(found, by) or f"no {by}"
    return Member(compared, group, specimen)


def _by_groups(members: Sequence[Member], answer: dict[str, object], console: Console) -> list[dict[str, object]]:
    try:
        answers = compare_groups(members)
    except TooFew as error:
        raise RecordingError(str(error)) from error
    for found in answers:
        _show_groups(found, console)
    return groups_json(answers)


def _label(member: Member, by: str) -> str:
    return member.session.name if by == "session" else f"{member.group}: {member.session.name}"


def refuse_figure(file: Path) -> None:
    """Find out before anything is computed whether a figure can be written there.

    Raises
    ------
    RecordingError
        It cannot, or a file of something else is there.
    """
    if file.suffix.lower() not in FIGURES:
        raise RecordingError(f"--figure {file}: a figure is written as {', '.join(FIGURES)}")
    make_ready(file, None)
    if file.exists() and file.stat().st_size and not _is_figure(file):
        raise RecordingError(f"{file}: exists already and is no figure; it is left as it is, name another file")


def _is_figure(file: Path) -> bool:
    from daq.regular import read_head

    return read_head(file, 5) in (b"%PDF-", b"\x89PNG\r", b"<?xml")


def _show(found: Sequence[Difference], console: Console) -> None:
    shown = Table(
        keys=3, title="the second against the first, 95 % intervals; p of single loads adjusted for their number"
    )
    for heading in ("first", "second", "load, mN", "of", "value", "95 % interval", "p", "had nothing been common"):
        shown.add_column(heading)
    for d in found[:MOST_SHOWN]:
        scale = 1.0 if d.quantity == STIFFNESS else 100.0
        load = "mean of all" if d.load_mn is None else f"{d.load_mn:.0f}"
        most = 5 if d.quantity == STIFFNESS else 3
        digits = [significant(scale * value, most) for value in (d.value, d.low, d.high)]
        wider = d.separate_half_width / d.half_width if d.half_width else 1.0
        shown.add_row(
            *(escape(d.a), escape(d.b), load, SHORT[d.quantity], digits[0], f"{digits[1]} to {digits[2]}"),
            *(significant(d.p_value, 2), f"{wider:.2f} times as wide"),
        )
    console.print(shown)
    if len(found) > MOST_SHOWN:
        console.print(f"... and {len(found) - MOST_SHOWN} more; --json has all", highlight=False)
    console.print(
        "- these intervals are of these sessions alone; how specimens scatter, several of each tell with --by title",
        highlight=False,
    )


def _show_groups(found: GroupAnswer, console: Console) -> None:
    name = "k_c" if found.quantity == STIFFNESS else "zeta2"
    shown = Table(
        title=f"{name}: {counted(found.sessions, 'session')} of {counted(found.specimens, 'specimen')}, "
        f"{counted(found.rows, 'load')}; "
        f"ratio to {escape(found.reference)}, 95 % intervals"
    )
    for heading in ("group", "ratio", "95 % interval", "degrees of freedom"):
        shown.add_column(heading)
    rows = groups_json([found])[0]
    for row in rows["ratios"]:
        ends = f"{significant(row['low'], 4)} to {significant(row['high'], 4)}"
        dof = row["degrees_of_freedom"]
        shown.add_row(escape(row["group"]), significant(row["value"], 4), ends, "∞" if dof is None else f"{dof:.1f}")
    console.print(shown)
    said = [
        f"{s['of']} {100 * s['value']:.2g} % ({100 * s['low']:.2g} to "
        f"{'no bound' if s['high'] is None else format(100 * s['high'], '.2g')} %)"
        for s in rows["scatters"]
    ]
    taps = "" if rows["between_taps"] is None else f", between taps of a load {100 * rows['between_taps']:.2g} %"
    console.print(f"- scatter of {name}: {', '.join(said)}{taps}", highlight=False)
