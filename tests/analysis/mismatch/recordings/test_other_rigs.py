"""Other linear rigs to begin from: those that show the same, and those that a strong law hides."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.joining import joined_to
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.other_rigs import equal_constants, likelier_rig
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.rig_description import DescribedRig
from analysis.mismatch.score_test import screen
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import (
    INPUT,
    RATE,
    SAMPLES,
    SPRING,
    duffing,
    motion,
    noise_input,
    recorded,
    sensor,
)
from tests.analysis.terms import listed

THREE = """
bodies: {{left: {left}, right: {right}}}
springs:
- {{name: a, between: [left, ground], stiffness: unknown, damping: unknown}}
- {{name: b, between: [right, left], stiffness: unknown, damping: unknown}}
- {{name: c, between: [right, ground], stiffness: unknown, damping: unknown}}
sensors: [{{channel: 0, of: left, shows: displacement, unit: m}}]
"""
DECK = """
bodies: {base: 14.0, top: 9.0}
springs:
- {name: foot, between: [base, ground], stiffness: unknown, damping: unknown}
- {name: column, between: [top, base], stiffness: unknown, damping: unknown}
inputs: [{channel: 0, force_on: base, offset: 0.0}]
sensors: [{channel: 1, of: top, shows: displacement, unit: m}]
recording: {hold: band-limited}
"""


def poles(mass: NDArray[np.float64], three: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the four poles of two bodies on three springs, (2, 3) stiffnesses and dampings."""
    k, c = (np.array([[a + b, -b], [-b, b + d]]) / mass[:, None] for a, b, d in three)
    found = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-k, -c]]))
    return found[np.lexsort((found.real.round(9), found.imag))]


def three_of(values: dict[str, float]) -> NDArray[np.float64]:
    names = [f"{of} of {name}" for of in ("stiffness", "damping") for name in "abc"]
    return np.array([values[name] for name in names]).reshape(2, 3)


positive = st.floats(0.3, 3.0)


@given(
    mass=st.tuples(positive, positive),
    k=st.tuples(positive, positive, positive),
    ratio=st.tuples(*[st.floats(0.008, 0.02)] * 3),
)
@settings(max_examples=30, deadline=None)
def test_equal_rigs_have_the_same_poles_and_other_stiffnesses(
    mass: tuple[float, float], k: tuple[float, float, float], ratio: tuple[float, float, float]
) -> None:
    rig = parse_rig(THREE.format(left=mass[0], right=mass[1]))
    own = np.array([np.array(k) * 1e4, np.array(ratio) * 200])
    names = [f"{of} of {name}" for of in ("stiffness", "damping") for name in "abc"]
    known = {p.name: p.value for p in rig.arrangement.parameters} | dict(zip(names, own.ravel(), strict=True))
    true = poles(np.array(mass), own)
    rigs = [three_of(values) for values in equal_constants(rig, known)]
    for other in rigs:
        # a free decay seen at one body: any amplitudes and phases, so that the poles are all that is shown
        np.testing.assert_allclose(poles(np.array(mass), other), true, rtol=1e-6)
        assert np.abs(np.log(other[0] / own[0])).max() > 0.25


def test_three_springs_seen_at_one_body_have_equals_both_ways() -> None:
    rig = parse_rig(THREE.format(left=1.0, right=1.0))
    known = {p.name: {"N/m": 1e4, "N s/m": 1.0}.get(p.unit, p.value) for p in rig.arrangement.parameters}
    middle = [values["stiffness of b"] for values in equal_constants(rig, known)]
    assert min(middle) < 0.9e4
    assert len(middle) >= 2


def test_a_rig_that_is_determined_has_no_equal() -> None:
    rig = parse_rig(DECK)
    assert equal_constants(rig, {p.name: 1.0 for p in rig.arrangement.parameters}) == []


def lowest_hz(recordings: list[Recording], rig: DescribedRig) -> float:
    """Return the lowest undamped mode of the linear rig that is fitted, Hz."""
    with np.errstate(all="ignore"):
        fitted = linear_fit(problem_of(rig, [prepare(r, rig) for r in recordings]))
    mass, _, stiffness = rig.arrangement.matrices(fitted.values)
    return math.sqrt(np.linalg.eigvals(stiffness / mass[:, None]).real.min()) / (2 * math.pi)


