"""The journal of a session, entry by entry: what each may hold, and where it leaves the session.

What is on disk is believed once it was looked at: an entry of the wrong type, one that cannot follow the one before
it, or one that stands twice is named by its line and field.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from daq.bounds import LOAD, VOLTAGE, elapsed_fault
from daq.errors import RecordingError, one_line
from daq.impact_group import check_time
from daq.journal import JOURNAL, SessionFolder
from daq.journal_file import mend
from mesotap.session.hand_verdicts import BY_HAND, IMPACT, LONGEST_REASON
from mesotap.session.progress import HARDWARE, NO_TAP, SAFE, STARTED, VERSION, ZERO, Progress
from mesotap.session.states import Event, State

FARTHEST_UM = 1e9
"""A kilometre: farther than any stage goes."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Load = Annotated[float, Field(ge=-LOAD.most, le=LOAD.most, allow_inf_nan=False)]
Voltage = Annotated[float, Field(ge=-VOLTAGE.most, le=VOLTAGE.most, allow_inf_nan=False)]
Whole = Annotated[int, Field(ge=0, le=10**9)]
LONGEST_SHOWN = 60


class Entry(BaseModel):
    """What every entry has; what is beside that is left alone."""

    model_config = ConfigDict(strict=True, extra="allow")

    event: str
    at: str = ""
    rig: dict[str, Any] = {}

    @model_validator(mode="after")
    def _dates(self) -> Entry:
        check_time(self.at, "at")
        return self


class _Calibrated(Entry):
    load_mn: Annotated[list[Load], Field(min_length=1)]
    voltage_mv: Annotated[list[Voltage], Field(min_length=1)]
    time: str
    elapsed_s: list[float] | None = None

    @model_validator(mode="after")
    def _pairs(self) -> _Calibrated:
        check_time(self.time, "time")
        if len(self.load_mn) != len(self.voltage_mv):
            raise ValueError(f"{len(self.load_mn)} loads, but {len(self.voltage_mv)} voltages")
        if self.elapsed_s is not None and (fault := elapsed_fault(np.array(self.elapsed_s), len(self.load_mn))):
            raise ValueError(f"elapsed_s {fault}")
        return self


class _Contact(Entry):
    position_um: Annotated[float, Field(ge=-FARTHEST_UM, le=FARTHEST_UM)] | None
    load_mn: Load


class _Loaded(Entry):
    load_mn: Load
    truth: dict[str, Number] | None = None


class _Impact(Entry):
    number: Whole
    load_set: Whole
    accepted: bool
    reject_reason: str
    digest: str = ""


class _ByHand(Entry):
    number: Whole
    accepted: bool
    reason: Annotated[str, Field(min_length=1, max_length=LONGEST_REASON)]


class _NoTap(Entry):
    reason: str


class _Safe(Entry):
    troubles: list[str] = []


class _Zero(Entry):
    voltage_mv: Voltage
    time: str

    @model_validator(mode="after")
    def _when(self) -> _Zero:
        check_time(self.time, "time")
        return self


class _Repeated(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow")

    device: str
    what: str
    count: Whole
    first: str
    last: str


class _Hardware(Entry):
    repeated: list[_Repeated]


KINDS: dict[str, type[Entry]] = {
    **{event.value: Entry for event in Event},
    Event.CALIBRATED.value: _Calibrated,
    Event.CONTACT.value: _Contact,
    Event.LOADED.value: _Loaded,
    IMPACT: _Impact,
    BY_HAND: _ByHand,
    NO_TAP: _NoTap,
    SAFE: _Safe,
    ZERO: _Zero,
    STARTED: Entry,
    HARDWARE: _Hardware,
    VERSION: Entry,
}


def fault_of(entry: dict[str, Any]) -> str:
    """Return what is wrong with an entry by itself, with its field; empty if nothing is."""
    name = entry.get("event")
    kind = KINDS.get(name) if isinstance(name, str) else None
    if kind is None:
        return f"event {_shown(name)} is unknown"
    try:
        kind.model_validate(entry)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        field = ".".join(map(str, fault["loc"]))
        message = fault["msg"].removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        if not field:
            return f"entry '{name}': {_shown(message)}"
        if fault["type"] == "missing":
            return f"entry '{name}': {field} is missing"
        return f"entry '{name}': {field} is {_shown(repr(fault['input']))}: {message}"
    return ""


def walk(entries: list[dict[str, Any]]) -> Iterator[tuple[Progress, str]]:
    """Yield where each entry leaves the session, and what is wrong with it; an entry with a fault is passed over."""
    progress = Progress()
    last_impact = -1
    known: set[int] = set()
    for entry in entries:
        fault = fault_of(entry)
        if not fault and entry["event"] == IMPACT:
            number = entry["number"]
            if number <= last_impact:
                fault = f"entry 'shot': number is {number}, after {last_impact}"
            else:
                last_impact = number
                known.add(number)
        if not fault and entry["event"] == BY_HAND and entry["number"] not in known:
            fault = f"entry '{BY_HAND}': there is no impact {entry['number']} before it"
        if not fault:
            try:
                progress.apply(entry)
            except ValueError as error:
                fault = f"entry {error}"
        yield progress, fault


def progress_in(folder: SessionFolder, loads: int) -> Progress:
    """Return where the journal of a folder leaves its session.

    Parameters
    ----------
    folder
        Opened.
    loads
        Steps of the load plan.

    Raises
    ------
    RecordingError
        An entry is damaged, cannot follow the one before it, or names a load or an impact that is not there.
    """
    progress = Progress()
    where = folder.path / JOURNAL
    for line, (progress, fault) in enumerate(walk(folder.events()), start=1):
        if not fault and progress.load_set >= loads and progress.state in (State.SET_LOAD, State.LOCK, State.TAP):
            fault = f"the load plan has {loads} loads, but this begins another"
        if fault:
            raise RecordingError(f"{where}: line {line}: {fault}; {mend(folder.path)}")
    noted = {entry["number"] for entry in folder.events() if entry["event"] == IMPACT}
    there = set(folder.impact_numbers())
    unlisted = there - noted
    # a kill leaves at most the last impact without its entry
    if len(unlisted) > 1 or (unlisted and not progress.was_loaded) or any(n < max(noted) for n in unlisted if noted):
        raise RecordingError(
            f"{where}: does not list impact {min(unlisted):05d}, which is there: entries were lost; {mend(folder.path)}"
        )
    gone = noted - there
    if gone:
        raise RecordingError(
            f"{where}: lists impact {min(gone):05d}, but its file is gone; put it back, or {mend(folder.path)}"
        )
    return progress


def _shown(value: object) -> str:
    text = one_line(value if isinstance(value, str) else repr(value))
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."
