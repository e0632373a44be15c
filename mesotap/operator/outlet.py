"""Output that never makes the program wait: a terminal that was halted, a reader that stands still or has gone.

While the surfaces touch, whoever waits for somebody to read watches no load.
"""

from __future__ import annotations

import io
import os
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, cast

from rich.console import Console

MOST_PIECES = 10_000  # of text that nobody reads yet; what comes after them is lost
LAST_WAIT_S = 1.0  # for a reader, at the end


class Outlet(io.TextIOBase):
    """A text stream to a descriptor, written by a thread of its own.

    Parameters
    ----------
    descriptor
        Open file, pipe or terminal; left open.
    coding
        Of its text.
    """

    def __init__(self, descriptor: int, coding: str) -> None:
        self._descriptor = descriptor
        self._coding = coding
        self._pieces: queue.Queue[bytes | None] = queue.Queue(MOST_PIECES)
        self._thread = threading.Thread(target=self._write_out, daemon=True)
        self._thread.start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Name of its coding."""
        return self._coding

    def write(self, text: str) -> int:
        """Take text in, to be written when somebody reads; more than a great deal is lost."""
        with suppress(queue.Full):
            self._pieces.put_nowait(text.encode(self._coding, errors="backslashreplace"))
        return len(text)

    def flush(self) -> None:
        """Do nothing: text is written as soon as it can be."""

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return os.isatty(self._descriptor)

    def fileno(self) -> int:
        """Descriptor behind it."""
        return self._descriptor

    def end(self) -> None:
        """Wait a moment until all is written."""
        with suppress(queue.Full):
            self._pieces.put_nowait(None)
        self._thread.join(LAST_WAIT_S)

    def _write_out(self) -> None:
        there = True
        while (piece := self._pieces.get()) is not None:
            while there and piece:
                try:
                    piece = piece[os.write(self._descriptor, piece) :]
                except OSError:  # nobody reads any more, or the disk is full: the session matters more
                    there = False


@contextmanager
def unhurried(console: Console) -> Iterator[None]:
    """Have a console wait for nobody; one that writes to no descriptor never does."""
    before = console.file
    try:
        descriptor = before.fileno()
        before.flush()
    except (OSError, ValueError, AttributeError):  # io.UnsupportedOperation is both of the first
        yield
        return
    outlet = Outlet(descriptor, getattr(before, "encoding", None) or "utf-8")
    console.file = cast(IO[str], outlet)
    try:
        yield
    finally:
        outlet.end()
        console.file = before
