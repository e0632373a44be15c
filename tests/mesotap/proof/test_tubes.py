"""The generator's tube springs against another derivation of the same ring."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mesotap.proof.generator.effects import LISTED
from mesotap.proof.generator.plan import machine_of, random_plan
from mesotap.proof.generator.tubes import RATIO, SHARE, ringing, walls_ring
from rig.tube import Tube


def test_a_ring_rings_where_the_series_of_its_receptances_vanishes() -> None:
    tube = Tube(192.92e9, 0.29, 7900.0, 9.25e-3, 0.5e-3, 30e-3)  # Sec. 3.1 of the paper
    own = tube.own_mode()
    assert RATIO * math.sqrt(tube.stiffness / tube.mass) / (2 * math.pi) == pytest.approx(own.frequency_hz, rel=1e-4)
    # what the series has above its first mode is not in the effective mass, and less than what rides at all
    assert 0.85 * own.mass_kg < SHARE * tube.mass < own.mass_kg


def test_more_shapes_change_nothing() -> None:
    assert ringing(40) == pytest.approx(ringing(160), rel=1e-3)


def test_at_rest_walls_that_ring_weigh_as_much_as_before() -> None:
    plan = random_plan(np.random.default_rng(2))
    machine = walls_ring(machine_of(plan), plan, 6e-3, {"zeta": 0.005})
    assert machine.mass.sum() == pytest.approx(sum(plan.masses))
    moved = np.ones(4)  # as one: the mounts are not deformed
    np.testing.assert_allclose(moved @ machine.stiffness[0] @ moved, sum(plan.springs))
    riding = machine.stiffness[0][2:, 2:] / machine.mass[2:]
    assert np.ptp(np.sqrt(np.diag(riding))) < 1e-6 * math.sqrt(riding[0, 0])  # cut from one: one frequency


def test_the_proof_draws_it() -> None:
    assert LISTED["tube_mode"].component == "tube springs"
