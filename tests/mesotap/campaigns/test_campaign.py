"""A campaign brings every task to one result or sets it aside, whatever runs it, and always ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from mesotap.campaigns import one_task
from mesotap.campaigns.campaign import ATTEMPTS, Campaign, seed_of
from mesotap.campaigns.engine import Engine, Outcomes, Processes, Run
from mesotap.campaigns.errors import CampaignError
from mesotap.campaigns.one_task import Limits, result_file, run_task
from mesotap.campaigns.task import Task, content_sha256, program_sha256
from tests.mesotap.interruptible import interruptible

LIMITS = Limits(time_s=60.0)
STAND_IN = """
import json, os, sys, time
what, *rest = sys.argv[1:]
if what == "answer":
    json.dump({"said": rest, "files": sorted(os.listdir("."))}, open("answer.json", "w"))
elif what == "hang":
    time.sleep(600)
elif what == "fill":
    bytearray(4_000_000_000)
elif what == "break":
    sys.exit("it broke")
elif what == "die":
    os.kill(os.getpid(), 9)
elif what == "slow":
    open(rest[0], "a").write("begun\\n")
    time.sleep(float(rest[1]))
    json.dump({}, open("answer.json", "w"))
"""


def quiet(done: int, total: int) -> None:
    pass


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Something that is quick in the place of `python -m mesotap`."""
    root = tmp_path / "stand-in"
    (root / "mesotap").mkdir(parents=True)
    (root / "mesotap" / "__main__.py").write_text(STAND_IN, encoding="utf-8")
    monkeypatch.setattr(one_task, "PACKAGE_ROOT", root)


def planned(folder: Path, **commands: Sequence[str]) -> Campaign:
    return Campaign.plan(folder, "a trial", {name: Task(tuple(words)) for name, words in commands.items()}, {})


def answers(campaign: Campaign) -> dict[str, object]:
    return {name: result["answers"] for name in campaign.digests if (result := campaign.result(name))}


@pytest.mark.usefixtures("program")
def test_a_task_sees_its_inputs_alone_and_its_result_says_how_it_came_about(tmp_path: Path):
    task = Task(("answer", "x"), {"a.txt": content_sha256(b"1")})
    campaign = Campaign.plan(tmp_path / "c", "a trial", {"one": task}, {content_sha256(b"1"): b"1"})
    assert campaign.carry_out(Processes(1), LIMITS, quiet) == Counter(done=1)
    result = campaign.result("one")
    assert result is not None
    assert result["answers"] == {"answer.json": {"said": ["x"], "files": ["a.txt"]}}
    assert Task.of(result["task"]) == task
    assert result["provenance"]["program_sha256"] == program_sha256()


@pytest.mark.slow
@pytest.mark.usefixtures("program")
def test_what_fails_three_times_is_set_aside_and_the_others_are_done(tmp_path: Path):
    bad = {"breaks": ["break"], "dies": ["die"], "hangs": ["hang"], "fills": ["fill"]}
    good = {f"good-{i}": ["answer", str(i)] for i in range(5)}
    campaign = planned(tmp_path / "c", **bad, **good)
    seen: list[tuple[int, int]] = []
    limits = Limits(time_s=2.0, memory_bytes=2_000_000_000)
    counted = campaign.carry_out(Processes(2), limits, lambda a, b: seen.append((a, b)))
    assert counted == Counter({"done": 5, "set aside": 4})
    assert {name: len(campaign.failures(name)) for name in bad} == dict.fromkeys(bad, ATTEMPTS)
    last = {name: campaign.failures(name)[-1] for name in bad}
    assert last["breaks"] == "exit code 1: it broke"
    assert last["dies"] == "killed by SIGKILL"
    assert last["hangs"] == "not done within 2 s"
    assert "MemoryError" in last["fills"]
    assert seen[-1] == (9, 9)
    assert campaign.carry_out(Processes(2), limits, quiet) == counted  # nothing is tried again ...
    campaign.retry()  # ... unless it is asked for
    assert {campaign.state(name) for name in bad} == {"owed"}


