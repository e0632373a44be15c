from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from daq.quality import Verdict, contact_force, is_clipped, judge
from daq.second_impact import find_second_impact
from daq.settings import Quality

from .two_mass import TwoMass, tap

RATE = 25000.0


def pair(a2: np.ndarray, noise: float = 0.002, seed: int = 0, offset: float = 0.0) -> np.ndarray:
    return np.stack([a2, a2]) + noise * np.random.default_rng(seed).normal(size=(2, a2.size)) + offset


def verdict(acceleration: np.ndarray, **changes: Any) -> Verdict:
    tester = TwoMass()
    given: dict[str, Any] = {
        "sample_rate_hz": RATE,
        "pretrigger": 250,
        "preload_mn": 500.0,
        "load_before_mn": 500.0,
        "load_after_mn": 500.5,
        "m2_kg": tester.m2,
        "k2_n_per_m": tester.k,
        "full_scale_m_s2": 49.0,
        "bits": 16,
        "quality": Quality(),
    }
    return judge(acceleration, **(given | changes))


@pytest.fixture(scope="module")
def clean() -> tuple[np.ndarray, np.ndarray]:
    return tap(TwoMass.damped(5e6, 0.01), [(0.0, 0.3)], filtered=True)


@pytest.mark.parametrize("k_c", [1e6, 5e6, 1e7])
@pytest.mark.parametrize("zeta", [0.0016, 0.03, 0.17])
@pytest.mark.parametrize("pulse_s", [2e-4, 4e-4])
def test_the_contact_force_is_that_of_the_exact_solution(k_c: float, zeta: float, pulse_s: float) -> None:
    tester = TwoMass.damped(k_c, zeta)
    a2, force = tap(tester, [(0.0, 5.0)], pulse_s=pulse_s)
    estimate = contact_force(a2, RATE, tester.m2, tester.k, 250)
    first = slice(0, 1000)
    assert np.abs(estimate - force)[first].max() < 0.04 * np.abs(force).max()
    assert estimate.min() == pytest.approx(force.min(), abs=0.03 * np.abs(force).max())


def test_the_contact_force_in_the_system_mode_nearly_vanishes() -> None:
    """Equal masses on equal springs that move together press hardly anything between them: closed form."""
    t = np.arange(5000) / RATE - 0.1
    m2, k2, width = 0.108, 0.5379e6, 0.02
    omega = math.sqrt(k2 / m2)
    envelope = np.exp(-((t / width) ** 2))
    slope, bend = -2 * t / width**2 * envelope, (4 * t**2 / width**4 - 2 / width**2) * envelope
    x2 = envelope * np.sin(omega * t) / omega**2
    a2 = ((bend - omega**2 * envelope) * np.sin(omega * t) + 2 * omega * slope * np.cos(omega * t)) / omega**2
    force = m2 * a2 + k2 * x2
    assert np.abs(force).max() < 0.05 * m2
    np.testing.assert_allclose(contact_force(a2, RATE, m2, k2, 250), force, atol=1e-3 * m2)


def test_a_good_tap_is_accepted_with_its_numbers(clean: tuple[np.ndarray, np.ndarray]) -> None:
    a2, force = clean
    result = verdict(pair(a2, offset=0.4))
    assert (result.accepted, result.reason) == (True, "")
    numbers = {name: value for name, value in result.numbers.items() if isinstance(value, float)}
    assert numbers["peak_acceleration_m_s2"] == pytest.approx(np.abs(a2).max(), abs=0.01)
    assert numbers["peak_contact_force_n"] == pytest.approx(np.abs(force).max(), rel=0.05)
    assert numbers["force_ratio"] == pytest.approx(-force.min() / 0.5, rel=0.05)
    assert numbers["noise_rms_m_s2"] == pytest.approx(0.002 / math.sqrt(2), rel=0.15)
    assert numbers["signal_to_noise"] == pytest.approx(np.abs(a2).max() / numbers["noise_rms_m_s2"], rel=0.01)
    assert numbers["rotation"] < 0.01
    assert result.numbers["force_rule"] == "applied"


