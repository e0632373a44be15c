"""`mesotap drivers`, `mesotap formats`, and the checks of these and of `mesotap mechanisms`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from mesotap.commands.outputs import write_json
from mesotap.operator.terminal import escape
from rig.plugins import Check, Offered, PluginError


def list_drivers(json_path: Path | None, console: Console) -> None:
    """Print the drivers that rig.parts can name: the program's own, and those of installed packages."""
    from rig.drivers.plugins import load, offered_drivers
    from rig.parts import IMPACTORS, LOAD_CELLS, RECORDERS, STAGES

    parts = {"load_cell": LOAD_CELLS, "stage": STAGES, "accelerometers": RECORDERS, "impactor": IMPACTORS}
    for part, choices in parts.items():
        _say(console, f"rig.parts.{part}: {choices}")

    def described(entry: Offered) -> tuple[str, dict[str, Any]]:
        plugin = load(entry)
        keys = ", ".join(f"{name}: ..." for name in plugin.settings.model_fields if name != "driver")
        said = f"rig.parts.{plugin.part}: {{driver: {plugin.name}, {keys}}}, {plugin.summary or 'a driver'}"
        return said, {"part": plugin.part, "summary": plugin.summary}

    found = _listed(offered_drivers(), described, console)
    write_json(json_path, {"built_in": parts, "drivers": found})


def list_formats(json_path: Path | None, console: Console) -> None:
    """Print the formats of recordings that can be read."""
    from daq.exchange.formats import BUILT_IN, load, offered_formats

    for ending, what in BUILT_IN.items():
        _say(console, f".{ending}: {what}")

    def described(entry: Offered) -> tuple[str, dict[str, Any]]:
        plugin = load(entry)
        return f".{plugin.ending}: {plugin.summary or 'a format'}", {"summary": plugin.summary}

    found = _listed(offered_formats(), described, console)
    write_json(json_path, {"built_in": BUILT_IN, "formats": found})


def _listed(
    entries: Sequence[Offered], described: Callable[[Offered], tuple[str, dict[str, Any]]], console: Console
) -> list[dict[str, Any]]:
    """Print a line for each plug-in; one that cannot be used says why, and the others are listed all the same."""
    found = []
    for entry in entries:
        item: dict[str, Any] = {"name": entry.name, "package": entry.package, "usable": True}
        try:
            said, more = described(entry)
            _say(console, f"{said}, of {entry.package}")
            found.append({**item, **more})
        except PluginError as error:
            _say(console, f"cannot be used: {error}")
            found.append({**item, "usable": False, "says": str(error)})
    return found


def check_driver(name: str, json_path: Path | None, console: Console) -> bool:
    """Print what is checked of a driver, a line each; return whether all of it holds."""
    from rig.drivers.conformance import conformance

    return _shown(conformance(name), json_path, console)


def check_format(name: str, json_path: Path | None, console: Console) -> bool:
    """Print what is checked of a file format, a line each; return whether all of it holds."""
    from daq.exchange.conformance import conformance

    return _shown(conformance(name), json_path, console)


def check_mechanism(name: str, json_path: Path | None, console: Console) -> bool:
    """Print what is checked of a mechanism, a line each; return whether all of it holds."""
    from sim_backend.mechanisms.conformance import conformance

    return _shown(conformance(Path(name)), json_path, console)


def _shown(checks: Sequence[Check], json_path: Path | None, console: Console) -> bool:
    for check in checks:
        said = f": {check.said}" if check.said else ""
        _say(console, f"{'holds' if check.holds else 'FAILS'}  {check.name}{said}")
    write_json(json_path, {"checks": [{"name": c.name, "holds": c.holds, "said": c.said} for c in checks]})
    return all(check.holds for check in checks)


def _say(console: Console, text: str) -> None:
    console.print(escape(text), highlight=False, soft_wrap=True)
