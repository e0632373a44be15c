"""How likely what is named is, beside what nobody listed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.policy import POLICY
from analysis.mismatch.ring_downs.account import ImpactAccount
from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.selection import LeftOver, Selection
from sim_backend.pulses import Pulse
from sim_backend.two_mass import TwoMass
from tests.analysis.mismatch.ring_downs.selections import accepted, screening, scripted, with_objective
from tests.analysis.ring_downs import K1, K2, M1, M2, RATE_HZ, SAMPLES, problem_of, session_of, with_law
from tests.analysis.terms import at_work


def odds(gain: float, unnamed: float = -50.0, left: float = 0.0, name: str = "channel_gain") -> float:
    before, best = with_objective(1000.0 + gain), with_objective(1000.0, name)
    step = accepted(name, before, best, gain)
    over = LeftOver(left, 0.0, left / (gain + left), unnamed)
    found = Selection(scripted(), before, screening(), (step,), best, best, screening(left), over)
    return ImpactAccount(found)._odds_of_something_else(step)


def test_the_weaker_an_effect_the_likelier_something_that_is_not_listed() -> None:
    assert odds(100.0) > odds(900.0) > odds(1e4) > 0
    assert 1 / (1 + odds(900.0)) < 0.9 < 1 / (1 + odds(1e4))


def test_something_without_a_name_that_leads_by_enough_is_likelier_than_what_is_named() -> None:
    assert odds(1e4, unnamed=POLICY.unnamed) > 1


def test_the_more_is_left_the_likelier_something_that_is_not_listed() -> None:
    assert odds(1e4, left=10.0) > odds(1e4)
    allowed = POLICY.may_be_left(1)
    assert odds(1e4, left=1e4 * allowed / (1 - allowed)) == pytest.approx(1.0)


def test_something_that_is_not_listed_looks_like_an_added_body_however_strong_that_is() -> None:
    assert odds(1e6, name="rocking") == pytest.approx(POLICY.unlisted)
    assert odds(1e6) == pytest.approx(POLICY.strong_likeness, rel=0.01)
    assert odds(100.0, name="rocking") == odds(100.0) > POLICY.unlisted  # what is weak looks like anything already


def test_a_line_at_a_mode_s_frequency_is_not_taken_for_the_loudest() -> None:
    """Of a mode and a tone at its frequency neither is known well: the mode's errors sound loud there."""
    size, mains_hz = 0.002, 66.0
    lowest = math.sqrt((K1 + K2) / (M1 + M2)) / (2 * math.pi)
    assert abs(5 * mains_hz - lowest) < 5.0
    t, rng, record = np.arange(SAMPLES) / RATE_HZ, np.random.default_rng(8), with_law()

    def humming(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
        moved = replace(rig, k1=rig.k1 * (1 + 1e-5 * rng.standard_normal()))  # the mode is not quite the same each time
        return record(moved, load_n, pulse) + size * np.sin(2 * np.pi * mains_hz * t + rng.uniform(0, 2 * np.pi))

    hum = at_work("mains_hum", {"mains_hz": mains_hz, "lines": 12345.0, "amplitude_m_s2": 0.0})
    fitted = fit(problem_of(session_of(humming, noise=0.01)), [hum])
    step = accepted("mains_hum", fitted, fitted, 1e3)
    found = Selection(scripted(), fitted, screening(), (step,), fitted, fitted, screening(), LeftOver(0.0, 0.5, 0.0))
    amplitude, error, unit = ImpactAccount(found).loudest_tone(fitted)
    assert abs(amplitude - size) < 3 * error < 0.4 * size
    assert unit == "m/s2"
