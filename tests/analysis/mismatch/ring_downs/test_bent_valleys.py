"""Fits of a heavy base near the mode in which both masses move: mass and stiffness go along a bent valley."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.intervals import intervals
from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.score_test import screen
from sim_backend.adopted import adopted
from sim_backend.pulses import Pulse
from sim_backend.recorder import analog_filter
from sim_backend.twin import twin_record
from sim_backend.two_mass import TwoMass
from tests.analysis.ring_downs import FILTER, ONSET_S, RATE_HZ, SAMPLES, problem_of, session_of
from tests.analysis.terms import at_work, listed

FRAME = {"frame_mass_kg": 0.61, "frame_stiffness_n_per_m": 1.09e5, "frame_damping_n_s_per_m": 14.1}
HEAVIER = 4.0  # than it is, where the fit begins; other beginnings end in other minima


def on_a_frame(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
    acting = [adopted("frame_compliance", FRAME)]
    return twin_record(rig, load_n, acting, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]


def test_a_fit_follows_the_valley_to_its_end() -> None:
    problem = problem_of(session_of(on_a_frame, noise=0.004))
    linear = fit(problem)
    term = screen(problem, linear, [listed("frame_compliance")]).scores[0].term
    begun = replace(term, values={**term.values, **{name: HEAVIER * value for name, value in FRAME.items()}})
    found = fit(problem, [begun], linear)
    numbers = sum(r.size for r in found.residuals)
    assert found.objective < numbers + 3 * math.sqrt(2 * numbers)  # the linear rig leaves nineteen times the noise
    stated = intervals(found, 0)
    for name, value in FRAME.items():
        half = (stated[name].high - stated[name].low) / 2
        assert abs(found.terms[0].values[name] - value) < 1.8 * half
        assert half < 0.1 * value


CREEP = {"creep_per_e_fold": 0.4, "creep_time_s": 0.02}


def creeping(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
    return twin_record(
        rig, load_n, [adopted("contact_creep", CREEP)], pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER)
    )[0]


@pytest.mark.slow
def test_a_fit_of_strong_creep_goes_on_to_the_end_of_its_valley() -> None:
    """How much it creeps and how fast are told apart by little: after 25 steps chi-squared was five times its least."""
    problem = problem_of(session_of(creeping))
    begun = at_work("contact_creep", {"creep_per_e_fold": 0.1, "creep_time_s": 0.01})
    found = fit(problem, [begun], fit(problem))
    numbers = sum(r.size for r in found.residuals)
    assert found.objective < numbers + 3 * math.sqrt(2 * numbers)
    for name, value in CREEP.items():
        assert found.terms[0].values[name] == pytest.approx(value, rel=2e-3)
