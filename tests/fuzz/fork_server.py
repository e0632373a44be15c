"""A small process that reads files in forks of itself: a fork of the tests, which hold much, takes far longer."""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import os
import select
import socket
import sys

from daq.limited_child import answer

LENGTH = 8
"""Bytes in which the length of a request stands before it."""


def received(connection: socket.socket, count: int) -> bytes:
    """Return so many bytes, fewer where the other end closes first."""
    found = b""
    while len(found) < count and (more := connection.recv(count - len(found))):
        found += more
    return found


def serve(place: str) -> None:
    """Answer requests at a socket one after the other, until standard input ends."""
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(place)
        listening.listen(64)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while True:
            ready, _, _ = select.select([sys.stdin, listening], [], [])
            if sys.stdin in ready:
                return
            with listening.accept()[0] as connection:
                _answered(connection)


def _answered(connection: socket.socket) -> None:
    """Read what one connection asks for, into the pipe that comes with it, and say how the fork ended."""
    length, (pipe,), _, _ = socket.recv_fds(connection, LENGTH, 1)
    asked = json.loads(received(connection, int.from_bytes(length, "little")))
    with contextlib.suppress(Exception):  # the fork says what is wrong
        importlib.import_module(asked["request"]["module"])
    child = os.fork()
    if child == 0:
        try:
            faulthandler.disable()
            connection.close()
            os.chdir(asked["cwd"])
            os.environ.update(asked["environment"])
            sys.path[:] = asked["path"]
            answer(asked["request"], os.fdopen(pipe, "wb"))
        finally:
            os._exit(1)
    os.close(pipe)
    status = os.waitpid(child, 0)[1]
    with contextlib.suppress(OSError):
        connection.sendall(status.to_bytes(LENGTH, "little"))
