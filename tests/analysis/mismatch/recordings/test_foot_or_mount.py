"""A frame and a part on a mount that do the same: impedances from assembled matrices, and a fit stuck elsewhere."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import fit
from analysis.mismatch.recordings.foot_or_mount import begun_from_another, mapped
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.score_test import Score
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import family
from sim_backend.mechanisms.kinds import AddedBody
from tests.analysis.mismatch.recordings.described_rigs import recorded

(FRAME,), (PART,) = family("frame_compliance"), family("attached_mass")
TWO = """
name: two
bodies: {block: 0.58, head: 0.31}
springs:
- {name: leaf, between: [block, ground], stiffness: unknown, damping: unknown}
- {name: neck, between: [head, block], stiffness: 900.0, damping: 0.4}
sensors: [{channel: v, of: head, shows: velocity, gain: 1.0, offset: 0.0, unit: m/s}]
"""
TRUE, RATE = (4.9, 37400.0, 17.2), 400.0  # frame's mass, stiffness and damping; Hz
DRIVEN = """
name: shaker
bodies: {block: 0.58}
springs: [{name: leaf, between: [block, ground], stiffness: unknown, damping: unknown}]
inputs: [{channel: 0, force_on: block, gain: 1.0, offset: 0.0}]
sensors: [{channel: 1, of: block, shows: velocity, gain: 1.0, offset: 0.0, unit: m/s}]
recording: {hold: first}
"""


def receptances(term: Term, constants: dict[str, float], omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return (omega, 2, 2) displacements of the rig's own bodies for forces on them, from assembled matrices."""
    assert isinstance(term.mechanism, AddedBody)
    rig = term.mechanism.extend(parse_rig(TWO).arrangement, term.values, term.place)
    mass, damping, stiffness = rig.matrices({**constants, **term.values})
    mass = np.diag(mass)
    dynamic = stiffness + 1j * omega[:, None, None] * damping - omega[:, None, None] ** 2 * mass
    return np.asarray(np.linalg.inv(dynamic)[:, :2, :2], np.complex128)


def constants_of(k: float, c: float) -> dict[str, float]:
    rig = parse_rig(TWO).arrangement
    leaf, neck = rig.elements
    known = {leaf.stiffness: k, leaf.damping: c, neck.stiffness: 900.0, neck.damping: 0.4}
    return {**{p.name: 1.0 for p in rig.parameters}, **dict(zip(rig.masses, (0.58, 0.31), strict=True)), **known}


@given(
    st.floats(300.0, 5000.0), st.floats(0.002, 0.3), st.floats(5.0, 40.0), st.booleans()
)  # leaf's stiffness, the other mass, its resonance, and which way round
def test_undamped_either_does_what_the_other_does(k: float, mass: float, hz: float, to_frame: bool) -> None:
    found, to = (PART, FRAME) if to_frame else (FRAME, PART)
    heavy = mass if to_frame else 200 * mass
    sizes = heavy, heavy * (2 * np.pi * hz) ** 2, 0.0
    term = Term(found, dict(zip(found.body, sizes, strict=True)), (0,))
    blank = Term(to, {q.name: 1.0 for q in to.parameters}, (0,))
    constants = constants_of(k, 0.0)
    start = mapped(parse_rig(TWO).arrangement, blank, term, constants)
    assert start is not None
    moved, other = start
    other = Term(to, {**other.values, to.body[2]: 0.0}, (0,))
    omega = 2 * np.pi * np.linspace(1.0, 60.0, 97)
    expected, got = receptances(term, constants, omega), receptances(other, moved, omega)
    np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_what_is_declared_exactly_stays_and_other_places_do_not_map() -> None:
    rig = parse_rig(TWO.replace("stiffness: unknown", "stiffness: 1200.0")).arrangement
    part = Term(PART, dict(zip(PART.body, (0.01, 40.0, 0.02), strict=True)), (0,))
    frame = Term(FRAME, {q.name: 1.0 for q in FRAME.parameters}, (0,))
    start = mapped(rig, frame, part, constants_of(1200.0, 0.5))
    assert start is not None
    assert start[0][str(rig.elements[0].stiffness)] == 1200.0
    on_head = Term(PART, part.values, (1,))
    assert mapped(rig, frame, on_head, constants_of(1200.0, 0.5)) is None
    assert mapped(rig, part, part, constants_of(1200.0, 0.5)) is None


@cache
def on_a_frame() -> Recording:
    """Return force and velocity of a driven body on a frame, by scipy's lsim."""
    k, c, (frame, stiffness, damping) = 1220.0, 0.64, TRUE
    springs = np.array([[k, -k], [-k, k + stiffness]])
    dampers = np.array([[c, -c], [-c, c + damping]])
    inverse = np.diag([1 / 0.58, 1 / frame])
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ springs, -inverse @ dampers]])
    band = signal.butter(4, 40.0, fs=RATE, output="sos")
    force = np.asarray(signal.sosfilt(band, np.random.default_rng(31).standard_normal(3000)))
    system = signal.StateSpace(state, np.array([[0], [0], [1 / 0.58], [0]]), [[0, 0, 1, 0]], [[0]])
    return recorded([force, signal.lsim(system, force, np.arange(3000) / RATE)[1]], RATE, 3e-3)


@pytest.mark.slow
def test_a_frame_that_is_stuck_is_begun_from_the_part_that_does_the_same() -> None:
    rig = parse_rig(DRIVEN)
    with np.errstate(all="ignore"):
        first = problem_of(rig, [prepare(on_a_frame(), rig)])
        linear = linear_fit(weighed(linear_fit(first)))
        problem = linear.problem
        terms = []
        for mechanism, sizes in ((FRAME, (60.0, 2750.0, 1.0)), (PART, (0.0045, 36.0, 0.015))):
            terms.append(Term(mechanism, dict(zip(mechanism.body, sizes, strict=True)), (0,)))
        fits = [(Score(t, 1e3, 3, 1.0, 0.0), fit(problem, (t,), linear)) for t in terms]
        assert fits[0][1].scatter > 1.2 * fits[1][1].scatter  # stuck; the test can fail
        (_, again), (_, same) = begun_from_another(problem, linear, fits)
    assert same is fits[1][1]
    assert again.scatter < 1.01 * same.scatter
    assert [again.terms[0].values[n] for n in FRAME.body] == pytest.approx(TRUE, rel=0.1)


@pytest.mark.slow
def test_a_frame_and_a_part_that_do_the_same_are_look_alikes_that_another_sensor_parts() -> None:
    answer = diagnose_recordings([on_a_frame()], parse_rig(DRIVEN), [FRAME, PART], learn=False).answer
    (named,) = answer.mechanisms
    assert {named.id, *named.indistinguishable_from} >= {FRAME.id, PART.id}
    assert answer.remainder.p_value > 0.01
    then = answer.next_experiment
    assert then is not None
    assert then.peak_force_ratio is None  # both are linear
    assert then.moves == ("other_place",)
