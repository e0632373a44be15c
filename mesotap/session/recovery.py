"""What can be saved of a session folder that is damaged, and line by line what cannot.

The folder is only read: impacts are read from copies, and nothing in it is locked, cut, removed or written.
"""

from __future__ import annotations

import contextlib
import json
import math
import stat
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from daq.durable import PART, cause_of, read_plain
from daq.errors import RecordingError, one_line
from daq.impact_group import check_time, digest_of
from daq.journal import HEADER, IMPACTS, JOURNAL, any_impact_in
from daq.journal_file import LARGEST_TEXT
from daq.json_text import GivenTwice, parsed_once
from daq.limited import LimitedReader
from daq.limits import folder_room
from daq.records import CalibrationPoints, Impact, RigDescription, Session, ZeroReading
from daq.session_file import RATE_TOLERANCE, read_session
from daq.texts import LONGEST_TEXT, is_storable
from mesotap import __version__
from mesotap.configuration.config import Config, ConfigError
from mesotap.configuration.yaml_text import NOT_YAML, parsed
from mesotap.session.entries import fault_of, walk
from mesotap.session.hand_verdicts import IMPACT, with_hand_verdicts
from mesotap.session.header import header_fault, kept_config, physical_part
from mesotap.session.progress import ZERO, Progress, chosen_of_surplus, describe_rig, elapsed_of
from mesotap.session.states import Event, State

SESSION_FILE = "session.h5"
LARGEST_IMPACT = 256 * 2**20
"""Bytes of an impact file beyond which it is none: one of 2500 samples takes a two-thousandth."""


NAMES = ("operator", "specimen", "title")
"""Texts of section ``mesotap`` that a session file has of its own."""


@dataclass(slots=True)
class Losses:
    """What was lost, was found to be other than it should, or was left out: a line each."""

    lines: list[str] = field(default_factory=list)

    def note(self, where: str, what: object) -> None:
        """Add a line."""
        self.lines.append(one_line(f"{where}: {what}"))


@dataclass(frozen=True, slots=True)
class Recovered:
    """A sound session, and what it took."""

    session: Session
    losses: tuple[str, ...]


def recover(folder: Path) -> Recovered:
    """Return a session of whatever impacts in ``folder`` are whole.

    Raises
    ------
    RecordingError
        There is no such folder, or no intact impact in it.
    """
    if not folder.is_dir():
        raise RecordingError(f"{folder}: there is no such session folder")
    losses = Losses()
    header = _header(folder, losses)
    entries, progress = _entries(folder, losses)
    noted = {e["number"]: e for e in entries if e["event"] == IMPACT}
    impacts = _impacts(folder, noted, losses)
    if not impacts:
        raise RecordingError(f"{folder}: holds no intact impact to make a session of{_finished(folder)}")
    for number in sorted(set(noted) - {impact.number for impact in impacts}):
        losses.note(f"impact {number:05d}", "is lost: the journal lists it, but there is no whole file of it")
    before, after = _calibrations(entries, impacts)
    if before is None:
        losses.note("calibration", "none from before the test is left")
    config, text = _config(folder, header, losses)
    rig = _rig(config, impacts, losses)
    names = {name: _kept(said, name, LONGEST_TEXT, losses) for name, said in _names(text).items()}
    at_its_end = progress is not None and progress.state in (State.FILE, State.DONE)
    session = Session(
        created=_created(header, impacts),
        rig=rig,
        impacts=chosen_of_surplus(with_hand_verdicts(impacts, entries), config),
        pre=before,
        post=after,
        zeros=tuple(ZeroReading(e["voltage_mv"], e["time"]) for e in entries if e["event"] == ZERO),
        operator=names["operator"],
        specimen=names["specimen"],
        title=names["title"],
        software=_software(header),
        complete=at_its_end and not losses.lines,
        config=text,
        hardware=None if progress is None else progress.hardware,
    )
    return Recovered(session, tuple(losses.lines))


