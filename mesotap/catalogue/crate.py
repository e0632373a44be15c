"""Sessions as an RO-Crate 1.1: files, hashes, configuration, versions and answers, in a folder that describes itself.

https://w3id.org/ro/crate/1.1: ``ro-crate-metadata.json`` is JSON-LD, flattened, with an entity for each file.
``manifest-sha256.txt`` beside it has what ``sha256sum -c`` checks, so that no program of this kind is needed for that.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import mimetypes
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mesotap import __version__
from mesotap.answers.rounding import counted
from mesotap.campaigns.task import program_sha256
from mesotap.catalogue.answers_beside import AGAIN, places_of_answers
from mesotap.catalogue.entry import Entry, Found
from mesotap.catalogue.reading import SESSION_FILE

METADATA, MANIFEST = "ro-crate-metadata.json", "manifest-sha256.txt"
SPECIFICATION = "https://w3id.org/ro/crate/1.1"
CONTEXT = [f"{SPECIFICATION}/context", {"sha256": "https://w3id.org/ro/terms/workflow-run#sha256"}]
CONFIGURATION = "config.yaml"
WANTED = (
    "session.json",
    "journal.jsonl",
    "results.json",
    "results.csv",
    "impacts.csv",
    "budgets.csv",
    "diagnosis.json",
)
PAGES = ("report.html", "diagnosis.html", "explanations.json")
UNIT = {"load_mn": "mN", "contact_stiffness_n_per_m": "N/m", "zeta2": "1", "f2_hz": "Hz"}
NO_LICENSE = "No licence was stated: whoever wants to use these data asks those who measured them."
KINDS = {".h5": "application/x-hdf5", ".jsonl": "application/jsonl", ".yaml": "application/yaml"}
SOFTWARE, MADE = "#mesotap", "#mesotap-crate"


@dataclass(frozen=True, slots=True)
class Packed:
    """A session to be put into a crate: its entry, its configuration's text, and its files by their names in it."""

    entry: Entry
    folder: str
    configuration: str
    files: dict[str, Path]


def packed(entry: Entry, configuration: str, folder: str) -> Packed:
    """Return what of a session goes into a crate: the session file, its answers old and new, and its configuration.

    Parameters
    ----------
    folder
        Name of its folder in the crate.
    """
    session = Path(entry.path)
    files: dict[str, Path] = {}
    recorded = session / SESSION_FILE if session.is_dir() else session
    if recorded.is_file():
        files[recorded.name] = recorded
    beside, again = places_of_answers(session)
    for name in (*WANTED, *PAGES):
        if (beside / name).is_file() and not (beside / name).is_symlink():
            files[name] = beside / name
    if entry.diagnosis and not session.is_dir() and (file := session.parent / entry.diagnosis).is_file():
        files["diagnosis.json"] = file
    if again.is_dir():
        for file in sorted(again.glob("*/*.json")):
            if not file.is_symlink() and not file.parent.is_symlink():
                files[f"{AGAIN}/{file.parent.name}/{file.name}"] = file
    return Packed(entry, folder, configuration, files)


def contents(sessions: Sequence[Packed], license_text: str, at: datetime.datetime) -> dict[str, bytes]:
    """Return every file of a crate by its path in it.

    Parameters
    ----------
    license_text
        An address, or a sentence; empty where none was stated.
    at
        When the crate is made.
    """
    made: dict[str, bytes] = {}
    for session in sessions:
        made[f"{session.folder}/{CONFIGURATION}"] = session.configuration.encode("utf-8", "replace")
        for name, file in session.files.items():
            made[f"{session.folder}/{name}"] = file.read_bytes()
    metadata = {"@context": CONTEXT, "@graph": _graph(sessions, made, license_text, at)}
    made[METADATA] = (json.dumps(metadata, indent=1, allow_nan=False) + "\n").encode()
    listed = "".join(f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in sorted(made.items()))
    made[MANIFEST] = listed.encode("utf-8", "surrogateescape")
    return made


