"""The session file, format 1: one HDF5 file that holds a whole test session."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from pathlib import Path

import h5py
import numpy as np

from daq.bounds import BOUNDS, elapsed_fault
from daq.durable import write_whole
from daq.errors import RecordingError, StructureError
from daq.hdf5 import CHECKSUMMED, Node, open_hdf5, refuse_non_finite
from daq.impact_group import (
    check_impact,
    check_time,
    read_impact,
    read_json_item,
    scalar_text,
    write_impact,
    write_json_item,
)
from daq.limited import read_limited
from daq.limits import data_room
from daq.records import CalibrationPoints, Impact, RigDescription, Session, ZeroReading
from daq.texts import LONGEST_TEXT, is_storable
from rig.hardware_log import Repetition

FORMAT = "mesotap-session"
VERSION = 1
MOST_POLES = 8
"""Poles of an analog filter ahead of a recorder; `rig.filter` of the configuration allows as many."""

MOST_BITS = 64
ZEROS = "zero_readings"
MOST_ZEROS = 10_000
"""Readings without load that are read; a plan has a tenth as many loads."""
FAMILIES = ("butterworth", "none", "")
MOST_REFUSED = 10
STILL = "constant throughout, so that no tap was recorded"
"""Records that cannot be read and are named; of more, their number is told."""
RATE_TOLERANCE = 0.01
"""Relative difference between the rig's sampling rate and an impact's that a recorder's clock may explain."""

TUBES = ("tube_added_kg", "tube_mode_kg", "tube_mode_hz")
"""Attributes of /rig beside the format, there where the tube springs' inertia was declared."""

_TEXTS = ("created", "operator", "specimen", "title", "software")


def write_session(path: str | Path, session: Session, new: bool = False) -> None:
    """Write a session file, whole or not at all: a kill at any instant leaves the file that was there before.

    Parameters
    ----------
    new
        Whether no file of that name may be there.

    Raises
    ------
    RecordingError
        The session holds something that format 1 does not (the item is named), or the file cannot be written.
    """
    path = Path(path)
    _check_session(path, session)
    try:
        image = _image(session, compress=True)
        if _samples_size(session) > data_room(len(image)):  # the reader would not believe it
            image = _image(session, compress=False)
    except (ValueError, TypeError, RuntimeError, OSError) as error:
        raise RecordingError(f"{path}: the session cannot be put into a file: {error}") from error
    write_whole(path, image, new)


def _check_session(path: Path, session: Session) -> None:
    for name in (*_TEXTS, "config"):
        text = getattr(session, name)
        if not is_storable(text):
            raise RecordingError(f"{path}: {name} holds a character that cannot be stored")
        if name != "config" and len(text.encode()) > LONGEST_TEXT:
            raise RecordingError(f"{path}: {name} is longer than {LONGEST_TEXT} bytes")
    check_time(session.created, f"{path}: created")
    if session.rig.filter_family not in FAMILIES:
        raise RecordingError(
            f"{path}: filter_family is {session.rig.filter_family!r:.40}, expected one of {FAMILIES[:2]}"
        )
    for item in fields(RigDescription):
        value = getattr(session.rig, item.name)
        if item.name in BOUNDS and (fault := BOUNDS[item.name].fault(value)):
            raise RecordingError(f"{path}: /rig: {item.name} {fault}")
    for when, points in (("pre", session.pre), ("post", session.post)):
        if points is None:
            continue
        if points.load_mn.ndim != 1 or points.load_mn.shape != points.voltage_mv.shape or not points.load_mn.size:
            raise RecordingError(f"{path}: /calibration/{when}: load_mn and voltage_mv are not two lists of one length")
        refuse_non_finite(points.load_mn, f"{path}: /calibration/{when}/load_mn")
        refuse_non_finite(points.voltage_mv, f"{path}: /calibration/{when}/voltage_mv")
        for name, values in (("load_mn", points.load_mn), ("voltage_mv", points.voltage_mv)):
            if fault := BOUNDS[name].fault_of_all(values):
                raise RecordingError(f"{path}: /calibration/{when}/{name} {fault}")
        if points.elapsed_s is not None and (fault := elapsed_fault(points.elapsed_s, points.load_mn.size)):
            raise RecordingError(f"{path}: /calibration/{when}/elapsed_s {fault}")
        check_time(points.time, f"{path}: /calibration/{when}: time")
    if len({impact.number for impact in session.impacts}) < len(session.impacts):
        raise RecordingError(f"{path}: two impacts have the same number")
    for impact in session.impacts:
        check_impact(impact, f"{path}: /impacts/{impact.name}")


def _samples_size(session: Session) -> int:
    """Bytes of all arrays of a session."""
    arrays = [a for s in session.impacts for a in (s.acceleration, s.strain_mv, s.channels, s.force)]
    arrays += [a for p in (session.pre, session.post) if p is not None for a in (p.load_mn, p.voltage_mv)]
    return sum(8 * a.size for a in arrays if a is not None)


