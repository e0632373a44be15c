"""Files read in a fork of the tests, which takes a hundredth of the time of a new process, under the same limits."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import time
from collections.abc import Iterator
from typing import Any
from unittest import mock

from daq import limited
from daq.limited_child import answer


def asked(request: bytes, most_bytes: int, wall_s: float) -> tuple[dict[str, Any] | None, list[Any], int]:
    """What `daq.limited` does with a new process. The tests that call this have one thread."""
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            faulthandler.disable()
            os.close(read_end)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            answer(json.loads(request), os.fdopen(write_end, "wb"))
        finally:
            os._exit(1)
    os.close(write_end)
    reply, arrays = None, []
    try:
        with contextlib.suppress(limited._Ended):
            reply, arrays = limited._received(read_end, most_bytes, time.monotonic() + wall_s)
    finally:
        os.close(read_end)
        status = os.waitpid(child, 0)[1]
    return reply, arrays, os.waitstatus_to_exitcode(status)


@contextlib.contextmanager
def reading_in_forks() -> Iterator[None]:
    """Read in forks inside: each file in one of its own, also where a reader would keep its process."""
    with (
        mock.patch.object(limited, "_asked", asked),
        mock.patch.object(limited.LimitedReader, "asked", staticmethod(asked)),
    ):
        yield
