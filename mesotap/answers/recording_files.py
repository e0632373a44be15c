"""Which files an answer is about."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from analysis.mismatch.answer import RecordingFile
from daq.regular import open_regular

CHUNK = 1 << 20  # bytes read at a time


def recording_files(paths: Sequence[Path]) -> tuple[RecordingFile, ...]:
    """Return files with the SHA-256 of what they hold.

    Raises
    ------
    RecordingError
        One is missing, is not a file, or may not be read.
    """
    return tuple(RecordingFile(str(path), sha256_of(path)) for path in paths)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of what a file holds; raises as `recording_files`."""
    descriptor, _ = open_regular(path)
    digest = hashlib.sha256()
    with os.fdopen(descriptor, "rb") as stream:
        while chunk := stream.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()