def _image(session: Session, compress: bool) -> bytes:
    """Return the bytes of the session file. Built in memory, so that a full disk meets plain file writing only."""
    with h5py.File("session", "w", driver="core", backing_store=False, libver=CHECKSUMMED) as file:
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = VERSION
        for name in _TEXTS:
            file.attrs[name] = getattr(session, name)
        file.attrs["complete"] = bool(session.complete)
        if session.hardware is not None:
            write_json_item(file, "hardware", [asdict(entry) for entry in session.hardware])
        if session.zeros:
            write_json_item(file, ZEROS, [asdict(zero) for zero in session.zeros])
        file.create_dataset("config", data=session.config, dtype=h5py.string_dtype())
        rig = file.create_group("rig")
        for item in fields(RigDescription):
            value = getattr(session.rig, item.name)
            if item.name not in ("filter_family", *TUBES) or value:
                rig.attrs[item.name] = value
        for when, points in (("pre", session.pre), ("post", session.post)):
            if points is not None:
                group = file.create_group(f"calibration/{when}")
                group.create_dataset("load_mn", data=np.asarray(points.load_mn, dtype=np.float64))
                group.create_dataset("voltage_mv", data=np.asarray(points.voltage_mv, dtype=np.float64))
                if points.elapsed_s is not None:
                    group.create_dataset("elapsed_s", data=np.asarray(points.elapsed_s, dtype=np.float64))
                group.attrs["time"] = points.time
        impacts = file.create_group("impacts")
        for impact in session.impacts:
            write_impact(impacts.create_group(impact.name), impact, compress)
        file.flush()
        return bytes(file.id.get_file_image())


KINDS = (Session, Impact, RigDescription, CalibrationPoints, Repetition, ZeroReading)


def read_session(path: str | Path) -> Session:
    """Return the session in a file of format 1, everything in it checked; what is beside the format is ignored.

    A record with something wrong is left out and named in the session's ``refused``; the others are checked each by
    itself, and by digests of their own. The file's path becomes the session's ``source``. A process of its own reads it
    (`daq.limited`).

    Raises
    ------
    RecordingError
        No such file, no HDF5 file, a damaged one, or an item of the session is missing or malformed, or every record
        is, or most records contradict the header's sampling rate, or one is put together as none is (a link, an array
        of two records, a claim beyond the file's size): one sentence that names it.
    """
    return read_limited(session_in, Path(path), kinds=KINDS)


def session_in(path: Path) -> Session:
    """Return the session in a file that this process opens itself; else as `read_session`."""
    with open_hdf5(path) as root:
        kind = root.attribute("format")
        if kind != FORMAT:
            raise RecordingError(
                f"{path}: is not a session file: attribute format of / is {kind!r:.40}, expected {FORMAT!r}"
            )
        version = root.number("format_version")
        if version != VERSION:
            raise RecordingError(f"{path}: attribute format_version of / is {version:g}, this program reads {VERSION}")
        created = check_time(root.text("created"), f"{path}: attribute created of /")
        config = root.child("config")
        if config is None:
            raise root.error(" is missing", "/config")
        rig = _read_rig(root.need_group("rig"))
        calibration = root.group("calibration")
        impacts, refused = _read_impacts(root.need_group("impacts"), rig.sample_rate_hz)
        return Session(
            created=created,
            rig=rig,
            impacts=impacts,
            pre=_read_points(calibration, "pre"),
            post=_read_points(calibration, "post"),
            zeros=_read_zeros(root),
            operator=root.text("operator"),
            specimen=root.text("specimen"),
            title=root.text("title"),
            software=root.text("software"),
            complete=root.flag("complete"),
            config=scalar_text(config),
            source=str(path),
            hardware=_read_hardware(root),
            refused=refused,
        )


def _read_hardware(root: Node) -> tuple[Repetition, ...] | None:
    """Return what had to be repeated, None where the file does not say so in the way of this program."""
    entries = read_json_item(root, "hardware")
    if not isinstance(entries, list):
        return None
    names = [item.name for item in fields(Repetition)]
    found = []
    for entry in entries:
        if not isinstance(entry, dict) or not isinstance(entry.get("count"), int):
            return None
        if not all(isinstance(entry.get(name), str) for name in names if name != "count"):
            return None
        found.append(Repetition(**{name: entry[name] for name in names}))
    return tuple(found)


def _read_zeros(root: Node) -> tuple[ZeroReading, ...]:
    """Return the readings without load, none where the file does not give them in the way of this program."""
    entries = read_json_item(root, ZEROS)
    if not isinstance(entries, list):
        return ()
    found = []
    for entry in entries[:MOST_ZEROS]:
        voltage, time = (entry.get("voltage_mv"), entry.get("time")) if isinstance(entry, dict) else (None, None)
        if (
            isinstance(voltage, int | float)
            and not BOUNDS["voltage_mv"].fault(float(voltage))
            and isinstance(time, str)
        ):
            found.append(ZeroReading(float(voltage), time))
    return tuple(found)


