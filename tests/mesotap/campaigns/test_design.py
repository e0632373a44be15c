"""The design of a sweep: what is planned from it, and what is wrong with one."""

from __future__ import annotations

import csv
import io
from collections import Counter
from pathlib import Path

import pytest
import yaml
from rich.console import Console

from mesotap.campaigns.design import Design, planned, read_design
from mesotap.campaigns.engine import Processes
from mesotap.campaigns.one_task import Limits
from mesotap.commands.campaign import TABLE, campaign, sweep
from mesotap.configuration.config import parse_config
from rig.errors import MesotapError

SHORT = "{mesotap.load_plan_mn: [264.9], mesotap.dwell_s: 0}"


def written(folder: Path, text: str) -> Path:
    path = folder / "design.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_each_value_is_tried_with_each_other_and_sessions_differ_in_their_seeds(tmp_path: Path):
    (tmp_path / "own.yaml").write_text("mesotap: {specimen: mine}\n", encoding="utf-8")
    design = """
config: own.yaml
seed: 3
repeats: 2
set: {mesotap.impacts_per_load: 4}
vary:
  sim_backend.noise.rms_m_s2: [0.001, 0.00001]
  mesotap.load_plan_mn: [[264.9], [264.9, 431.6], [200, 300, 400]]
  sim_backend.mechanisms: [[], [{id: hunt_crossley_damping, parameters: {damping_growth_per_relative_approach: 1.5}}]]
"""
    path = written(tmp_path, design)
    sessions = dict(planned(read_design(path), path))
    assert len(sessions) == 2 * 3 * 2 * 2
    assert len({s.seed for s in sessions.values()}) == len(sessions)
    configs = [parse_config(s.config.decode()) for s in sessions.values()]
    assert {c.mesotap.specimen for c in configs} == {"mine"}
    assert {c.mesotap.impacts_per_load for c in configs} == {4}
    tried = Counter(
        (c.sim_backend.noise.rms_m_s2, len(c.mesotap.load_plan_mn), len(c.sim_backend.mechanisms)) for c in configs
    )
    assert tried == {(noise, loads, beyond): 2 for noise in (0.001, 1e-5) for loads in (1, 2, 3) for beyond in (0, 1)}
    assert all(f"--seed {s.seed} " in " ".join(s.task.arguments) for s in sessions.values())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1, 2]", "valid dictionary"),
        ("a: [", "YAML"),
        ("loads: [1]", "loads: Extra inputs are not permitted"),
        ("repeats: 0", "repeats: Input should be greater than or equal to 1"),
        ("vary: {mesotap.dwell_s: []}", "mesotap.dwell_s: has no values"),
        ("vary: {mesotap.dwell_s: 1}", "vary.mesotap.dwell_s: Input should be a valid list"),
        ("vary: {mesotap.dwel_s: [1]}", "mesotap.dwel_s"),
        ("vary: {mesotap.dwell_s: [1, -1]}", "mesotap.dwell_s: -1"),
        ("{set: {mesotap.dwell_s: 1}, vary: {mesotap.dwell_s: [1, 2]}}", "mesotap.dwell_s stands in set and in vary"),
        ("config: nowhere.yaml", "nowhere.yaml"),
        ("repeats: 2000000", "asks for 2,000,000 sessions"),
        ('title: "a\\nb"', "title"),
    ],
)
def test_what_is_no_design_gets_a_sentence_that_says_where(tmp_path: Path, text: str, said: str):
    path = written(tmp_path, text)
    with pytest.raises(MesotapError) as caught:
        dict(planned(read_design(path), path))
    assert said in str(caught.value)
    assert "design.yaml" in str(caught.value) or "nowhere.yaml" in str(caught.value)


@pytest.mark.parametrize("text", ["", "{}", "# to be written\n"])
def test_an_empty_design_is_refused_with_what_to_write(tmp_path: Path, text: str):
    with pytest.raises(MesotapError, match=r"is empty.*write for example 'vary: \{mesotap.impacts_per_load"):
        read_design(written(tmp_path, text))
    assert len(dict(planned(Design(), tmp_path / "design.yaml"))) == 1


@pytest.mark.slow
def test_a_sweep_is_a_table_of_its_answers_and_is_not_done_again(tmp_path: Path):
    design = yaml.safe_dump(
        {
            "title": "impacts",
            "set": yaml.safe_load(SHORT),
            "vary": {"mesotap.impacts_per_load": [2, 3], "mesotap.specimen": ["steel, ground"]},
        }
    )
    path = written(tmp_path, design)
    quiet = Console(quiet=True)
    sweep(path, tmp_path / "out", Processes(2), Limits(), None, quiet)
    table = (tmp_path / "out" / TABLE).read_bytes()
    rows = list(csv.DictReader(io.StringIO(table.decode())))
    assert [row["mesotap.impacts_per_load"] for row in rows] == [row["impacts_used"] for row in rows] == ["2", "3"]
    assert {row["mesotap.specimen"] for row in rows} == {"steel, ground"}
    for row in rows:  # the simulated rig's contact at 264.9 mN, config.yaml
        low, value, high = (float(row[f"contact_stiffness_n_per_m_{end}"]) for end in ("low", "value", "high"))
        assert low < value < high
        assert value == pytest.approx(3.95e6, rel=0.03)
    began = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "results").iterdir()}
    sweep(path, tmp_path / "out", Processes(2), Limits(), None, quiet)
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "results").iterdir()} == began
    assert (tmp_path / "out" / TABLE).read_bytes() == table
    (tmp_path / "out" / TABLE).unlink()
    campaign(tmp_path / "out", True, False, Processes(2), Limits(), None, quiet)
    assert (tmp_path / "out" / TABLE).read_bytes() == table
