"""The process that reads foreign files: takes a request, limits itself, answers through a pipe. See `daq.limited`."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import resource
import signal
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from daq.limited_reply import Array, encoded, shapes
from daq.limits import longest_read_s, memory_room

_NO_ROOM = "memory allocation failed"
"""What HDF5 says where it gets no more memory."""

_WIDE = [f"utf-{bits}{order}" for bits in (16, 32) for order in ("", "-le", "-be")]
_CODINGS = ("utf-8", "utf-8-sig", "latin-1", "ascii", *_WIDE)


def main() -> None:
    """Answer the requests on standard input, a line each, on standard output; end when there are no more."""
    for line in sys.stdin.buffer:
        answer(json.loads(line), sys.stdout.buffer)
        signal.alarm(0)
    os._exit(0)


def answer(request: dict[str, Any], stream: BinaryIO) -> None:
    """Limit this process, read what is asked for, and answer; where nobody listens, end the process."""
    read = getattr(importlib.import_module(request["module"]), request["function"])
    arguments = [Path(a["path"]) if "path" in a else a["value"] for a in request["arguments"]]
    path = Path(request["path"])
    limit_this_process(int(request["size"]))
    arrays: list[Array] = []
    try:
        reply = {"value": encoded(read(path, *arguments), arrays), "arrays": shapes(arrays)}
        text = json.dumps(reply).encode()
    except Exception as error:
        arrays, text = [], json.dumps({"error": _told(path, error, request["errors"])}).encode()
    _send(stream, text, arrays)


def limit_this_process(size: int) -> None:
    """Let this process take no more memory and time than a file of ``size`` bytes may need, and write no file.

    What it took for files before is not counted.
    """
    cpu_s, wall_s = longest_read_s(size)
    _lower(resource.RLIMIT_CPU, int(time.process_time() + cpu_s) + 1)
    _lower(resource.RLIMIT_CORE, 0)
    _lower(resource.RLIMIT_FSIZE, 0)
    signal.alarm(int(wall_s) + 2)  # should whoever asked be gone
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    _lower(resource.RLIMIT_AS, pages * resource.getpagesize() + memory_room(size))


@contextlib.contextmanager
def no_more_files() -> Iterator[None]:
    """Let nothing be opened inside: a file that is read cannot have others read in its place."""
    for coding in _CODINGS:  # looked up now: Python reads their modules when they are first used
        "".encode(coding)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def _lower(what: int, wanted: int) -> None:
    soft, hard = _found(what)
    most = min((n for n in (soft, hard, wanted) if n != resource.RLIM_INFINITY), default=wanted)
    resource.setrlimit(what, (most, hard))


@cache
def _found(what: int) -> tuple[int, int]:
    """Return a limit as it was when the process began."""
    return resource.getrlimit(what)


def _told(path: Path, error: Exception, known: list[str]) -> tuple[str, str]:
    """Return the name and text of an error for a person."""
    for kind in type(error).__mro__:
        if kind.__name__ in known:
            cause = error.__cause__
            if isinstance(cause, MemoryError) or _NO_ROOM in str(cause):
                break
            return kind.__name__, str(error)
    else:
        if not isinstance(error, MemoryError) and _NO_ROOM not in str(error):
            what = f"{type(error).__name__}: {error}"
            return known[0], f"{path}: is damaged: it cannot be read ({what:.200})"
    return known[0], f"{path}: is damaged: it needs more memory than a file of its size may"


def _send(stream: BinaryIO, text: bytes, arrays: list[Any]) -> None:
    try:
        stream.write(len(text).to_bytes(8, "little"))
        stream.write(text)
        for array in arrays:
            stream.write(array.reshape(-1).view("u1").data)
        stream.flush()
    except BrokenPipeError:
        os._exit(0)
