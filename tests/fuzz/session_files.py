"""Whatever a session file holds, it is read or refused in one sentence that names it."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from daq.errors import RecordingError
from daq.journal import SessionFolder
from daq.records import Session
from daq.session_file import read_session, write_session
from tests.fuzz.forked import reading_in_forks
from tests.fuzz.mutations import Content, Damage, damaged, damages
from tests.fuzz.sessions import as_written_here, in_the_old_layout, small_session
from tests.fuzz.source import Source, Target


def read_or_refused(path: Path) -> Session | None:
    try:
        with reading_in_forks():
            session = read_session(path)
    except RecordingError as error:
        text = str(error)
        assert text.startswith(str(path))
        assert len(text) < len(str(path)) + 400
        assert "\n" not in text
        return None
    for impact in session.impacts:
        assert impact.acceleration.shape[0] == 2
        assert np.isfinite(impact.acceleration).all()
        assert 0 <= impact.pretrigger < impact.acceleration.shape[1]
        assert math.isfinite(impact.sample_rate_hz)
        assert impact.sample_rate_hz > 0
    return session


def damaged_file(place: Path) -> Target:
    sound = as_written_here(place / "sound.h5")
    path = place / "damaged.h5"

    def check(damage: Damage) -> None:
        path.write_bytes(damaged(sound, damage))
        read_or_refused(path)

    return Target(damages(), check)


def damaged_file_in_the_old_layout(place: Path) -> Target:
    sound = in_the_old_layout(place / "old.h5")
    path = place / "damaged_old.h5"

    def check(damage: Damage) -> None:
        path.write_bytes(damaged(sound, damage))
        read_or_refused(path)

    return Target(damages(), check)


def any_bytes(place: Path) -> Target:
    path = place / "any.h5"

    def check(content: bytes) -> None:
        path.write_bytes(content)
        assert read_or_refused(path) is None

    return Target(lambda source: source.content(600), check)


# --- sound HDF5 that is not a sound session


GROUPS = ("", "rig", "calibration", "calibration/pre", "impacts", "impacts/00000", "impacts/00001")
DATASETS = (
    "config",
    "calibration/pre/load_mn",
    "calibration/post/voltage_mv",
    "impacts/00000/acceleration",
    "impacts/00000/strain_mv",
    "impacts/00001/acceleration",
    "impacts/00000/extra",
    "impacts/00000/channels",
)
ATTRIBUTES = {
    "": ("format", "format_version", "created", "operator", "specimen", "title", "software", "complete"),
    "rig": ("m1_kg", "sample_rate_hz", "highpass_order", "filter_family", "full_scale_m_s2", "bits"),
    "calibration/pre": ("time",),
    "impacts/00000": (
        "load_set", "target_load_mn", "load_before_mn", "time", "sample_rate_hz", "pretrigger", "accepted",
        "reject_reason", "extra", "channel_names", "voltage_before_mv",
    ),
    "impacts/00000/acceleration": ("units",),
}  # fmt: skip
EVERY_ATTRIBUTE = [(item, name) for item, names in ATTRIBUTES.items() for name in names]
NUMBERS = (0, 1, -1, 25000.0, 24999.0, 1e308)
STRANGE = (
    np.array([], dtype=np.float64),
    np.zeros((2, 2)),
    np.array([1 + 2j]),
    np.array([b"\xff\xfe"], dtype="S2"),
    b"\xff\xfe",
    np.array([True, False]),
    np.zeros(3, dtype=[("a", "f8"), ("b", "i4")]),
    np.float16(1.5),
    np.uint64(2**64 - 1),
    h5py.Empty("f8"),
    h5py.Empty("S10"),
    h5py.Empty(h5py.string_dtype()),
    np.array(["a", "b"], dtype=h5py.string_dtype()),
    np.void(b"abc"),
)
KINDS = ("f8", "f4", "f2", "i4", "u8", "?", "c16", "S5", "O", "V4")
CLAIMS = ((2, 10**9), (2, 2**40), (2**31, 2**31), (10**12,), (2, 64), ())
IMPACTS = ("99999", "0", "-1", "00002", "²", "1e3", "000000", "x", "00000 ")
LINKS = ("/", "/rig", "/nowhere", "/impacts", "itself", "elsewhere", "object")
EDITS = ("attribute", "no attribute", "remove", "array", "group", "link", "claim", "impact")

Edit = tuple[str, Any, Any]


def value(source: Source) -> Any:
    """A value for an attribute."""
    kind = source.integer(0, 6)
    if kind == 0:
        return source.integer(-(2**63), 2**63 - 1)
    if kind == 1:
        return source.number()
    if kind == 2:
        return source.choice(NUMBERS)
    if kind == 3:
        return source.text(20).replace("\0", "")
    return source.choice((True, False) if kind == 4 else STRANGE)


def edit(source: Source) -> Edit:
    """One change to a sound session: (what, where, with what)."""
    what = source.choice(EDITS)
    if what in ("attribute", "no attribute"):
        return what, source.choice(EVERY_ATTRIBUTE), value(source)
    if what == "impact":
        return what, source.choice(IMPACTS), None
    where = source.choice((*GROUPS[1:], *DATASETS))
    if what == "array":
        shape = tuple(source.several(lambda inner: inner.integer(0, 5), 0, 4))
        return what, where, (shape, source.choice(KINDS), source.choice((0.0, 1.0, math.nan, math.inf, -1e308)))
    if what == "claim":
        return what, where, source.choice(CLAIMS)
    return what, where, source.choice(LINKS) if what == "link" else None


def apply(file: h5py.File, edit: Edit) -> None:
    """Make the change, where the file still has the place for it."""
    what, where, value = edit
    if what == "attribute":
        item, name = where
        if item == "" or item in file:
            file[item or "/"].attrs[name] = value
    elif what == "no attribute":
        item, name = where
        if (item == "" or item in file) and name in file[item or "/"].attrs:
            del file[item or "/"].attrs[name]
    elif what == "impact":
        file.create_group(f"impacts/{where}")
    else:
        if where in file:
            del file[where]
        if what == "array":
            shape, kind, fill = value
            dtype = h5py.string_dtype() if kind == "O" else np.dtype(kind)
            data = np.full(shape, fill).astype(dtype) if kind in ("f8", "f4", "f2", "c16") else np.zeros(shape, dtype)
            file.create_dataset(where, data=data if kind != "O" else None, shape=shape, dtype=dtype)
        elif what == "group":
            file.create_group(where)
        elif what == "claim":
            file.create_dataset(where, shape=value, dtype="f8", chunks=tuple(min(n, 8) for n in value) or None)
        elif what == "link":
            links = {"itself": h5py.SoftLink("/" + where), "elsewhere": h5py.ExternalLink("/nowhere.h5", "/")}
            if value == "object":
                file.create_dataset(where, data=file.ref, dtype=h5py.ref_dtype)
            else:
                file[where] = links.get(value, h5py.SoftLink(value))


def sound_hdf5_that_is_no_sound_session(place: Path) -> Target:
    sound = as_written_here(place / "sound.h5")
    path, again = place / "edited.h5", place / "again.h5"

    def check(edits: list[Edit]) -> None:
        path.write_bytes(sound)
        with np.errstate(all="ignore"), h5py.File(path, "r+") as file:
            for one in edits:
                # an earlier change may have taken the place for this one
                with suppress(ValueError, KeyError, OSError, RuntimeError, TypeError, AttributeError):
                    apply(file, one)
        session = read_or_refused(path)
        if session is not None:  # what is read can be written, and reads as the same again
            write_session(again, session)
            with reading_in_forks():
                assert [s.number for s in read_session(again).impacts] == [s.number for s in session.impacts]

    return Target(lambda source: source.several(edit, 1, 3), check)


# --- the folder of a running session


FILES = ("journal.jsonl", "session.json", "shots/00000.h5")


def folder_bytes(root: Path) -> dict[str, bytes]:
    """What a session folder with one impact holds."""
    with SessionFolder.create(root, {"created": "2026-01-01T00:00:00Z", "config": "", "simulated": True}) as folder:
        folder.append({"event": "started"})
        folder.write_impact(small_session().impacts[0], {"state": 1})
        folder.append({"event": "shot", "number": 0, "accepted": True, "reject_reason": ""})
    return {
        str(path.relative_to(root)): Content(path.read_bytes())
        for path in root.rglob("*")
        if path.is_file() and path.stat().st_size
    }


def damaged_session_folder(place: Path) -> Target:
    root = place / "folder"
    sound = folder_bytes(root)

    def check(drawn: tuple[str, Damage]) -> None:
        name, damage = drawn
        for file, content in sound.items():
            (root / file).write_bytes(damaged(content, damage) if file == name else content)
        try:
            with reading_in_forks(), SessionFolder.open(root) as folder:
                folder.events()
                list(folder.impacts())
        except RecordingError as error:
            assert str(root) in str(error)
            assert "\n" not in str(error)

    return Target(lambda source: (source.choice(FILES), damages()(source)), check)


TARGETS = (
    damaged_file,
    damaged_file_in_the_old_layout,
    any_bytes,
    sound_hdf5_that_is_no_sound_session,
    damaged_session_folder,
)
