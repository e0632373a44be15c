"""The motion that recordings show, whatever the forces, and laws held against it: rigs by scipy's own integrators."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import StateSpace, lsim

from analysis.mismatch.diagnosis import diagnose
from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import silent
from analysis.mismatch.recordings.along_the_motion import (
    curves_along,
    laws_along,
    one_law_tells,
    ranked_along,
    with_largest_fitted,
)
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.otherwise import constant_that_explains, may_explain
from analysis.mismatch.recordings.ranking import Ranking
from analysis.mismatch.recordings.recorded import FIT, prepare
from analysis.mismatch.recordings.regression import Regression, regression_of
from analysis.mismatch.recordings.shown_motion import shown_motion
from analysis.mismatch.score_test import screen
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.learned.families import form_of, learned_mechanisms
from sim_backend.learned.forms import FORM
from sim_backend.learned.kept import kept_law
from sim_backend.mechanisms.catalogue import catalogue, family, variants
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input

Real = NDArray[np.float64]
RATE, SAMPLES = 500.0, 3000
M, K, C = (1.0, 0.6), (4000.0, 3000.0), (2.0, 1.0)
RIG = """
bodies: {foot: 1.0, head: 0.6}
springs:
- {name: stand, between: [foot, ground], damping: unknown}
- {name: neck, between: [head, foot], damping: unknown}
inputs: [{channel: 0, force_on: foot}]
sensors:
- {channel: 1, of: foot, shows: SHOWS}
- {channel: 2, of: head, shows: SHOWS}
"""
NOISE = 0.002
LISTED = variants(catalogue())

Law = Callable[[Real, Real], Real]
"""From deformations and rates of stand and neck to the force in each beside spring and damper."""


def growing(d: Real, v: Real) -> Real:
    """Return a damper in the stand that grows with the fourth power of the deflection."""
    return np.array([2e9 * d[0] ** 4 * v[0], 0.0])


def saturating(d: Real, v: Real) -> Real:
    return np.array([0.0, 20.0 * np.tanh(d[1] / 3e-3)])


def stiffer_one_way(d: Real, v: Real) -> Real:
    """Return a stiffness of the neck from 30 % less to 30 % more, smoothly: nearly a squared force and a stop."""
    z = abs(d[1]) / 8e-3
    return np.array([0.0, 0.3 * K[1] * 8e-3 * (z + np.log1p(np.exp(-2 * z)) - np.log(2))])


def cubic(d: Real, v: Real) -> Real:
    return np.array([0.0, 2e7 * d[1] ** 3])


def cubic_and_drag(d: Real, v: Real) -> Real:
    return np.array([0.0, 2e7 * d[1] ** 3 + 40.0 * v[1] * abs(v[1])])


def nothing(d: Real, v: Real) -> Real:
    return np.zeros(2)


@cache
def moved(law: Law) -> tuple[Real, Real, Real]:
    """Return a force, states and accelerations of the rig with a law."""
    u = 12.0 * noise_input(SAMPLES, RATE, 3.0, 25.0, seed=3)

    def rest(force: float, x: Real, v: Real) -> Real:
        d, w = np.array([x[0], x[1] - x[0]]), np.array([v[0], v[1] - v[0]])
        f = K * d + C * w + law(d, w)
        return np.array([(force - f[0] + f[1]) / M[0], -f[1] / M[1]])

    states = motion(rest, [0.0] * 4, SAMPLES, RATE, u)
    accelerations = np.array([rest(*one) for one in zip(u, states[:2].T, states[2:].T, strict=True)]).T
    return u, states, accelerations


def recorded_with(law: Law, shows: str) -> Recording:
    u, states, accelerations = moved(law)
    rows = states[:2] if shows == "displacement" else accelerations
    noisy = rows + NOISE * rows.std() * np.random.default_rng(4).normal(size=rows.shape)
    return Recording(np.array([u, *noisy]), RATE, ("force", "foot", "head"), "", "simulated")


@cache
def fitted(law: Law, shows: str = "displacement") -> SimulatedFit:
    recording = recorded_with(law, shows)
    rig = parse_rig(RIG.replace("SHOWS", shows))
    with np.errstate(all="ignore"):
        return linear_fit(weighed(linear_fit(problem_of(rig, [prepare(recording, rig)]))))


def regression(law: Law, shows: str = "displacement") -> Regression:
    found = regression_of(fitted(law, shows))
    assert found is not None
    return found


@pytest.mark.parametrize("shows", ["displacement", "acceleration"])
def test_the_motion_is_found_though_the_law_is_not_known(shows: str) -> None:
    linear = fitted(saturating, shows)
    shown, states = shown_motion(linear, 0), moved(saturating)[1]
    assert shown is not None
    begun = linear.simulation.motion(linear.x, linear.own[0], 0, linear.problem.recordings[0].fitted, False)
    assert begun is not None
    slow = states[:2] - states[:2].mean(axis=1, keepdims=True) if shows == "acceleration" else states[:2]
    for rows, truth, before in (
        (shown.displacement, slow, begun.states[:, :2]),
        (shown.velocity, states[2:], begun.states[:, 2:]),
    ):
        off = float(np.std(rows[100:-100].T - truth[:, 100:-100]) / truth.std())
        assert off < 0.03
        # the test can fail: the linear rig is far from it
        assert off < 0.2 * float(np.std(before[100:-100].T - truth[:, 100:-100]) / truth.std())


def test_what_channels_show_of_a_force_is_what_scipy_computes() -> None:
    linear = fitted(nothing)
    shown = shown_motion(linear, 0)
    assert shown is not None
    mass, damping, stiffness = linear.simulation.arrangement.matrices(linear.values)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    row, force = np.array([1.0, -1.0]), np.random.default_rng(5).normal(size=400)
    b, c = np.concatenate([[0, 0], row / mass])[:, None], np.eye(4)[:2]
    expected = lsim(StateSpace(a, b, c, np.zeros((2, 1))), force, np.arange(400) / RATE)[1].T
    found = shown.answer.to(force[None], row)[0] * linear.problem.recordings[0].unit[:, None]
    assert found == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("shows", ["displacement", "acceleration"])
def test_a_law_is_told_with_its_numbers_and_its_place_before_anything_is_simulated(shows: str) -> None:
    along = regression(growing, shows)
    found = sorted(laws_along(along, learned_mechanisms(one_load=True)), key=lambda one: one.left)
    best = found[0]
    assert best.term.place == (0,)
    values = best.term.values
    assert values["deflection_exponent"] == pytest.approx(4.0, rel=0.03)
    size = values["force_n"] / values["reference_deflection_m"] ** 4 / values["reference_rate_m_per_s"]
    near = 0.7 * values["reference_deflection_m"]
    exponent = values["deflection_exponent"]
    at_this = size * values["reference_deflection_m"] ** (4 - exponent) * near**exponent
    assert at_this == pytest.approx(2e9 * near**4, rel=0.03)
    assert best.constants["stiffness of stand"] == pytest.approx(K[0], rel=0.01)
    assert best.constants["stiffness of neck"] == pytest.approx(K[1], rel=0.01)
    elsewhere = [one for one in found if one.term.place == (1,)]
    assert min(one.left for one in elsewhere) > 10 * best.left


def test_a_curve_says_what_no_formula_does() -> None:
    curves = sorted(curves_along(regression(saturating)), key=lambda one: one.left)
    best = curves[0]
    assert best.term.place == (1,)
    assert best.left < 0.05 * regression(saturating).without
    other_places = [one for one in curves if one.term.place != (1,)]
    assert min(one.left for one in other_places) > 10 * best.left


@pytest.mark.parametrize(
    ("law", "told"),
    [(growing, True), (cubic, False), (cubic_and_drag, False), (nothing, False), (stiffer_one_way, True)],
    ids=["growing damper", "cubic, which is listed", "two that are listed", "nothing", "nearly two that are listed"],
)
def test_one_law_tells_only_where_nothing_listed_and_no_two_of_it_do(law: Law, told: bool) -> None:
    assert one_law_tells(fitted(law), LISTED, learned_mechanisms(one_load=True)) is told


def declared(law: Law, **stiffness: float) -> SimulatedFit:
    """Return the linear rig fitted where a stiffness of the neck is declared and taken for exact."""
    rig = parse_rig(
        RIG.replace("SHOWS", "displacement").replace("{name: neck,", f"{{name: neck, stiffness: {stiffness['neck']},")
    )
    recording = recorded_with(law, "displacement")
    with np.errstate(all="ignore"):
        return linear_fit(weighed(linear_fit(problem_of(rig, [prepare(recording, rig)]))))


def test_a_spring_that_was_declared_wrongly_is_no_law_and_its_stiffness_is_told() -> None:
    wrong = declared(nothing, neck=2600.0)
    assert wrong.scatter > 10 * fitted(nothing).scatter
    assert not one_law_tells(wrong, LISTED, learned_mechanisms(one_load=True))
    with np.errstate(all="ignore"):
        found = constant_that_explains(wrong, lambda one: screen(wrong.problem, one, LISTED), silent)
    assert found is not None
    assert found.said.startswith("leaves the stiffness of neck unknown, which is then ")
    assert float(found.said.split()[-1]) == pytest.approx(3000.0, rel=0.002)


def test_beside_a_law_a_stiffness_that_was_declared_rightly_is_not_doubted() -> None:
    linear = declared(growing, neck=3000.0)
    with np.errstate(all="ignore"):
        assert constant_that_explains(linear, lambda one: screen(linear.problem, one, LISTED), silent) is None


def test_constants_are_tried_with_other_values_only_where_these_may_explain() -> None:
    """Of a rig of three floors with two effects none of seven could, and trying them took 27 of 180 s."""
    wrong, right = declared(nothing, neck=2600.0), fitted(nothing)
    assert may_explain("stiffness of neck", wrong, right)
    for law in (saturating, cubic):
        names = sorted(p.name for p in fitted(law).problem.arrangement.parameters)
        assert "mass of head" in names
        assert [name for name in names if may_explain(name, fitted(law), right)] == []


def test_two_laws_are_told_together() -> None:
    along = regression(cubic_and_drag)
    rig = along.fitted.problem.arrangement
    bent, drag = (
        next(m for m in family(name) or () if (1,) in m.places(rig))
        for name in ("tube_spring_cubic", "quadratic_damping")
    )
    alone = along.regressed(Term(bent, {"cubic_stiffness_n_per_m3": 1.0}, (1,)))
    both = along.regressed(
        Term(bent, {"cubic_stiffness_n_per_m3": 1.0}, (1,)), Term(drag, {"quadratic_damping_n_s2_per_m2": 1.0}, (1,))
    )
    assert alone is not None
    assert both is not None
    assert both.terms[0].values["cubic_stiffness_n_per_m3"] == pytest.approx(2e7, rel=0.03)
    assert both.terms[1].values["quadratic_damping_n_s2_per_m2"] == pytest.approx(40.0, rel=0.05)
    assert alone.left > 5 * both.left


def test_laws_that_leave_much_more_than_the_best_are_not_fitted() -> None:
    linear = fitted(cubic)
    ranking = ranked_along(linear, LISTED, Ranking((), 0))
    first = [scores[0].term for scores in ranking.scores[: ranking.finalists]]
    assert (first[0].mechanism.id, first[0].place) == ("tube_spring_cubic", (1,))
    assert len(first) < 4


def test_a_curve_that_was_kept_is_listed_and_no_other_is_learned_beside_it() -> None:
    curve = min(curves_along(regression(saturating)), key=lambda one: one.left).term
    kept = kept_law(
        "kept_curve", form_of(curve.values).key, acts_in="spring", preloaded=False, component="",
        values={k: v for k, v in curve.values.items() if k != FORM}, free={}, learned_from={"before.csv": "0" * 64},
    )  # fmt: skip
    linear, known = fitted(saturating), [*LISTED, kept]
    assert not one_law_tells(linear, known, learned_mechanisms(one_load=True))
    ranking = ranked_along(linear, known, Ranking((), 0))
    first = [scores[0].term for scores in ranking.scores[: ranking.finalists]]
    assert (first[0].mechanism.id, first[0].place) == ("kept_curve", (1,))
    assert all(FORM not in term.values for term in first)
    # the test can fail: without it one is learned
    assert one_law_tells(linear, LISTED, learned_mechanisms(one_load=True))


def test_where_nothing_stands_out_the_ranking_by_scores_stands() -> None:
    others = Ranking((), 0)
    assert ranked_along(fitted(nothing), LISTED, others) is others


def test_the_largest_motion_is_fitted() -> None:
    linear = fitted(cubic)
    recorded, states = linear.problem.recordings[0], moved(cubic)[1][:2]
    largest = int(np.argmax(np.max(np.abs(states) / np.abs(states).max(axis=1, keepdims=True), axis=0)))
    divided: SimulatedRecordings = with_largest_fitted(linear)
    assert divided.recordings[0].part[largest] == FIT
    counts = [np.count_nonzero(r.part == FIT) for r in (recorded, divided.recordings[0])]
    assert abs(counts[0] - counts[1]) < recorded.samples // 24


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "place", "kind"), [(growing, "stand", "rate"), (saturating, "neck", "static")], ids=["formula", "curve"]
)
def test_a_law_in_no_list_is_learned(law: Law, place: str, kind: str) -> None:
    with np.errstate(all="ignore"):
        answer = diagnose(fitted(law).problem, LISTED).answer
    (named,) = answer.mechanisms
    assert answer.verdict == "new_physics"
    assert named.element == place
    assert named.law is not None
    assert named.law.kind == kind
    assert answer.remainder.p_value > 1e-3
    if law is growing:
        exponent = named.law.exponents["deflection"]
        assert exponent is not None
        assert exponent.low <= 4.0 <= exponent.high
        return
    table = named.law.table
    assert table is not None
    d = np.asarray(table.axes["deflection_m"])
    inner = np.abs(d) < 0.8 * d.max()  # the ends of what the recording covers were hardly visited
    truth = 20.0 * np.tanh(d / 3e-3)
    own = np.polyval(np.polyfit(d[inner], (table.force_n - truth)[inner], 1), d)  # is the element's stiffness
    off = table.force_n - own - truth
    assert np.abs(off[inner]).max() < 0.02 * truth.max()
    assert np.all((table.low - own <= truth + 0.01 * truth.max()) & (truth - 0.01 * truth.max() <= table.high - own))
