"""`mesotap catalog`: index folders of sessions, and list those that are asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.console import Console

from daq.durable import write_whole
from daq.errors import RecordingError
from daq.regular import read_head
from mesotap.answers.rounding import counted, significant
from mesotap.catalogue.entry import MOVED, UNREADABLE, Entry
from mesotap.catalogue.indexing import Update, update
from mesotap.catalogue.listing import COLUMNS, loads_csv, loads_parquet, sessions_json
from mesotap.catalogue.question import EVERYTHING, Node, asked
from mesotap.catalogue.store import Catalogue, CatalogueError, usual_place
from mesotap.commands.outputs import make_ready, write_json
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

MOST_SHOWN = 200  # rows of the table that a person is shown
MOST_TOLD = 20


@dataclass(frozen=True, slots=True)
class Asked:
    """What a command asks of the catalogue: values by key of `question.KEYS`, an expression, folders, which index."""

    folders: Sequence[Path] = ()
    where: str = ""
    options: Mapping[str, str | None] = field(default_factory=dict)
    index: Path | None = None

    def question(self) -> Node:
        """Return what is asked for."""
        return asked(self.where, self.options)


@dataclass(frozen=True, slots=True)
class Answer:
    """What was found, what of it cannot be judged, and what the update came to (None without folders)."""

    index: Path
    found: list[Entry]
    not_judged: list[Entry]
    update: Update | None


def catalog(what: Asked, json_path: Path | None, csv: Path | None, parquet: Path | None, console: Console) -> None:
    """Index the folders and list what is asked for."""
    for file in (csv, parquet):
        if file is not None:
            make_ready(file, None)
            _refuse_others_file(file, b"PAR1" if file is parquet else COLUMNS[0].encode())
    answer = look_up(what, console)
    _show(answer, console)
    if csv is not None:
        write_whole(csv, loads_csv(answer.found).encode("utf-8", "replace"))
    if parquet is not None:
        write_whole(parquet, loads_parquet(answer.found))
    updated = None if answer.update is None else asdict(answer.update)
    made = {"sessions": sessions_json(answer.found), "not_judged": sessions_json(answer.not_judged)}
    write_json(json_path, {**made, "index": str(answer.index), "update": updated})


def look_up(what: Asked, console: Console) -> Answer:
    """Bring the catalogue up to date with the folders, if any are named, and find what is asked for.

    Raises
    ------
    QuestionError, CatalogueError, RecordingError
        The question, the catalogue or a folder is at fault.
    """
    question = what.question()
    place = what.index or usual_place()
    if not what.folders and not place.exists():
        raise CatalogueError("nothing is in the catalogue yet: name the folders of your sessions")
    with Catalogue(place) as catalogue:
        made = None
        if what.folders:
            with console.status("reading sessions ...") as shown:
                made = update(catalogue, what.folders, lambda done: shown.update(f"looked at {done} sessions"))
        within = [folder.resolve() for folder in what.folders]
        found = catalogue.find(question, within)
        everything = question == EVERYTHING
        if not everything and "state:" not in what.where:
            found = [entry for entry in found if entry.state != MOVED]
        paths = {entry.path for entry in found}
        rest = [] if everything else [e for e in catalogue.find(EVERYTHING, within) if e.state in UNREADABLE]
        return Answer(place, found, [e for e in rest if e.path not in paths and e.state != MOVED], made)


def _refuse_others_file(file: Path, begins: bytes) -> None:
    """Raise where a file is there that is not such a table."""
    if file.exists() and read_head(file, len(begins)) not in (b"", begins):
        raise RecordingError(f"{file}: exists already and is no table of sessions; it is left as it is, name another")


def _show(answer: Answer, console: Console) -> None:
    shown = Table(keys=2, title=f"{counted(len(answer.found), 'session')}; loads in mN, k_c in MN/m, zeta2 in %")
    for heading in ("created", "name", "specimen", "operator", "loads", "k_c", "zeta2", "diagnosis", "state"):
        shown.add_column(heading)
    for entry in answer.found[:MOST_SHOWN]:
        named = ", ".join(m.id for m in entry.mechanisms) or entry.verdict
        doubt = ", gauge drifted" if entry.drifted else ""
        state = f"{entry.state}: {entry.reason}" if entry.reason else entry.state
        cells = (entry.created[:16], entry.name, entry.specimen, entry.operator)
        numbers = (
            _range(entry, "load_mn", 1.0, 3),
            _range(entry, "contact_stiffness_n_per_m", 1e-6, 3),
            _range(entry, "zeta2", 100.0, 2),
        )
        shown.add_row(*map(escape, cells), *numbers, escape(named), escape(state + doubt))
    console.print(shown)
    more = len(answer.found) - MOST_SHOWN
    if more > 0:
        console.print(f"... and {more} more; --json and --csv have all", highlight=False)
    for entry in answer.not_judged[:MOST_TOLD]:
        said = f"{entry.path}: cannot be judged by this: {entry.state}: {entry.reason}"
        console.print(f"- {escape(said)}", highlight=False, soft_wrap=True)
    if len(answer.not_judged) > MOST_TOLD:
        console.print(f"- and {len(answer.not_judged) - MOST_TOLD} more cannot be judged", highlight=False)
    made = answer.update
    if made is not None:
        for other in made.others[:MOST_TOLD]:
            console.print(f"- {escape(other)}", highlight=False, soft_wrap=True)
        if len(made.others) > MOST_TOLD:
            console.print(f"- and {len(made.others) - MOST_TOLD} more such files", highlight=False)
        said = f"{made.read} read, {made.unchanged} unchanged, {made.moved} moved, {made.gone} gone"
        console.print(f"index {escape(answer.index)}: {said}", highlight=False, soft_wrap=True)


def _range(entry: Entry, quantity: str, scale: float, digits: int) -> str:
    values = [scale * e.value for load in entry.loads if (e := getattr(load, quantity)) is not None]
    if not values:
        return ""
    ends = [significant(end, digits) for end in (min(values), max(values))]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"