# --- header and configuration ---------------------------------------------------------------------------------


def _header(folder: Path, losses: Losses) -> dict[str, Any]:
    """Return the header, or those of its items that can still be read."""
    try:
        content = read_plain(folder / HEADER, LARGEST_TEXT)
    except OSError as error:
        losses.note(HEADER, "is missing" if isinstance(error, FileNotFoundError) else f"is lost: {cause_of(error)}")
        return {}
    try:
        header = json.loads(content)
        if isinstance(header, dict):
            fault = header_fault(header)
            if fault:
                losses.note(HEADER, fault)
            return header
        losses.note(HEADER, "is lost: it is not a JSON object")
        return {}
    except (ValueError, RecursionError):
        found = dict(_items(content.decode("utf-8", "replace")))
        losses.note(HEADER, f"is damaged: of its items {', '.join(found) or 'none'} could be read")
        return found


def _items(text: str) -> Iterator[tuple[str, Any]]:
    """Yield those items of a damaged header that are whole."""
    decoder = json.JSONDecoder()
    for name in ("created", "config", "simulated", "software"):
        at = text.find(f'"{name}": ')
        if at >= 0:
            try:
                yield name, decoder.raw_decode(text, at + len(name) + 4)[0]
            except (ValueError, RecursionError):
                continue


def _config(folder: Path, header: dict[str, Any], losses: Losses) -> tuple[Config | None, str]:
    """Return the last configuration that can be read, and its text; None and nothing if there is none."""
    candidates = [(HEADER, header.get("config"))]
    with contextlib.suppress(RecordingError):  # an unfinished session has none
        candidates.append((SESSION_FILE, read_session(folder / SESSION_FILE).config))
    for where, said in candidates:
        if not isinstance(said, str) or not said.strip():
            continue
        text = _kept(said, "its configuration", math.inf, losses)
        try:
            kept = kept_config(text, where)
        except ConfigError as error:
            losses.note(where, f"its configuration cannot be used: {str(error).splitlines()[0]}")
            part = physical_part(text, where)
            if part is None:
                continue
            losses.note(where, "of its configuration only masses, springs, filter and wiring were used")
            return part, text
        for difference in kept.differences():
            losses.note(where, difference)
        if where != HEADER:
            losses.note(where, "the configuration was taken from here")
        return kept.config, text
    losses.note("configuration", "none can be read: masses, springs and filter are unknown")
    return None, ""


def _names(text: str) -> dict[str, str]:
    """Return operator, specimen and title as a configuration gives them, also one that is refused for something."""
    try:
        section = parsed(text)[1]["mesotap"]
    except (*NOT_YAML, LookupError, TypeError):
        section = None
    given = section if isinstance(section, dict) else {}
    return {name: said if isinstance(said := given.get(name), str) else "" for name in NAMES}


def _kept(text: str, what: str, most: float, losses: Losses) -> str:
    """Return a text such that a session file can hold it, and tell what was done to it."""
    if not is_storable(text):
        text = text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\0")
        losses.note(HEADER, f"{what} holds characters that no file keeps; they are written as escapes")
    if len(text.encode()) > most:
        text = text.encode()[: int(most)].decode("utf-8", "ignore")
        losses.note(HEADER, f"{what} is longer than {most:g} bytes; the rest is cut off")
    return text


def _rig(config: Config | None, impacts: list[Impact], losses: Losses) -> RigDescription:
    """Return the rig as configured, at the rate that the impacts were sampled with; NaN where they differ."""
    rig = RigDescription(filter_family="") if config is None else describe_rig(config.rig)
    rates = [impact.sample_rate_hz for impact in impacts]
    if max(rates) - min(rates) > RATE_TOLERANCE * min(rates):
        losses.note("shots", f"were sampled at different rates, {min(rates):g} to {max(rates):g} Hz")
        return replace(rig, sample_rate_hz=math.nan)
    return replace(rig, sample_rate_hz=rates[0])


