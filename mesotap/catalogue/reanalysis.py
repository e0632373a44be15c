"""A session analysed again: the answer beside the older ones, what changed, and what may have changed it.

``reanalysis/<digest>/`` beside a session has ``results.json`` and ``provenance.json``; the digest is that of program,
configuration and recording, so that the same analysis is not done twice. No older answer is touched.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq.durable import make_folder, write_error, write_whole
from daq.errors import RecordingError
from mesotap import __version__
from mesotap.answers.results_files import QUANTITIES, json_text
from mesotap.campaigns.task import program_sha256
from mesotap.catalogue.answers_beside import RESULTS, places_of_answers, read_answer, result_files
from mesotap.catalogue.reading import content_of
from mesotap.configuration.config import Config, effective_text

PROVENANCE = "provenance.json"
ROUNDING = 1e-6
"""Relative difference below which a number is the same: libraries and processors round differently."""

NOTHING = 1e-3
"""Of half of the older interval: less is no change of a number next to zero."""

UNKNOWN = "not recorded with the older answer"


@dataclass(frozen=True, slots=True)
class Changed:
    """A number that is another now; ``beyond`` its former 95 % interval or not, None for what one of both lacks."""

    load_set: int
    target_load_mn: float | None
    quantity: str
    old: float | None
    new: float | None
    old_half_width: float | None
    beyond: bool | None


@dataclass(frozen=True, slots=True)
class Reanalysis:
    """What an analysis came to: ``answer`` and ``older`` are files, ``older`` empty for the first answer.

    ``done`` is false where this program had analysed this recording with this configuration before. ``causes`` says of
    program, configuration and data what differs from when the older answer was made.
    """

    answer: Path
    older: str
    done: bool
    changes: tuple[Changed, ...]
    causes: dict[str, str]


def reanalysed(session: Path, software: str, config: Config, analyse: Callable[[], dict[str, Any]]) -> Reanalysis:
    """Analyse a session again, or return what this program said of it before.

    Parameters
    ----------
    session
        Its folder, or a session file that lies by itself.
    software
        That the session file says it was written by.
    config
        To analyse with.
    analyse
        Returns results as JSON.

    Raises
    ------
    RecordingError
        The answer cannot be written, or an older one not read.
    """
    text = effective_text(config)
    now = {
        "software": f"mesotap {__version__}",
        "program_sha256": program_sha256(),
        "configuration_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "session_sha256": content_of(session),
    }
    digest = hashlib.sha256(json.dumps(now, sort_keys=True).encode()).hexdigest()[:16]
    place = places_of_answers(session)[1] / digest
    answer = place / RESULTS
    older = next((file for file in result_files(session) if file != answer), None)
    before = None if older is None else read_answer(older, "the results of a session")
    if done := not answer.is_file():
        said = json_text(analyse())
        _make(place)
        at = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        about = {"format": "mesotap-provenance", "version": 1, **now, "at": at, "configuration": text}
        write_whole(place / PROVENANCE, json_text(about).encode())
        write_whole(answer, said.encode())  # last: an answer is complete or absent
    if before is None or older is None:
        return Reanalysis(answer, "", done, (), {})
    changes = changed(before, read_answer(answer, "the results of a session"))
    return Reanalysis(answer, str(older), done, changes, _causes(older, session, software, now))


def changed(old: dict[str, Any], new: dict[str, Any]) -> tuple[Changed, ...]:
    """Return every number of every load that is not the same in two results.

    Raises
    ------
    RecordingError
        One of them is not the results of a session.
    """
    try:
        before, after = ({load["load_set"]: load for load in results["loads"]} for results in (old, new))
        found = []
        for load_set in sorted(before.keys() | after.keys()):
            was, now = before.get(load_set, {}), after.get(load_set, {})
            target = now.get("target_load_mn", was.get("target_load_mn"))
            for quantity in QUANTITIES:
                one, other = was.get(quantity), now.get(quantity)
                if one is None and other is None:
                    continue
                if one is None or other is None:
                    values = [None if e is None else float(e["value"]) for e in (one, other)]
                    found.append(Changed(load_set, target, quantity, values[0], values[1], None, None))
                    continue
                then, here, half = float(one["value"]), float(other["value"]), (one["high"] - one["low"]) / 2
                if not math.isclose(then, here, rel_tol=ROUNDING, abs_tol=NOTHING * half):
                    beyond = not one["low"] <= here <= one["high"]
                    found.append(Changed(load_set, target, quantity, then, here, half, beyond))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RecordingError("an older answer is not the results of a session") from error
    return tuple(found)


def _causes(older: Path, session: Path, software: str, now: dict[str, str]) -> dict[str, str]:
    kept = older.parent / PROVENANCE
    if kept.is_file() and older.parent.parent == places_of_answers(session)[1]:
        then = read_answer(kept, "what an answer was made from")
        said = {}
        for name, key in (("version", "program_sha256"), ("configuration", "configuration_sha256")):
            said[name] = "the same" if then.get(key) == now[key] else "another"
        said["data"] = "the same" if then.get("session_sha256") == now["session_sha256"] else "another"
        if said["version"] == "another":
            said["version"] = f"another ({then.get('software')}, now {now['software']})"
        return said
    plain = software.partition(" (")[0]
    recorded = session if not session.is_dir() else session / "session.h5"
    newer = recorded.is_file() and recorded.stat().st_mtime_ns > older.stat().st_mtime_ns
    return {
        "version": f"another ({plain}, now {now['software']})" if plain != now["software"] else UNKNOWN,
        "configuration": UNKNOWN,
        "data": "the session file was written after the older answer" if newer else "the same, by its time",
    }


def _make(place: Path) -> None:
    try:
        make_folder(place)
    except OSError as error:
        raise write_error(place, error) from error
