"""The commands about campaigns: many sessions at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mesotap.cli_options import JsonPath, console

if TYPE_CHECKING:
    from mesotap.campaigns.one_task import Limits

commands = typer.Typer()

Jobs = Annotated[int, typer.Option("--jobs", min=1, help="Tasks at a time, each a process with one thread.")]
ClusterSite = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS|local:N|slurm:FILE",
        help="Workers of dask instead: of a scheduler's address, N here, or SLURM jobs as a YAML describes them.",
        show_default=False,
    ),
]
TaskTime = Annotated[
    float, typer.Option("--task-time", metavar="S", min=1.0, help="Seconds after which a task has failed.")
]
TaskMemory = Annotated[
    float, typer.Option("--task-memory", metavar="GB", min=0.5, help="Memory with which a task has failed.")
]


def limits_of(time_s: float, memory_gb: float) -> Limits:
    """Return what a task may take."""
    from mesotap.campaigns.one_task import Limits

    return Limits(time_s, int(memory_gb * 1e9))


@commands.command()
def sweep(
    design: Annotated[Path, typer.Argument(metavar="DESIGN.yaml", help="What is varied.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the campaign.")] = Path("sweep"),
    jobs: Jobs = 2,
    cluster: ClusterSite = None,
    task_time: TaskTime = 900.0,
    task_memory: TaskMemory = 6.0,
    json: JsonPath = None,
) -> None:
    """Simulate sessions of every combination of settings, and write their answers as one table.

    An interrupted sweep goes on where it stopped.
    """
    from mesotap.campaigns.cluster import engine_of
    from mesotap.commands.campaign import sweep as begin

    with engine_of(cluster, jobs) as engine:
        begin(design, output, engine, limits_of(task_time, task_memory), json, console(json, output))


@commands.command()
def campaign(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign.", show_default=False)],
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what is owed.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Go on, also with what was set aside.")] = False,
    jobs: Jobs = 2,
    cluster: ClusterSite = None,
    task_time: TaskTime = 900.0,
    task_memory: TaskMemory = 6.0,
    json: JsonPath = None,
) -> None:
    """Show where a campaign stands: what is done, owed, and set aside with the reason."""
    from mesotap.campaigns.cluster import engine_of
    from mesotap.commands.campaign import campaign as show
    from mesotap.commands.campaign import is_left

    with engine_of(cluster, jobs, is_left(folder, resume, retry)) as engine:
        show(folder, resume, retry, engine, limits_of(task_time, task_memory), json, console(json))
