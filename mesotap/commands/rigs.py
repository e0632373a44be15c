"""``rig init`` and ``rig check``: a first description of a rig from its recordings, and what it leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from analysis.mismatch.recordings.determined import Undetermined, undetermined, unknown
from analysis.mismatch.recordings.first_look import first_look
from analysis.mismatch.recordings.other_constants import SameShown, undetermined_between
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.start_check import HELPS, NOISE, StartCheck, frame_remark, start_check
from analysis.mismatch.rig_description import DescribedRig
from analysis.session import AnalysisError
from daq.errors import RecordingError
from daq.exchange import Recording, import_recording
from mesotap.answers.rig_text import first_rig, seen
from mesotap.commands.outputs import make_ready, write_json
from mesotap.commands.recordings import believed, show_left_out, show_remarks
from mesotap.configuration.rig_files import load_rig
from mesotap.configuration.usual_recordings import recording_remarks, rig_remarks
from mesotap.operator.terminal import escape


def begin_rig(
    files: Sequence[Path],
    output: Path,
    rate: float | None,
    inputs: Sequence[str],
    json_path: Path | None,
    console: Console,
) -> None:
    """Write a first rig file from what the first of some recordings shows; never overwrites one.

    Parameters
    ----------
    rate
        Sampling rate, Hz, where the files do not say.
    inputs
        Channels that drive the rig, where their names and units do not tell.
    """
    if output.exists():
        raise RecordingError(f"{output}: exists already; it is left as it is")
    make_ready(output, None)
    make_ready(json_path, None)
    recordings = [believed(import_recording(file, rate_hz=rate)) for file in files]
    for other in recordings[1:]:
        if other.names != recordings[0].names:
            raise RecordingError(f"{other.source}: has other channels than {recordings[0].source}")
    show_left_out(recordings[0], console)
    unusual = [remark for one in recordings for remark in recording_remarks(one, rate=False)]
    show_remarks(unusual, console)
    missing = [name for name in inputs if name not in recordings[0].names]
    if missing:
        raise RecordingError(f"{files[0]}: has no channel {missing[0]}; it holds {', '.join(recordings[0].names[:20])}")
    look = first_look(recordings[0], inputs)
    if all(s.rms == 0 for s in look.sensors):
        raise RecordingError(f"{look.source}: no channel shows a motion")
    text = first_rig(look, [file.name for file in files], rate)
    try:
        with output.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise RecordingError(f"{output}: exists already; it is left as it is") from None
    for line in seen(look):
        console.print(escape(line), highlight=False, soft_wrap=True)
    console.print(
        escape(f"{output}: written; look at every line, then 'mesotap rig check {output} {files[0]}'"),
        highlight=False,
        soft_wrap=True,
    )
    content = {"written": str(output), "seen": list(seen(look))}
    write_json(json_path, content | ({"remarks": unusual} if unusual else {}))


def check_rig(file: Path, recordings: Sequence[Path], json: Path | None, console: Console) -> None:
    """Say what the channels of a rig cannot tell, and how well it begins on its recordings."""
    rig = load_rig(file)
    with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
        left_open = undetermined(rig)
        between = None if left_open else undetermined_between(rig)
        read = [believed(import_recording(file, rate_hz=rig.rate_hz)) for file in recordings]
        unusual = [said for one in read for said in (*recording_remarks(one, rate=False), *rig_remarks(rig, one))]
        show_remarks(unusual, console)
        started = _started(rig, read) if read else None
    lines = [f"{file}: valid; {_counted(rig)}", *(u.statement for u in left_open)]
    if between is not None:
        lines.append(between.statement)
    elif not left_open:
        lines.append("every unknown constant can be told from such channels")
    if started is not None:
        with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
            lines += [*_of_start(started), *filter(None, [frame_remark(rig, read)])]
    for line in lines:
        console.print(escape(line), highlight=False, soft_wrap=True)
    write_json(json, _content(left_open, between, started) | ({"remarks": unusual} if unusual else {}))


def _started(rig: DescribedRig, recordings: Sequence[Recording]) -> StartCheck:
    try:
        return start_check(rig, [prepare(r, rig) for r in recordings])
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        raise AnalysisError(
            f"{recordings[0].source}: cannot be computed with the rig {rig.name!r} as described: its constants or its "
            "times are far from what was recorded; check their units"
        ) from error


def _counted(rig: DescribedRig) -> str:
    a = rig.arrangement
    parts = ((len(a.bodies), "body", "bodies"), (len(a.elements), "element", "elements"))
    told = [f"{n} {one if n == 1 else more}" for n, one, more in (*parts, (len(rig.seen), "sensor", "sensors"))]
    free = len(unknown(rig))
    return f"{', '.join(told)}, {free} unknown constant{'s' if free != 1 else ''}"


def _of_start(found: StartCheck) -> list[str]:
    lines = [
        f"with constants from the spectra the linear rig misses {100 * share:.3g} % of what {name} shows (rms)"
        for name, share in found.missed.items()
    ]
    if found.poor and max(found.missed.values()) >= 1:
        lines.append("that is worse than predicting nothing: a value or a unit of the description is far off")
    lines += [
        f"with an unknown {name} it would miss {100 * share:.3g} %: say 'unknown' in the place of its value"
        for name, share in found.freed.items()
        if share < HELPS
    ]
    if found.poor and not any(share < HELPS for share in found.freed.values()):
        lines.append(
            "no single value left free would mend that: look at the units (kg, N/m), at the bodies, at what holds them;"
            " if these are right, a force or a part is left out, which 'mesotap diagnose' looks for"
        )
    lines += [
        f"these recordings hardly hold the {name}: +-{100 * error:.2g} % with noise of {100 * NOISE:g} % in each "
        "channel; declare it if you know it"
        for name, error in found.weak.items()
    ]
    return lines


def _content(
    left_open: Sequence[Undetermined], between: SameShown | None, started: StartCheck | None
) -> dict[str, Any]:
    content: dict[str, Any] = {
        "undetermined": [
            {"name": u.name, "with": dict(zip(u.with_it, u.powers, strict=True)), "statement": u.statement}
            for u in left_open
        ]
    }
    if between is not None:
        content["same_shown_by"] = {"factors": dict(between.factors), "statement": between.statement}
    if started is not None:
        content |= {"missed": started.missed, "weak": started.weak, "better_unknown": started.freed}
    return content
