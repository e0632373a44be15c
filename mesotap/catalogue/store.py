"""The catalogue on disk: one SQLite file, which holds nothing that is not in session files and their answers.

Several processes read it while one writes (WAL). It lies on the machine's own disk, because SQLite's shared memory
works on no network file system, while the sessions may lie anywhere.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType

from mesotap.catalogue.entry import Entry, LoadEntry, entry_from
from mesotap.catalogue.finding import clause_for
from mesotap.catalogue.question import EVERYTHING, Node
from rig.errors import MesotapError

APPLICATION = 0x6D657361  # "mesa": says of an SQLite file whose it is
SCHEMA = 1
"""Raised when tables or their meaning change; an index of another one is made anew."""

WAIT_S = 30.0  # for another process that writes; it does so in short transactions
CACHE_KB = (
    64_000  # of pages in memory: with SQLite's 2,000 the indexes of 60,000 sessions are read from disk over again
)
FILE = "catalogue.sqlite"

_DAMAGED = "is damaged ({}); delete it: it is made anew from the session files"
_TABLES = """
CREATE TABLE session (
    id INTEGER PRIMARY KEY, path BLOB UNIQUE NOT NULL, signature TEXT NOT NULL, created REAL, state TEXT NOT NULL,
    software TEXT, verdict TEXT, simulated INTEGER, drifted INTEGER, f1_hz REAL, noise_m_s2 REAL, sha256 TEXT);
CREATE TABLE said (id INTEGER PRIMARY KEY, entry BLOB NOT NULL);
CREATE INDEX by_date ON session (created);
CREATE INDEX by_content ON session (sha256);
CREATE INDEX by_verdict ON session (verdict);
CREATE INDEX by_state ON session (state);
CREATE TABLE load (
    session INTEGER NOT NULL, number INTEGER NOT NULL, load_mn REAL, k_c REAL, zeta REAL, f2_hz REAL,
    PRIMARY KEY (session, number)) WITHOUT ROWID;
CREATE INDEX by_load ON load (load_mn, k_c, zeta);
CREATE TABLE mechanism (
    session INTEGER NOT NULL, number INTEGER NOT NULL, mechanism TEXT NOT NULL, PRIMARY KEY (session, number))
    WITHOUT ROWID;
CREATE INDEX by_mechanism ON mechanism (mechanism);
CREATE VIRTUAL TABLE words USING fts5 (
    specimen, title, operator, name, other, tokenize = 'unicode61 remove_diacritics 2');
