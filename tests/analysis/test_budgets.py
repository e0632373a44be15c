"""The budgets of a session's loads: what they sum to, and whether a Monte Carlo simulation from the inputs agrees."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis.budgets import mass_sources, rig_covariance
from analysis.session import analyse_session, session_modes
from analysis.settings import AnalysisSettings, TapScatter
from analysis.stiffness import contact_from_pole, pole, springs_from_system_mode
from analysis.tap_scatter import known_scatter, repeated
from calibration.estimate import Estimate
from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints, Session
from mesotap import simulate
from mesotap.session.bench import simulated_rig
from mesotap.session.progress import assemble
from rig.settings import Masses, Springs
from tests.mesotap.benches import header_of, new_runner, small_config

CHANGES = (
    "mesotap.impacts_per_load=4",
    "calibration.weights_mn=[0, 200, 400, 600, 800, 1000]",
    "calibration.latitude_deg=52",
)
TUBES = ("rig.springs.system_resonance_hz=356", "rig.springs.added_mass_kg=0.0027")
QUANTITIES = {
    "load_mn",
    "f1_hz",
    "f2_hz",
    "zeta1",
    "zeta2",
    "contact_stiffness_n_per_m",
    "contact_damping_n_s_per_m",
}


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Session:
    config = small_config(*CHANGES)
    folder, runner = new_runner(tmp_path_factory.mktemp("budget") / "s", config, simulated_rig(config, seed=4))
    with folder:
        progress = runner.run()
        return assemble(header_of(config), config, progress, folder.impacts())


def analysed(session: Session, *changes: str):
    config = small_config(*CHANGES, *changes)
    return analyse_session(
        session,
        config.analysis,
        config.calibration,
        config.rig.masses,
        config.rig.springs,
        wiring=config.rig.wiring,
    )


@pytest.fixture(scope="module")
def results(session):
    return analysed(session)


def test_every_number_has_a_budget_that_sums_to_its_interval(results):
    for load in results.loads:
        assert {budget.quantity for budget in load.budgets} == QUANTITIES
        for budget in load.budgets:
            stated = getattr(load, budget.quantity)
            total = math.sqrt(sum((c.sensitivity * c.standard_uncertainty) ** 2 for c in budget.contributions))
            assert total == pytest.approx(stated.standard_error, rel=1e-9)
            assert sum(budget.shares) == pytest.approx(1.0)
            assert budget.value == stated.value


def budget_of(results, quantity, load=0):
    return next(b for b in results.loads[load].budgets if b.quantity == quantity)


def shares(budget):
    return {c.source: share for c, share in zip(budget.contributions, budget.shares, strict=True)}


def test_frequencies_are_no_better_than_the_clock(session):
    found = budget_of(analysed(session, "rig.wiring.clock_accuracy_ppm=50"), "f1_hz").estimate()
    # limits of 50 ppm, of which 95 % of a rectangle
    assert found.half_width == pytest.approx(0.95 * 50e-6 * found.value, rel=0.01)
    exact = budget_of(analysed(session, "rig.wiring.clock_accuracy_ppm=0"), "f1_hz").estimate()
    assert exact.half_width < 0.2 * found.half_width


def test_stiffness_and_damping_agree_with_a_simulation_from_their_inputs(session, results):
    rng = np.random.default_rng(1)
    n = 20_000
    f1 = next(c for c in budget_of(results, "contact_stiffness_n_per_m").contributions if c.source.startswith("f1"))
    f2, zeta2 = (budget_of(results, name).contributions[0] for name in ("f2_hz", "zeta2"))
    clock = 1 + 50e-6 * rng.uniform(-1, 1, n)
    split = 0.01 * rng.standard_normal(n)
    m1, m2 = (m + 5e-5 * rng.standard_normal(n) for m in (session.rig.m1_kg, session.rig.m2_kg))
    k_c, c_c = np.empty(n), np.empty(n)
    near = budget_of(results, "contact_stiffness_n_per_m").value
    for i in range(n):
        f1_drawn = (f1.value + f1.standard_uncertainty * rng.standard_normal()) * clock[i]
        k1, k2 = springs_from_system_mode(f1_drawn, near, m1[i], m2[i])
        s = pole(
            (f2.value + f2.standard_uncertainty * rng.standard_normal()) * clock[i],
            zeta2.value + zeta2.standard_uncertainty * rng.standard_normal(),
        )
        shift = split[i] / math.sqrt(2)
        k_c[i], c_c[i] = contact_from_pole(s, m1[i], m2[i], k1 * (1 + shift), k2 * (1 - shift))
    for drawn, quantity in ((k_c, "contact_stiffness_n_per_m"), (c_c, "contact_damping_n_s_per_m")):
        assert np.std(drawn) == pytest.approx(budget_of(results, quantity).standard_uncertainty, rel=0.02)


@pytest.mark.slow
def test_load_agrees_with_a_simulation_from_readings_weights_and_gravity(session):
    settings = small_config(*CHANGES, "calibration.common_weight_uncertainty_percent=0.05").calibration
    settings = settings.model_copy(
        update={"zero_drift_mn_per_root_hour": 0.0, "sensitivity_drift_percent_per_root_hour": 0.0}
    )
    rng = np.random.default_rng(2)
    loads = np.tile([0.0, 200, 400, 600, 800, 1000, 1000, 800, 600, 400, 200, 0.0], 1)
    noise, reading = 0.004, 0.002

    def calibration(hung, time):
        voltage = 0.35 + 0.042 * hung + noise * rng.standard_normal(len(hung))
        return CalibrationPoints(loads, voltage, time)

    found, stated = [], []
    for _ in range(600):
        own = dict(zip(np.unique(loads), 0.1 * rng.standard_normal(6), strict=True)) | {0.0: 0.0}
        common = 5e-4 * rng.standard_normal() + 1.5e-4 * rng.uniform(-1, 1)
        common += settings.gravity.standard_uncertainty / settings.gravity.value * rng.standard_normal()
        hung = np.array([load * (1 + common) + own[load] for load in loads])
        pre, post = (calibration(hung, f"2024-05-01T{hour:02d}:00:00Z") for hour in (8, 10))
        voltage = 0.35 + 0.042 * 700 + reading * rng.standard_normal()
        budget = GaugeHistory(pre, post, settings).budget_at(voltage, "2024-05-01T09:00:00Z", reading)
        found.append(budget.value)
        # what these draws have none of, and the budget is not sure of
        parts = [c for c in budget.contributions if c.source not in ("misfit of the curve", "hysteresis")]
        stated.append(sum(c.uncertainty**2 for c in parts if not c.source.startswith("drift")))
    assert np.std(found) == pytest.approx(math.sqrt(np.mean(stated)), rel=0.06)


def test_sources_of_the_masses_make_their_covariance():
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])
    follow = np.array([[2.0, 2.0], [3.0, 3.0]])
    jacobian = np.vstack([np.eye(2), follow])
    made = rig_covariance(tuple(mass_sources((1.0, 1.0), covariance, follow)))
    np.testing.assert_allclose(made, jacobian @ covariance @ jacobian.T)


def test_a_single_tap_says_that_its_scatter_is_unknown(session):
    first = next(s for s in session.impacts if s.load_set == 0 and s.accepted)
    alone = analysed(replace(session, impacts=(first,)))
    (load,) = alone.loads
    assert "single tap" in " ".join(load.notes)
    assert "analysis.tap_scatter" in " ".join(load.notes)
    assert load.f2_hz.standard_error == pytest.approx(0.013 * load.f2_hz.value, rel=0.01)


def test_the_noise_of_a_single_tap_is_told_from_its_ring_down_too(session, monkeypatch):
    first = next(s for s in session.impacts if s.load_set == 0 and s.accepted)
    alone = replace(session, impacts=(first,))

    def stated(of):
        return session_modes(of, AnalysisSettings())[first.number].system.damping_ratio.standard_error

    known, told = stated(session), stated(alone)
    monkeypatch.setattr("analysis.session.FEW_QUIET", 0)
    by_few = stated(alone)
    assert told == pytest.approx(known, rel=0.1)
    assert abs(by_few - known) > 2 * abs(told - known)


def test_a_single_tap_takes_the_scatter_of_the_sessions_other_loads(session):
    first = next(s for s in session.impacts if s.load_set == 0 and s.accepted)
    beside = analysed(replace(session, impacts=(first, *(s for s in session.impacts if s.load_set == 1))))
    assert "the session's other loads" in " ".join(beside.loads[0].notes)
    # the simulated contact scatters by 0.04 % in stiffness
    assert 5e-5 < beside.loads[0].f2_hz.standard_error / beside.loads[0].f2_hz.value < 1e-3


def test_scatter_is_that_of_the_loads_with_several_taps():
    loads = [
        {"f2_hz": [Estimate(1000.0, 0.1), Estimate(1002.0, 0.1), Estimate(998.0, 0.1)]},
        {"f2_hz": [Estimate(2000.0, 0.1), Estimate(2004.0, 0.1)]},
        {"f2_hz": [Estimate(500.0, 0.1)]},
    ]
    scatter = known_scatter(loads, TapScatter())["f2_hz"]
    assert scatter.dof == 3
    assert scatter.relative == pytest.approx(math.sqrt((2 * 2e-3**2 + 2 * (2 / 2002) ** 2) / 3))
    single = repeated(loads[2]["f2_hz"], scatter)
    assert single.estimate.standard_error == pytest.approx(math.hypot(0.1, 500 * scatter.relative))


def test_stated_scatter_is_that_of_the_paper():
    assert AnalysisSettings().tap_scatter.relative("f2_hz") == pytest.approx(0.026 / 2)


def test_what_both_masses_have_of_the_tube_springs_is_a_source_of_its_own(session):
    found = shares(budget_of(analysed(session, *TUBES), "contact_stiffness_n_per_m"))
    assert found["what both masses have in common"] > found["mass m1"]


def test_a_load_without_a_calibration_counts_what_the_gauge_is_known_to() -> None:
    session = simulate(load_mn=500.0)
    for percent, half_percent in ((10.0, 9.5), (2.0, 1.9)):  # 95 % of what lies evenly between limits
        calibration = CalibrationSettings(uncalibrated_sensitivity_percent=percent)
        found = analyse_session(session, AnalysisSettings(), calibration, Masses(), Springs(system_resonance_hz=356.0))
        for load in (found.loads[0].load_mn, found.impacts[0].load_mn):
            assert load is not None
            assert 100 * (load.high - load.low) / 2 / load.value == pytest.approx(half_percent, rel=0.02)
        (budget,) = [b for b in found.loads[0].budgets if b.quantity == "load_mn"]
        assert "never calibrated" in budget.contributions[1].source
        assert any(f"right to within {percent:g} %" in note for note in found.notes)


def test_a_load_written_beside_a_calibration_does_not() -> None:
    plain = simulate(load_mn=500.0)
    weights = np.tile([0.0, 200.0, 600.0, 1000.0], 2)
    noise = 1e-3 * np.random.default_rng(5).normal(size=weights.size)
    pre = CalibrationPoints(weights, 0.042 * weights + noise, "2026-01-01T00:00:00Z")
    tap = replace(plain.impacts[0], voltage_before_mv=math.nan, voltage_after_mv=math.nan, strain_mv=None)
    tap = replace(tap, load_before_mn=500.0, load_after_mn=500.2)
    session = replace(plain, pre=pre, impacts=(tap,))
    found = analyse_session(
        session, AnalysisSettings(), CalibrationSettings(), Masses(), Springs(system_resonance_hz=356.0)
    )
    load = found.loads[0].load_mn
    assert load is not None
    assert (load.value, load.standard_error) == (pytest.approx(500.1), pytest.approx(0.1))