def _created(header: dict[str, Any], impacts: list[Impact]) -> str:
    created = header.get("created")
    with contextlib.suppress(RecordingError):  # told with the header
        if isinstance(created, str) and check_time(created, "created"):
            return created
    return min((impact.time for impact in impacts if impact.time), default="")


def _software(header: dict[str, Any]) -> str:
    kept = header.get("software")
    before = one_line(kept)[:100] if isinstance(kept, str) and kept else "unknown"
    simulated = " (simulated rig)" if header.get("simulated") is True else ""
    return f"{before}{simulated}, recovered by mesotap {__version__}"


# --- journal --------------------------------------------------------------------------------------------------


def _entries(folder: Path, losses: Losses) -> tuple[list[dict[str, Any]], Progress | None]:
    """Return the entries that are sound by themselves, and where they leave the session if nothing is amiss."""
    try:
        content = read_plain(folder / JOURNAL, LARGEST_TEXT)
    except OSError as error:
        losses.note(JOURNAL, "is missing" if isinstance(error, FileNotFoundError) else f"is lost: {cause_of(error)}")
        return [], None
    if not content:
        losses.note(JOURNAL, "is empty")
    entries: list[dict[str, Any]] = []
    numbers: list[int] = []
    lines = content.split(b"\n")
    for number, line in enumerate(lines, start=1):
        if number == len(lines):
            if line:
                losses.note(f"{JOURNAL}, line {number}", "was not written to its end")
            break
        try:
            entry = parsed_once(line)
            fault = fault_of(entry) if isinstance(entry, dict) else "is not a journal entry"
        except GivenTwice as error:
            fault = str(error)
        except (ValueError, RecursionError):
            fault = "is not a journal entry"
        if fault:
            losses.note(f"{JOURNAL}, line {number}", fault)
        elif entries and entry == entries[-1] and entry["event"] != "started":
            losses.note(f"{JOURNAL}, line {number}", "stands twice")
        else:
            entries.append(entry)
            numbers.append(number)
    walked = list(walk(entries))
    for number, (_, fault) in zip(numbers, walked, strict=True):
        if fault:
            losses.note(f"{JOURNAL}, line {number}", fault)
            break  # where entries are missing, none of those after it follows
    return entries, walked[-1][0] if walked else None


def _calibrations(
    entries: list[dict[str, Any]], impacts: list[Impact]
) -> tuple[CalibrationPoints | None, CalibrationPoints | None]:
    """Return the calibrations before and after the taps: by their dates, and where there are none by their order."""
    before = after = None
    tapped = False
    for entry in entries:
        tapped = tapped or entry["event"] in (IMPACT, Event.CONTACT.value, Event.LOADED.value, Event.APART.value)
        if entry["event"] != Event.CALIBRATED.value:
            continue
        points = CalibrationPoints(
            np.array(entry["load_mn"], np.float64),
            np.array(entry["voltage_mv"], np.float64),
            entry["time"],
            elapsed_s=elapsed_of(entry),
        )
        if tapped or _later(entry["time"], [impact.time for impact in impacts]):
            after = points
        else:
            before = points
    return before, after


def _later(time: str, taps: list[str]) -> bool:
    """Whether a date is known to be after all taps."""
    try:
        return bool(time) and all(datetime.fromisoformat(time) > datetime.fromisoformat(tap) for tap in taps)
    except (ValueError, TypeError):  # one without a date, or some with and some without a time zone
        return False


# --- impacts ----------------------------------------------------------------------------------------------------


