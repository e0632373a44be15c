"""What the site has that no page is written for: the list of commands, and that of decisions."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import typer

COMMANDS, DECISIONS = "<!-- commands -->", "<!-- decisions -->"


def setup(app: Any) -> dict[str, bool]:
    """Be an extension of Sphinx."""
    app.connect("source-read", with_lists)
    return {"parallel_read_safe": True}


def with_lists(app: Any, docname: str, source: list[str]) -> None:
    """Put the lists in the place of their marks."""
    if COMMANDS in source[0]:
        source[0] = source[0].replace(COMMANDS, "\n".join(commands()))
    if DECISIONS in source[0]:
        folder = Path(app.srcdir) / "decisions"
        source[0] = source[0].replace(DECISIONS, "\n".join(decisions(folder)))


def commands() -> list[str]:
    """Return a heading, a sentence and a table of options for each command."""
    from mesotap.cli import app

    lines: list[str] = []
    _add("mesotap", typer.main.get_command(app), lines)
    return lines


def _add(name: str, command: Any, lines: list[str]) -> None:
    inner = getattr(command, "commands", None)
    if inner is None:
        lines += [f"## {name}", "", (command.help or "").strip(), "", f"    {_usage(name, command)}", ""]
        rows = [_row(parameter) for parameter in command.params if parameter.name != "help"]
        if rows:
            lines += ["| | |", "|---|---|", *rows, ""]
        return
    for key in sorted(inner):
        _add(f"{name} {key}", inner[key], lines)


def _usage(name: str, command: Any) -> str:
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    shown = [f"{_name(p)}{' ...' if p.nargs == -1 else ''}" for p in arguments]
    words = [word if p.required else f"[{word}]" for word, p in zip(shown, arguments, strict=True)]
    return " ".join([name, "[OPTIONS]", *words])


def _name(argument: Any) -> str:
    return str(argument.metavar or argument.name).upper()


def _row(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        shown = f"`{_name(parameter)}`"
    else:
        switch = getattr(parameter, "is_flag", False)
        value = "" if switch else f" {parameter.metavar or str(parameter.name).upper()}"
        names = [*parameter.opts, *parameter.secondary_opts]
        shown = ", ".join(f"`{name}{value if name.startswith('--') else ''}`" for name in names)
    default = parameter.default
    told = f" ({default})" if isinstance(default, str | int | float | Path) and not isinstance(default, bool) else ""
    cells = (shown, f"{parameter.help or ''}{told}")
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def decisions(folder: Path) -> list[str]:
    """Return a line for each decision, its title as the link."""
    lines = []
    for file in sorted(folder.glob("[0-9]*.md")):
        title = file.read_text(encoding="utf-8").splitlines()[0]
        number, _, name = re.sub(r"^# *", "", title).partition(". ")
        lines.append(f"- {int(number):03d} [{name}]({file.name})")
    return lines