class Forgetful:
    """An engine that loses some tasks, says nothing of others, does some twice, and answers from the end."""

    def __init__(self, lost: Callable[[int], bool]) -> None:
        self._lost = lost
        self._calls = 0

    def run(self, digests: Sequence[str], run: Run) -> Outcomes:
        for digest in reversed(digests):
            self._calls += 1
            if self._lost(self._calls):
                if self._calls % 2:
                    yield digest, RuntimeError("its worker died")
                continue
            run(digest)
            yield digest, run(digest)


@pytest.mark.usefixtures("program")
def test_results_are_the_same_whatever_engine_runs_them_in_any_order_twice(tmp_path: Path):
    commands = {f"t{i}": ["answer", str(i)] for i in range(7)}
    engines: list[Engine] = [Processes(2), Forgetful(lambda n: n % 3 == 0), Forgetful(lambda n: False)]
    campaigns = [planned(tmp_path / str(i), **commands) for i in range(3)]
    for campaign, engine in zip(campaigns, engines, strict=True):
        assert campaign.carry_out(engine, LIMITS, quiet) == Counter(done=7)
    first, *others = map(answers, campaigns)
    assert all(other == first for other in others)


@pytest.mark.usefixtures("program")
def test_it_ends_with_an_engine_that_does_nothing(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=["answer"], two=["answer", "2"])
    assert campaign.carry_out(Forgetful(lambda n: True), LIMITS, quiet) == Counter({"set aside": 2})
    said = {text for name in campaign.digests for text in campaign.failures(name)}
    assert said == {"RuntimeError: its worker died", "RuntimeError: the engine ended without a word about it"}


@pytest.mark.usefixtures("program")
def test_what_is_done_is_not_done_again(tmp_path: Path):
    log = tmp_path / "log"
    campaign = planned(tmp_path / "c", one=["slow", str(log), "0"])
    campaign.carry_out(Processes(1), LIMITS, quiet)
    planned(tmp_path / "c", one=["slow", str(log), "0"]).carry_out(Processes(1), LIMITS, quiet)
    assert log.read_text(encoding="utf-8") == "begun\n"


@pytest.mark.usefixtures("program")
def test_a_task_planned_by_another_version_is_not_passed_off_as_one_of_this(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=["answer"])
    (digest,) = campaign.digests.values()
    wrong = "0" * 64
    (campaign.folder / "tasks" / f"{digest}.json").rename(campaign.folder / "tasks" / f"{wrong}.json")
    outcome = run_task(campaign.folder, wrong, LIMITS)
    assert outcome.failure == "the program here is another version than the one that planned this task"
    assert not result_file(campaign.folder, wrong).exists()


@pytest.mark.usefixtures("program")
def test_a_damaged_or_missing_input_is_told(tmp_path: Path):
    tasks = {name: Task(("answer", name), {"x": content_sha256(name.encode())}) for name in ("a", "b")}
    files: dict[str, Path | bytes] = {content_sha256(name.encode()): name.encode() for name in tasks}
    campaign = Campaign.plan(tmp_path / "c", "a trial", tasks, files)
    (campaign.folder / "inputs" / content_sha256(b"a")).write_bytes(b"else")
    (campaign.folder / "inputs" / content_sha256(b"b")).unlink()
    assert campaign.carry_out(Processes(2), LIMITS, quiet) == Counter({"set aside": 2})
    assert "is damaged" in campaign.failures("a")[0]
    assert "No such file" in campaign.failures("b")[0]


def test_seeds_are_those_of_numpys_children_and_all_different():
    import numpy as np

    children = np.random.SeedSequence(5).spawn(100)
    assert [seed_of(5, i) for i in range(100)] == [int(child.generate_state(1)[0]) for child in children]
    assert len({seed_of(5, i) for i in range(1000)}) == 1000


def test_a_task_is_named_by_all_that_its_result_depends_on():
    task = Task(("a", "b"), {"x": "1"}, ("y",))
    others = [
        replace(task, arguments=("a",)),
        replace(task, arguments=("a b",)),
        replace(task, inputs={"x": "2"}),
        replace(task, inputs={"z": "1"}),
        replace(task, answers=("z",)),
    ]
    digests = {task.digest("p"), task.digest("q"), *(other.digest("p") for other in others)}
    assert len(digests) == 7


