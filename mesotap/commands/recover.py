"""``recover``: a sound session file from a damaged session folder."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from daq.errors import RecordingError
from daq.session_file import read_session, write_session
from mesotap.commands.outputs import write_json
from mesotap.operator.terminal import escape
from mesotap.session.recovery import recover


def recover_folder(folder: Path, output: Path | None, json_path: Path | None, console: Console) -> None:
    """Write a session file of the intact impacts in a folder, and report line by line what was lost.

    Raises
    ------
    RecordingError
        There is no intact impact, or the file exists already or would be in the folder that must not change.
    """
    where = folder.resolve()
    if output is None and not where.name:
        raise RecordingError(f"{folder}: has no name to call the session file after; name a file with -o")
    target = output or where.with_name(f"{where.name}-recovered.h5")
    if target.resolve().is_relative_to(where):
        raise RecordingError(f"{target}: lies in the damaged folder, which is left as it is; name a place outside")
    if target.exists() or target.is_symlink():
        raise RecordingError(f"{target}: exists already and is left as it is; name another file with -o")
    found = recover(folder)
    write_session(target, found.session, new=True)
    session = read_session(target)  # what was written can be read, or this is the place to say so
    if session.refused:
        raise RecordingError(f"{target}: {session.refused[0]}")
    for line in found.losses:
        console.print(f"- {escape(line)}", highlight=False, soft_wrap=True)
    accepted = sum(impact.accepted for impact in session.impacts)
    state = "complete" if session.complete else "not complete, as far as can be proven"
    console.print(
        f"{escape(str(target))}: {len(session.impacts)} impacts, {accepted} of them accepted; {state}; "
        f"{_counted(len(found.losses))} amiss",
        highlight=False,
        soft_wrap=True,
    )
    write_json(
        json_path,
        {
            "format": "mesotap-recovery",
            "version": 1,
            "source": str(folder),
            "file": str(target),
            "shots": [impact.number for impact in session.impacts],
            "accepted": accepted,
            "complete": session.complete,
            "losses": list(found.losses),
        },
    )


def _counted(losses: int) -> str:
    return "nothing was" if not losses else "1 thing was" if losses == 1 else f"{losses} things were"
