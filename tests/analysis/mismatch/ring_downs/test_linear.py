"""Modes of linear rigs: many at a time as one by one, and against the characteristic equation."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.ring_downs.fit import RingDowns
from analysis.mismatch.ring_downs.linear import linear_rig, linear_rigs
from rig.settings import Filter
from sim_backend.arrangement import tester as eq_9
from sim_backend.recorder import analog_filter
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import listed


@pytest.fixture(scope="module")
def problem() -> RingDowns:
    return problem_of(session_of(with_law()))


def test_rigs_solved_together_are_those_solved_alone(problem: RingDowns) -> None:
    rig = eq_9(0.107, 0.108, 5e5, 5e5, 1e6, 1.0, mass_uncertainty=1e-3, spring_uncertainty=1e-2)
    rig = listed("attached_mass").extend(  # type: ignore[misc]
        rig, {"attached_mass_kg": 0.004, "mount_stiffness_n_per_m": 4e5, "mount_damping_n_s_per_m": 1.0}, (1,)
    )
    rng = np.random.default_rng(1)
    values = {k: v * rng.uniform(0.7, 1.4, 12) for k, v in rig.declared().items()}
    values["cc"][5] = 2e4  # more than critical: as many modes, of another kind
    noise, rate = problem.experiment.noise, problem.experiment.sample_rate_hz
    together = linear_rigs(rig, values, problem.analog, noise, rate)
    assert len({r.poles.size for r in together}) == 2
    for i, found in enumerate(together):
        alone = linear_rig(rig, {k: float(v[i]) for k, v in values.items()}, problem.analog, noise, rate)
        for name in ("poles", "gains", "filtered", "drive", "direct", "weight"):
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-9, err_msg=name)


def test_a_rig_without_filter_keeps_its_poles(problem: RingDowns) -> None:
    rig = eq_9(0.107, 0.108, 5e5, 5e5, 1e6, 0.0, mass_uncertainty=1e-3, spring_uncertainty=1e-2)
    found = linear_rig(rig, rig.declared(), analog_filter(Filter(family="none")), problem.experiment.noise, 25e3)
    # det(K - w^2 M) = 0 of the two masses
    m1, m2, k, kc = 0.107, 0.108, 5e5, 1e6
    squares = np.sort(np.roots([m1 * m2, -(m1 + m2) * (k + kc), (k + kc) ** 2 - kc**2]).real)
    np.testing.assert_allclose(found.poles.imag, np.sqrt(squares), rtol=1e-9)
    np.testing.assert_allclose(found.filtered, found.raw_gains, rtol=0)


def test_base_strain_shows_the_contacts_force_which_newtons_law_gives(problem: RingDowns) -> None:
    rig = eq_9(0.107, 0.108, 5e5, 5e5, 1e6, 3.0, mass_uncertainty=1e-3, spring_uncertainty=1e-2)
    strained = listed("base_strain").extend(rig, {"base_strain_m_s2_per_n": 0.02}, (2, 1))  # type: ignore[misc]
    found = linear_rig(strained, strained.declared(), problem.analog, problem.experiment.noise, 25e3)
    s, x2 = found.poles, found.shapes[1]
    force = 0.108 * s**2 * x2 + 5e5 * x2  # of the contact on the lower mass
    np.testing.assert_allclose(found.raw_gains[1], s**2 * x2 + 0.02 * force, rtol=1e-9)
    np.testing.assert_allclose(found.raw_gains[0], s**2 * x2, rtol=1e-9)