@cache
def hardening() -> list[Recording]:
    """Return three decays of bodies between which a spring hardens: one mode shifts by much more than its width."""
    mass, k, c = np.array([1.7, 1.1]), np.array([6.04e4, 2.67e4, 2.1e4]), np.array([3.2, 1.96, 1.82])

    def rest(s: float, x: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        apart, rate = x[1] - x[0], v[1] - v[0]
        middle = k[1] * apart + c[1] * rate + 8e8 * apart**3
        return np.array([middle - k[0] * x[0] - c[0] * v[0], -middle - k[2] * x[1] - c[2] * v[1]]) / mass

    starts = [[0.002 * share, -0.0012 * share, 0.0, 0.1 * share] for share in (1.0, 0.55, 0.3)]
    return [recorded([motion(rest, s, 2500, 400.0)[0]], 400.0, 0.01, seed=i) for i, s in enumerate(starts)]


@pytest.mark.slow
def test_a_strong_law_that_hides_a_mode_from_the_linear_fit_is_named() -> None:
    known = [listed(i) for i in ("tube_spring_cubic", "end_stop", "quadratic_damping", "attached_mass")]
    rig = parse_rig(THREE.format(left=1.7, right=1.1))
    assert lowest_hz(hardening(), rig) > 35  # it is at 26.3 Hz
    (named,) = diagnose_recordings(hardening(), rig, known, learn=False).answer.mechanisms
    assert (named.id, named.element) == ("tube_spring_cubic", "b")
    assert named.parameters["cubic_stiffness_n_per_m3"].value == pytest.approx(8e8, rel=0.01)


@cache
def on_a_frame() -> list[Recording]:
    """Return a slow sweep of two bodies, of which one is seen, on a frame that is soft."""
    mass, k, c = np.array([56.0, 14.0, 9.0]), np.array([4.68e4, 3.27e4, 2.63e4]), np.array([129.5, 20.8, 7.6])

    def rest(s: float, x: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        pulls = k * np.diff(x, prepend=0.0) + c * np.diff(v, prepend=0.0)
        return np.asarray((np.append(np.diff(pulls), -pulls[-1]) + np.array([0.0, s, 0.0])) / mass)

    t = np.arange(5000) / 80
    u = 30 * np.sin(2 * np.pi * (1.5 * t + 20.5 * t**2 / 2 / t[-1])) * np.clip(np.minimum(t, t[-1] - t) / 2, 0, 1)
    return [recorded([u, motion(rest, [0.0] * 6, 5000, 80.0, u)[2]], 80.0, 0.004)]


@pytest.mark.slow
def test_a_frame_under_two_bodies_is_named_though_the_linear_fit_puts_a_mode_at_the_wrong_body() -> None:
    known = [listed(i) for i in ("frame_compliance", "attached_mass", "tube_spring_cubic", "relaxation")]
    (named,) = diagnose_recordings(on_a_frame(), parse_rig(DECK), known, learn=False).answer.mechanisms
    assert (named.id, named.element) == ("frame_compliance", "foot")
    assert named.parameters["frame_mass_kg"].value == pytest.approx(56.0, rel=0.001)


def test_a_contact_that_a_fit_has_left_without_stiffness_is_given_no_law_of_its_preload() -> None:
    rig = parse_rig(
        "bodies: {mass: 1}\ncontacts: [{name: pad, between: [mass, ground], preload: 5.0}]\n"
        "sensors: [{channel: 0, of: mass, shows: displacement}]\n"
    )
    decay = motion(lambda s, x, v: -5700 * x - 1.2 * v, [0.01, 0.0], 800, 200.0)[0]
    known = [listed("menisci"), listed("adhesion"), listed("tube_spring_cubic")]
    with np.errstate(all="ignore"):
        problem = problem_of(rig, [prepare(recorded([decay], 200.0, 0.01), rig)])
        fitted = linear_fit(problem)
        assert {t.mechanism.id for t in problem.trials(fitted, known)} == {m.id for m in known}
        at = [p.name for p in fitted.simulation.parameters].index("stiffness of pad")
        gone = fitted.x.copy()
        gone[at] = -1e4  # its logarithm
        assert {t.mechanism.id for t in problem.trials(replace(fitted, x=gone), known)} == {"tube_spring_cubic"}


def test_a_rig_too_stiff_to_be_stepped_is_no_other_start() -> None:
    """Beside one of a damping of 1e13 N s/m, a fit to spectra, the scale of a damper's rate was zero."""
    rig = parse_rig(SPRING + INPUT + sensor("velocity"))
    begun = problem_of(rig, [prepare(duffing(noise_input(SAMPLES, RATE, 2, 25, seed=3)), rig)])
    linear = BlockJudge.of(begun, []).baseline()
    laws = [m for m in variants(catalogue()) if m.id == "quadratic_damping"]
    (damping,) = (name for name in linear.values if name.startswith("damping"))
    still = {**linear.values, damping: 1e13}
    problem = replace(linear.problem, rivals=((still, (linear.state(0),)),))
    best, nearest = likelier_rig(
        problem,
        linear,
        lambda beside: screen(problem, beside, laws, ranks=True),
        lambda beside, score: joined_to(problem, beside, score),
    )
    assert best is linear
    assert [t.mechanism.id for t in nearest.terms] == ["quadratic_damping"]
