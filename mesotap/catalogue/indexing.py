"""Folders of sessions into the catalogue: what changed is read, what is gone or was moved is said to be."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from daq.errors import RecordingError
from daq.journal import IMPACTS
from daq.limited import LimitedReader
from mesotap.catalogue.answers_beside import AGAIN
from mesotap.catalogue.entry import GONE, MOVED
from mesotap.catalogue.reading import SESSION_FILE, entry_of, is_session_folder, signature_of
from mesotap.catalogue.store import Catalogue, Kept

SUFFIXES = (".h5", ".hdf5")
_WITHIN = (IMPACTS, "figures", AGAIN)
"""Folders of a session that hold no sessions."""

BATCH = 20
"""Sessions in a transaction: so many are read again after a kill, and others wait for no more than one of them."""


@dataclass(slots=True)
class Update:
    """What an update came to: how many sessions were read, were as before, or are no longer where they were."""

    read: int = 0
    unchanged: int = 0
    moved: int = 0
    gone: int = 0
    others: list[str] = field(default_factory=list)
    """HDF5 files that are no sessions, and folders that could not be listed or are links."""


def update(
    catalogue: Catalogue, folders: Sequence[Path], on_progress: Callable[[int], None] = lambda done: None
) -> Update:
    """Bring the catalogue up to date with folders.

    Parameters
    ----------
    folders
        That hold sessions at any depth, sessions themselves, or session files.
    on_progress
        Called with the number of sessions that were looked at.

    Raises
    ------
    RecordingError
        One of the folders is not there.
    CatalogueError
        The catalogue cannot be written.
    """
    roots = [_root(folder) for folder in folders]
    made = Update()
    seen: set[str] = set()
    waiting: list[Kept] = []
    with LimitedReader() as reader:
        for root in roots:
            for session in sessions_within(root, made.others):
                if str(session) in seen:
                    continue
                seen.add(str(session))
                fresh = _fresh(catalogue, session, reader, made)
                if fresh is not None:
                    waiting.append(fresh)
                if len(waiting) >= BATCH:
                    catalogue.put(waiting)
                    waiting.clear()
                on_progress(len(seen))
    catalogue.put(waiting)
    catalogue.put(list(_missing(catalogue, roots, seen, made)))
    return made


def sessions_within(root: Path, others: list[str]) -> Iterator[Path]:
    """Yield session folders and session files at any depth, in the order of their names; links are not followed."""
    if not root.is_dir():
        yield root
        return
    walk = os.walk(root, onerror=lambda error: others.append(f"{error.filename}: cannot be listed: {error.strerror}"))
    for place, folders, files in walk:
        folder, names = Path(place), {*folders, *files}
        is_session = is_session_folder(folder, names)
        others += [
            f"{folder / name}: is a link, which is not followed" for name in folders if (folder / name).is_symlink()
        ]
        folders[:] = sorted(
            name
            for name in folders
            if not (folder / name).is_symlink() and not (is_session and (name in _WITHIN or name == SESSION_FILE))
        )
        if is_session:
            yield folder
        elif IMPACTS in folders and any((folder / IMPACTS).glob("*.h5")):
            folders.remove(IMPACTS)
            yield folder  # a session's folder that has lost header and journal
        for name in sorted(files):
            if name.lower().endswith(SUFFIXES) and not (is_session and name == SESSION_FILE):
                yield folder / name


def _root(folder: Path) -> Path:
    if not folder.exists():
        raise RecordingError(f"{folder}: there is no such folder")
    root = folder.resolve()
    if root.is_file() and root.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{folder}: is not a folder, and not a session file")
    return root.parent if root.name == SESSION_FILE and root.is_file() else root


def _fresh(catalogue: Catalogue, session: Path, reader: LimitedReader, made: Update) -> Kept | None:
    """Return what is to be kept of a session; None where that is kept already, or it is none."""
    before = catalogue.kept(session)
    signature = signature_of(session)
    if before is not None and before.signature == signature and before.entry.state not in (MOVED, GONE):
        made.unchanged += 1
        return None
    entry = entry_of(session, reader, None if before is None else before.entry)
    if entry is None:
        made.others.append(f"{session}: is an HDF5 file, and no session")
        return None
    made.read += 1
    return Kept(signature, entry)


def _missing(catalogue: Catalogue, roots: Sequence[Path], seen: set[str], made: Update) -> Iterator[Kept]:
    """Yield what was kept of sessions that are no longer where they were, as moved or gone.

    That of a folder that nobody asked for now is looked at where its content was found in one that was.
    """
    for path in catalogue.paths():
        if path in seen:
            continue
        asked = any(Path(path).is_relative_to(root) for root in roots)
        kept = catalogue.kept(path) if asked or not Path(path).exists() else None
        if kept is None or kept.entry.state == MOVED:
            continue
        sha256 = kept.entry.sha256
        there = [p for p in catalogue.at(sha256) if p != path and Path(p).exists()] if sha256 else []
        if not (asked or there):
            continue
        if there:
            made.moved += 1
            yield Kept("", replace(kept.entry, state=MOVED, reason=f"was moved to {_plain(there[0])}"))
        elif kept.entry.state != GONE:
            made.gone += 1
            yield Kept("", replace(kept.entry, state=GONE, reason="is no longer there"))


def _plain(path: str) -> str:
    return path.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
