"""What a task is, and its name: the hash of all that its result depends on."""

from __future__ import annotations

import functools
import hashlib
import importlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

PACKAGES = ("rig", "daq", "calibration", "analysis", "sim_backend", "mesotap")
SOURCES = (".py", ".yaml", ".json")


@dataclass(frozen=True, slots=True)
class Task:
    """One command of mesotap in an empty folder.

    Attributes
    ----------
    arguments
        What stands after ``mesotap`` on the command line.
    inputs
        Name of each file in the folder to the SHA-256 of its content.
    answers
        JSON files that the command writes: the result.
    """

    arguments: tuple[str, ...]
    inputs: Mapping[str, str] = field(default_factory=dict)
    answers: tuple[str, ...] = ("answer.json",)

    def digest(self, program: str) -> str:
        """Return the SHA-256 of the task and of the program that carries it out.

        Examples
        --------
        >>> Task(("diagnose", "x.h5")).digest("1") == Task(("diagnose", "x.h5")).digest("1")
        True
        >>> Task(("diagnose", "x.h5")).digest("1") == Task(("diagnose", "x.h5")).digest("2")
        False
        """
        content = json.dumps({**asdict(self), "program": program}, sort_keys=True, allow_nan=False)
        return hashlib.sha256(content.encode()).hexdigest()

    @classmethod
    def of(cls, described: Mapping[str, Any]) -> Task:
        """Return the task that `dataclasses.asdict` described."""
        return cls(tuple(described["arguments"]), dict(described["inputs"]), tuple(described["answers"]))


def content_sha256(source: Path | bytes) -> str:
    """Return the SHA-256 of a content, or of a file's."""
    if isinstance(source, bytes):
        return hashlib.sha256(source).hexdigest()
    with source.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@functools.cache
def program_sha256() -> str:
    """Return the SHA-256 of the program's source: every module and data file of its packages, with their names."""
    digest = hashlib.sha256()
    for name, path in _sources():
        digest.update(f"{name}\0{content_sha256(path)}\n".encode())
    return digest.hexdigest()


def _sources() -> Iterator[tuple[str, Path]]:
    for package in PACKAGES:
        folder = Path(str(importlib.import_module(package).__file__)).parent
        for path in sorted(folder.rglob("*")):
            if path.suffix in SOURCES and "__pycache__" not in path.parts:
                yield f"{package}/{path.relative_to(folder)}", path
