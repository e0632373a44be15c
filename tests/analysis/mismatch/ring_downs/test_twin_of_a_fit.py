"""The simulated twin of a fitted rig does what the fitted model says, once the tap has ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Constants
from analysis.mismatch.ring_downs.added_response import AddedResponse, Variant, rung
from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.response import responses
from sim_backend.adopted import adopted
from sim_backend.twin import SUBSTEPS, twin_record
from tests.analysis.ring_downs import (
    FILTER,
    LOADS_N,
    ONSET_S,
    PRETRIGGER,
    RATE_HZ,
    SAMPLES,
    analog_filter,
    problem_of,
    pulse_of,
    session_of,
    two_mass,
    with_law,
)

Real = NDArray[np.float64]
FIRST, FORGOTTEN, SHOWN = 20, 40, 1200  # samples after the trigger, until the low-pass forgets, and compared
EARLY = 150  # samples that the refit begins with
GROUP = 1
VALUES: dict[str, dict[str, float]] = {
    "hertz_stiffness": {},
    "rough_surface_stiffness": {},
    "contact_loss": {},
    "hunt_crossley_damping": {"damping_growth_per_relative_approach": 1.5},
    "tube_spring_cubic": {"cubic_stiffness_n_per_m3": 1e18},
}


def free_model(name: str) -> tuple[AddedResponse, Variant]:
    """Return a model with the true constants and the mechanism, and a variant without amplitudes."""
    problem = problem_of(session_of(with_law(), ratios=(0.5, 0.7)))
    rigs = [two_mass(load) for load in LOADS_N]
    load = np.array([[rig.kc, rig.cc] for rig in rigs])
    rig = np.array([rigs[0].m1, rigs[0].m2, rigs[0].k1, rigs[0].k2, 1.0])  # the last: loads as measured
    constants = Constants(problem.arrangement, rig, load)
    found = adopted(name, VALUES[name])
    term = Term(found.mechanism, VALUES[name], found.place)
    model = AddedResponse(problem, (term,), SUBSTEPS)
    _, made = model.modes(constants)
    return model, Variant((term,), np.zeros(2, np.complex128), constants.at(GROUP), made[GROUP])


def predicted(model: AddedResponse, variant: Variant, record: Segment, numbers: Real) -> Real:
    """Return what channel A shows for the real and imaginary parts of the modal amplitudes."""
    own = replace(variant, amplitudes=numbers[:2] + 1j * numbers[2:])
    h, samples = 1 / RATE_HZ / SUBSTEPS, record.y.shape[1]
    motion, used, _ = model.forces((record, own), samples - 1 + record.run_up)
    added = responses([own.to], used, h, SUBSTEPS)(motion.forces, motion.bends)[0, 0, record.run_up :]
    return added + rung(own.to, own.amplitudes, 1 / RATE_HZ, samples)[0]


@pytest.mark.parametrize("name", VALUES)
def test_the_twin_rings_as_the_model_with_its_state_refitted(name: str) -> None:
    model, variant = free_model(name)
    load = LOADS_N[GROUP]
    rig = two_mass(load)
    pulse = pulse_of(rig, load, 1.3 if name == "contact_loss" else 0.9)
    found = [adopted(name, VALUES[name])]
    made = twin_record(rig, load, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))
    start = PRETRIGGER + FIRST + FORGOTTEN
    y = made[0][0, start : start + SHOWN]
    empty = np.zeros((2, SHOWN))
    record = Segment("", empty, empty, (FIRST + FORGOTTEN) / RATE_HZ, GROUP, load, 0, FORGOTTEN)
    slow = np.exp(np.outer(np.arange(SHOWN) / RATE_HZ, model.problem.slow.real))
    unit = [rung(variant.to, np.eye(2)[j] * phase, 1 / RATE_HZ, SHOWN)[0] for phase in (1.0, 1j) for j in range(2)]
    numbers = np.linalg.lstsq(np.stack(unit, axis=1)[:EARLY], y[:EARLY], rcond=None)[0]
    for used in (*[EARLY] * 5, *[SHOWN] * 5):  # as the linear rig the later part would begin out of phase
        here = predicted(model, variant, record, numbers)
        step = 1e-4 * np.abs(numbers).max()
        columns = [(predicted(model, variant, record, numbers + step * e) - here) / step for e in np.eye(4)]
        own = np.column_stack([*columns, slow])
        change = np.linalg.lstsq(own[:used], (y - here)[:used], rcond=None)[0]
        numbers = numbers + change[:4]
    left = y - predicted(model, variant, record, numbers)
    left -= slow @ np.linalg.lstsq(slow, left, rcond=None)[0]
    assert np.abs(left).max() < 1e-6 * np.abs(y).max()
