"""What terms add to segments: second impacts and delayed channels against closed forms, and many segments at once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.ring_downs.added_response import BEYOND, AddedResponse, Variant, rung, second_impact
from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.fit import RingDownFit, RingDowns, Stop, fit
from analysis.mismatch.ring_downs.linear import LinearRig
from analysis.mismatch.ring_downs.response import Response
from analysis.mismatch.score_test import screen
from sim_backend.propagate import Clock, Impact, Rigs, laws_of, propagate
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import at_work, listed

RATE = 25e3
PULSE_S = 0.31e-3
POLE = -400.0 + 2j * np.pi * 2900.0
DRIVE = 0.7 - 0.2j


@pytest.fixture(scope="module")
def problem() -> RingDowns:
    whole = problem_of(session_of(with_law("hertz_stiffness"), noise=0.01))
    return whole.only([0, 1, 2, len(whole.experiment.segments) - 1])


@pytest.fixture(scope="module")
def baseline(problem: RingDowns) -> RingDownFit:
    with np.errstate(all="ignore"):  # of a trial step
        return fit(problem)


def response_of(poles: Any, filtered: Any) -> Response:
    """Modes that the channels show so, without a filter."""
    p, c = len(poles), len(filtered)
    one = np.ones((1, p), np.complex128)
    rig = LinearRig(
        poles, one, one, one[0], filtered, filtered, filtered, np.zeros((c, 1)), np.full(p, 2.0)
    )  # fmt: skip
    none = np.zeros((0, p), np.complex128)
    return Response(rig, none, none, none, poles, rig.weight, np.zeros((0, c, p), np.complex128), np.zeros((0, c)))


def response(t: np.ndarray) -> np.ndarray:
    """Twice the real part of a mode under half a sine from 0 to PULSE_S, from rest."""
    w = np.pi / PULSE_S
    inside = np.clip(t, 0.0, PULSE_S)
    driven = (w * np.exp(POLE * inside) - w * np.cos(w * inside) - POLE * np.sin(w * inside)) / (POLE**2 + w**2)
    return 2 * (DRIVE * driven * np.exp(POLE * np.maximum(t - PULSE_S, 0.0))).real * (t > 0)


def ended() -> complex:
    """Amplitude of the mode at the end of the pulse."""
    w = np.pi / PULSE_S
    return DRIVE * w * (np.exp(POLE * PULSE_S) + 1) / (POLE**2 + w**2)


@pytest.mark.parametrize("delay", [60.0, 61.37, 75.5])
def test_a_second_impact_is_the_first_one_again_while_it_acts_and_after(delay: float) -> None:
    start, n = 13, 400
    t = np.arange(n) / RATE
    pulse = response((np.arange(-5, start)) / RATE)[None]
    start_s = start / RATE
    segment = Segment("", response(start_s + t)[None], np.zeros((1, n)), start_s, 0, 0.1, 0, 0, pulse)
    segment = replace(segment, second=delay - segment.since_tap_s * RATE)
    to = response_of(np.array([POLE]), np.array([[1.0 + 0j]]))
    amplitude = np.array([ended() * np.exp(POLE * (start_s - PULSE_S))])
    found = second_impact(to, amplitude, segment, RATE)[0]
    expected = response(start_s + t - delay / RATE)
    rings = start_s + t - delay / RATE >= start_s
    assert np.allclose(found[rings], expected[rings], rtol=0, atol=1e-12 * np.abs(expected).max())
    assert np.abs(found - expected).max() < 0.03 * np.abs(expected).max()  # the pulse has a corner at either end


def test_a_law_feels_a_second_impact_as_if_the_rig_had_been_struck_anew() -> None:
    h, steps, at = 1 / RATE / 4, 900, 317
    creep = listed("contact_creep").law  # its force is proportional to the deformation: motions add up
    laws = laws_of([(creep, 0)], [[np.array([1.0, 2e6, 10.0, h, 0.2, 5e-3])]])
    stiffness, damping = np.array([[[3e6, -2e6], [-2e6, 2.5e6]]]), 10.0 * np.array([[[1.0, -1.0], [-1.0, 1.0]]])
    rigs = Rigs(np.array([[0.1, 0.12]]), damping, stiffness, np.array([[[1.0, -1.0]]]), np.zeros((1, 2, 0)))
    begun, again = np.array([[1e-8, 0.0, 1e-4, 2e-4]]), np.array([[2e-8, -1e-8, 3e-4, 0.0]])

    def forces(start: np.ndarray, t0: float, count: int, struck: int) -> np.ndarray:
        impact = Impact(np.array([struck]), again)
        return propagate(rigs, laws, start, Clock(np.array([t0]), h, count, 0), impact=impact).forces[0, 0]

    both = forces(begun, 0.0, steps, at)
    one_by_one = forces(begun, 0.0, steps, -1)
    one_by_one[at:] += forces(again, at * h, steps - at, -1)
    assert np.abs(both - one_by_one).max() < 1e-4 * np.abs(one_by_one[at:]).max()
    assert np.abs(both - forces(begun, 0.0, steps, -1)).max() > 0.05 * np.abs(both).max()


@pytest.mark.parametrize("delay", [-1.6, -0.587, 0.3, 2.4])
def test_a_delayed_channel_is_right_to_the_ends_of_the_segment(
    problem: RingDowns, baseline: RingDownFit, delay: float
) -> None:
    segment, term = baseline.segments[0], at_work("channel_skew", {"delay_of_b_samples": delay})
    to, amplitudes, rate = baseline.responded(segment.group), baseline.amplitudes[0], problem.experiment.sample_rate_hz
    n = segment.y.shape[1]
    (found,) = AddedResponse(problem, [term], 1).extra([(segment, Variant((term,), amplitudes, {}, to))])
    earlier = rung(to, amplitudes * np.exp(-delay / rate * to.rig.poles), 1 / rate, n)
    expected = problem.experiment.noise[1].whiten((earlier - rung(to, amplitudes, 1 / rate, n))[1])
    assert abs(delay) < BEYOND
    assert np.abs(found[1] - expected).max() < 1e-4 * np.abs(expected).max()
    assert not found[0].any()


@pytest.mark.parametrize("name", ["hunt_crossley_damping", "micro_slip", "clipping"])
def test_segments_carried_together_are_those_carried_alone(
    problem: RingDowns, baseline: RingDownFit, name: str
) -> None:
    score = screen(problem, baseline, [listed(name)]).scores[0]
    terms = (at_work(name, score.term.values),)
    added, constants = AddedResponse(problem, terms, 4), baseline.constants
    _, to = added.modes(constants)
    runs = []
    for segment, amplitudes in zip(baseline.segments, baseline.amplitudes, strict=True):
        for factor in np.linspace(0.5, 1.5, 12):
            variant = Variant(terms, factor * amplitudes, constants.at(segment.group), to[segment.group])
            runs.append((segment, variant))
    together = added.extra(runs)
    assert max(float(np.abs(one).max()) for one in together) > 0
    for run, found in zip(runs, together, strict=True):
        np.testing.assert_array_equal(found, added.extra([run])[0])


def test_two_tubes_of_one_frequency_ring_as_one_pulse_makes_them(baseline: RingDownFit) -> None:
    mass, omega = 1e-3, 2 * np.pi * 4800.0
    values = {
        "tube_mode_mass_kg": mass,
        "tube_mode_stiffness_n_per_m": mass * omega**2,
        "tube_mode_damping_n_s_per_m": 0.02 * mass * omega,
    }
    term = at_work("tube_mode", values)
    with np.errstate(all="ignore"):  # of a trial step
        fits = [
            fit(baseline.problem, [t], baseline, stop=Stop(iterations=1)) for t in (term, replace(term, freed=True))
        ]
    together, apart = (f.modes[0] for f in fits)
    assert together.coefficients == baseline.modes[0].coefficients + 2
    assert apart.coefficients == baseline.modes[0].coefficients + 4
    (locked,), (other,) = together.phase_locked, together.rings_with
    frequencies = np.abs(together.rig.poles[[locked, other]]) / (2 * np.pi)
    np.testing.assert_allclose(frequencies, 4800, rtol=0.03)
    ratio = together.rig.drive[locked] / together.rig.drive[other]
    amplitudes = fits[0].amplitudes[0]
    since = fits[0].segments[0].since_tap_s
    turned = np.exp((together.rig.poles[locked] - together.rig.poles[other]) * since)
    assert amplitudes[locked] / amplitudes[other] == pytest.approx(ratio * turned)
