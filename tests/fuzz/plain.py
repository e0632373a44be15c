"""Many inputs, drawn plainly at random: ``python -m tests.fuzz.plain exchange.damaged_tables --inputs 100000``.

The inputs and what has to hold for each are those that hypothesis draws and checks in the tests; hypothesis needs
milliseconds for an input, this driver microseconds. Each input is drawn from a seed of its own, so that its number is
all it takes to try it again. Chunks of inputs run in forked processes: a library may crash or never return.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib
import mmap
import os
import signal
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from tests.fuzz.source import Plain, Target

MODULES = ("session_files", "exchange", "configs", "rig_files", "wires", "usb")
CHUNK = 2000
LONGEST_S = 60.0
"""Time after which an input counts as one that never returns."""

LONGEST_SHOWN = 3000
_MEMORY = Path("/dev/shm")  # files that last for microseconds belong in memory, where there is such a place


@dataclass(frozen=True)
class Failure:
    """The first input that broke the rule, and how."""

    number: int
    what: str


def run(
    name: str,
    target: Target,
    inputs: int,
    seed: int = 1,
    first: int = 0,
    longest_s: float = LONGEST_S,
    progress: Callable[[int], None] = lambda done: None,
) -> Failure | None:
    """Try inputs ``first``, ``first + 1`` and so on of a target; stop at the first that fails."""
    for begin in range(first, first + inputs, CHUNK):
        failure = _chunk(name, target, seed, range(begin, min(begin + CHUNK, first + inputs)), longest_s)
        if failure:
            return failure
        progress(min(begin + CHUNK - first, inputs))
    return None


def _chunk(name: str, target: Target, seed: int, numbers: range, longest_s: float) -> Failure | None:
    parent = os.getpid()
    with mmap.mmap(-1, 8) as counter, tempfile.TemporaryFile("w+", encoding="utf-8") as told:
        child = os.fork()
        if child == 0:
            status = 1
            try:
                faulthandler.enable(told, all_threads=False)
                faulthandler.register(signal.SIGUSR1, told, all_threads=False)
                status = _try_all(name, target, seed, numbers, counter, told, parent)
            finally:
                told.flush()
                os._exit(status)
        status = _ended(child, counter, longest_s)
        number = numbers.start + struct.unpack("<q", counter[:])[0]
        if status == 0:
            return None
        told.seek(0)
        text = f"{_drawn(name, target, seed, number)!r:.{LONGEST_SHOWN}}\n{told.read()}"
    if status is None:
        text += f"did not return within {longest_s:g} s"
    elif os.WIFSIGNALED(status):
        text += f"the process died of {signal.Signals(os.WTERMSIG(status)).name}"
    return Failure(number, text)


def _try_all(
    name: str, target: Target, seed: int, numbers: range, counter: mmap.mmap, told: TextIO, parent: int
) -> int:
    unraisable: list[BaseException] = []  # what comes out of a __del__
    sys.unraisablehook = lambda error: unraisable.append(error.exc_value or error.exc_type())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # as in the tests
        for done, number in enumerate(numbers):
            counter[:] = struct.pack("<q", done)
            if os.getppid() != parent:  # nobody is there any more to hear of it
                return 1
            try:
                target.check(_drawn(name, target, seed, number))
                if unraisable:
                    raise unraisable[0]
            except BaseException:
                told.write(traceback.format_exc())
                return 1
    return 0


def _drawn(name: str, target: Target, seed: int, number: int) -> Any:
    return target.draw(Plain(f"{name}/{seed}/{number}"))


def _ended(child: int, counter: mmap.mmap, longest_s: float) -> int | None:
    """Wait for a process to end: its status, or None where it stood still for too long and was killed."""
    seen, since, pause_s = b"", time.monotonic(), 0.001
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        if counter[:] != seen:
            seen, since = counter[:], time.monotonic()
        elif time.monotonic() - since > longest_s:
            os.kill(child, signal.SIGUSR1)  # it writes down where it is
            time.sleep(0.2)
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, 0.1)


def named(what: str) -> Iterator[tuple[str, Callable[[Path], Target]]]:
    """The targets of a name: ``module.target``, a ``module``, or ``all``."""
    for module in MODULES if what == "all" else {what.partition(".")[0]}.intersection(MODULES):
        for make in importlib.import_module(f"tests.fuzz.{module}").TARGETS:
            name = f"{module}.{make.__name__}"
            if what in ("all", module, name):
                yield name, make


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 1 where an input failed, 2 where there is no such target."""
    parser = argparse.ArgumentParser("python -m tests.fuzz.plain", description=__doc__.splitlines()[0])
    parser.add_argument("target", help=f"module.target, all, or one of the modules {', '.join(MODULES)}")
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    chosen = parser.parse_args(arguments)
    known = list(named(chosen.target))
    if not known:
        print(f"there is no target {chosen.target}; modules are {', '.join(MODULES)}", file=sys.stderr)
        return 2
    failed = 0
    for name, make in known:
        with tempfile.TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as place:
            failed |= _report(name, make(Path(place)), chosen.inputs, chosen.seed, chosen.first)
    return failed


def _report(name: str, target: Target, inputs: int, seed: int, first: int) -> int:
    begin = time.monotonic()
    on_screen = sys.stderr.isatty()
    tenths = 0

    def progress(done: int) -> None:
        nonlocal tenths
        text = f"{name}: {done:,} of {inputs:,}, {done / max(time.monotonic() - begin, 1e-3):,.0f} a second"
        if on_screen:
            print(f"\r{text} ", end="\n" if done == inputs else "", file=sys.stderr, flush=True)
        elif 10 * done // inputs > tenths:
            tenths = 10 * done // inputs
            print(text, file=sys.stderr, flush=True)

    failure = run(name, target, inputs, seed, first, progress=progress)
    if failure is None:
        print(f"{name}: {inputs:,} inputs of seed {seed} in {time.monotonic() - begin:.0f} s, no failure", flush=True)
        return 0
    print(f"\n{name}: input {failure.number} of seed {seed} failed:\n{failure.what}")
    print(f"again: python -m tests.fuzz.plain {name} --seed {seed} --first {failure.number} --inputs 1", flush=True)
    return 1


if __name__ == "__main__":
    sys.exit(main())
