"""What is not a file, or has a name that is not a name, given to every command that reads one."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from daq.session_file import write_session
from tests.fuzz.sessions import small_session
from tests.hostile.case import Case, Make
from tests.hostile.recordings import table

COMMANDS: dict[str, tuple[str, ...]] = {
    "info": ("info", "@"),
    "analyze": ("analyze", "@"),
    "report": ("report", "@"),
    "import": ("import", "@", "y.h5"),
    "surface": ("surface", "@"),
    "diagnose": ("diagnose", "@"),
    "diagnose --rig": ("diagnose", "--rig", "@", "x.h5"),
    "config check": ("config", "check", "@"),
    "config show": ("config", "show", "--config", "@"),
    "adopt": ("adopt", "@"),
    "analyze --model": ("analyze", "x.h5", "--model", "@"),
    "analyze --config": ("analyze", "x.h5", "--config", "@"),
    "run --config": ("run", "--simulate", "--config", "@"),
}


def link_loop(place: Path) -> None:
    place.symlink_to("there")
    place.with_name("there").symlink_to(place.name)


def listening(place: Path) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(place)[-100:] if len(str(place)) > 100 else str(place))


KINDS: dict[str, tuple[Callable[[Path], Any], tuple[str, ...]]] = {
    "a pipe": (lambda p: os.mkfifo(p), tuple(COMMANDS)),
    "/dev/zero": (lambda p: p.symlink_to("/dev/zero"), tuple(COMMANDS)),
    "a link to nowhere": (lambda p: p.symlink_to("nowhere"), tuple(COMMANDS)),
    "a folder": (lambda p: p.mkdir(), tuple(COMMANDS)),
    "a terminal": (lambda p: p.symlink_to("/dev/tty"), ("info", "config check")),
    "the memory of the process": (
        lambda p: p.symlink_to("/proc/self/mem"),
        ("info", "config check", "adopt", "surface"),
    ),
    "the log of the kernel": (lambda p: p.symlink_to("/proc/kmsg"), ("info", "config check")),
    "a link to itself": (link_loop, ("info", "config check", "adopt")),
}
SUFFIXES = {"info": ".h5", "report": ".h5", "analyze": ".h5", "diagnose": ".h5", "import": ".csv", "surface": ".csv"}


def given(command: str, put: Callable[[Path], Any]) -> Make:
    def make(folder: Path) -> Sequence[str]:
        write_session(folder / "x.h5", small_session())
        name = "input" + SUFFIXES.get(command, ".yaml")
        put(folder / name)
        return [name if word == "@" else word for word in COMMANDS[command]]

    return make


NAMES = {
    "of 255 bytes": "n" * 252 + ".h5",
    "that acts on terminals": "\x1b]0;x\x07\x1b[31m.h5",
    "with a line end": "a\nmesotap: all is well.h5",
    "that turns the writing": "\u202e5h.x",
    "that is not UTF-8": os.fsdecode(b"\xff\xfe.h5"),
    "that is markup": "[red]x[bold].h5",
    "that is an option": "--help.h5",
    "that is mathematics": "$\\frac{.h5",
}


def called(name: str, there: bool, *command: str) -> Make:
    def make(folder: Path) -> Sequence[str]:
        if there and name.endswith(".h5"):
            write_session(folder / "plain", small_session())
            (folder / "plain").rename(folder / name)
        elif there:
            (folder / name).write_bytes(table("t,a,b"))
        return [*command, "--", f"./{name}"]

    return make


def over(output: str, *command: str) -> Make:
    """Have something written over what is there."""

    def make(folder: Path) -> Sequence[str]:
        write_session(folder / "x.h5", small_session())
        (folder / "x.csv").write_bytes(table("t,a,b"))
        (folder / "file").write_text("x", encoding="utf-8")
        return [*command, output]

    return make


def cases() -> Iterator[Case]:
    for kind, (put, commands) in KINDS.items():
        for command in commands:
            quick = (kind, command) in (("a pipe", "info"), ("a pipe", "config check"), ("/dev/zero", "adopt"))
            yield Case("no files", f"{kind} to {command}", given(command, put), says="input", quick=quick)
    for what, name in NAMES.items():
        shows = "kind:" if name.endswith(".h5") else "channels"
        yield Case("names", f"a file with a name {what}", called(name, True, "info"), shows=shows)
        yield Case("names", f"no file with a name {what}", called(name, False, "info"), says="there is no such file")
    yield Case("names", "a name of 3000 bytes", called("n" * 3000, False, "info"), says="too long")
    yield Case("outputs", "JSON over a session", over("x.h5", "info", "x.h5", "--json"), says="exists already")
    yield Case("outputs", "a recording over itself", over("x.csv", "import", "x.csv"), says="exists already")
    yield Case("outputs", "a report into a file", over("file", "published", "--report"), says="file")
    yield Case("outputs", "JSON into a folder that is none", over("file/x.json", "info", "x.h5", "--json"), says="file")
    yield Case("outputs", "a configuration over another", over("file", "config", "init"), says="exists already")
    for what, words in {
        "no command": ("\x1b[31mx",),
        "no option": ("info", "--\x1b[31mx"),
        "no number": ("analyze", "x.h5", "--rate", "\x1b]0;x\x07"),
        "too many words": ("info", "a", "b\nmesotap: all is well"),
        "no mechanism": ("diagnose", "x.h5", "--without", "\x1b[31m"),
        "no method": ("analyze", "x.h5", "--method", "\u202e"),
    }.items():
        yield Case("names", f"words that are {what}", lambda folder, words=words: words, quick=what == "no command")
