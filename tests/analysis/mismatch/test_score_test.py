"""Score tests against linear least squares with all unknowns at once, under known and under unknown noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Columns, Problem
from analysis.mismatch.recordings.fit import fit as fit_recordings
from analysis.mismatch.recordings.linear_rig import problem_of as recordings_of
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.ring_downs import signatures
from analysis.mismatch.ring_downs.fit import RingDownFit, fit
from analysis.mismatch.ringing_tests import RingingTests
from analysis.mismatch.score_test import Score, Screening, _Noise, _rung_scores, effective_number, screen
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input, recorded
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import at_work, listed

Real = NDArray[np.float64]
NAMES = ("hunt_crossley_damping", "micro_slip", "channel_gain", "guide_friction", "tube_spring_cubic")
DESCRIBED = """
bodies: {mass: 1}
springs: [{between: [mass, ground], damping: unknown}]
inputs: [{channel: 0, force_on: mass, gain: unknown, offset: 0.0}]
sensors: [{channel: 1, of: mass, shows: displacement}]
"""


@pytest.fixture(scope="module")
def ring_down() -> RingDownFit:
    with np.errstate(all="ignore"):  # of a trial step
        return fit(problem_of(session_of(with_law("hertz_stiffness"), noise=0.05)).only((0, 3, 5, 10)))


def left(segments: Sequence[Columns], precision: Real, size: int, term: int | None) -> tuple[float, Real, int]:
    """Return what least squares leaves with one further column (or none), all coefficients, and degrees of freedom."""
    more = 0 if term is None else 1
    starts = np.cumsum([size + more] + [s.own.shape[1] for s in segments])
    rows, right = [], []
    for i, s in enumerate(segments):
        row = np.zeros((s.residual.size, starts[-1]))
        row[:, s.where] = s.slopes
        if term is not None:
            row[:, size] = s.made[:, term]
        row[:, starts[i] : starts[i + 1]] = s.own
        rows.append(row)
        right.append(s.residual)
    prior = np.zeros((precision.size, starts[-1]))
    prior[:, : precision.size] = np.diag(np.sqrt(precision))
    matrix, y = np.vstack([*rows, prior]), np.concatenate([*right, np.zeros(precision.size)])
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    x = np.linalg.lstsq(matrix / scale, y, rcond=1e-12)[0] / scale
    samples = sum(s.residual.size - s.own.shape[1] for s in segments) - size
    return float(np.sum((y - matrix @ x) ** 2)), x, samples


def compared(problem: Problem[Any], fitted: Any, scores: Sequence[Score], known_noise: bool) -> None:
    terms: list[Term] = [s.term for s in scores]
    segments = [one for part in problem.columns(fitted, terms, []) for one in part]
    precision = problem.precision(fitted)
    size = precision.size
    before, _, samples = left(segments, precision, size, None)
    for i, score in enumerate(scores):
        after, x, _ = left(segments, precision, size, i)
        strength = float(x[size])
        gain = before - after if known_noise else samples * math.log(before / after)
        z = math.copysign(math.sqrt(gain), strength)
        one_sided = score.term.mechanism.one_signed
        assert score.strength == pytest.approx(strength, rel=1e-4)
        assert score.gain == pytest.approx(0.0 if one_sided and z < 0 else gain, rel=1e-3, abs=1e-3)
        p = norm.sf(z) if one_sided else 2 * norm.sf(abs(z))
        assert score.p_value == pytest.approx(p, rel=0.02, abs=1e-300)
        variance = 1.0 if known_noise else before / samples
        assert score.error == pytest.approx(abs(strength) * math.sqrt(variance / (before - after)), rel=1e-3)


def best_of_each(screening: Screening) -> list[Score]:
    found: dict[str, Score] = {}
    for score in screening.scores:
        found.setdefault(score.term.mechanism.id, score)
    return list(found.values())


def test_scores_under_known_noise_are_what_least_squares_gains(ring_down: RingDownFit) -> None:
    screening = screen(ring_down.problem, ring_down, [listed(name) for name in NAMES])
    compared(ring_down.problem, ring_down, best_of_each(screening), known_noise=True)


@pytest.mark.slow
def test_scores_under_unknown_noise_are_likelihood_ratios_of_least_squares() -> None:
    u, omega = noise_input(2400, 200.0, 2, 25, seed=3), 2 * np.pi * 12
    y = motion(
        lambda s, x, v: 100 * s - omega**2 * x * (1 + 0.05 * x * x) - 0.04 * omega * v, [0.0, 0.0], 2400, 200.0, u
    )
    rig = parse_rig(DESCRIBED)
    problem = recordings_of(rig, [prepare(recorded([u, y[0]], 200.0, 0.05), rig)])
    fitted = fit_recordings(problem, fine=True)
    known = [catalogue()[name][-1] for name in ("tube_spring_cubic", "quadratic_damping", "guide_friction")]
    compared(problem, fitted, best_of_each(screen(problem, fitted, known)), known_noise=False)


def test_the_score_of_a_weak_effect_is_what_its_fit_gains() -> None:
    session = session_of(with_law(), noise=0.02)
    problem = problem_of(session).only((0, 3, 5, 10))
    linear = fit(problem)
    (score,) = screen(problem, linear, [listed("channel_gain")]).scores
    strength = score.strength * score.term.values["gain_error_of_b"]
    fitted = fit(problem, [at_work("channel_gain", {"gain_error_of_b": strength})], linear)
    assert score.gain == pytest.approx(linear.objective - fitted.objective, rel=0.02, abs=0.02)
    assert fitted.terms[0].values["gain_error_of_b"] == pytest.approx(strength, rel=0.02)


@pytest.mark.slow
def test_scores_do_not_depend_on_how_segments_are_shared_out(
    monkeypatch: pytest.MonkeyPatch, ring_down: RingDownFit
) -> None:
    found = {}
    for parts in (1, 2, 3):
        monkeypatch.setattr(signatures, "PARTS", parts)
        screening = screen(ring_down.problem, ring_down, variants(catalogue()))
        found[parts] = {(s.term.mechanism.id, str(s.term.values)): s.gain for s in screening.scores}
    for parts in (2, 3):
        assert found[parts].keys() == found[1].keys()
        np.testing.assert_allclose([found[parts][k] for k in found[1]], list(found[1].values()), rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("known", [True, False])
def test_bodies_tried_side_by_side_count_as_fewer_tests_than_they_are(
    known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem: Any
    fitted: Any
    counted: list[tuple[int, float]] = []

    def counting(chances: Real) -> float:
        counted.append((len(chances), effective_number(chances)))
        return counted[-1][1]

    monkeypatch.setattr("analysis.mismatch.score_test.effective_number", counting)
    if known:
        problem = problem_of(session_of(with_law(), noise=0.02)).only((0, 3, 5, 10))
        fitted = fit(problem)
    else:
        u, omega = noise_input(2400, 200.0, 2, 25, seed=3), 2 * np.pi * 12
        y = motion(lambda s, x, v: 100 * s - omega**2 * x - 0.04 * omega * v, [0.0, 0.0], 2400, 200.0, u)
        rig = parse_rig(DESCRIBED)
        problem = recordings_of(rig, [prepare(recorded([u, y[0]], 200.0, 0.05), rig)])
        fitted = fit_recordings(problem, fine=True)
    screen(problem, fitted, [catalogue()["attached_mass"][0 if known else -1]])
    ((tried, effective),) = counted
    assert tried > 10
    assert 2 < effective < 0.8 * tried


@pytest.mark.parametrize("tests", [1, 30])
def test_independent_tests_count_as_many_as_they_are_and_repeated_ones_as_one(tests: int) -> None:
    chances = np.random.default_rng(2).uniform(size=(tests, 4000))
    assert effective_number(chances) == pytest.approx(tests, rel=0.05)
    assert effective_number(np.repeat(chances[:1], 12, axis=0)) == pytest.approx(1, rel=0.05)
    assert effective_number(np.zeros((tests, 0))) == tests


@pytest.mark.parametrize("wide", [False, True])
def test_gains_of_free_amplitudes_count_as_chi_squared_where_noise_makes_three_times_as_much(wide: bool) -> None:
    """Of what rings at a resonance draws of the noise make more than of white noise: their p-values stay uniform."""
    draws, dof, larger = 4000, 6, 3.0 if wide else 1.0
    tests = RingingTests([0], 0, draws)
    tests.dof[0] = dof
    tests.gain[0] = np.append(larger * np.random.default_rng(4).chisquare(dof, draws), larger * 20.0)
    (score,), by_chance = _rung_scores(
        [Term(listed("mains_hum"), {}, (0,))], tests, np.zeros(0), _Noise(True, 1.0, 1000, wide)
    )
    assert score.gain == pytest.approx(20.0, rel=0.05)
    assert score.p_value == pytest.approx(chi2.sf(20.0, dof), rel=0.3)
    assert np.mean(by_chance < 0.05) == pytest.approx(0.05, abs=0.012)
