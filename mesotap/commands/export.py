"""``export``: a recording, or the accepted impacts of a session, for other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from daq.errors import RecordingError
from daq.exchange.exporting import UNIVERSAL, Shape, export_recording, rewritten
from daq.exchange.recording import Recording
from daq.records import Session
from mesotap.commands.outputs import make_ready, refuse_to_overwrite, write_json
from mesotap.commands.recordings import opened, show_left_out, show_remarks
from mesotap.configuration.usual_recordings import refused_records
from mesotap.operator.terminal import escape

MOST_SAID = 10
"""Lines that are printed about names and units; `--json` has all."""


def export(
    source: Path,
    output: Path,
    rate: float | None,
    text: bool,
    with_modes: bool,
    json_path: Path | None,
    console: Console,
) -> None:
    """Write a recording or a session in the format that the ending of ``output`` says, and say what is in it."""
    refuse_to_overwrite(output)
    make_ready(output, None)
    found = opened(source, rate)
    if isinstance(found, Session) and with_modes:
        raise RecordingError(f"{source}: is a session, whose modes at each load are in its results.json")
    recording = accepted_impacts(found) if isinstance(found, Session) else found
    show_left_out(recording, console)
    refused = refused_records(found) if isinstance(found, Session) else []
    show_remarks(refused, console)
    modes = _modes(recording) if with_modes else []
    export_recording(output, recording, binary=not text, modes=modes)
    channels, samples = recording.data.shape
    shapes = f", {len(modes)} modes" if with_modes else ""
    said = f"{escape(output)}: {channels} channels, {samples} samples at {recording.rate_hz:g} Hz{shapes}"
    console.print(said, highlight=False, soft_wrap=True)
    changed = rewritten(recording) if output.suffix.lower() in UNIVERSAL else ()
    for line in changed[:MOST_SAID]:
        console.print(f"- {escape(output)}: {escape(line)}", highlight=False, soft_wrap=True)
    if len(changed) > MOST_SAID:
        console.print(f"- {escape(output)}: and {len(changed) - MOST_SAID} more such", highlight=False, soft_wrap=True)
    answer = {"written": str(output), "channels": list(recording.names), "samples": samples, "modes": len(modes)}
    write_json(json_path, {**answer, "rate_hz": recording.rate_hz, "notes": [*refused, *changed]})


def accepted_impacts(session: Session) -> Recording:
    """Return the accepted impacts of a session as one recording, whose channels are named by impact: A, B, any force.

    Raises
    ------
    RecordingError
        There is none, or they are unlike in length or rate.
    """
    impacts = [impact for impact in session.impacts if impact.accepted]
    if not impacts:
        raise RecordingError(f"{session.source}: holds no accepted impact")
    kinds = {(impact.sample_rate_hz, impact.acceleration.shape[1]) for impact in impacts}
    if len(kinds) > 1:
        raise RecordingError(
            f"{session.source}: its impacts are unlike in length or rate, so that no one file holds them"
        )
    named = [
        channel
        for impact in impacts
        for channel in (
            (f"{impact.name} A", "m/s2", impact.acceleration[0]),
            (f"{impact.name} B", "m/s2", impact.acceleration[1]),
            (f"{impact.name} force", "N", impact.force),
        )
    ]
    names, units, data = zip(*(channel for channel in named if channel[2] is not None), strict=True)
    unit = "" if "N" in units else "m/s2"
    return Recording(np.array(data, np.float64), impacts[0].sample_rate_hz, names, unit, session.source, units)


def _modes(recording: Recording) -> list[Shape]:
    from mesotap.commands.files import modes_of

    found = modes_of(recording, "ml")
    poles = [2 * np.pi * m.frequency_hz.value * _direction(m.damping_ratio.value) for m in found.modes]
    return list(zip(poles, found.shapes().T, strict=True))


def _direction(damping_ratio: float) -> complex:
    """Return a pole over its magnitude."""
    return complex(-damping_ratio, np.sqrt(1 - damping_ratio**2))
