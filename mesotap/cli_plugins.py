"""The commands about what mesotap can drive, read and name: drivers, their access, file formats, mechanisms."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesotap.cli_options import ConfigPath, JsonPath, console

commands = typer.Typer()


@commands.command()
def mechanisms(
    config: ConfigPath = None,
    check: Annotated[
        str | None,
        typer.Option(
            "--check", metavar="NAME|FILE.py", help="Check a mechanism of your own instead.", show_default=False
        ),
    ] = None,
    json: JsonPath = None,
) -> None:
    """List the mechanisms that a diagnosis can name."""
    if check is None:
        from mesotap.commands.diagnose import list_mechanisms

        list_mechanisms(config, json, console(json))
        return
    from mesotap.commands.plugins import check_mechanism

    if not check_mechanism(check, json, console(json)):
        raise typer.Exit(2)


@commands.command()
def drivers(
    check: Annotated[
        str | None,
        typer.Option("--check", metavar="NAME|FILE.py", help="Check a driver of your own instead.", show_default=False),
    ] = None,
    json: JsonPath = None,
) -> None:
    """List the drivers that rig.parts of a configuration can name, those of installed packages among them."""
    from mesotap.commands.plugins import check_driver, list_drivers

    if check is None:
        list_drivers(json, console(json))
    elif not check_driver(check, json, console(json)):
        raise typer.Exit(2)


@commands.command()
def formats(
    check: Annotated[
        str | None,
        typer.Option(
            "--check", metavar="ENDING|FILE.py", help="Check a file format of your own instead.", show_default=False
        ),
    ] = None,
    json: JsonPath = None,
) -> None:
    """List the files that can be read, those of installed packages among them."""
    from mesotap.commands.plugins import check_format, list_formats

    if check is None:
        list_formats(json, console(json))
    elif not check_format(check, json, console(json)):
        raise typer.Exit(2)


@commands.command()
def udev(
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="New file, or its folder, instead of printing.", show_default=False),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Write udev rules that let the person at this machine open the recorder and the serial ports."""
    from mesotap.commands.udev import udev as write

    write(output, json, console(json))