def test_a_tap_that_parts_the_surfaces_is_rejected_far_below_1_g(clean: tuple[np.ndarray, np.ndarray]) -> None:
    a2, force = clean
    result = verdict(pair(a2), preload_mn=100.0, load_before_mn=100.0, load_after_mn=100.0)
    assert -force.min() > 0.08
    assert np.abs(a2).max() < 0.5 * 9.80665
    assert not result.accepted
    assert result.reason.startswith("the contact was relieved by")
    assert "of the preload of 100 mN" in result.reason


def test_an_unknown_preload_skips_the_force_rule_and_says_so(clean: tuple[np.ndarray, np.ndarray]) -> None:
    result = verdict(pair(clean[0]), preload_mn=math.nan, load_before_mn=math.nan, load_after_mn=math.nan)
    assert result.accepted
    assert result.numbers["force_rule"] == "skipped: the preload is unknown"
    assert math.isnan(float(result.numbers["force_ratio"]))
    assert float(result.numbers["peak_contact_force_n"]) > 0


def test_over_1_g_is_rejected(clean: tuple[np.ndarray, np.ndarray]) -> None:
    a2 = clean[0] * 10.5 / np.abs(clean[0]).max()
    result = verdict(pair(a2), preload_mn=math.nan)
    assert "peak acceleration 10.5 m/s2 is over 1 g (9.81 m/s2)" in result.reason


def test_clipping_comes_first_and_names_the_channel(clean: tuple[np.ndarray, np.ndarray]) -> None:
    a = pair(clean[0])
    limit = 0.7 * np.abs(a).max()
    a[1] = np.clip(a[1], -limit, limit)
    result = verdict(a, full_scale_m_s2=limit, preload_mn=100.0)
    assert result.reason.startswith("accelerometer A and B clipped")
    a[0] *= 0.5
    assert verdict(a, full_scale_m_s2=limit).reason.startswith("accelerometer B clipped")


def test_a_flat_top_is_clipped_without_a_known_scale(clean: tuple[np.ndarray, np.ndarray]) -> None:
    step = 1.5e-3
    a = np.round(pair(clean[0]) / step) * step
    assert not is_clipped(a, math.nan, 0).any()
    a[0] = np.minimum(a[0], 0.6 * a[0].max())
    np.testing.assert_array_equal(is_clipped(a, math.nan, 0), [True, False])


def test_a_rotation_is_rejected(clean: tuple[np.ndarray, np.ndarray]) -> None:
    t = (np.arange(clean[0].size) - 250) / RATE
    swing = np.where(t > 0, 0.4 * np.abs(clean[0]).max() * np.sin(2 * np.pi * 600 * t) * np.exp(-200 * t), 0.0)
    a = pair(clean[0]) + np.stack([swing, -swing])
    assert "the mass rotated" in verdict(a).reason


@pytest.mark.parametrize(("dead", "said"), [(0, "A shows hardly anything of what B shows"), (1, "B shows hardly")])
def test_a_silent_channel_is_no_fault_of_who_taps(clean: tuple[np.ndarray, np.ndarray], dead: int, said: str) -> None:
    a = pair(clean[0])
    a[dead] = 0.002 * np.random.default_rng(1).normal(size=a.shape[1])
    told = verdict(a)
    assert not told.accepted
    assert said in told.reason
    assert "check its cable" in told.reason
    assert "'mesotap console --scope'" in told.reason
    assert "rotated" not in told.reason


def test_a_weak_channel_is_told_from_a_silent_one(clean: tuple[np.ndarray, np.ndarray]) -> None:
    for share, silent in ((0.05, True), (0.2, False)):
        reason = verdict(pair(clean[0]) * np.array([[1.0], [share]])).reason
        assert ("hardly anything" in reason) is silent, share
        assert ("rotated" in reason) is not silent


def test_rotation_is_the_ratio_of_difference_to_sum(clean: tuple[np.ndarray, np.ndarray]) -> None:
    a = np.stack([1.1 * clean[0], 0.9 * clean[0]])
    assert verdict(a).numbers["rotation"] == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize(
    ("before", "after", "moved"),
    [(500, 514, False), (500, 516, True), (100, 104.9, False), (100, 94.9, True), (math.nan, 500, False)],
)
def test_a_load_that_moved_is_rejected(
    clean: tuple[np.ndarray, np.ndarray], before: float, after: float, moved: bool
) -> None:
    result = verdict(pair(clean[0]), load_before_mn=before, load_after_mn=after)
    assert ("the load moved from" in result.reason) is moved