def test_another_campaign_or_anything_else_is_left_alone(tmp_path: Path):
    planned(tmp_path / "c", one=["answer"])
    with pytest.raises(CampaignError, match="holds another campaign"):
        Campaign.plan(tmp_path / "c", "another trial", {}, {})
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(CampaignError, match="is not empty"):
        planned(tmp_path / "full", one=["answer"])
    assert [p.name for p in (tmp_path / "full").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("content", [None, "", "[]", "{}", '{"format": "x"}', "\0"])
def test_what_is_no_campaign_gets_a_sentence(tmp_path: Path, content: str | None):
    if content is not None:
        (tmp_path / "campaign.json").write_text(content, encoding="utf-8")
    with pytest.raises(CampaignError, match=r"campaign\.json"):
        Campaign.open(tmp_path)


CARRY_OUT = """
import sys
from pathlib import Path
from mesotap.campaigns import one_task
from mesotap.campaigns.campaign import Campaign
from mesotap.campaigns.engine import Processes
one_task.PACKAGE_ROOT = Path(sys.argv[2])
Campaign.open(Path(sys.argv[1])).carry_out(Processes(2), one_task.Limits(), lambda done, total: None)
"""


@pytest.mark.usefixtures("program")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_campaign_that_was_ended_goes_on(tmp_path: Path, number: signal.Signals):
    log = tmp_path / "log"
    commands = {"slow": ["slow", str(log), "40"], **{f"t{i}": ["answer", str(i)] for i in range(3)}}
    campaign = planned(tmp_path / "c", **commands)
    command = [sys.executable, "-c", CARRY_OUT, str(campaign.folder), str(one_task.PACKAGE_ROOT)]
    child = subprocess.Popen(command, stderr=subprocess.DEVNULL, preexec_fn=interruptible)
    until = time.monotonic() + 60.0
    while not (log.exists() and len(answers(campaign)) == 3) and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(child.pid, number)
    assert child.wait(60.0) != 0
    assert [campaign.state(name) for name in campaign.digests] == ["owed", "done", "done", "done"]
    assert campaign.failures("slow") == []
    (campaign.folder / "tasks" / f"{campaign.digests['slow']}.json").unlink()
    goes_on = planned(tmp_path / "c", slow=["slow", str(log), "0"], **{k: commands[k] for k in ("t0", "t1", "t2")})
    assert goes_on.carry_out(Processes(2), LIMITS, quiet) == Counter(done=4)


@pytest.mark.usefixtures("program")
def test_two_processes_do_not_carry_out_one_campaign(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=["answer"])

    class Nested:
        def run(self, digests: Sequence[str], run: Run) -> Outcomes:
            with pytest.raises(CampaignError, match="another process carries this campaign out"):
                Campaign.open(campaign.folder).carry_out(Processes(1), LIMITS, quiet)
            for digest in digests:
                yield digest, run(digest)

    assert campaign.carry_out(Nested(), LIMITS, quiet) == Counter(done=1)


@pytest.mark.usefixtures("program")
def test_a_result_is_whole_or_absent(tmp_path: Path):
    campaign = planned(tmp_path / "c", one=["answer"])
    assert campaign.carry_out(Processes(1), LIMITS, quiet) == Counter(done=1)
    files = [path.name for path in (campaign.folder / "results").iterdir()]
    assert files == [f"{campaign.digests['one']}.json"]
    assert json.loads((campaign.folder / "results" / files[0]).read_bytes())["answers"]


@pytest.mark.usefixtures("program")
@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"\0" * 100])
def test_a_damaged_result_gets_a_sentence(tmp_path: Path, content: bytes):
    campaign = planned(tmp_path / "c", one=["answer"])
    campaign.carry_out(Processes(1), LIMITS, quiet)
    result_file(campaign.folder, campaign.digests["one"]).write_bytes(content)
    with pytest.raises(CampaignError, match="is damaged; remove it"):
        campaign.result("one")
