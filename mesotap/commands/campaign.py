"""`mesotap sweep` and `mesotap campaign`: many simulated sessions, and where a campaign stands."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from daq.durable import write_whole
from mesotap.campaigns.campaign import Campaign
from mesotap.campaigns.design import Planned, planned, read_design
from mesotap.campaigns.engine import Engine
from mesotap.campaigns.errors import CampaignError
from mesotap.campaigns.one_task import Limits
from mesotap.campaigns.table import sweep_csv, verdict_of
from mesotap.commands.outputs import make_ready, write_json
from mesotap.commands.progress import progress
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

TABLE, PLANNED = "sweep.csv", "sweep.json"
LONGEST_SHOWN = 200  # characters of a failure in the table


def sweep(path: Path, output: Path, engine: Engine, limits: Limits, json_path: Path | None, console: Console) -> None:
    """Simulate the sessions of a design and write their answers.

    Raises
    ------
    CampaignError
        Some came to no result; all else is written.
    """
    design = read_design(path)
    sessions = dict(planned(design, path))
    make_ready(json_path, None)
    title = f"mesotap sweep {design.title}"
    files = {digest: p.config for p in sessions.values() for digest in p.task.inputs.values()}
    campaign = Campaign.plan(output, title, {name: p.task for name, p in sessions.items()}, files)
    about = {name: {"varied": dict(p.factors), "seed": p.seed} for name, p in sessions.items()}
    write_whole(output / PLANNED, (json.dumps(about, indent=1) + "\n").encode())
    with progress(console, "simulating") as shown:
        campaign.carry_out(engine, limits, shown)
    _show_sweep(campaign, sessions, console)
    _write_table(campaign, console)
    write_json(json_path, {**standing(campaign), "table": str(output / TABLE)})
    _refuse_incomplete(campaign)


def campaign(
    folder: Path,
    go_on: bool,
    retry: bool,
    engine: Engine,
    limits: Limits,
    json_path: Path | None,
    console: Console,
) -> None:
    """Show where a campaign stands, going on with it first if asked to.

    Raises
    ------
    CampaignError
        It was gone on with, and some tasks came to no result.
    """
    opened = Campaign.open(folder)
    make_ready(json_path, None)
    if retry:
        opened.retry()
    if go_on or retry:
        with progress(console, opened.title) as shown:
            opened.carry_out(engine, limits, shown)
        _write_table(opened, console)
    found = standing(opened)
    console.print(escape(opened.title), highlight=False, soft_wrap=True)
    _show_counts(Counter({k: found[k] for k in ("done", "owed", "set_aside")}), console)
    _show_failures(opened, console)
    write_json(json_path, found)
    if go_on or retry:
        _refuse_incomplete(opened)


def is_left(folder: Path, go_on: bool, retry: bool) -> bool:
    """Return whether going on with a campaign, as asked for, would carry out anything."""
    found = standing(Campaign.open(folder))
    return bool((found["owed"] and (go_on or retry)) or (found["set_aside"] and retry))


def _write_table(campaign: Campaign, console: Console) -> None:
    """Write the answers of a sweep that are there; other campaigns have no table."""
    file = campaign.folder / PLANNED
    if not file.exists():
        return
    try:
        about = json.loads(file.read_text(encoding="utf-8"))
        listed = [(name, about[name], campaign.result(name)) for name in campaign.digests]
        content = sweep_csv(listed)
    except (ValueError, KeyError, TypeError) as error:
        raise CampaignError(f"{file}: is damaged; 'mesotap sweep' with the same design writes it anew") from error
    write_whole(campaign.folder / TABLE, content)
    console.print(f"table        {escape(campaign.folder / TABLE)}", highlight=False, soft_wrap=True)


def standing(campaign: Campaign) -> dict[str, Any]:
    """Return where a campaign stands, for programs."""
    states = {name: campaign.state(name) for name in campaign.digests}
    counted = Counter(states.values())
    return {
        "format": "mesotap-campaign-state",
        "version": 1,
        "title": campaign.title,
        "folder": str(campaign.folder),
        "done": counted["done"],
        "owed": counted["owed"],
        "set_aside": counted["set aside"],
        "failures": {name: failures for name in states if (failures := campaign.failures(name))},
    }


def _refuse_incomplete(campaign: Campaign) -> None:
    missing = sum(campaign.state(name) != "done" for name in campaign.digests)
    if missing:
        raise CampaignError(
            f"{campaign.folder}: {missing} of {len(campaign.digests)} tasks came to no result; 'mesotap campaign "
            f"{campaign.folder}' says why, with --retry they are tried again"
        )


def _show_sweep(campaign: Campaign, sessions: Mapping[str, Planned], console: Console) -> None:
    """Print how many sessions of each combination are done, and what their diagnoses say."""
    factors = list(next(iter(sessions.values())).factors) if sessions else []
    table = Table(*factors, "sessions", "done", "diagnoses", box=None, header_style="bold")
    rows: dict[tuple[str, ...], list[str]] = {}
    for name, session in sessions.items():
        rows.setdefault(tuple(str(v) for v in session.factors.values()), []).append(name)
    for shown, names in rows.items():
        results = [result for name in names if (result := campaign.result(name))]
        verdicts: Counter[str] = Counter()
        for result in results:
            verdict, named = verdict_of(result["answers"])
            verdicts[" + ".join(named) or verdict] += 1
        said = ", ".join(f"{n} {what}" for what, n in verdicts.most_common() if what)
        table.add_row(*map(escape, shown), str(len(names)), str(len(results)), escape(said) or "-")
    console.print(table)
    _show_failures(campaign, console)


def _show_counts(counted: Counter[str], console: Console) -> None:
    said = f"{counted['done']} done, {counted['owed']} owed, {counted['set_aside']} set aside"
    console.print(said, highlight=False)
    if counted["owed"]:
        console.print("next: 'mesotap campaign FOLDER --resume' goes on", highlight=False)


def _show_failures(campaign: Campaign, console: Console) -> None:
    for name in campaign.digests:
        if campaign.state(name) == "set aside":
            last = campaign.failures(name)[-1].splitlines()[-1][:LONGEST_SHOWN]
            console.print(escape(f"set aside    {name}, after three failures; the last: {last}"), soft_wrap=True)