def test_a_weak_tap_is_rejected(clean: tuple[np.ndarray, np.ndarray]) -> None:
    a2 = clean[0] * 0.02 / np.abs(clean[0]).max()
    assert "too weak: the peak of 0.02" in verdict(pair(a2)).reason


def test_a_noisy_tap_is_rejected(clean: tuple[np.ndarray, np.ndarray]) -> None:
    assert "noisy before the tap: 0.03" in verdict(pair(clean[0], noise=0.045)).reason


def test_the_worst_reason_comes_first(clean: tuple[np.ndarray, np.ndarray]) -> None:
    slightly_over = clean[0] * 10.0 / np.abs(clean[0]).max()
    reasons = verdict(pair(slightly_over), load_after_mn=900.0, preload_mn=math.nan).reason.split("; ")
    assert reasons[0].startswith("the load moved")
    assert reasons[1].startswith("peak acceleration 10")


def synthetic(rng: np.random.Generator, second: bool, noise_db: float = 40.0) -> tuple[np.ndarray, float]:
    """A filtered tap of any damping from 0.16 to 17 %, with noise; and the delay of its second impact, s."""
    k_c, zeta = 10 ** rng.uniform(5.9, 7.05), 10 ** rng.uniform(math.log10(0.0016), math.log10(0.17))
    delay = rng.uniform(1e-3, 8e-3)
    impacts = [(0.0, 0.3)] + ([(delay, 0.3 * rng.uniform(0.15, 0.3))] if second else [])
    tester = TwoMass.damped(k_c, zeta, 10 ** rng.uniform(-3.5, -2))
    a2, _ = tap(tester, impacts, pulse_s=rng.uniform(2e-4, 5e-4), filtered=True, samples=1500)
    peak = np.abs(a2).max()
    a2 = a2 + peak * 10 ** (-noise_db / 20) * rng.normal(size=a2.size)
    onset = max(250, int(np.argmax(np.abs(a2) > max(0.05, 0.06 * peak))))
    return a2[onset - 250 :], delay


def is_double(a2: np.ndarray) -> bool:
    found = find_second_impact(a2, RATE, 250)
    return found.ratio > max(Quality().second_impact_ratio, 6 * found.noise_ratio)


def test_clean_taps_are_not_taken_for_double_ones() -> None:
    rng = np.random.default_rng(11)
    alarms = sum(is_double(synthetic(rng, second=False)[0]) for _ in range(300))
    assert alarms <= 3


def test_second_impacts_are_found() -> None:
    rng = np.random.default_rng(12)
    found = sum(is_double(synthetic(rng, second=True)[0]) for _ in range(150))
    assert found >= 146


def test_a_second_impact_is_told_with_strength_and_time() -> None:
    a2, _ = tap(TwoMass.damped(5e6, 0.01), [(0.0, 0.3), (4e-3, 0.09)], pulse_s=3e-4, filtered=True)
    result = verdict(pair(a2))
    assert float(result.numbers["second_impact_ratio"]) == pytest.approx(0.3, abs=0.02)
    assert float(result.numbers["second_impact_ms"]) == pytest.approx(4.0, abs=0.1)
    assert "a second impact of 30% of the first came 4 ms after it" in result.reason


def test_a_record_too_short_to_tell_has_no_second_impact() -> None:
    assert math.isnan(find_second_impact(np.ones(300), RATE, 250).ratio)
    assert math.isnan(find_second_impact(np.zeros(3000), RATE, 250).ratio)


@pytest.mark.parametrize("pretrigger", [0, 1, 20])
def test_a_record_with_little_before_the_trigger_is_judged(
    clean: tuple[np.ndarray, np.ndarray], pretrigger: int
) -> None:
    result = verdict(pair(clean[0][250 - pretrigger :]), pretrigger=pretrigger)
    assert math.isnan(float(result.numbers["noise_rms_m_s2"])) is (pretrigger < 16)


def test_silence_is_too_weak_not_an_error() -> None:
    assert math.isnan(float(verdict(np.zeros((2, 2500))).numbers["second_impact_ratio"]))
    assert "too weak" in verdict(1e-3 * np.random.default_rng(0).normal(size=(2, 2500))).reason
