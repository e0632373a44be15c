"""A campaign on a cluster: whatever ends on the way, it ends, and says what is missing."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mesotap.campaigns import cluster, parcel
from mesotap.campaigns.campaign import Campaign
from mesotap.campaigns.cluster import Cluster, engine_of
from mesotap.campaigns.engine import Processes
from mesotap.campaigns.errors import CampaignError
from mesotap.campaigns.one_task import Limits
from mesotap.campaigns.parcel import Order, carry_out, keep, order
from mesotap.campaigns.sites import Address, Local, site_of
from mesotap.campaigns.slurm import read_jobs
from mesotap.campaigns.task import Task, content_sha256
from mesotap.cli import app
from tests.mesotap.campaigns.emulated_slurm import EmulatedSlurm

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("dask_jobqueue") is None, reason="the extra 'cluster' is not installed"
)
LIMITS = Limits(time_s=60.0)
# what a task runs: a module of that name among its inputs comes before the program's
STAND_IN = b"""
import json, os, sys, time
what, *rest = sys.argv[1:]
if what == "mark":
    open(rest[0], "a").write("begun\\n")
    time.sleep(float(rest[1]))
elif what == "kill":
    os.kill(os.getppid(), 9)
    time.sleep(60)
json.dump({"said": rest}, open("answer.json", "w"))
"""
PROGRAM = {"mesotap.py": content_sha256(STAND_IN)}


def quiet(done: int, total: int) -> None:
    pass


def planned(folder: Path, **commands: tuple[str, ...]) -> Campaign:
    tasks = {name: Task(words, PROGRAM) for name, words in commands.items()}
    return Campaign.plan(folder, "a trial", tasks, {PROGRAM["mesotap.py"]: STAND_IN})


def marking(folder: Path, number: int, seconds: float) -> Campaign:
    """Tasks that note in a file of each how often they were begun."""
    marks = folder / "marks"
    marks.mkdir()
    return planned(folder / "c", **{f"t{i}": ("mark", str(marks / str(i)), str(seconds)) for i in range(number)})


def begun(folder: Path) -> list[int]:
    return [len(path.read_text().split()) for path in (folder / "marks").iterdir()]


@contextlib.contextmanager
def meanwhile(when: Callable[[], bool], then: Callable[[], None]) -> Iterator[None]:
    """Do something to a campaign that goes on."""
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            if when():
                then()
                return
            time.sleep(0.05)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


# --- what a worker is sent, and answers -----------------------------------------------------------------------------


def test_a_worker_that_does_not_see_the_folder_sends_the_result_back(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=("answer", "x"))
    digest = campaign.digests["one"]
    elsewhere = tmp_path / "not here"
    without = dataclasses.replace(order(digest, campaign.folder, LIMITS, False), folder=elsewhere)
    assert carry_out(without).refused == "folder"
    reply = carry_out(dataclasses.replace(order(digest, campaign.folder, LIMITS, True), folder=elsewhere))
    assert campaign.state("one") == "owed"
    keep(campaign.folder, digest, reply)
    result = campaign.result("one")
    assert result is not None
    assert result["answers"] == {"answer.json": {"said": ["x"]}}
    assert not elsewhere.exists()


def test_a_folder_of_that_name_with_another_campaign_is_not_taken_for_it(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=("answer", "x"))
    other = planned(tmp_path / "other", one=("answer", "y"))
    sent = dataclasses.replace(order(campaign.digests["one"], campaign.folder, LIMITS, False), folder=other.folder)
    assert carry_out(sent).refused == "folder"


def test_another_version_of_the_program_begins_nothing(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=("answer", "x"))
    sent = order(campaign.digests["one"], campaign.folder, LIMITS, True)
    assert carry_out(dataclasses.replace(sent, program_sha256="0")).refused == "program"
    assert campaign.state("one") == "owed"


def test_a_command_ends_with_the_process_that_began_it(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=("mark", str(tmp_path / "mark"), "60"))
    text = (
        "from pathlib import Path; from mesotap.campaigns.one_task import *;"
        f"run_task(Path({str(campaign.folder)!r}), {campaign.digests['one']!r}, Limits(90.0))"
    )
    worker = subprocess.Popen([sys.executable, "-c", text], cwd=Path(__file__).parents[3])
    until = time.monotonic() + 60
    while not (tmp_path / "mark").exists() and time.monotonic() < until:
        time.sleep(0.05)
    children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children").read_text().split()
    worker.kill()
    worker.wait()
    assert children
    while any(_runs(int(child)) for child in children) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(_runs(int(child)) for child in children)


def _runs(pid: int) -> bool:
    try:
        return " Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


# --- what is asked for ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "asked", ["", "local:", "local:0", "local:-1", "local:x", "ray://h:1", "host", "tcp://h", ":1"]
)
def test_what_is_no_cluster_is_refused_in_one_sentence(asked: str):
    with pytest.raises(CampaignError, match=r"--cluster .*expected"):
        site_of(asked)


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(CampaignError, match=r"pip install 'mesotap\[cluster\]'"):
        site_of("local:2")


def test_without_a_cluster_processes_of_this_machine_carry_it_out():
    with engine_of(None, 3) as engine:
        assert isinstance(engine, Processes)


def test_where_nothing_is_left_no_cluster_is_sought(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    campaign = marking(tmp_path, 2, 0.0)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    command = ["campaign", str(campaign.folder), "--resume", "--cluster"]
    assert "pip install" in str(CliRunner().invoke(app, [*command, "tcp://10.0.0.1:8786"]).exception)
    campaign.carry_out(Processes(2), LIMITS, quiet)
    assert CliRunner().invoke(app, [*command, "tcp://10.0.0.1:8786"]).exit_code == 0
    assert "expected" in str(CliRunner().invoke(app, [*command, "nowhere"]).exception)


def test_the_command_ends_with_2(tmp_path: Path):
    (tmp_path / "d.yaml").write_text("repeats: 1\n", encoding="utf-8")
    command = ["sweep", str(tmp_path / "d.yaml"), "-o", str(tmp_path / "c"), "--cluster", "nowhere"]
    failed = CliRunner().invoke(app, command)
    assert isinstance(failed.exception, CampaignError)
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "jobs: Field required"),
        ("jobs: 0\nmemory: 1GB", "jobs: Input should be greater"),
        ("jobs: 1\nmemory: much", "memory: "),
        ("jobs: 1\nmemory: 1GB\nwalltime: long", "walltime: "),
        ("jobs: 1\nmemory: 1GB\nqueue: x", "queue: Extra inputs"),
        ("jobs: [", "jobs.yaml"),
    ],
)
def test_jobs_that_are_not_well_described_are_told_by_key(text: str, fault: str, tmp_path: Path):
    (tmp_path / "jobs.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError, match=fault):
        read_jobs(tmp_path / "jobs.yaml")


def test_a_description_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(CampaignError, match="nothing here"):
        read_jobs(tmp_path / "nothing here")


# --- on workers of dask ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@needs_dask
def test_a_task_that_kills_its_worker_is_set_aside_and_the_others_are_done(tmp_path: Path):
    good = {f"t{i}": ("answer", str(i)) for i in range(6)}
    campaign = planned(tmp_path / "c", bad=("kill",), **good)
    with engine_of("local:2", 1) as engine:
        counted = campaign.carry_out(engine, LIMITS, quiet)
    assert counted == Counter({"done": 6, "set aside": 1})
    assert campaign.failures("bad") == ["RuntimeError: the worker that carried it out ended"] * 3


@needs_dask
@pytest.mark.slow
def test_a_scheduler_that_is_killed_comes_back_and_nothing_is_lost(tmp_path: Path):
    campaign = marking(tmp_path, 12, 1.0)
    site = Local(2)

    def kill() -> None:
        site._running[0].kill()

    with (
        contextlib.closing(Cluster(site)) as engine,
        meanwhile(lambda: len(begun(tmp_path)) > 3, kill),
    ):
        assert campaign.carry_out(engine, LIMITS, quiet) == Counter(done=12)
    assert sum(begun(tmp_path)) - 12 <= 2  # what its two workers were at


@needs_dask
@pytest.mark.slow
def test_workers_that_do_not_see_the_folder_answer_with_the_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def unseen(*arguments: object) -> Order:
        return dataclasses.replace(parcel.order(*arguments), folder=tmp_path / "not there")  # type: ignore[arg-type]

    monkeypatch.setattr(cluster, "order", unseen)
    campaign = planned(tmp_path / "c", **{f"t{i}": ("answer", str(i)) for i in range(4)})
    with engine_of("local:2", 1) as engine:
        assert campaign.carry_out(engine, LIMITS, quiet) == Counter(done=4)
    assert not any(campaign.failures(name) for name in campaign.digests)


@needs_dask
@pytest.mark.slow
def test_workers_of_another_version_are_sent_away_and_the_campaign_says_so(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=("answer", "x"))
    site = Local(1)
    site.patience_s = 20.0
    with contextlib.closing(Cluster(site)) as engine:
        engine.program = "another"
        with pytest.raises(CampaignError, match=r"no worker; the worker .* was sent away: it has another version"):
            campaign.carry_out(engine, LIMITS, quiet)
    assert campaign.state("one") == "owed"


@needs_dask
def test_an_address_where_nobody_is_ends_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cluster, "LOOK_S", 0.1)
    campaign = planned(tmp_path / "c", one=("answer", "x"))
    site = Address("tcp://127.0.0.1:9")
    site.patience_s = 0.5
    with (
        contextlib.closing(Cluster(site)) as engine,
        pytest.raises(CampaignError, match=r"no scheduler answers .* start 'dask scheduler' there.*--resume"),
    ):
        campaign.carry_out(engine, LIMITS, quiet)
    assert campaign.state("one") == "owed"


@needs_dask
@pytest.mark.slow
def test_slurm_is_asked_for_jobs_that_are_replaced_when_they_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    slurm = EmulatedSlurm(tmp_path / "slurm")
    monkeypatch.setenv("PATH", slurm.path)
    monkeypatch.setattr("mesotap.campaigns.slurm.LOOK_S", 1.0)
    text = 'jobs: 2\ncores: 1\nmemory: 2GB\nwalltime: "00:10:00"\npartition: compute\naccount: lab\n'
    (tmp_path / "jobs.yaml").write_text(text + 'directives: ["--exclusive"]\nprologue: ["export A=1"]\n')
    campaign = marking(tmp_path, 30, 1.0)

    def kill() -> None:
        for job in slurm.running():
            slurm.kill(job)

    with (
        engine_of(f"slurm:{tmp_path / 'jobs.yaml'}", 1) as engine,
        meanwhile(lambda: len(begun(tmp_path)) > 4, kill),
    ):
        assert campaign.carry_out(engine, LIMITS, quiet) == Counter(done=30)
    assert sum(begun(tmp_path)) - 30 <= 2
    scripts = slurm.submitted()
    assert len(scripts) > 2
    for line in ("-p compute", "-A lab", "--cpus-per-task=1", "--mem=2G", "-t 00:10:00", "--exclusive"):
        assert f"#SBATCH {line}\n" in scripts[0]
    assert "export A=1\n" in scripts[0]
    assert not slurm.running()


@needs_dask
def test_jobs_that_slurm_refuses_end_the_campaign_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    slurm = EmulatedSlurm(tmp_path / "slurm")
    (slurm.commands / "sbatch").write_text("#!/bin/bash\necho 'sbatch: error: invalid partition' >&2; exit 1\n")
    monkeypatch.setenv("PATH", slurm.path)
    (tmp_path / "jobs.yaml").write_text("jobs: 1\nmemory: 1GB\n", encoding="utf-8")
    campaign = planned(tmp_path / "c", one=("answer", "x"))
    with (
        engine_of(f"slurm:{tmp_path / 'jobs.yaml'}", 1) as engine,
        pytest.raises(CampaignError, match="no job could be submitted: sbatch: error: invalid partition"),
    ):
        campaign.carry_out(engine, LIMITS, quiet)


@needs_dask
def test_a_machine_without_slurm_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "jobs.yaml").write_text("jobs: 1\nmemory: 1GB\n", encoding="utf-8")
    with pytest.raises(CampaignError, match="sbatch is not found"):
        site_of(f"slurm:{tmp_path / 'jobs.yaml'}")


def test_the_emulated_slurm_runs_and_cancels_a_job(tmp_path: Path):
    slurm = EmulatedSlurm(tmp_path)
    (tmp_path / "job").write_text("#!/bin/bash\n#SBATCH -n 1\nsleep 60\n", encoding="utf-8")
    said = subprocess.run([str(slurm.commands / "sbatch"), str(tmp_path / "job")], capture_output=True, text=True)
    number = said.stdout.split()[-1]
    assert list(slurm.running()) == [number]
    pid = slurm.running()[number]
    subprocess.run([str(slurm.commands / "scancel"), number], check=True)
    until = time.monotonic() + 120
    while _runs(pid) and time.monotonic() < until:
        time.sleep(0.02)
    assert not slurm.running()
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