def _read_rig(node: Node) -> RigDescription:
    family = node.attribute("filter_family")
    if family is not None and family not in FAMILIES:
        raise node.error(f": filter_family is {family!r:.40}, expected 'butterworth' or 'none'")
    positive = {
        name: node.number(name, required=False, above=0.0)
        for name in ("m1_kg", "m2_kg", "k1_n_per_m", "k2_n_per_m", "sample_rate_hz", "full_scale_m_s2")
    }
    corner = {name: node.number(name, required=False, least=0.0) for name in ("highpass_hz", "lowpass_hz")}
    tubes = {name: node.number(name, required=False, least=0.0) for name in TUBES}
    most = {"highpass_order": MOST_POLES, "lowpass_order": MOST_POLES, "bits": MOST_BITS}
    count = {name: _known_count(node, name, most[name]) for name in most}
    return RigDescription(
        m1_kg=positive["m1_kg"],
        m2_kg=positive["m2_kg"],
        k1_n_per_m=positive["k1_n_per_m"],
        k2_n_per_m=positive["k2_n_per_m"],
        sample_rate_hz=positive["sample_rate_hz"],
        highpass_hz=corner["highpass_hz"],
        highpass_order=count["highpass_order"],
        lowpass_hz=corner["lowpass_hz"],
        lowpass_order=count["lowpass_order"],
        filter_family=family or "",
        full_scale_m_s2=positive["full_scale_m_s2"],
        bits=count["bits"],
        **{name: 0.0 if math.isnan(value) else value for name, value in tubes.items()},
    )


def _known_count(node: Node, name: str, most: int) -> int:
    return 0 if math.isnan(node.number(name, required=False)) else node.count(name, most=most)


def _read_points(calibration: Node | None, when: str) -> CalibrationPoints | None:
    node = calibration.group(when) if calibration else None
    if node is None:
        return None
    load, voltage = node.values("load_mn", (None,)), node.values("voltage_mv", (None,))
    if load.shape != voltage.shape:
        raise node.error(f": load_mn has {load.size} values but voltage_mv has {voltage.size}")
    elapsed = None if node.child("elapsed_s") is None else node.values("elapsed_s", (None,))
    if elapsed is not None and (fault := elapsed_fault(elapsed, load.size)):
        raise node.error(f"/elapsed_s {fault}")
    time = check_time(node.text("time"), f"{node.path}: attribute time of {node.name}")
    return CalibrationPoints(load, voltage, time, elapsed_s=elapsed)


class _OtherRate(RecordingError):
    """A record is sampled at another rate than the header says: one of the two is wrong."""


def _read_impacts(group: Node, rig_rate_hz: float) -> tuple[tuple[Impact, ...], tuple[str, ...]]:
    """Return the records that are sound, and what is wrong with the others.

    Raises
    ------
    RecordingError
        None is sound, or it is rather the header or the file's structure that is wrong.
    """
    impacts: list[Impact] = []
    faults: list[RecordingError] = []
    for name in sorted((n for n in group.names() if n.isascii() and n.isdigit()), key=int):
        try:
            impacts.append(_read_one(group, name, rig_rate_hz))
        except StructureError:
            raise
        except RecordingError as error:
            faults.append(error)
    still = [i for i in impacts if i.accepted and not np.ptp(i.acceleration, axis=1).any()]
    if len(still) < len(impacts):  # where all are, the whole session is in question, and its analysis says so
        impacts = [i for i in impacts if not any(i is s for s in still)]
        faults += [group.need_group(i.name).error(f"/acceleration: {STILL}") for i in still]
    rates = [fault for fault in faults if isinstance(fault, _OtherRate)]
    if len(rates) > len(impacts):
        raise RecordingError(str(rates[0]))
    if faults and not impacts:
        more = f"; nor can any of its {len(faults) - 1} other records be read" if len(faults) > 1 else ""
        raise RecordingError(f"{faults[0]}{more}")
    said = [f"{str(fault).removeprefix(f'{group.path}: ')}; this record is left out" for fault in faults]
    if len(said) > MOST_REFUSED:
        said[MOST_REFUSED:] = [f"{len(said) - MOST_REFUSED} more records cannot be read and are left out"]
    return tuple(impacts), tuple(said)


def _read_one(group: Node, name: str, rig_rate_hz: float) -> Impact:
    node = group.need_group(name)
    node.take()
    number = int(name)
    if name != f"{number:05d}":
        raise node.error(": an impact's name has five digits")
    rate_hz = node.number("sample_rate_hz", above=0.0)
    if math.isfinite(rig_rate_hz) and abs(rate_hz - rig_rate_hz) > RATE_TOLERANCE * rig_rate_hz:
        raise _OtherRate(str(node.error(f": sample_rate_hz is {rate_hz:g} but /rig says {rig_rate_hz:g}")))
    return read_impact(node, number)