def _impacts(folder: Path, noted: dict[int, dict[str, Any]], losses: Losses) -> list[Impact]:
    """Return the intact impacts in order of their numbers."""
    place = folder / IMPACTS
    if place.is_symlink():
        losses.note(IMPACTS, "is lost: it is a link to another place, which is not followed")
        return []
    try:
        files = sorted(entry for entry in place.iterdir())
    except OSError as error:
        losses.note(IMPACTS, "is missing" if isinstance(error, FileNotFoundError) else f"is lost: {cause_of(error)}")
        return []
    found: dict[int, tuple[Impact, str]] = {}
    room = folder_room(sum(file.lstat().st_size for file in files if _is_plain(file)))
    with tempfile.TemporaryDirectory(prefix="mesotap-recover-") as scratch, LimitedReader() as reader:
        # files under their own names first: a renamed one is the copy
        for file in sorted(files, key=lambda f: (not _own_name(f), f.name)):
            where = f"{IMPACTS}/{file.name}"
            try:
                impact = _impact_in(file, Path(scratch) / "shot.h5", reader)
            except (RecordingError, OSError) as error:
                cause = cause_of(error) if isinstance(error, OSError) else error
                losses.note(where, f"is lost: {cause}".removesuffix(": "))
                continue
            if _samples_size(impact) > room:
                losses.note(where, "is lost: the impacts claim more samples than a folder of this size holds")
                continue
            room -= _samples_size(impact)
            _take(impact, file, noted, found, losses)
    impacts = [found[number][0] for number in sorted(found)]
    if noted:
        for impact in impacts:
            if impact.number not in noted:
                losses.note(f"impact {impact.number:05d}", "is not in the journal; kept, with what its file says")
    return impacts


def _own_name(file: Path) -> bool:
    return file.suffix == ".h5" and len(file.stem) == 5 and file.stem.isascii() and file.stem.isdigit()


def _is_plain(file: Path) -> bool:
    try:
        return stat.S_ISREG(file.lstat().st_mode)
    except OSError:
        return False


def _samples_size(impact: Impact) -> int:
    """Bytes of an impact's arrays."""
    return sum(
        a.nbytes for a in (impact.acceleration, impact.strain_mv, impact.channels, impact.force) if a is not None
    )


def _impact_in(file: Path, copy: Path, reader: LimitedReader) -> Impact:
    """Return the impact in a file, of which another process reads a copy."""
    copy.write_bytes(read_plain(file, LARGEST_IMPACT))
    try:
        return reader.read(any_impact_in, copy, kinds=(Impact,))
    except RecordingError as error:
        raise RecordingError(str(error).removeprefix(f"{copy}: ")) from error


def _take(
    impact: Impact,
    file: Path,
    noted: dict[int, dict[str, Any]],
    found: dict[int, tuple[Impact, str]],
    losses: Losses,
) -> None:
    """Add an intact impact to those found, unless it is a copy or another impact than the journal lists."""
    where, digest = f"{IMPACTS}/{file.name}", digest_of(impact)
    entry = noted.get(impact.number, {})
    if entry.get("digest") not in (None, "", digest):
        if all(digest != other.get("digest") for other in noted.values()):
            losses.note(
                where, f"is left out: it is not the impact {impact.name} that the journal lists (its digest differs)"
            )
            return
        losses.note(where, "has another number in the journal; kept, with what its file says")
    if impact.number in found:
        same = found[impact.number][1] == digest
        losses.note(where, f"is left out: it {'is a copy of' if same else 'has the number of'} impact {impact.name}")
        return
    if file.name != f"{impact.name}.h5":
        unnamed = "was whole, but not yet named" if file.name == f"{impact.name}.h5{PART}" else "is under another name"
        losses.note(where, f"{unnamed}: it is impact {impact.name}")
    for key in ("load_set", "accepted", "reject_reason"):
        if key in entry and entry[key] != getattr(impact, key):
            losses.note(
                f"impact {impact.name}", f"{key} is {getattr(impact, key)!r} in its file, {entry[key]!r} in the journal"
            )
    found[impact.number] = (impact, digest)


def _finished(folder: Path) -> str:
    try:
        finished = read_session(folder / SESSION_FILE)
    except RecordingError:
        return ""
    sound = "can be read in part" if finished.refused else "is sound"
    return f"; the finished {SESSION_FILE} in it {sound} and holds {len(finished.impacts)}: use that"
