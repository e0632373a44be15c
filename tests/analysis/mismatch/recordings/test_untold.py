"""Offsets that nothing tells: a rig that rests elsewhere shows the same."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.constants import constant_intervals
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.simulation import Simulation
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import RATE, SAMPLES, recorded

RIG = """
bodies: {{a: 2, b: 0.5}}
springs:
  - {{name: foot, between: [a, {ground}], stiffness: 800, damping: 4}}
  - {{name: joint, between: [b, a], stiffness: 900, damping: 0.3}}
slides: [{{name: rail, between: [a, ground], damping: 0.0}}]
inputs: [{{channel: 0, force_on: a}}]
sensors: [{{channel: 1, of: b, shows: {shows}{offset}}}]
recording: {{hold: first}}
"""
SHIFT_N = 0.7
FRICTION = ("guide_friction", {"friction_force_n": 0.3, "rounding": 1e-3}, "rail")
CUBIC = ("tube_spring_cubic", {"cubic_stiffness_n_per_m3": 1e7}, "foot")
CUBIC_ABOVE = ("tube_spring_cubic", {"cubic_stiffness_n_per_m3": 1e8}, "joint")
STOP = ("end_stop", {"stop_stiffness_n_per_m": 900.0, "gap_m": 4e-3}, "foot")
BOTH = {"offset of input 1", "offset of sensor 1"}


def simulated(shows: str = "displacement", offset: str = "", ground: str = "ground", law=None) -> Simulation:
    rig = parse_rig(RIG.format(shows=shows, offset=offset, ground=ground))
    terms = []
    if law is not None:
        name, values, element = law
        place = next(i for i, e in enumerate(rig.arrangement.elements) if e.name.endswith(element))
        terms = [Term(catalogue()[name][0], values, (place,))]
    random = np.random.default_rng(8)
    force = 20 * np.repeat(random.normal(size=SAMPLES // 20), 20)
    prepared = prepare(recorded([force, random.normal(size=force.size)], RATE, 0.0), rig)
    return Simulation(rig, [prepared], {p.name: p.value for p in rig.arrangement.parameters}, 8.0, terms)


def at_rest_elsewhere(simulation: Simulation, gap: str = "") -> tuple[np.ndarray, np.ndarray]:
    """What is shown, and what is shown with another offset of the force, all else moved with the place of rest."""
    moved = SHIFT_N / 800  # of both bodies
    x, state = simulation.begin(), np.zeros(4)
    there, elsewhere = x.copy(), state.copy()
    elsewhere[:2] += moved
    for k, p in enumerate(simulation.parameters):
        if p.name == "offset of input 1":
            there[k] += SHIFT_N / p.scale
        elif p.name == "offset of sensor 1" and simulation.rig.seen[0].sensor.quantity == "displacement":
            there[k] -= moved / p.scale
        elif p.name == gap:
            there[k] += moved / p.scale
    return (
        simulation.run(x, simulation.own(state), 0)[0],
        simulation.run(there, simulation.own(elsewhere), 0)[0],
    )


@pytest.mark.parametrize(
    ("made", "gap", "untold"),
    [
        ({}, "", BOTH),
        ({"shows": "velocity"}, "", {"offset of input 1"}),
        ({"shows": "acceleration", "law": FRICTION}, "", {"offset of input 1"}),
        ({"law": FRICTION}, "", BOTH),
        ({"law": CUBIC_ABOVE}, "", BOTH),  # both bodies move alike, and the joint between them rests as before
        ({"law": STOP}, "gap_m", BOTH),
        ({"law": CUBIC}, "", set()),
    ],
)
def test_offsets_are_untold_where_a_rig_at_rest_elsewhere_shows_the_same(made, gap, untold) -> None:
    simulation = simulated(**made)
    assert simulation.untold == untold
    here, there = at_rest_elsewhere(simulation, gap)
    apart = np.abs(there - here).max() / np.ptp(here)
    assert apart < 1e-4 if untold else apart > 1e-2


@pytest.mark.parametrize("made", [{"offset": ", offset: 0"}, {"ground": "b"}])
def test_what_is_declared_or_moves_away_is_told(made) -> None:
    assert simulated(**made).untold == set()


def test_an_untold_offset_of_an_input_stays_where_it_is_and_its_interval_has_no_end() -> None:
    simulation = simulated(law=FRICTION)
    priors = {p.name: p.prior for p in simulation.parameters if "offset" in p.name}
    assert priors["offset of input 1"][1] < 1e-3
    assert priors["offset of sensor 1"] == (0.0, 1.0)
    free = len(simulation.parameters)
    fitted = SimpleNamespace(simulation=simulation, values=simulation.constants, covariance=1e-6 * np.eye(free))
    found = constant_intervals(fitted)
    assert found["offset of input 1"] == found["offset of sensor 1"] == (-np.inf, np.inf)
