"""Hits in a force channel, and each fault of it in a sentence."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.frequency_response.estimators import ForceError
from analysis.frequency_response.hits import hits_in, is_lasting
from analysis.frequency_response.impacts import HitRecord, of_hits, of_recording
from tests.analysis.frequency_response.hits_of_two import RATE, hits

KC, CC = 8.0e6, 2.3


def _changed(record: HitRecord, force: np.ndarray) -> HitRecord:
    return HitRecord(force, record.response, record.name)


@pytest.fixture
def good() -> list[HitRecord]:
    return hits(np.random.default_rng(1), KC, CC, count=3, samples=1500)


def test_a_clean_hit_is_one_pulse(good: list[HitRecord]) -> None:
    found = hits_in(good[0].force, RATE, least=0.1)
    assert len(found) == 1
    assert 250 <= found[0].first <= 253
    assert 6 <= found[0].samples <= 9  # 0.3 ms at 25 kHz
    assert not is_lasting(good[0].force)


def test_a_dead_channel_is_told(good: list[HitRecord]) -> None:
    with pytest.raises(ForceError, match=r"never changes.*plugged in"):
        of_hits([_changed(r, np.zeros_like(r.force)) for r in good], RATE, ["x"])


def test_a_channel_with_noise_alone_is_told(good: list[HitRecord]) -> None:
    noise = np.random.default_rng(2).standard_normal(good[0].force.size)
    with pytest.raises(ForceError, match=r"shows no hit: its largest value is \d\.\d+ N, its noise \d\.\d+ N;"):
        of_hits([_changed(good[0], noise)], RATE, ["x"])


def test_an_overloaded_hit_is_left_out(good: list[HitRecord]) -> None:
    clipped = _changed(good[0], np.minimum(good[0].force, 0.6 * good[0].force.max()))
    found = of_hits([clipped, *good[1:]], RATE, ["x"])
    assert found.used == ("hit 1", "hit 2")
    assert any("hit 0: the hammer's channel was overloaded (flat" in note for note in found.response.notes)


def test_a_hit_beyond_the_declared_reach_is_left_out(good: list[HitRecord]) -> None:
    least = min(r.force.max() for r in good)
    found = of_hits(good, RATE, ["x"], largest_force=1.001 * least)
    assert len(found.used) == 1
    assert sum("it holds" in note for note in found.response.notes) == 2


def test_a_double_hit_is_left_out(good: list[HitRecord]) -> None:
    second = good[0].force + 0.3 * np.roll(good[0].force, 100)
    found = of_hits([_changed(good[0], second), *good[1:]], RATE, ["x"])
    assert found.used == ("hit 1", "hit 2")
    assert any("a second hit of 30% of the first" in note for note in found.response.notes)


def test_a_pulse_of_two_samples_is_left_out(good: list[HitRecord]) -> None:
    short = np.zeros_like(good[0].force)
    short[250:252] = 5.0
    found = of_hits([_changed(good[0], short), *good[1:]], RATE, ["x"])
    assert any("only 2 samples of its pulse" in note and "softer tip" in note for note in found.response.notes)


def test_a_reversed_sign_is_told_and_turned(good: list[HitRecord]) -> None:
    turned = of_hits([_changed(r, -r.force) for r in good], RATE, ["x"])
    plain = of_hits(good, RATE, ["x"])
    assert turned.response.h1 == pytest.approx(plain.response.h1)
    assert any("its sign is reversed" in note for note in turned.response.notes)
    assert not plain.response.notes


def test_many_hits_of_one_recording_are_averaged_and_a_bounce_is_none_of_its_own(good: list[HitRecord]) -> None:
    bounced = _changed(good[1], good[1].force + 0.4 * np.roll(good[1].force, 200))
    force = np.concatenate([good[0].force, bounced.force, good[2].force])
    response = np.concatenate([r.response for r in good], axis=1)
    found = of_recording(force, response, RATE, ["x"], "m/s2/N")
    assert found.averages == 2
    assert any("a second hit of 40% of the first" in note for note in found.notes)
