"""Options that several commands have, and where they talk to a person."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

ConfigPath = Annotated[
    Path | None,
    typer.Option("--config", "-c", help="Configuration; config.yaml of this folder by default.", show_default=False),
]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override one key, such as mesotap.dwell_s=0.", show_default=False),
]
JsonPath = Annotated[
    Path | None,
    typer.Option("--json", metavar="OUT.json", help="Also write the answer for programs.", show_default=False),
]

PIPED_WIDTH = 160  # of tables where neither a terminal nor COLUMNS says how wide it is


def console(json: Path | None, *made: Path | None) -> Console:
    """Where a command talks to a person: not where its answer for programs goes.

    Parameters
    ----------
    json
        Where that goes.
    made
        Folders that the command is going to make.

    Raises
    ------
    UnwrittenError
        ``json`` is in a folder that is not there and that the command does not make: told now, not at its end.
    """
    from mesotap.operator.terminal import SafeConsole

    if json is not None and str(json) != "-" and not any(json.parent in (m, *m.parents) for m in made if m):
        from mesotap.commands.outputs import make_ready

        make_ready(json, None)

    found = SafeConsole(stderr=str(json) == "-")
    if not found.is_terminal and not os.environ.get("COLUMNS", "").isdigit():  # rich heeds that
        found.width = PIPED_WIDTH
    return found
