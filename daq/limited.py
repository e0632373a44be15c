"""Files that others wrote are read by a process of its own, with limits; it hands back numbers and texts.

HDF5 and its like are read by large libraries that a file can crash, hold in a loop, or have fill the memory, and an
HDF5 file may name other files that are read in its place. So this process opens none of them: a child does, which may
use so much memory, so much time and no other file, and answers through a pipe (`daq.limited_reply`). What happens to it
becomes a sentence about the file. See docs/decisions/0060.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import numpy as np

from daq.errors import RecordingError
from daq.limited_reply import Array, NoReply, decoded, empty_arrays
from daq.limits import LARGEST_ARRAY, data_room, longest_read_s

T = TypeVar("T")
_Answer = tuple[dict[str, Any] | None, list[Array], int]

LARGEST_TEXTS = 64_000_000
"""Bytes of an answer besides its arrays."""

_PROGRAM = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from daq.limited_child import main; main()"
_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "HDF5_PLUGIN_PRELOAD": "::",  # no filters from shared libraries that a file asks for
    "PYTHONDONTWRITEBYTECODE": "1",
}


class _Ended(Exception):
    """The child closed its pipe before the answer was whole."""


class _TooLong(Exception):
    """The time is over."""


def read_limited(
    read: Callable[..., T],
    path: Path,
    *arguments: Any,
    kinds: Sequence[type] = (),
    errors: Sequence[type[Exception]] = (RecordingError,),
    size: int | None = None,
) -> T:
    """Return ``read(path, *arguments)`` as a process with limits on memory, time and files answers it.

    Parameters
    ----------
    read
        A function at the top level of a module; what it returns is made of JSON types, float64 arrays and ``kinds``.
    path
        The file, or the folder of files, that it reads.
    arguments
        Of JSON types; a `Path` is handed over as one.
    kinds
        Dataclasses that may be in the answer.
    errors
        What ``read`` raises for a person, made from one text; the first is raised where the child fails.
    size
        Bytes of the files; those of ``path`` by default. Memory and time are measured by it.

    Raises
    ------
    Exception
        One of ``errors``: what ``read`` raised, or the first of them where the child came to its limits or died.
    """
    return _read(_asked, read, path, arguments, kinds, errors, size)


class LimitedReader:
    """One process with limits that reads file after file, started anew after a file that ended it.

    To start a process takes longer than to read an impact. Use it in a ``with`` statement.
    """

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None

    def read(self, read: Callable[..., T], path: Path, *arguments: Any, kinds: Sequence[type] = ()) -> T:
        """Return ``read(path, *arguments)``; see `read_limited`."""
        return _read(self.asked, read, path, arguments, kinds, (RecordingError,), None)

    def asked(self, request: bytes, most_bytes: int, wall_s: float) -> _Answer:
        """Return the answer to a request, its arrays, and how the child ended; no answer where it died."""
        deadline = time.monotonic() + wall_s
        child = self._child = self._child or _started()
        whole = False
        try:
            if child.stdin is None or child.stdout is None:
                raise OSError(0, "it has no pipes")
            try:
                with contextlib.suppress(BrokenPipeError):
                    child.stdin.write(request + b"\n")
                reply, arrays = _received(child.stdout.fileno(), most_bytes, deadline)
                whole = True
                return reply, arrays, 0
            except _Ended:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(max(deadline - time.monotonic(), 1.0))
        finally:
            if not whole:
                self.close()
        return None, [], child.returncode

    def close(self) -> None:
        """End the process; harmless when called twice."""
        child, self._child = self._child, None
        if child is None:
            return
        if child.poll() is None:
            child.kill()
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                pipe.close()
        child.wait()

    def __enter__(self) -> LimitedReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _read(
    asked: Callable[[bytes, int, float], _Answer],
    read: Callable[..., T],
    path: Path,
    arguments: Sequence[Any],
    kinds: Sequence[type],
    errors: Sequence[type[Exception]],
    size: int | None,
) -> T:
    """Return what a child that is ``asked`` answers; see `read_limited`."""
    if size is None:
        try:
            size = path.stat().st_size
        except (OSError, ValueError):
            size = 0  # the child says what is wrong
    request = {
        "module": read.__module__,
        "function": read.__qualname__,
        "path": str(path),
        "arguments": [{"path": str(a)} if isinstance(a, Path) else {"value": a} for a in arguments],
        "size": size,
        "errors": [e.__name__ for e in errors],
    }
    wall_s = longest_read_s(size)[1]
    try:
        reply, arrays, status = asked(json.dumps(request).encode(), data_room(size), wall_s)
    except OSError as error:
        raise errors[0](f"{path}: no process could be started to read it: {error.strerror}") from error
    except _TooLong:
        raise errors[0](f"{path}: is damaged: it was not read within {wall_s:.0f} s") from None
    except (NoReply, RecursionError, MemoryError) as error:
        raise errors[0](f"{path}: is damaged: {error or 'it needs more memory than there is'}") from error
    if reply is None:
        raise errors[0](f"{path}: {_death(status)}")
    if "error" in reply:
        kind, text = reply["error"]
        raise next((e for e in errors if e.__name__ == kind), errors[0])(text)
    try:
        return decoded(reply["value"], arrays, {kind.__name__: kind for kind in kinds})
    except (NoReply, RecursionError) as error:
        raise errors[0](f"{path}: is damaged: {error}") from error


def _asked(request: bytes, most_bytes: int, wall_s: float) -> _Answer:
    """Return the answer of a child of its own."""
    with LimitedReader() as reader:
        return reader.asked(request, most_bytes, wall_s)


def _started() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _PROGRAM, json.dumps(sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        env={**os.environ, **_ENVIRONMENT},
        start_new_session=True,  # Ctrl-C at the terminal is the parent's
    )


def _received(pipe: int, most_bytes: int, deadline: float) -> tuple[dict[str, Any], list[Array]]:
    """Return the answer and its arrays, as far as they are within bounds."""
    length = bytearray(8)
    _fill(pipe, memoryview(length), deadline)
    claimed = int.from_bytes(length, "little")
    if claimed > LARGEST_TEXTS:
        raise NoReply(f"its texts take more than {LARGEST_TEXTS // 10**6} MB")
    text = bytearray(claimed)
    _fill(pipe, memoryview(text), deadline)
    try:
        reply = json.loads(text)
    except ValueError as error:
        raise NoReply("the process that read it answered something else") from error
    if not isinstance(reply, dict):
        raise NoReply("the process that read it answered something else")
    arrays = empty_arrays(reply.get("arrays", []), min(most_bytes, 8 * LARGEST_ARRAY))
    for array in arrays:
        _fill(pipe, array.reshape(-1).view(np.uint8).data, deadline)
    return reply, arrays


def _fill(pipe: int, buffer: memoryview, deadline: float) -> None:
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    while buffer:
        left_s = deadline - time.monotonic()
        if left_s <= 0 or not poll.poll(1000 * left_s):
            raise _TooLong
        got = os.readv(pipe, [buffer])
        if not got:
            raise _Ended
        buffer = buffer[got:]


def _death(status: int) -> str:
    """Return what became of a child that did not answer."""
    if -status in (signal.SIGXCPU, signal.SIGALRM):
        return "is damaged: reading it takes longer than a file of its size may"
    if -status == signal.SIGKILL:
        return "is damaged, or the memory is full: the process that read it was killed"
    if status < 0:
        return "the file is damaged or truncated: the library that reads it failed"
    return "the file is damaged or truncated: the process that read it ended"
