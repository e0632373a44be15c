"""The commands about many sessions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesotap.cli_options import Changes, ConfigPath, JsonPath, console

commands = typer.Typer()

Where = Annotated[
    str,
    typer.Option(
        "--where",
        metavar="QUESTION",
        help="Which sessions, such as 'specimen:steel load:300..500 -verdict:consistent' (docs/catalogue.md).",
        show_default=False,
    ),
]
Index = Annotated[
    Path | None,
    typer.Option(
        "--index",
        metavar="FILE",
        help="Index to use; catalogue.sqlite in ~/.cache/mesotap by default.",
        show_default=False,
    ),
]


def _asks(option: str, what: str) -> object:
    return typer.Option(option, help=what, show_default=False)


@commands.command()
def catalog(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Folders of sessions, at any depth; without any, what was indexed earlier.", show_default=False
        ),
    ] = None,
    specimen: Annotated[str | None, _asks("--specimen", "Words of the specimen; the last may be cut short.")] = None,
    material: Annotated[str | None, _asks("--material", "Words of specimen or title.")] = None,
    operator: Annotated[str | None, _asks("--operator", "Words of the operator.")] = None,
    since: Annotated[str | None, _asks("--since", "Date, such as 2026-03-01, from which on (UTC).")] = None,
    until: Annotated[str | None, _asks("--until", "Date up to which, that day included (UTC).")] = None,
    load: Annotated[str | None, _asks("--load", "Load in mN: 300..500, 300.. or ..500, or a number.")] = None,
    kc: Annotated[str | None, _asks("--kc", "Contact stiffness in MN/m, at such a load.")] = None,
    zeta: Annotated[str | None, _asks("--zeta", "Damping ratio of the contact mode in %, at such a load.")] = None,
    verdict: Annotated[
        str | None, _asks("--verdict", "consistent, missing_physics, new_physics or unexplained.")
    ] = None,
    mechanism: Annotated[str | None, _asks("--mechanism", "Mechanism that the diagnosis names.")] = None,
    text: Annotated[str | None, _asks("--text", "Words anywhere: names, title, what the diagnosis says.")] = None,
    where: Where = "",
    index: Index = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", help="Also write a row for each load.", show_default=False)
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option("--parquet", help="The same as Parquet (needs pyarrow).", show_default=False)
    ] = None,
    json: JsonPath = None,
) -> None:
    """Index the sessions of folders, and list those that are asked for; damaged and moved ones with the reason."""
    from mesotap.commands.catalog import Asked
    from mesotap.commands.catalog import catalog as look

    options = {
        **{"specimen": specimen, "material": material, "operator": operator, "since": since, "until": until},
        **{"load": load, "kc": kc, "zeta": zeta, "verdict": verdict, "mechanism": mechanism, "text": text},
    }
    look(Asked(folders or (), where, options, index), json, csv, parquet, console(json))


@commands.command()
def compare(
    sessions: Annotated[list[Path], typer.Argument(help="Session files or folders.", show_default=False)],
    by: Annotated[
        str,
        typer.Option(
            "--by",
            metavar="session|specimen|title|operator",
            help="Put sessions in groups by this; a mixed model tells groups from the scatter within.",
        ),
    ] = "session",
    figure: Annotated[
        Path | None,
        typer.Option(
            "--figure", metavar="FILE", help="Also draw k_c and zeta: .svg, .pdf or .png.", show_default=False
        ),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Compare k_c and zeta of sessions at each load; what they have in common, such as the masses, is counted once."""
    from mesotap.commands.compare import Wanted
    from mesotap.commands.compare import compare as hold_together

    hold_together(Wanted(sessions, by, figure), json, console(json))


@commands.command()
def trend(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(help="Folders of sessions; without any, what was indexed earlier.", show_default=False),
    ] = None,
    specimen: Annotated[
        str | None, _asks("--specimen", "Words of the check specimen, whose k_c is charted too.")
    ] = None,
    since: Annotated[str | None, _asks("--since", "Date from which on, such as that of the last repair.")] = None,
    until: Annotated[str | None, _asks("--until", "Date up to which.")] = None,
    at: Annotated[
        float | None, typer.Option("--at", help="Load in mN at which k_c is read off; 500.", show_default=False)
    ] = None,
    where: Where = "",
    index: Index = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE", help="Also draw the charts: .svg, .pdf or .png.", show_default=False),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Say whether gauge, springs, f1, noise or k_c of a check specimen changed over the sessions, and since when."""
    from mesotap.commands.catalog import Asked
    from mesotap.commands.trend import trend as watch

    options = {"specimen": specimen, "since": since, "until": until}
    watch(Asked(folders or (), where, options, index), at, figure, json, console(json))


@commands.command()
def reanalyze(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(help="Folders of sessions; without any, what was indexed earlier.", show_default=False),
    ] = None,
    where: Where = "",
    index: Index = None,
    config: ConfigPath = None,
    changes: Changes = None,
    json: JsonPath = None,
) -> None:
    """Analyse all sessions that are asked for with this version; older answers stay, and what changed is told."""
    from mesotap.commands.catalog import Asked
    from mesotap.commands.reanalyze import reanalyze as again

    again(Asked(folders or (), where, {}, index), config, changes or (), json, console(json))


@commands.command()
def crate(
    sessions: Annotated[
        list[Path] | None,
        typer.Argument(help="Session files or folders; without any, those that --where asks for.", show_default=False),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write; a new one.")
    ] = Path("crate"),
    within: Annotated[
        list[Path] | None,
        typer.Option("--in", metavar="FOLDER", help="With --where: folders to look in first.", show_default=False),
    ] = None,
    where: Where = "",
    index: Index = None,
    licence: Annotated[
        str, typer.Option("--license", help="Address or sentence that says how others may use it.", show_default=False)
    ] = "",
    json: JsonPath = None,
) -> None:
    """Write sessions as an RO-Crate: files with hashes, configuration, versions and answers, for others to check."""
    from mesotap.commands.catalog import Asked
    from mesotap.commands.crate import crate as pack

    if bool(sessions) == bool(where or within):
        raise typer.BadParameter("name sessions, or ask for some with --where and --in")
    pack(sessions or (), Asked(within or (), where, {}, index), output, licence, json, console(json))
