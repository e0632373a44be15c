"""Whether the numbers of a session can be trusted: a line each for gauge, taps and physics, and what to do next."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from shlex import quote
from typing import Any

from analysis.results import LoadResult, SessionResults
from analysis.session import DRIFTED
from daq.errors import RecordingError
from daq.hits import LEFT_OUT
from daq.records import Session
from daq.regular import read_regular
from daq.reject_reasons import most_frequent
from mesotap.answers.recording_files import sha256_of
from mesotap.answers.rounding import significant

DIAGNOSIS, DIAGNOSIS_PAGE = "diagnosis.json", "diagnosis.html"
HOW_TO_DIAGNOSE = "#model"
"""Paragraph of the report that tells how the model is tested."""

LARGEST_DIAGNOSIS = 10_000_000
"""Bytes; a session of 64 impacts at 8 loads is answered in 30,000."""

MANY_REJECTED = 0.3
"""Share of rejected taps from which on the taps themselves are in doubt: twice and more that of the simulated person of
`config.yaml` (13 %); the published sessions do not say how many were."""

LEAST_IMPACTS = 3
"""Accepted taps at a load, with fewer of which their scatter is hardly known."""


LINE = 47
"""Characters of a line, from its name to its few words: what 390 px hold at 13 px."""


class Light(Enum):
    """How far something can be trusted."""

    GOOD = "good"
    OPEN = "not known"
    DOUBT = "in doubt"
    BAD = "not to be used"


@dataclass(frozen=True, slots=True)
class Trust:
    """One line.

    Attributes
    ----------
    what
        What is judged.
    light
        How far it can be trusted.
    brief
        Why, in a few words with which it stays on one line of a telephone (see `LINE`).
    words
        Why, in a sentence.
    evidence
        Where on the page, or beside it, the evidence is.
    then
        What to do about it; empty where there is nothing to do.
    """

    what: str
    light: Light
    brief: str
    words: str
    evidence: str
    then: str = ""


def trusted(session: Session, results: SessionResults, folder: Path, sha256: str | None = None) -> tuple[Trust, ...]:
    """Judge a session.

    Parameters
    ----------
    session, results
        The session and what its analysis answered.
    folder
        Where a diagnosis of it may be.
    sha256
        Of the session's file, wherever it lies; None: it is looked for in ``folder``.
    """
    physics = _physics(session, folder, sha256)
    return (*_values(results), *_gauge(results), _taps(session, results), _agreement(results.loads), physics)


def what_next(lines: Sequence[Trust]) -> str:
    """Say in a sentence what to do: about the worst of the lines first."""
    order = (Light.BAD, Light.DOUBT, Light.OPEN)
    wanted = [line.then for light in order for line in lines if line.light is light and line.then]
    return wanted[0] if wanted else "Nothing speaks against these numbers: results.csv has them for the next step."


def _values(results: SessionResults) -> list[Trust]:
    """Say which values are far from usual; nothing where all of them are usual."""
    if not results.remarks:
        return []
    first, more = results.remarks[0], len(results.remarks) - 1
    others = f"; {more} more such beneath" if more else ""
    again = "Correct what is declared in another unit and analyse again: every number here follows from it."
    brief = f"{more + 1} to be looked at"
    return [Trust("Values and units", Light.DOUBT, brief, f"{first[:1].upper()}{first[1:]}{others}.", "#notes", again)]


def _gauge(results: SessionResults) -> list[Trust]:
    gauge, where = results.calibration, "#calibration"
    if gauge is None:
        words = "There is none: loads are those of the file, or targets."
        again = "Calibrate the strain gauge ('mesotap calibrate'), then repeat."
        return [Trust("Calibration", Light.BAD, "none", words, where, again)]
    off = f"{significant(gauge.nonlinearity_percent, 2)} % off its line"
    straight = f"Departs from its line by {significant(gauge.nonlinearity_percent, 2)} % at most."
    bent = "curved" in gauge.statement
    lines = [
        Trust(
            "Calibration",
            Light.DOUBT if bent else Light.GOOD,
            "curved" if bent else off,
            f"{straight} It is curved; the loads follow the curve." if bent else straight,
            where,
            "Look at the gauge and its weights: a strain gauge is straight in this range." if bent else "",
        )
    ]
    if gauge.drifted:
        again = "Let the gauge come to rest, calibrate, and repeat the loads."
        words = "It drifted: every load is interpolated, with a wider interval."
        lines.append(Trust("Drift of the gauge", Light.DOUBT, "it drifted", words, where, again))
    elif gauge.drift_p_value is None:
        untested = "There is one calibration alone, so that it could not be tested."
        again = "Calibrate after the test too ('mesotap resume')."
        lines.append(Trust("Drift of the gauge", Light.OPEN, "one calibration", untested, where, again))
    else:
        p = significant(gauge.drift_p_value, 2)
        words = f"The calibrations before and after agree (p = {p})."
        if not gauge.zero_readings:
            words += " What came and went between them was not read (calibration.zero_every_loads)."
        lines.append(Trust("Drift of the gauge", Light.GOOD, f"none (p = {p})", words, where))
    return lines


def _taps(session: Session, results: SessionResults) -> Trust:
    left_out = sum(i.reject_reason.startswith(LEFT_OUT) for i in results.impacts if not i.accepted)
    made, rejected = len(results.impacts), sum(not impact.accepted for impact in results.impacts) - left_out
    why = _why_rejected(results)
    by_hand = sum(bool(i.accepted and i.extra.get("overruled")) for i in session.impacts)
    few = [load for load in results.loads if load.impacts_used < LEAST_IMPACTS]
    words, where = f"{rejected} of {made} rejected", "#taps"
    brief = words
    if left_out:
        words += f", {left_out} left out by the choice of hits"
    if session.refused:
        words += ", and not every record of the file could be read"
    if not made or len(few) == len(results.loads):
        again = f"Tap more often at each load: eight accepted taps are usual.{why}"
        light, words = Light.DOUBT if made else Light.BAD, f"{words}; no load has {LEAST_IMPACTS} good ones."
        brief = f"fewer than {LEAST_IMPACTS} good at any load" if made else "none"
        return Trust("Taps", light, brief, words, where, again)
    if few:
        loads = ", ".join(f"{load.target_load_mn:.4g}" for load in few)
        again = f"Tap more often at {loads} mN.{why}"
        brief = f"fewer than {LEAST_IMPACTS} good at {len(few)} load{'s' * (len(few) != 1)}"
        words = f"{words}; fewer than {LEAST_IMPACTS} good ones at {loads} mN."
        return Trust("Taps", Light.DOUBT, brief, words, where, again)
    if by_hand:
        return Trust(
            "Taps",
            Light.DOUBT,
            f"{by_hand} accepted by hand",
            f"{words}; {by_hand} accepted by hand.",
            where,
            "Read the reasons of the taps accepted by hand.",
        )
    if rejected > MANY_REJECTED * made:
        return Trust(
            "Taps",
            Light.DOUBT,
            brief,
            f"{words}: more than usual.",
            where,
            why.strip() or "See why so many taps were rejected; a steadier tap scatters less.",
        )
    return Trust("Taps", Light.GOOD, brief, f"{words}.", where)


def _why_rejected(results: SessionResults) -> str:
    """Say what most taps were rejected for and what to do at the bench; empty where none was rejected."""
    reasons = [i.reject_reason for i in results.impacts if not i.accepted and not i.reject_reason.startswith(LEFT_OUT)]
    found = most_frequent(reasons)
    if found is None:
        return ""
    what, count, then = found
    return f" {count} of {len(reasons)} rejected taps: {what}. At the bench: {then}."


def _agreement(loads: Sequence[LoadResult]) -> Trust:
    # the gauge's drift has a line of its own
    noted = [load for load in loads if any(note != DRIFTED for note in load.notes)]
    without = [load for load in loads if load.contact_stiffness_n_per_m is None]
    if without:
        where = ", ".join(f"{load.target_load_mn:.4g}" for load in without)
        again = "Read the notes beneath Table 1: they say why there is no contact mode."
        brief = f"no contact mode at {len(without)}"
        return Trust("Each load", Light.BAD, brief, f"No contact mode at {where} mN.", "#results", again)
    if noted:
        words = f"notes at {len(noted)} of {len(loads)} loads"
        again = "Read the notes beneath Table 1 before the numbers are used."
        return Trust("Each load", Light.DOUBT, words, f"{words.capitalize()}.", "#results", again)
    return Trust(
        "Each load",
        Light.GOOD,
        "nothing noted against it",
        "A contact mode was found at all of them, and nothing was noted against it.",
        "#results",
    )


def _physics(session: Session, folder: Path, sha256: str | None) -> Trust:
    """Say what a diagnosis that lies beside the report found of Eq. 9."""
    what, answer = "Eq. 9 as a model", _diagnosis(session, folder, sha256)
    file = session.source or "session.h5"
    if answer is None:
        command = f"mesotap diagnose {quote(file)} --report FOLDER"
        run = f"Have the model tested ('{command}', the folder of this page), then write it again ('mesotap report')."
        return Trust(what, Light.OPEN, "no diagnosis", "Not tested: no diagnosis was run.", HOW_TO_DIAGNOSE, run)
    page = DIAGNOSIS_PAGE if (folder / DIAGNOSIS_PAGE).is_file() else DIAGNOSIS
    if answer["verdict"] == "consistent":
        return Trust(what, Light.GOOD, "nothing is left out", "A diagnosis found nothing that it leaves out.", page)
    named = " and ".join(str(m["statement"]).rstrip(".") for m in answer["mechanisms"])
    if answer["verdict"] == "unexplained" or not named:
        again = "Read the diagnosis: it says where the mismatch is and what would tell more."
        words = "It leaves something out that no known mechanism explains."
        return Trust(what, Light.DOUBT, "not explained", words, page, again)
    chance = significant(float(answer["mechanisms"][0]["probability"]), 2)
    again = f"Correct the numbers for it: 'mesotap analyze {quote(file)} --model {DIAGNOSIS} --report corrected'."
    words = f"It leaves something out (probability {chance}): {named}."
    return Trust(what, Light.DOUBT, f"incomplete ({chance})", words, page, again)


def _diagnosis(session: Session, folder: Path, sha256: str | None) -> dict[str, Any] | None:
    """Return the diagnosis in a folder, if it is one of this very recording: by the hash, wherever the file lies."""
    file, recording = folder / DIAGNOSIS, folder / Path(session.source).name
    if not file.is_file() or (sha256 is None and not (session.source and recording.is_file())):
        return None
    try:
        answer = json.loads(read_regular(file, LARGEST_DIAGNOSIS, "a diagnosis"))
        its_own = [r["sha256"] for r in answer["recordings"]] == [sha256 or sha256_of(recording)]
        sound = answer["version"] == 2 and all(m["statement"] and m["probability"] for m in answer["mechanisms"])
        return answer if its_own and sound and isinstance(answer["verdict"], str) else None
    except (RecordingError, ValueError, LookupError, TypeError):
        return None