def _graph(
    sessions: Sequence[Packed], files: dict[str, bytes], license_text: str, at: datetime.datetime
) -> list[dict[str, Any]]:
    addressed = urllib.parse.urlsplit(license_text).scheme in ("http", "https")
    license_id = license_text if addressed else "#license"
    names = ", ".join(sorted({s.entry.specimen for s in sessions if s.entry.specimen})) or "no specimen named"
    operators = sorted({s.entry.operator for s in sessions if s.entry.operator})
    descriptor = {
        **{"@id": METADATA, "@type": "CreativeWork"},
        **{"conformsTo": {"@id": SPECIFICATION}, "about": {"@id": "./"}},
    }
    root = {
        **{"@id": "./", "@type": "Dataset", "datePublished": at.date().isoformat()},
        "name": f"{counted(len(sessions), 'session')} of contact resonance tests: {names}",
        "description": "Recordings of taps on two masses pressed together, with calibration, configuration and the "
        "contact stiffness and damping found in them (doi 10.1115/1.1857920).",
        "license": {"@id": license_id},
        "hasPart": [{"@id": f"{_id(s.folder)}/"} for s in sessions],
        "mentions": [{"@id": f"#analysis-{i}"} for i, s in enumerate(sessions) if s.entry.answer],
        **({"author": [{"@id": f"#operator-{i}"} for i in range(len(operators))]} if operators else {}),
    }
    license_entity = {
        **{"@id": license_id, "@type": "CreativeWork", "name": license_text or "no licence stated"},
        "description": license_text or NO_LICENSE,
    }
    program = {
        **{"@id": MADE, "@type": "SoftwareApplication", "name": "mesotap", "version": __version__},
        "sha256": program_sha256(),
        "description": "Program that made this crate; sha256 is that of its sources.",
    }
    people = [{"@id": f"#operator-{i}", "@type": "Person", "name": name} for i, name in enumerate(operators)]
    graph: list[dict[str, Any]] = [descriptor, root, license_entity, program, *people]
    for i, session in enumerate(sessions):
        graph += _session(i, session, files, operators)
    return graph


def _session(i: int, session: Packed, files: dict[str, bytes], operators: Sequence[str]) -> list[dict[str, Any]]:
    entry, inside = session.entry, f"{session.folder}/"
    own = {name: content for name, content in files.items() if name.startswith(inside)}
    values = [*_values(i, entry)]
    dataset: dict[str, Any] = {
        **{"@id": f"{_id(session.folder)}/", "@type": "Dataset", "name": entry.title or entry.name},
        "description": f"Specimen: {entry.specimen or 'not named'}. State: {entry.state}. {entry.accepted} of "
        f"{entry.taps} taps accepted." + (" Diagnosis: " + entry.verdict + "." if entry.verdict else ""),
        "hasPart": [{"@id": _id(name)} for name in own],
        "variableMeasured": [{"@id": value["@id"]} for value in values],
    }
    if entry.created:
        dataset["dateCreated"] = entry.created
    if entry.operator:
        dataset["creator"] = {"@id": f"#operator-{operators.index(entry.operator)}"}
    graph = [dataset, *(_file(name, content, inside) for name, content in own.items()), *values]
    graph += _actions(i, session)
    return graph


def _actions(i: int, session: Packed) -> list[dict[str, Any]]:
    """What recorded the session and what analysed it, each with its program."""
    entry = session.entry
    made: list[dict[str, Any]] = []
    if entry.software:
        recorder = f"{SOFTWARE}-{i}"
        made.append(
            {"@id": recorder, "@type": "SoftwareApplication", "name": entry.software, "version": entry.software}
        )
    if entry.answer:
        recorded = next((n for n in session.files if n.endswith((".h5", ".hdf5"))), "journal.jsonl")
        answer = entry.answer if entry.answer in session.files else "results.json"
        made.append(
            {
                **{"@id": f"#analysis-{i}", "@type": "CreateAction", "name": f"analysis of {entry.name}"},
                "object": [{"@id": _id(f"{session.folder}/{n}")} for n in (recorded, CONFIGURATION)],
                "result": {"@id": _id(f"{session.folder}/{answer}")},
                "instrument": {"@id": f"{SOFTWARE}-{i}" if entry.software else MADE},
            }
        )
    return made


def _values(i: int, entry: Entry) -> list[dict[str, Any]]:
    made = []
    for load in entry.loads:
        at = "an unknown load" if load.load_mn is None else f"{load.load_mn.value:.1f} mN"
        for quantity, unit in UNIT.items():
            found: Found | None = getattr(load, quantity)
            if found is not None:
                made.append(
                    {
                        **{"@id": f"#value-{i}-{load.load_set}-{quantity}", "@type": "PropertyValue"},
                        **{"name": f"{quantity} at {at}", "propertyID": quantity, "unitText": unit},
                        **{"value": found.value, "minValue": found.low, "maxValue": found.high},
                        "description": "minValue and maxValue are the 95 % interval",
                    }
                )
    return made


def _file(name: str, content: bytes, inside: str) -> dict[str, Any]:
    suffix = Path(name).suffix
    return {
        **{"@id": _id(name), "@type": "File", "name": name.removeprefix(inside), "contentSize": str(len(content))},
        "encodingFormat": KINDS.get(suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream",
        "sha256": hashlib.sha256(content).hexdigest(),
    }


def _id(name: str) -> str:
    """A file's path as a reference (RFC 3986)."""
    return urllib.parse.quote(name)
