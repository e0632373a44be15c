"""Where a fit leaves more than noise: on segments whose flaw is known."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.evidence.excess import ExcessMap, by_impact, map_by_frequency, map_by_time, spectrum
from analysis.mismatch.ring_downs.fit import RingDownFit, fit
from daq.records import Session
from tests.analysis.ring_downs import LOADS_N, RATE_HZ, RATIOS, SAMPLES, problem_of, session_of, with_law

TONE_HZ, TONE = 3000.0, 0.05


@functools.cache
def fitted(*, hum: bool = False) -> RingDownFit:
    session = session_of(with_law(), noise=0.01)
    return fit(problem_of(humming(session) if hum else session))


def humming(session: Session) -> Session:
    """A tone in channel A alone, at the middle load, from 20 ms after the tap on."""
    t = np.arange(SAMPLES) / RATE_HZ
    tone = np.where(t > 0.03, TONE * np.sin(2 * np.pi * TONE_HZ * t), 0.0)
    impacts = [
        replace(s, acceleration=s.acceleration + np.outer([1.0, 0.0], tone)) if s.load_set == 1 else s
        for s in session.impacts
    ]
    return replace(session, impacts=tuple(impacts))


@pytest.mark.slow
@pytest.mark.parametrize("found", [map_by_frequency, map_by_time])
def test_what_is_explained_leaves_the_noise_everywhere(found: Callable[[RingDownFit], ExcessMap]) -> None:
    power = found(fitted()).power
    assert np.nanmax(np.abs(power - 1)) < 0.8
    assert np.nanmean(power) == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_a_tone_is_found_at_its_load_frequency_and_time() -> None:
    for found, at in ((map_by_frequency(fitted(hum=True)), TONE_HZ), (map_by_time(fitted(hum=True)), 0.05)):
        _, load, place = np.unravel_index(np.nanargmax(found.power), found.power.shape)
        assert found.loads_n[load] == pytest.approx(LOADS_N[1])
        assert found.edges[place] <= at <= found.edges[place + 1]
    frequency, power = spectrum(fitted(hum=True))
    assert frequency[int(np.argmax(power[1]))] == pytest.approx(TONE_HZ, abs=30.0)


@pytest.mark.slow
def test_impacts_are_told_by_strength_and_order() -> None:
    found = by_impact(fitted())
    assert found.order.tolist() == list(range(len(LOADS_N) * len(RATIOS)))
    assert np.abs(found.excess).max() < 4.0
    # the largest force comes during the tap or a little after it, so what rings down is a little less
    ratios = fitted().force_ratios().reshape(len(LOADS_N), len(RATIOS))
    assert np.all(np.diff(ratios, axis=1) > 0)
    assert np.all((ratios / np.array(RATIOS) > 0.5) & (ratios / np.array(RATIOS) < 1.0))
