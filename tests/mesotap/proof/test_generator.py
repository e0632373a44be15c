"""The generator of concealed sessions against closed forms, finer steps and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from mesotap.proof.generator import integration
from mesotap.proof.generator.concealed import Concealed, Hidden, conceal, record, signals, surviving
from mesotap.proof.generator.effects import LISTED, OUTSIDE
from mesotap.proof.generator.hidden import HIDDEN, film_modes
from mesotap.proof.generator.plan import PRETRIGGER, RATE_HZ, Noise, Plan, machine_of, random_plan
from mesotap.proof.generator.recorder import converted, filtered, innovations, noise_of, sampled, whitened
from mesotap.proof.generator.scenarios import DOZEN, GRADES, draw_scenarios
from mesotap.proof.generator.survival import alike, knowing_rms, refit

EFFECTS = {**LISTED, **OUTSIDE}


def small_plan(seed: int = 3, exponent: float | None = None) -> Plan:
    """A plan with its first two loads and one tap at each: cheap."""
    plan = random_plan(np.random.default_rng(seed), exponent=exponent)
    kept = [int(np.flatnonzero(plan.group == g)[0]) for g in (0, 1)]
    return replace(
        plan,
        loads=plan.loads[:2],
        kc=plan.kc[:2],
        cc=plan.cc[:2],
        group=np.array([0, 1]),
        pulses=plan.pulses[kept],
        offset=plan.offset[kept],
        samples=1000,
    )


@pytest.mark.long
def test_ring_down_is_that_of_the_matrix_exponential() -> None:
    plan = small_plan()
    machine = machine_of(plan)
    seen = integration.integrate(machine, 16_000, plan.step_s)
    start, later = 4000, 12_000  # after the pulse
    for i in range(2):
        mass = np.diag(1 / machine.mass)
        motion = np.block([[np.zeros((2, 2)), np.eye(2)], [-mass @ machine.stiffness[i], -mass @ machine.damping[i]]])
        step = expm(motion * plan.step_s)
        # the state at `start` from four accelerations of the lower mass, the one much later from the closed form
        rows, power = [], np.eye(4)
        for _ in range(400):
            rows.append(motion[3] @ power)
            power = step @ power
        state = np.linalg.lstsq(np.array(rows), seen[i, 0, start : start + 400], rcond=None)[0]
        expected = motion[3] @ np.linalg.matrix_power(step, later - start) @ state
        assert seen[i, 0, later] == pytest.approx(expected, abs=1e-5 * np.abs(seen[i]).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_half_the_step_makes_the_same_of_an_effect(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    effect = EFFECTS[name]
    plan = small_plan(exponent=effect.exponent)
    if effect.fixed:
        plan = plan.louder(3.0 if name == "contact_loss" else 1.0)
    hidden = (Hidden(effect, min(effect.first, effect.largest), effect.draw(np.random.default_rng(1), plan)),)
    coarse = signals(Concealed(plan, hidden)) - signals(Concealed(plan))
    for module in ("integration", "plan", "recorder"):
        monkeypatch.setattr(f"mesotap.proof.generator.{module}.STEPS_PER_SAMPLE", 32)
    plan = replace(plan, offset=2 * plan.offset)
    fine = signals(Concealed(plan, hidden)) - signals(Concealed(plan))
    assert np.abs(coarse - fine).max() < 2e-2 * np.abs(fine).max()


@pytest.mark.slow
def test_nothing_survives_where_nothing_is_hidden() -> None:
    plan = small_plan()
    assert surviving(Concealed(plan)).d < 1e-3


def test_other_constants_are_refitted() -> None:
    plan = small_plan()
    stiffer = replace(plan, kc=plan.kc * 1.003, cc=plan.cc * 0.97)
    found = refit(plan, signals(Concealed(stiffer)))
    assert found.d < 0.05
    np.testing.assert_allclose(found.constants[:2], 1.003, rtol=1e-4)
    np.testing.assert_allclose(found.constants[2:4], 0.97, rtol=1e-2)


def test_what_is_no_number_survives_without_bound() -> None:
    plan = small_plan()
    y = signals(Concealed(plan))
    y[0, 0, -1] = np.inf
    with np.errstate(invalid="ignore"):
        assert refit(plan, y).d == np.inf


def test_traceless_faults_leave_no_trace() -> None:
    plan = small_plan()
    assert surviving(Concealed(plan, undeclared_hz=4000.0)).d < 0.3


@pytest.mark.parametrize("name", sorted(set(HIDDEN) - {"sampling_jitter"}))
def test_what_a_free_decay_hides_leaves_next_to_nothing(name: str) -> None:
    plan, effect = small_plan(), HIDDEN[name]
    strongest = effect.first if name == "air_film" else effect.largest  # the thinnest film
    hidden = Hidden(effect, strongest, effect.draw(np.random.default_rng(1), plan))
    without, found = signals(Concealed(plan)), signals(Concealed(plan, (hidden,)))
    if name != "holder_compliance":  # in series with a stiffer contact it is k_c from the beginning
        assert np.abs(found - without).max() > 2 * plan.noise.rms
    assert refit(plan, found).d < 0.6  # of two impacts


def test_jitter_is_noise_in_proportion_to_the_slope() -> None:
    plan, effect = small_plan(), HIDDEN["sampling_jitter"]
    y = signals(Concealed(plan))
    errors = signals(Concealed(plan, (Hidden(effect, 1e-3, {"clock": 3}),))) - y
    np.testing.assert_allclose(errors[:, 0] / np.gradient(y, axis=2)[:, 0], errors[:, 1] / np.gradient(y, axis=2)[:, 1])
    assert np.std(errors / np.gradient(y, axis=2)) == pytest.approx(1e-3, rel=0.1)


def test_the_films_modes_bear_its_whole_stiffness_and_leak_as_a_slow_film_does() -> None:
    side, gap = 1.35e-3, 2e-6
    modes = film_modes(side, gap)
    assert sum(k for k, _ in modes) == pytest.approx(1.013e5 * side**2 / gap, rel=0.1)  # of the orders that are kept
    assert sum(k * t for k, t in modes) == pytest.approx(0.4217 * 1.83e-5 * side**4 / gap**3, rel=0.01)


def test_strained_channel_shows_the_force_of_the_contact() -> None:
    plan, effect = small_plan(), EFFECTS["base_strain"]
    assert effect.machined is not None
    machine = effect.machined(machine_of(plan), plan, 0.1, {"sign": 1.0, "channel": 1})
    a, b = np.moveaxis(integration.integrate(machine, 8000, plan.step_s), 1, 0)
    h = plan.step_s
    place = np.cumsum(np.cumsum(a, axis=1), axis=1) * h * h
    force = plan.masses[1] * a + plan.springs[1] * place
    assert np.abs(b - a - 0.1 * force / plan.masses[1]).max() < 2e-3 * np.abs(b - a).max()


def test_strength_is_graded_by_what_survives() -> None:
    plan = small_plan()
    for name in ("channel_gain", "guide_friction"):
        concealed = conceal(plan, EFFECTS[name], EFFECTS[name].draw(np.random.default_rng(2), plan), 25.0)
        assert concealed.hidden[0].d == pytest.approx(25.0, rel=0.08)
        assert surviving(concealed).d == pytest.approx(concealed.hidden[0].d, rel=1e-9)


def test_score_of_noise_alone_is_standard_normal() -> None:
    plan = small_plan()
    effect = EFFECTS["hunt_crossley_damping"]
    found = surviving(conceal(plan, effect, {}, 20.0))
    direction = np.concatenate([x.ravel() for x in found.left]) / found.d
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(200):
        noise = noise_of(rng, plan.noise, (plan.group.size, 2, plan.samples))
        turned = np.stack([noise[:, 0] + noise[:, 1], noise[:, 0] - noise[:, 1]], axis=1) / np.sqrt(2)
        white = whitened(plan.noise, turned[:, :, plan.settled :])
        scores.append(direction @ np.concatenate([white[plan.group == g].ravel() for g in range(plan.loads.size)]))
    assert np.mean(scores) == pytest.approx(0.0, abs=4 / np.sqrt(200))
    assert np.std(scores) == pytest.approx(1.0, abs=4 / np.sqrt(2 * 200))


def test_an_effect_is_like_itself_and_unlike_another() -> None:
    plan = small_plan()
    gain = surviving(conceal(plan, EFFECTS["channel_gain"], {"sign": 1.0}, 10.0))
    more = surviving(conceal(plan, EFFECTS["channel_gain"], {"sign": -1.0}, 40.0))
    skew = surviving(conceal(plan, EFFECTS["channel_skew"], {"sign": 1.0}, 10.0))
    assert alike(gain, more) == pytest.approx(1.0, abs=1e-3)
    assert alike(gain, skew) < 0.3


def test_noise_has_the_level_and_is_made_white() -> None:
    noise = Noise(0.01, 0.5, 300.0)
    y = noise_of(np.random.default_rng(1), noise, (20, 20_000))
    assert np.std(y) == pytest.approx(0.01, rel=0.03)
    white = whitened(noise, y)[:, 100:]
    assert np.std(white) == pytest.approx(1.0, rel=0.01)
    assert abs(np.mean(white[:, 1:] * white[:, :-1])) < 0.01
    assert innovations(noise)[1] < noise.rms


def test_knowing_fit_leaves_the_noise_less_its_freedom() -> None:
    plan = replace(small_plan(), noise=Noise(0.01, 0.0, 100.0))
    shape = (plan.group.size, 2, plan.samples)
    squares = [knowing_rms(plan, noise_of(np.random.default_rng(s), plan.noise, shape)) ** 2 for s in range(40)]
    left = plan.samples - plan.settled
    expected = 0.01**2 * (1 - 8 / (2 * left))  # four for the state, two for each channel
    assert np.mean(squares) == pytest.approx(expected, rel=0.01)


def test_b_is_late_by_the_delay() -> None:
    plan = small_plan()
    fine = filtered(plan, integration.integrate(machine_of(plan), plan.steps, plan.step_s))
    y = sampled(plan, fine, delay_of_b=0.5)
    shifted = sampled(replace(plan, offset=plan.offset + 8), fine)
    np.testing.assert_allclose(y[:, 1, 1:], shifted[:, 1, :-1], atol=1e-9 * np.abs(y).max())
    np.testing.assert_array_equal(sampled(plan, fine)[:, 0], y[:, 0])


def test_converter_rounds_and_saturates() -> None:
    step = 1.0 / 2**15
    np.testing.assert_allclose(converted(np.array([0.4 * step, 0.6 * step, 5.0]), 1.0), [0.0, step, 1.0 - step])


def test_contact_that_parts_never_pulls() -> None:
    plan = small_plan().louder(4.0)
    effect = EFFECTS["contact_loss"]
    assert effect.machined is not None
    machine = effect.machined(machine_of(plan), plan, 1.0, {})
    seen = integration.integrate(machine, 8000, plan.step_s)[:, 0]
    h = plan.step_s
    place = np.cumsum(np.cumsum(seen, axis=1), axis=1) * h * h
    force = machine.mass[1] * seen + plan.springs[1] * place + plan.of_each_impact(plan.loads)[:, None]
    assert force.min() > -2e-2 * plan.loads.max()
    linear = integration.integrate(machine_of(plan), 8000, plan.step_s)[:, 0]
    assert np.abs(seen - linear).max() > 0.1 * np.abs(linear).max()


def test_a_record_begins_with_noise_alone_and_is_what_the_rig_shows() -> None:
    plan = small_plan()
    recorded = record(np.random.default_rng(9), Concealed(plan), 4).session
    clean = signals(Concealed(plan))
    for impact, y in zip(recorded.impacts, clean, strict=True):
        assert impact.acceleration.shape == (2, PRETRIGGER + plan.samples)
        assert np.std(impact.acceleration[:, :PRETRIGGER]) == pytest.approx(plan.noise.rms, rel=0.4)
        assert np.std(impact.acceleration[:, PRETRIGGER:] - y) == pytest.approx(plan.noise.rms, rel=0.2)
    assert recorded.rig.sample_rate_hz == RATE_HZ
    assert recorded.rig.k1_n_per_m == plan.declared_springs[0]


def test_scenarios_are_those_of_their_seed_and_hold_every_kind() -> None:
    scenarios = draw_scenarios(7, 360)
    assert scenarios == draw_scenarios(7, 360)
    assert scenarios != draw_scenarios(8, 360)
    assert scenarios[:50] == draw_scenarios(7, 50)
    kinds = [c.kind for c in scenarios]
    assert {k: kinds.count(k) for k in set(kinds)} == {k: 30 * DOZEN.count(k) for k in set(DOZEN)}
    singles = [(c.effects[0], c.d[0]) for c in scenarios if c.kind == "single"]
    assert set(singles) == {(e, d) for e in LISTED for d in GRADES}
    assert {c.kind for c in draw_scenarios(1, 9, only="null")} == {"null"}
