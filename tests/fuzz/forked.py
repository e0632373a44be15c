"""Files read in forks of a small process, which takes a hundredth of the time of a new one, under the same limits."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

from daq import limited
from tests.fuzz.fork_server import LENGTH, received

_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from tests.fuzz.fork_server import serve; serve(sys.argv[2])"
)


@cache
def _server() -> str:
    """Start the small process once; return its socket. Forks of the tests ask the same one."""
    folder = tempfile.mkdtemp(prefix="mesotap-forks-")
    place = str(Path(folder) / "asked")
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _PROGRAM, json.dumps(sys.path), place],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **limited._ENVIRONMENT},
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    owner = os.getpid()

    def end() -> None:
        if os.getpid() == owner:
            process.communicate()
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(end)
    return place


def asked(request: bytes, most_bytes: int, wall_s: float) -> tuple[dict[str, Any] | None, list[Any], int]:
    """What `daq.limited` does with a new process."""
    here = {"cwd": str(Path.cwd()), "path": sys.path, "environment": {**os.environ, **limited._ENVIRONMENT}}
    message = json.dumps({"request": json.loads(request), **here}).encode()
    reply, arrays = None, []
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(_server())
        read_end, write_end = os.pipe()
        socket.send_fds(connection, [len(message).to_bytes(LENGTH, "little")], [write_end])
        os.close(write_end)
        connection.sendall(message)
        try:
            with contextlib.suppress(limited._Ended):
                reply, arrays = limited._received(read_end, most_bytes, time.monotonic() + wall_s)
        finally:
            os.close(read_end)
            status = int.from_bytes(received(connection, LENGTH), "little")
    return reply, arrays, os.waitstatus_to_exitcode(status)


_ASKED = limited._asked, limited.LimitedReader.asked


@contextlib.contextmanager
def reading_in_forks() -> Iterator[None]:
    """Read in forks inside: each file in one of its own, also where a reader would keep its process."""
    with (
        mock.patch.object(limited, "_asked", asked),
        mock.patch.object(limited.LimitedReader, "asked", staticmethod(asked)),
    ):
        yield


@contextlib.contextmanager
def reading_in_new_processes() -> Iterator[None]:
    """Read inside as the program does."""
    with (
        mock.patch.object(limited, "_asked", _ASKED[0]),
        mock.patch.object(limited.LimitedReader, "asked", _ASKED[1]),
    ):
        yield
