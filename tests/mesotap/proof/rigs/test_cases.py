"""The generator of recordings of described rigs, against closed forms, other integrators and the rigs' reader."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from daq.exchange import import_recording
from mesotap.configuration.rig_files import load_rig
from mesotap.proof.rigs import laws
from mesotap.proof.rigs.cases import (
    GRADES,
    LISTED,
    MIXTURE,
    UNLISTED,
    Unreachable,
    _drawn,
    draw_scenarios,
    make,
    size_of,
)
from mesotap.proof.rigs.draw import Wants, draw_trial
from mesotap.proof.rigs.plant import Branch, Law, Plant
from mesotap.proof.rigs.refit import Point, Refit
from mesotap.proof.rigs.trial import Altered, Trial, recorded

SPRING = Branch(np.array([1.0]), 4000.0, 0.8)
ONE = Plant(np.array([0.1]), (SPRING,), np.array([1.0]))
H = 1e-4
STEPS = 2000
START = np.array([1e-3, 0.1])


def small(wants: Wants, seed: int = 5) -> Trial:
    """A trial whose recordings are short."""
    trial = draw_trial(wants, np.random.default_rng(seed))
    records = tuple(replace(r, drive=replace(r.drive, count=min(r.count, 600))) for r in trial.records[:2])
    return replace(trial, records=records)


def test_a_linear_rig_follows_the_matrix_exponential() -> None:
    moved, times = ONE.motion(START, np.zeros((STEPS, 3)), H)
    a, _ = ONE.matrices()
    for n in (1, 700, STEPS):
        expected = expm(a * times[n]) @ START
        assert moved[:2, n, 0] == pytest.approx(expected, rel=1e-9, abs=1e-15)


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "constants", "rest"),
    [
        (laws.CUBIC, (3e8,), lambda d, v, t: 3e8 * d**3),
        (laws.RATE_SQUARED, (2.0,), lambda d, v, t: 2.0 * v * abs(v)),
        (laws.HERTZ, (2.0, 4000.0), lambda d, v, t: 2.0 * (max(0.0, 1 + d / 7.5e-4) ** 1.5 - 1) - 4000.0 * d),
        (laws.SETTLING, (400.0, 0.1, 0.05), lambda d, v, t: (400.0 * d + 0.1 * v) * (1 - np.exp(-t / 0.05))),
        (laws.PARTING, (2.0, 4000.0, 0.8), lambda d, v, t: max(-2.0, 4000.0 * d + 0.8 * v) - (4000.0 * d + 0.8 * v)),
        (laws.SWING, (4000.0, 900.0), lambda d, v, t: 4000.0 * (np.sin(900.0 * d) / 900.0 - d)),
        (laws.STOP, (8000.0, 5e-4), lambda d, v, t: 8000.0 * max(d - 5e-4, 0.0)),
    ],
)
def test_a_law_moves_as_by_another_integrator(code: int, constants: tuple[float, ...], rest) -> None:  # type: ignore[no-untyped-def]
    plant = replace(ONE, laws=(Law(code, np.array([1.0]), constants),))
    moved, times = plant.motion(START, np.zeros((STEPS, 3)), H)

    def rates(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -(4000.0 * x[0] + 0.8 * x[1] + rest(x[0], x[1], t)) / 0.1]

    true = solve_ivp(rates, (0, times[-1]), START, "DOP853", times, rtol=1e-11, atol=1e-14, max_step=2e-4).y
    assert np.max(np.abs(moved[0, :, 0] - true[0])) < 2e-6 * np.max(np.abs(true[0]))


@pytest.mark.slow
def test_dry_friction_stops_a_body_and_loses_the_energy_that_it_should() -> None:
    plant = Plant(np.array([0.1]), (Branch(np.array([1.0]), 4000.0, 0.0),), np.array([1.0]))
    plant = replace(plant, laws=(Law(laws.FRICTION, np.array([1.0]), (0.5,)),))
    moved, _ = plant.motion(np.array([1e-3, 0.0]), np.zeros((STEPS, 3)), H)
    turns = moved[0, np.flatnonzero(np.diff(np.sign(moved[1, 1:, 0]))) + 1, 0]
    # between turning points the deflection falls by 2 F / k; the body rests where the spring is weaker than friction
    assert np.abs(turns[:3]) == pytest.approx(1e-3 - 2.5e-4 * np.arange(1, 4), abs=2e-6)
    assert abs(moved[0, -1, 0]) <= 0.5 / 4000 + 1e-9
    assert np.ptp(moved[0, -200:, 0]) < 1e-12


@pytest.mark.parametrize("effect", [*LISTED, *UNLISTED], ids=lambda e: e.id)
def test_an_effect_of_no_strength_is_none_and_steps_are_short_enough(effect) -> None:  # type: ignore[no-untyped-def]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        trial = draw_trial(effect.wants, rng)
        if sum(r.count for r in trial.records) > 6000:
            continue
        try:
            hidden = _drawn(effect, trial, rng)
        except Unreachable:
            continue
        break
    else:
        pytest.skip("no small trial has it")
    linear = Altered(trial.rig.plant(trial.rig.true_values()))
    without = recorded(trial, linear)
    strength = min(hidden.start, 0.5 * hidden.most)
    altered = hidden.add(linear, strength)
    once, twice = recorded(trial, altered), recorded(trial, altered, refined=2)
    sigma = np.array([noise.rms(len(once[0])) for noise in trial.noises])
    assert all(_near(a, b, sigma) for a, b in zip(once, twice, strict=True))
    assert any(np.any(a != plain) for a, plain in zip(once, without, strict=True))
    if not hidden.preload:  # a preload changes with the strength
        nearly_none = recorded(trial, hidden.add(linear, 1e-9 * strength))
        assert all(_near(a, b, sigma) for a, b in zip(nearly_none, without, strict=True))


def _near(a: np.ndarray, b: np.ndarray, sigma: np.ndarray) -> bool:
    return bool(np.all(np.abs(a - b).max(axis=0) < 0.05 * sigma))


def test_a_gain_leaves_what_the_refit_cannot_take_up() -> None:
    trial = draw_trial(Wants(sensors=2), np.random.default_rng(8))
    gain = next(e for e in LISTED if e.id == "channel_gain")
    hidden, linear = _drawn(gain, trial, np.random.default_rng(1)), Altered(trial.rig.plant(trial.rig.true_values()))
    refit = Refit(trial)
    assert refit(recorded(trial, linear)).d < 1e-3
    sizes = [size_of(trial, refit, linear, hidden, s) for s in (1e-3, 2e-3)]
    assert sizes[1] == pytest.approx(2 * sizes[0], rel=0.05)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_refit_that_ran_away_ends_where_it_is() -> None:
    trial = draw_trial(Wants(sensors=2), np.random.default_rng(8))
    refit = Refit(trial)
    channels = recorded(trial, Altered(trial.rig.plant(trial.rig.true_values())))
    damping = next(k for k in refit.free if k[0] == "damping")
    away = Point({**refit.true.values, damping: -1e17}, refit.true.starts)
    assert refit._settled(channels, away, 0.1).point is away
    assert refit(channels).d < 1e-3


def test_cases_are_drawn_evenly_and_made_again_from_their_seed(tmp_path: Path) -> None:
    scenarios = draw_scenarios(4, 300, None)
    kinds = [s.kind for s in scenarios]
    assert all(kinds.count(k) == 30 * MIXTURE.count(k) for k in set(MIXTURE))
    singles = [s for s in scenarios if s.kind == "single"]
    assert {s.grade for s in singles} == set(GRADES)
    assert {s.effects[0] for s in singles} == set(range(len(LISTED)))
    null = next(s for s in scenarios if s.kind == "null")
    truths = [make(4, null, tmp_path / which) for which in ("one", "two")]
    assert truths[0] == truths[1]
    files = sorted((tmp_path / "one" / null.name).iterdir())
    assert [f.read_bytes() for f in files] == [f.read_bytes() for f in sorted((tmp_path / "two" / null.name).iterdir())]


def test_what_is_written_is_read_by_a_diagnosis(tmp_path: Path) -> None:
    for scenario in [s for s in draw_scenarios(6, 40, None) if s.kind == "null"]:
        truth = make(6, scenario, tmp_path)
        folder = tmp_path / scenario.name
        rig = load_rig(folder / "rig.yaml")
        assert len(rig.arrangement.bodies) == truth["bodies"]
        recordings = sorted(folder.glob("recording-*.csv"))
        assert len(recordings) == len(truth["samples"])
        for file, samples in zip(recordings, truth["samples"], strict=True):
            recording = import_recording(file, rig.rate_hz)
            assert recording.data.shape[1] == samples
            assert recording.rate_hz == pytest.approx(truth["rate_hz"], rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("factor", [1.0005, 1.3])
def test_a_refit_takes_up_what_its_constants_can_do(factor: float) -> None:
    tried = 0
    for seed in range(24):
        trial = small(Wants(excited="forced"), seed)
        refit, true = Refit(trial), trial.rig.true_values()
        softened = [k for k in refit.free if k[0] == "stiffness" and k not in refit.uncertainty]
        if not softened:
            continue
        channels = recorded(trial, Altered(trial.rig.plant({**true, softened[0]: factor * true[softened[0]]})))
        before = float(np.linalg.norm(refit._residual(channels, refit.true)))
        assert refit(channels).d <= 0.05 * before
        tried += before > 0  # some are cut before anything happens
    assert tried > 8
