"""Which taps are kept of more than needed: ring-downs by closed forms, with things that go wrong."""

from __future__ import annotations

import doctest
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import hits, reject_reasons
from daq.hits import COHERENCE, agreeing, coherences, is_left_out, with_chosen
from daq.records import Impact
from daq.reject_reasons import most_frequent

RATE, PRETRIGGER, SAMPLES = 25_000.0, 250, 2_500
MODES = ((356.0, 0.001), (3300.0, 0.006))


def ring_down(seed: int, strength: float = 1.0, begins: float = 0.0, noise: float = 1e-3) -> np.ndarray:
    """Return (2, n) of two modes with amplitudes and phases of their own, beginning between two samples."""
    random = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE - (PRETRIGGER + begins) / RATE
    one = np.zeros(SAMPLES)
    for f, zeta in MODES:
        pole = 2 * math.pi * f * (1j - zeta)
        amplitude = random.uniform(0.5, 1.5) * np.exp(2j * math.pi * random.random())
        one += np.where(t > 0, (amplitude * np.exp(pole * np.maximum(t, 0))).real, 0.0)
    return strength * np.array([one, one]) + noise * random.normal(size=(2, SAMPLES))


def doubled(seed: int) -> np.ndarray:
    again = np.roll(ring_down(seed + 500, noise=0.0), 400, axis=1)
    again[:, : PRETRIGGER + 400] = 0
    return ring_down(seed) + 0.1 * again


def turned(seed: int) -> np.ndarray:
    t = np.arange(SAMPLES) / RATE - PRETRIGGER / RATE
    swing = np.where(t > 0, np.exp(-200 * t) * np.sin(2 * math.pi * 3200 * t), 0.0)
    return ring_down(seed) + 0.1 * np.array([swing, -swing])


def noisy(seed: int) -> np.ndarray:
    burst = 0.1 * np.random.default_rng(seed).normal(size=(2, SAMPLES))
    burst[:, : PRETRIGGER + 200] = 0
    burst[:, PRETRIGGER + 600 :] = 0
    return ring_down(seed) + burst


def impacts(*taps: np.ndarray, load_set: int = 0, first: int = 0) -> list[Impact]:
    return [Impact(first + k, load_set, 300.0, 300.0, 300.0, "", RATE, PRETRIGGER, a, True) for k, a in enumerate(taps)]


def test_strength_phase_trigger_and_shares_of_the_modes_do_not_count() -> None:
    taps = [ring_down(k, strength=1 + k, begins=0.3 * k, noise=1e-6) for k in range(4)]
    found = coherences(taps, [PRETRIGGER] * 4, RATE)
    assert sorted(round(f / 100) for f in found.modes_hz) == [4, 33]
    assert float(found.by_band.min()) > 0.999


@pytest.mark.parametrize("wrong", [doubled, turned, noisy])
def test_what_went_wrong_is_left_out_with_its_reason(wrong) -> None:
    made = impacts(*(wrong(k) if k in (1, 4, 6) else ring_down(k) for k in range(9)))
    chosen = with_chosen(made, 6)
    assert [i.number for i in chosen if not i.accepted] == [1, 4, 6]
    for impact in chosen:
        assert 0 < impact.extra[COHERENCE] <= 1
        assert is_left_out(impact) == (impact.number in (1, 4, 6))
    assert all(i.reject_reason.startswith("left out: about ") for i in chosen if not i.accepted)
    assert "taps kept, these lack" in chosen[1].reject_reason


def test_as_many_as_are_wanted_stay_and_loads_are_chosen_by_themselves() -> None:
    made = [
        *impacts(*(ring_down(k) for k in range(3))),
        *impacts(*(ring_down(k) for k in range(5)), load_set=1, first=3),
    ]
    chosen = with_chosen(made, 3)
    assert chosen[:3] == made[:3]
    assert sum(i.accepted for i in chosen[3:]) == 3
    assert [i.number for i in chosen] == list(range(8))


def test_a_choice_is_undone_by_the_next_and_hands_are_never_overruled() -> None:
    made = impacts(*(doubled(k) if k < 2 else ring_down(k) for k in range(6)))
    made[0].extra["hand_reason"] = "I saw it"
    once = with_chosen(made, 4)
    assert once[0].accepted
    assert is_left_out(once[1])
    again = with_chosen(once, 6)
    assert all(i.accepted for i in again)
    assert [i.reject_reason for i in again] == [""] * 6


def test_rejected_taps_take_no_part() -> None:
    made = impacts(*(ring_down(k) for k in range(4)))
    bad = Impact(4, 0, 300.0, 300.0, 300.0, "", RATE, PRETRIGGER, ring_down(9), False, "too weak: tap harder")
    chosen = with_chosen([*made, bad], 2)
    assert chosen[4] == bad
    assert sum(i.accepted for i in chosen) == 2


@settings(max_examples=60)
@given(st.integers(2, 9), st.integers(1, 9), st.randoms(use_true_random=False))
def test_so_many_are_taken_as_are_wanted_with_those_that_a_person_keeps(n: int, wanted: int, random) -> None:
    apart = np.array([[random.uniform(-3, 3) for _ in range(n)] for _ in range(n)])
    fixed = random.sample(range(n), min(n, random.randint(0, 2)))
    kept = agreeing((apart + apart.T) / 2, wanted, fixed)
    assert len(kept) == len(set(kept)) == min(n, max(wanted, len(fixed)))
    assert set(fixed) <= set(kept)


def test_of_taps_that_agree_the_first_are_used_not_the_most_alike() -> None:
    apart = 0.1 * np.random.default_rng(1).random((12, 12))
    assert agreeing((apart + apart.T) / 2, 5) == (0, 1, 2, 3, 4)
    apart[1] = apart[:, 1] = 3.0
    assert agreeing(apart, 5) == (0, 2, 3, 4, 5)


@pytest.mark.parametrize("samples", [PRETRIGGER + 1, PRETRIGGER + 3, PRETRIGGER + 40])
def test_records_too_short_for_a_spectrum_are_chosen_from_all_the_same(samples: int) -> None:
    made = impacts(*(ring_down(k)[:, :samples] for k in range(3)))
    assert sum(i.accepted for i in with_chosen(made, 2)) == 2
    silent = impacts(*(np.zeros((2, SAMPLES)) for _ in range(3)))
    assert sum(i.accepted for i in with_chosen(silent, 2)) == 2


def test_the_reason_that_most_taps_were_rejected_for_comes_with_what_to_do() -> None:
    double = "a second impact of 12% of the first came 5 ms after it: pull back faster"
    turned_ = "A and B differ by 30% of their sum in the first 2 ms (limit 15%), the mass rotated: tap in the middle"
    what, count, then = most_frequent([f"{double}; {turned_}", turned_, double]) or ("", 0, "")
    assert (what, count) == ("double impacts", 2)
    assert "pull back faster" in then
    assert most_frequent([]) is None


def test_the_examples() -> None:
    assert doctest.testmod(hits, extraglobs={"np": np}).failed == 0
    assert doctest.testmod(reject_reasons).failed == 0
