"""Which added bodies are admissible, and in which numbers they are fitted."""

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.coordinates import MOST_RATIO, Coordinates, admissible
from sim_backend import arrangement as rigs
from sim_backend.acting import extended
from sim_backend.arrangement import LOAD
from sim_backend.mechanisms.catalogue import catalogue, placed, variants
from sim_backend.mechanisms.kinds import AddedBody
from tests.analysis.terms import at_work, listed

RIG = rigs.tester(0.107, 0.108, 4e5, 4.1e5, 2e6, 20.0, mass_uncertainty=5e-4, spring_uncertainty=1e-2)
FRAME = {"frame_mass_kg": 1.2, "frame_stiffness_n_per_m": 7e5, "frame_damping_n_s_per_m": 30.0}
PART = {"attached_mass_kg": 4e-4, "mount_stiffness_n_per_m": 6e4, "mount_damping_n_s_per_m": 0.3}


def coordinates(name: str, values: dict[str, float]) -> tuple[Coordinates, list[str], np.ndarray]:
    mechanism, place = next((m, p) for m, p in placed(variants(catalogue()), RIG) if m.id == name)
    term = Term(mechanism, values, place)
    arrangement = extended(RIG, [term])
    own = [p for p in arrangement.parameters if p.scope != LOAD]
    names = [p.name for p in own]
    positive = np.array([p.positive for p in own], bool)
    rig = np.array([values.get(p.name, p.value) for p in own])
    return Coordinates(names, positive, [term], arrangement), names, rig


@pytest.mark.parametrize(("name", "values"), [("frame_compliance", FRAME), ("attached_mass", PART)])
def test_the_basis_is_the_slope_of_a_step(name, values):
    made, _, rig = coordinates(name, values)
    basis = made.basis(rig)
    for i in range(rig.size):
        step = np.zeros(rig.size)
        step[i] = 1e-6 * (rig[i] if i < 4 or basis[i, i] == 1.0 else 1.0)
        np.testing.assert_allclose(made.moved(rig, step) - rig, basis @ step, rtol=1e-4, atol=1e-12 * np.abs(rig).max())


def test_a_heavier_frame_rings_at_the_same_frequency_with_the_tube_that_stands_on_it():
    made, names, rig = coordinates("frame_compliance", FRAME)
    step = np.zeros(rig.size)
    step[names.index("frame_mass_kg")] = 0.7  # of the logarithm
    new = dict(zip(names, made.moved(rig, step), strict=True))
    springs = {k for k in ("k1", "k2") if made.basis(rig)[names.index("frame_stiffness_n_per_m"), names.index(k)] != 0}
    assert len(springs) == 1
    beside = RIG.declared()[springs.pop()]
    assert new["frame_mass_kg"] == pytest.approx(1.2 * np.exp(0.7))
    assert (new["frame_stiffness_n_per_m"] + beside) / new["frame_mass_kg"] == pytest.approx((7e5 + beside) / 1.2)


def test_a_heavier_part_rings_at_the_same_frequency_against_the_mass_it_is_mounted_on():
    made, names, rig = coordinates("attached_mass", PART | {"attached_mass_kg": 0.02})
    step = np.zeros(rig.size)
    step[names.index("attached_mass_kg")] = 0.01
    new = dict(zip(names, made.moved(rig, step), strict=True))
    hosts = [m for m in ("m1", "m2") if made.basis(rig)[names.index("mount_stiffness_n_per_m"), names.index(m)] != 0]
    assert len(hosts) == 1
    host = RIG.declared()[hosts[0]]
    assert new["attached_mass_kg"] == pytest.approx(0.03)
    after = new["mount_stiffness_n_per_m"] * (1 / 0.03 + 1 / host)
    assert after == pytest.approx(6e4 * (1 / 0.02 + 1 / host))


@pytest.mark.parametrize("name", ["attached_mass", "frame_compliance", "rocking"])
def test_a_body_that_hardly_rings_is_not_admissible(name: str) -> None:
    mechanism = listed(name)
    assert isinstance(mechanism, AddedBody)
    assert mechanism.body is not None
    mass, stiffness, damping = mechanism.body
    values = {mass: 4.0, stiffness: 9.0, damping: 2 * MOST_RATIO * 6.0}
    assert not admissible(Term(mechanism, {}, (2,)), values)
    assert admissible(Term(mechanism, {}, (2,)), values | {damping: 0.9 * values[damping]})


def test_what_adds_no_body_is_admissible() -> None:
    assert admissible(at_work("micro_slip"), {})
