"""Fits of simulated recordings."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedRecordings, fit, problem_of
from analysis.mismatch.recordings.recorded import HELD, prepare
from analysis.mismatch.score_test import screen
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import (
    INPUT,
    OMEGA,
    RATE,
    SAMPLES,
    SPRING,
    duffing,
    motion,
    noise_input,
    recorded,
    sensor,
)

Real = NDArray[np.float64]
SHORT = ("tube_spring_cubic", "quadratic_damping", "guide_friction", "micro_slip", "contact_creep", "input_curvature")
KNOWN = [catalogue()[name][-1] for name in SHORT]


@pytest.fixture(scope="module")
def u() -> Real:
    return noise_input(SAMPLES, RATE, 2, 25, seed=3)


def test_p_values_of_linear_rigs_are_not_small_too_often(u: Real) -> None:
    rig = parse_rig(SPRING + INPUT + sensor("displacement"))
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    small = 0
    for seed in range(8):
        problem = problem_of(rig, [prepare(recorded([u, y[0]], RATE, 0.03, seed), rig)])
        small += screen(problem, fit(problem, fine=True), KNOWN).p_value < 0.1
    assert small <= 4  # more than four of eight below 0.1: less than once in two thousand


def test_held_out_samples_take_no_part(u: Real) -> None:
    rig = parse_rig(SPRING + INPUT + sensor("velocity") + "recording: {held_out: [{name: end, from_s: 9}]}\n")
    good, spoilt = duffing(u), duffing(u)
    spoilt.data[1, 1900:] = 7.0
    fits = []
    for recording in (good, spoilt):
        prepared = prepare(recording, rig)
        assert np.all(prepared.part[1800:] == HELD)
        values = {"stiffness of spring": OMEGA**2, "damping of spring": 3.0, "gain of input 1": 100.0}
        constants = {p.name: values.get(p.name, p.value) for p in rig.arrangement.parameters}
        term = Term(catalogue()["tube_spring_cubic"][-1], {"cubic_stiffness_n_per_m3": 8 * OMEGA**2}, (0,))
        problem = SimulatedRecordings(rig, (prepared,), constants, 12.0, (np.zeros(2),))
        fits.append(fit(problem, [term]))
    # the recording's level, by which residuals are measured, is the only thing the spoilt part changes
    for name in ("stiffness of spring", "damping of spring"):
        assert fits[0].values[name] == pytest.approx(fits[1].values[name], rel=2e-3)