"""


class CatalogueError(MesotapError, ValueError):
    """The catalogue cannot be used; one sentence."""


@dataclass(frozen=True, slots=True)
class Kept:
    """An entry as it is kept: ``signature`` says of which files, by name, time and size, it was made."""

    signature: str
    entry: Entry


def usual_place() -> Path:
    """Return where the catalogue of this person lies: ``$XDG_CACHE_HOME/mesotap``, in ``~/.cache`` by default."""
    said = os.environ.get("XDG_CACHE_HOME", "")
    cache = Path(said) if Path(said).is_absolute() else Path.home() / ".cache"
    return cache / "mesotap" / FILE


class Catalogue:
    """The index. Use it in a ``with`` statement.

    Parameters
    ----------
    path
        Of the SQLite file; it is made where there is none.
    read_only
        Whether nothing is to be written; the file must be there then.

    Raises
    ------
    CatalogueError
        The file is something else, damaged, or cannot be written, or this Python's SQLite has no full-text search.
    """

    def __init__(self, path: Path, read_only: bool = False) -> None:
        self.path = path
        self._refuse_foreign()
        mode = "ro" if read_only else "rwc"
        try:
            if not read_only:
                path.parent.mkdir(parents=True, exist_ok=True)
            uri = f"{path.absolute().as_uri()}?mode={mode}"
            self._database = sqlite3.connect(uri, uri=True, timeout=WAIT_S, isolation_level=None)
        except (sqlite3.Error, OSError) as error:
            raise CatalogueError(f"{path}: cannot be opened as a catalogue: {error}") from error
        try:
            if not read_only:
                with self._told():
                    self._prepare()
            elif self._version() != SCHEMA:
                raise CatalogueError(f"{path}: was made by another version; 'mesotap catalog FOLDER' makes it anew")
        except BaseException:
            self._database.close()
            raise

    def _refuse_foreign(self) -> None:
        try:
            if self.path.is_dir():
                raise CatalogueError(f"{self.path}: is a folder, not a catalogue; name a file")
            if not self.path.exists() or self.path.stat().st_size == 0:
                return
            if not self.path.is_file():
                raise CatalogueError(f"{self.path}: is no file; name another")
            with self.path.open("rb") as file:
                head = file.read(100)
        except OSError as error:
            raise CatalogueError(f"{self.path}: cannot be read: {error.strerror}") from error
        if not head.startswith(b"SQLite format 3\0") or head[68:72] not in (APPLICATION.to_bytes(4, "big"), bytes(4)):
            raise CatalogueError(f"{self.path}: is not a catalogue, and left as it is; name another file")

    def _version(self) -> int:
        with self._told():
            return int(self._database.execute("PRAGMA user_version").fetchone()[0])

    def _prepare(self) -> None:
        run = self._database.execute
        if not run("SELECT sqlite_compileoption_used('ENABLE_FTS5')").fetchone()[0]:
            raise CatalogueError(
                "the SQLite of this Python has no full-text search (FTS5), which the catalogue needs: use a Python "
                "whose sqlite3 was built with it, such as that of Debian or python.org"
            )
        run("PRAGMA journal_mode = WAL")
        run(f"PRAGMA cache_size = -{CACHE_KB}")
        run("PRAGMA synchronous = NORMAL")  # at a power cut the newest rows are lost, and are read from the files again
        if self._version() == SCHEMA:
            return
        with self._writing():
            version = int(run("PRAGMA user_version").fetchone()[0])
            if version == SCHEMA:  # another process was quicker
                return
            tables = [r[0] for r in run("SELECT name FROM sqlite_master WHERE type = 'table'")]
            if tables and int(run("PRAGMA application_id").fetchone()[0]) != APPLICATION:
                raise CatalogueError(f"{self.path}: is a database of another program; name another file")
            for table in ("words", "mechanism", "load", "said", "session"):
                run(f"DROP TABLE IF EXISTS {table}")
            for statement in _TABLES.split(";"):
                run(statement)
            run(f"PRAGMA application_id = {APPLICATION}")
            run(f"PRAGMA user_version = {SCHEMA}")

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what SQLite raises into a sentence."""
        try:
            yield
        except UnicodeDecodeError as error:  # of SQLite's own sentence, which quotes what it cannot read
            raise CatalogueError(f"{self.path}: {_DAMAGED.format('its schema is unreadable')}") from error
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError) and "locked" in str(error):
                what = "another process has kept it locked; try again"
            elif isinstance(error, sqlite3.OperationalError) and "malformed" not in str(error):
                what = f"cannot be used: {error}"
            else:
                what = _DAMAGED.format(error)
            raise CatalogueError(f"{self.path}: {what}") from error

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        with self._told():
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._database.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):
                    self._database.execute("ROLLBACK")
                raise

    def put(self, entries: Sequence[Kept]) -> None:
        """Take in entries, in one transaction, in place of those of the same paths."""
        with self._writing():
            for kept in entries:
                self._put(kept)

    def _put(self, kept: Kept) -> None:
        run, many, entry = self._database.execute, self._database.executemany, kept.entry
        place = os.fsencode(entry.path)
        old = run("SELECT id FROM session WHERE path = ?", (place,)).fetchone()
        if old is not None:
            self._take_out(old)
        drifted = None if entry.drifted is None else int(entry.drifted)
        number = run(
            "INSERT INTO session (path, signature, created, state, software, verdict, simulated, drifted, f1_hz, "
            "noise_m_s2, sha256) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                *(place, kept.signature, seconds_of(entry.created), entry.state, entry.software, entry.verdict),
                *(int(entry.simulated), drifted, entry.f1_hz, entry.noise_m_s2, entry.sha256),
            ),
        ).lastrowid
        run("INSERT INTO said VALUES (?, ?)", (number, _packed(entry)))
        many(
            "INSERT INTO load VALUES (?, ?, ?, ?, ?, ?)",
            [(number, i, *_values(load)) for i, load in enumerate(entry.loads)],
        )
        many("INSERT INTO mechanism VALUES (?, ?, ?)", [(number, i, m.id) for i, m in enumerate(entry.mechanisms)])
        other = " ".join(
            [entry.reason, entry.verdict, *entry.notes, *(f"{m.id} {m.statement}" for m in entry.mechanisms)]
        )
        name = entry.name.encode("utf-8", "replace").decode()
        run(
            "INSERT INTO words (rowid, specimen, title, operator, name, other) VALUES (?, ?, ?, ?, ?, ?)",
            (number, entry.specimen, entry.title, entry.operator, name, other),
        )

    def _take_out(self, number: tuple[int]) -> None:
        for table, column in (("load", "session"), ("mechanism", "session"), ("words", "rowid"), ("said", "id")):
            self._database.execute(f"DELETE FROM {table} WHERE {column} = ?", number)
        self._database.execute("DELETE FROM session WHERE id = ?", number)

    def kept(self, path: Path | str) -> Kept | None:
        """Return what is kept of the session at a path."""
        with self._told():
            row = self._database.execute(
                "SELECT signature, entry FROM session JOIN said USING (id) WHERE path = ?", (os.fsencode(path),)
            ).fetchone()
        return None if row is None else Kept(row[0], _unpacked(row[1]))

    def at(self, sha256: str) -> list[str]:
        """Return the paths of sessions of this content."""
        with self._told():
            rows = self._database.execute("SELECT path FROM session WHERE sha256 = ? ORDER BY id", (sha256,)).fetchall()
        return [os.fsdecode(row[0]) for row in rows]

    def paths(self, folder: Path | None = None) -> list[str]:
        """Return the paths that are kept, of those within a folder."""
        with self._told():
            rows = self._database.execute("SELECT path FROM session ORDER BY id").fetchall()
        found = [os.fsdecode(row[0]) for row in rows]
        return found if folder is None else [path for path in found if Path(path).is_relative_to(folder)]

    def find(self, question: Node = EVERYTHING, folders: Sequence[Path] = ()) -> list[Entry]:
        """Return the sessions that a question asks for, the newest first.

        Parameters
        ----------
        question
            As `mesotap.catalogue.question.asked` makes it.
        folders
            In one of which they lie; anywhere by default.
        """
        where, values = clause_for(question)
        for_folders, places = _within(folders)
        with self._told():
            rows = self._database.execute(
                f"SELECT entry FROM session JOIN said USING (id) WHERE {where}{for_folders} "
                "ORDER BY created DESC, path",
                [*values, *places],
            ).fetchall()
        return [_unpacked(row[0]) for row in rows]

    def count(self, question: Node) -> int:
        """Return how many sessions a question finds."""
        where, values = clause_for(question)
        with self._told():
            return int(self._database.execute(f"SELECT count(*) FROM session WHERE {where}", values).fetchone()[0])

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def __enter__(self) -> Catalogue:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def seconds_of(created: str) -> float | None:
    """Return an ISO 8601 date in seconds since 1970, of UTC where it has no zone; None where it is none."""
    try:
        at = datetime.fromisoformat(created)
    except ValueError:
        return None
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _packed(entry: Entry) -> bytes:
    return zlib.compress(json.dumps(entry.as_json(), separators=(",", ":")).encode(), 1)


def _unpacked(kept: bytes) -> Entry:
    try:
        return entry_from(json.loads(zlib.decompress(kept)))
    except (zlib.error, ValueError, KeyError, TypeError) as error:
        raise CatalogueError("the catalogue is damaged; delete it: it is made anew from the session files") from error


def _values(load: LoadEntry) -> list[float | None]:
    found = (load.load_mn, load.contact_stiffness_n_per_m, load.zeta2, load.f2_hz)
    return [None if estimate is None else estimate.value for estimate in found]


def _within(folders: Sequence[Path]) -> tuple[str, list[bytes]]:
    if not folders:
        return "", []
    places = [os.fsencode(folder) for folder in folders]
    one = "path = ? OR substr(path, 1, ?) = ?"
    values: list[object] = []
    for place in places:
        inside = place.rstrip(b"/") + b"/"
        values += [place, len(inside), inside]
    return f" AND ({' OR '.join([one] * len(places))})", values  # type: ignore[return-value]
