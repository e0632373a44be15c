"""The diagnosis on the concealed practice sessions, and its parts against closed forms."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from analysis.mismatch.colour import noise_colour
from analysis.mismatch.diagnosis import Diagnosis, diagnose_session
from daq.session_file import read_session
from mesotap.answers.diagnosis_files import diagnosis_answer
from sim_backend.mechanisms.mechanism import AtRest, mechanisms
from sim_backend.modal_march import MEMORY, along, respond, step_weights, waves

DATA = Path(os.environ.get("MESOTAP_DATA", Path(__file__).parents[4] / "shared" / "data")) / "concealed-practice"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no practice sessions at {DATA}")


def diagnosed(case: str, *struck: str) -> Diagnosis:
    known = [m for m in mechanisms().values() if m.id not in struck]
    return diagnose_session(read_session(DATA / f"{case}.h5"), known)


def truth(case: str) -> dict:
    return json.loads((DATA / "truth.json").read_text())[case]


@pytest.mark.data
@needs_data
def test_nothing_is_found_where_nothing_is_hidden() -> None:
    assert diagnosed("case-027").verdict == "consistent"


@pytest.mark.data
@needs_data
def test_hunt_crossley_damping_is_named_with_an_interval_that_holds_the_truth() -> None:
    found = diagnosed("case-021").mechanisms
    growth = found[0].parameters["damping_growth_per_relative_approach"]
    true = truth("case-021")["effect"]["damping_growth_per_relative_approach"]
    assert [m.id for m in found] == ["hunt_crossley_damping"]
    assert growth.low < true < growth.high


@pytest.mark.data
@needs_data
def test_held_out_impacts_get_better_with_what_is_named() -> None:
    found = diagnosed("case-040")
    assert [m.id for m in found.mechanisms] == ["channel_gain"]
    assert found.rms_after is not None
    assert found.rms_after < found.rms_before


@pytest.mark.data
@needs_data
def test_a_struck_mechanism_is_not_replaced_by_a_wrong_name() -> None:
    assert diagnosed("case-030", "rocking").verdict == "unexplained"


@pytest.mark.data
@needs_data
def test_the_answer_is_what_other_programs_read() -> None:
    answer = diagnosis_answer(diagnosed("case-027"), 1.0)
    assert (answer["format"], answer["version"], answer["verdict"]) == ("mesotap-diagnosis", 1, "consistent")
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer


def test_every_mechanism_of_the_contract_is_listed() -> None:
    expected = {
        "hertz_stiffness": "contact", "rough_surface_stiffness": "contact", "contact_loss": "contact",
        "hunt_crossley_damping": "contact", "micro_slip": "contact", "quadratic_damping": "contact",
        "squeeze_film": "contact", "adhesion": "contact", "contact_creep": "contact", "guide_friction": "upper mass",
        "tube_spring_damping": "tube springs", "tube_spring_cubic": "tube springs", "attached_mass": "lower mass",
        "frame_compliance": "frame", "rocking": "lower mass", "double_hit": "impactor",
        "undeclared_filter": "sensor chain", "channel_gain": "sensor chain", "channel_skew": "sensor chain",
        "clipping": "sensor chain", "mains_hum": "sensor chain", "load_drift": "load cell",
    }  # fmt: skip
    assert {m.id: m.component for m in mechanisms().values()} == expected


@pytest.mark.parametrize("s", [-30.0 + 4000.0j, -2e4 + 6e4j, -5.0 + 0.0j, 0.0j, 12.0 - 3e3j])
def test_powers_of_a_step_are_the_exponential(s: complex) -> None:
    h, n = 4e-5, 5000
    exact = np.exp(s * h * np.arange(n))
    found = waves(np.array([s, 2 * s]), h, n)
    assert np.abs(found[:, 0] - exact).max() < 1e-12 * np.abs(exact).max()
    assert np.abs(found[:, 1] - exact**2).max() < 1e-11 * np.abs(exact**2).max()


def _response_of_a_mode(s: complex, h: float, force: np.ndarray) -> np.ndarray:
    weights, residue = step_weights(np.array([s]), h)[None], np.ones((1, 1, 1, 1), np.complex128)
    return respond(force[None, None].copy(), weights, residue, np.array([1.0]), np.zeros((1, 1, 1)), 1)[0, 0]


@pytest.mark.parametrize("s", [-30.0 + 4000.0j, -1.0 + 30.0j, -2e4 + 6e4j])
def test_the_response_of_a_mode_to_a_ramp_is_exact(s: complex) -> None:
    h = 1e-5
    t = h * np.arange(500)
    found = _response_of_a_mode(s, h, t)
    expected = ((np.exp(s * t) - 1 - s * t) / s**2).real
    assert np.allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_the_response_of_a_mode_to_an_oscillating_force_is_wrong_by_the_third_power_of_the_step() -> None:
    s, omega = -30.0 + 12000.0j, 9000.0
    errors = []
    for h in (2e-5, 1e-5):
        t = h * np.arange(round(2e-2 / h))
        found = _response_of_a_mode(s, h, np.sin(omega * t))
        expected = (((1j * omega - s) * 1j) ** -1 * (np.exp(1j * omega * t) - np.exp(s * t)) / 2).real
        expected += (-(((-1j * omega - s) * 1j) ** -1) * (np.exp(-1j * omega * t) - np.exp(s * t)) / 2).real
        errors.append(np.abs(found - expected)[10:].max() / np.abs(expected).max())
    assert errors[1] < 5e-4
    assert errors[1] < errors[0] / 6


def test_the_hertz_law_is_the_power_of_three_halves_about_the_preload() -> None:
    preload, stiffness = 0.3, 2e6
    rest = 1.5 * preload / stiffness
    d = np.linspace(-0.9, 2, 50) * rest
    p = np.array([preload, stiffness, 0.0, 1e-5])
    extra = along(mechanisms()["hertz_stiffness"].law, p, d, np.zeros(50), 0.0, 1e-5, np.zeros(MEMORY))
    expected = preload * ((rest + d) / rest) ** 1.5 - preload - stiffness * d
    assert np.allclose(extra, expected, atol=1e-12)


def test_a_slider_dissipates_four_times_its_force_times_the_sliding_in_a_cycle() -> None:
    k, limit, reach = 1e5, 1e-3, 5e-8
    d = reach * np.sin(np.linspace(0, 4 * math.pi, 40001))
    mechanism = mechanisms()["micro_slip"]
    p = np.array([0.1, 1e6, 0.0, 1e-6, k, limit, 1.0])
    force = along(mechanism.law, p, d, np.zeros(d.size), 0.0, 1e-6, np.zeros(MEMORY)) + k * d
    second = slice(20000, 40001)
    work = float(np.trapezoid(force[second], d[second]))
    assert work == pytest.approx(4 * limit * (reach - limit / k), rel=1e-3)


def test_whitened_noise_is_white_with_unit_variance() -> None:
    rng = np.random.default_rng(3)
    rate, pole = 25000.0, math.exp(-2 * math.pi * 300 / 25000)
    quiet, whole, records = [], [], []
    for _ in range(48):
        slow = np.zeros((2, 3000))
        step = 0.1 * rng.standard_normal((2, 3000))
        for i in range(1, 3000):
            slow[:, i] = pole * slow[:, i - 1] + step[:, i]
        y = 0.01 * (slow + rng.standard_normal((2, 3000)))[:, 500:]
        quiet.append(y[:, :245])
        whole.append(y[0] - y[1])
        records.append(y)
    colours = noise_colour(quiet, whole, rate)
    white = np.stack([colours[0].whiten(y[0])[200:] for y in records])
    spectrum = (np.abs(np.fft.rfft(white, axis=1)) ** 2).mean(axis=0) / white.shape[1]
    assert spectrum[2:40].mean() == pytest.approx(1, abs=0.1)
    assert spectrum[400:].mean() == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("speed", [-3e-4, -1e-5, 0.0, 1e-5, 3e-4])
def test_menisci_pull_as_the_surfaces_part_and_other_attraction_on_both_ways(speed: float) -> None:
    adhesion = mechanisms()["adhesion"]
    rest = AtRest(0.2, 2e6, 3.0)
    values = {"adhesion_force_share": 0.1, "adhesion_range_share": 0.5, "sets_in_m_per_s": 1e-4}
    d = np.linspace(-2e-7, 1e-7, 31)
    fading = np.exp(np.minimum(d, 0) / (0.5 * 0.2 / 2e6))
    expected = {0.0: 0.02 * (1 - fading), 1.0: 0.01 * (1 - (1 - math.tanh(speed / 1e-4)) * fading)}
    for menisci, force in expected.items():
        p = np.array([0.2, 2e6, 3.0, 1e-5, *adhesion.constants(values | {"menisci": menisci}, rest)])
        found = along(adhesion.law, p, d, np.full(31, speed), 0.0, 1e-5, np.zeros(MEMORY))
        assert np.allclose(found, force, atol=1e-12)
