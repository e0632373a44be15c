"""What a bad file or a bad setting raises: one sentence that names the file and the item."""

from __future__ import annotations

import re
from pathlib import Path

from rig.errors import MesotapError

_BREAK = re.compile(r"\s*[\n\r\f\v\x85\u2028\u2029]\s*")


def one_line(text: str) -> str:
    """Return text on one line, with nothing in it that a terminal would act on.

    Sentences quote what stands in files: names, texts, printed arrays.
    """
    if text.isprintable():
        return text
    line = _BREAK.sub(" ", text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in line)


class RecordingError(MesotapError, ValueError):
    """A recording, session or exchange file cannot be used; the text says where, what, and what to do."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


class StructureError(RecordingError):
    """A file is made as no recording is (links, shared arrays, claims beyond its size): all of it is doubtful."""


class UnwrittenError(RecordingError):
    """A file could not be written.

    Attributes
    ----------
    path
        Which file.
    cause
        Why, and what to do.
    """

    def __init__(self, path: Path, cause: str) -> None:
        super().__init__(f"{path}: cannot be written: {cause}")
        self.path = path
        self.cause = cause
