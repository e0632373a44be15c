"""`mesotap udev`: rules that give the devices to the person at the machine."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from daq.durable import write_whole
from daq.errors import UnwrittenError
from mesotap.commands.outputs import make_ready, refuse_to_overwrite, write_json
from mesotap.operator.terminal import escape, say
from rig.drivers.usb_access import BEFORE, FILE, FOLDER, INSTALL, is_early, rules
from rig.errors import MesotapError


class RulesName(MesotapError, ValueError):
    """A file of this name would not do what it is for."""


def udev(output: Path | None, json_path: Path | None, console: Console) -> None:
    """Print the rules, or write them to a new file; a folder gets one of the usual name."""
    if output is None:
        if str(json_path) != "-":
            say(rules().rstrip("\n"))
        write_json(json_path, {"file": None, "rules": rules(), "install": list(INSTALL)})
        return
    file = output / FILE if output.is_dir() else output
    if not is_early(file.name):
        raise RulesName(
            f"{file}: udev would not act on a file of this name: it has to end in .rules and sort before {BEFORE}, as "
            f"{FILE} does"
        )
    refuse_to_overwrite(file)
    make_ready(file, None)
    try:
        write_whole(file, rules().encode())
    except OSError as error:
        raise UnwrittenError(file, error.strerror or str(error)) from error
    console.print(f"{escape(file)}: written; to install and to load it:", highlight=False, soft_wrap=True)
    commands = INSTALL[1:] if str(file.resolve().parent) == FOLDER else (_install(file), *INSTALL[1:])
    write_json(json_path, {"file": str(file), "rules": rules(), "install": list(commands)})
    for command in commands:
        console.print(f"    {escape(command)}", highlight=False, soft_wrap=True)


def _install(file: Path) -> str:
    return INSTALL[0].replace(FILE, str(file))
