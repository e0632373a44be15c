"""Parameters that depend on when and how the tap struck are found, on sessions of the independent generator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.mismatch.answer import Interval
from analysis.mismatch.ring_downs.fit import Stop, fit
from analysis.mismatch.score_test import screen
from analysis.mismatch.selection import started
from daq.session_file import read_session
from mesotap.proof.generator.scenarios import Scenario, make
from mesotap.proof.parameters import true_parameters
from tests.analysis.terms import listed
from tests.mesotap.tester import diagnosed, problem_of


def recovered(folder: Path, effect: str, d: float, seed: int) -> tuple[dict[str, float], dict[str, Interval]]:
    """True values, and the intervals where only the true mechanism is known."""
    scenario = Scenario(0, "single", (effect,), (d,))
    truth = make(seed, scenario, folder)
    found = diagnosed(read_session(folder / f"{scenario.name}.h5"), [listed(effect)]).answer
    assert [m.id for m in found.mechanisms] == [effect]
    return true_parameters(truth, effect), found.mechanisms[0].parameters


@pytest.mark.long
@pytest.mark.parametrize(("effect", "d", "seed"), [("double_hit", 300.0, 2), ("frame_compliance", 100.0, 1)])
def test_what_the_tap_ties_is_found_without_bias(tmp_path: Path, effect: str, d: float, seed: int) -> None:
    truth, found = recovered(tmp_path, effect, d, seed)
    for name, true in truth.items():
        assert found[name].low < true < found[name].high, name
        assert found[name].value == pytest.approx(true, rel=0.05), name


@pytest.mark.long
def test_a_strong_frame_is_found_though_the_linear_rig_goes_far_to_stand_in_for_it(tmp_path: Path) -> None:
    scenario = Scenario(47, "single", ("frame_compliance",), (300.0,))
    truth = make(11, scenario, tmp_path)
    found = diagnosed(read_session(tmp_path / f"{scenario.name}.h5"), [listed("frame_compliance")]).answer
    assert found.remainder.p_value > 0.01
    for name, true in true_parameters(truth, "frame_compliance").items():
        assert found.mechanisms[0].parameters[name].value == pytest.approx(true, rel=0.05), name


@pytest.mark.slow
def test_a_part_of_unknown_mass_gets_an_interval_that_says_so(tmp_path: Path) -> None:
    truth, found = recovered(tmp_path, "attached_mass", 100.0, 5)
    for name, true in truth.items():
        assert found[name].low < true < found[name].high, name
    assert found["mount_frequency_hz"].high < 1.1 * found["mount_frequency_hz"].low
    assert found["attached_mass_kg"].high < 3 * truth["attached_mass_kg"]
    assert found["attached_mass_kg"].high > 5 * found["attached_mass_kg"].low


@pytest.mark.long
def test_the_interval_of_a_mass_beside_a_force_law_is_its_profile(tmp_path: Path) -> None:
    scenario = Scenario(0, "two", ("quadratic_damping", "attached_mass"), (60.0, 30.0))
    truth = make(2, scenario, tmp_path)
    found = diagnosed(
        read_session(tmp_path / f"{scenario.name}.h5"), [listed(effect) for effect in scenario.effects]
    ).answer
    named = {m.id: m.parameters for m in found.mechanisms}
    assert set(named) == set(scenario.effects)
    for name, true in true_parameters(truth, "attached_mass").items():
        assert named["attached_mass"][name].low < true < named["attached_mass"][name].high, name


def test_the_fit_of_an_added_body_knows_its_errors_even_where_it_only_competed(tmp_path: Path) -> None:
    scenario = Scenario(0, "single", ("frame_compliance",), (30.0,))
    make(3, scenario, tmp_path)
    problem = problem_of(read_session(tmp_path / f"{scenario.name}.h5"))
    frame = listed("frame_compliance")
    with np.errstate(all="ignore"):
        linear = fit(problem)
        begin = next(s for s in screen(problem, linear, [frame]).scores if s.term.mechanism.id == frame.id)
        found = fit(problem, [started(begin)], linear, stop=Stop(competing=True))
    assert np.all(np.diag(found.term_covariances[0]) > 0)


@pytest.mark.long
@pytest.mark.parametrize(("effect", "d", "seed"), [("tube_spring_cubic", 300.0, 1), ("contact_creep", 300.0, 2)])
def test_intervals_of_strong_laws_hold_the_truth(tmp_path: Path, effect: str, d: float, seed: int) -> None:
    truth, found = recovered(tmp_path, effect, d, seed)
    for name, true in truth.items():
        assert found[name].low < true < found[name].high, name


@pytest.mark.long
def test_a_delayed_channel_is_not_taken_for_a_mass_that_turns(tmp_path: Path) -> None:
    scenario = Scenario(118, "excluded", ("channel_skew",), (30.0,))
    make(1, scenario, tmp_path)
    found = diagnosed(read_session(tmp_path / f"{scenario.name}.h5"), [listed("rocking")]).answer
    assert found.verdict == "unexplained"


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "imitation"), [("cubed_rate_damping", "quadratic_damping"), ("tube_spring_damping", "frame_compliance")]
)
def test_an_imitation_that_a_simple_force_without_a_name_beats_is_not_stated_with_confidence(
    tmp_path: Path, effect: str, imitation: str
) -> None:
    scenario = Scenario(7, "outside", (effect,), (30.0,))
    make(3, scenario, tmp_path)
    found = diagnosed(read_session(tmp_path / f"{scenario.name}.h5"), [listed(imitation)]).answer
    assert found.verdict != "consistent"
    assert all(m.probability < 0.8 for m in found.mechanisms)


@pytest.mark.long
def test_what_has_a_name_is_not_beaten_by_the_same_force_without_one(tmp_path: Path) -> None:
    scenario = Scenario(7, "single", ("quadratic_damping",), (60.0,))
    make(3, scenario, tmp_path)
    found = diagnosed(read_session(tmp_path / f"{scenario.name}.h5"), [listed("quadratic_damping")])
    assert [m.id for m in found.answer.mechanisms] == ["quadratic_damping"]
    assert found.selection.left.unnamed < 6
    assert found.answer.mechanisms[0].probability > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("error", [-0.3, -0.1, 0.2])
def test_springs_declared_far_off_are_found(tmp_path: Path, error: float) -> None:
    scenario = Scenario(2, "null", (), ())
    make(5, scenario, tmp_path)
    session = read_session(tmp_path / f"{scenario.name}.h5")
    true = session.rig
    wrong = replace(true, k1_n_per_m=(1 + error) * true.k1_n_per_m, k2_n_per_m=(1 + error) * true.k2_n_per_m)
    with np.errstate(all="ignore"):  # of trial steps
        found = fit(problem_of(replace(session, rig=wrong)))
    assert found.reduced_chi_squared < 1.05
    springs = [
        v for name, v in zip(found.constants.names()[0], found.constants.rig, strict=True) if name in ("k1", "k2")
    ]
    assert sum(springs) == pytest.approx(true.k1_n_per_m + true.k2_n_per_m, rel=0.01)


@pytest.mark.long
def test_ringing_tube_springs_are_recognised(tmp_path: Path) -> None:
    truth, found = recovered(tmp_path, "tube_mode", 300.0, 5)
    frequency = found["tube_mode_frequency_hz"]
    assert frequency.value == pytest.approx(truth["tube_mode_frequency_hz"], rel=0.01)
