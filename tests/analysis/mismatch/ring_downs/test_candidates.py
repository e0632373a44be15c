"""Full fits of candidates: where they begin, which are out, which are looked for again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import POLICY
from analysis.mismatch.ring_downs import candidates
from analysis.mismatch.ring_downs.candidates import (
    _with_scales_found_again,
    competing,
    looked_for_again,
    stiffness_evidence,
    variants,
)
from analysis.mismatch.ring_downs.fit import Start, fit
from analysis.mismatch.score_test import Score
from tests.analysis.mismatch.ring_downs.selections import linear
from tests.analysis.ring_downs import PRETRIGGER, problem_of, session_of, with_law
from tests.analysis.terms import at_work, listed


def test_sliders_one_and_many_are_both_begun_where_both_are_near() -> None:
    slip = listed("micro_slip")

    def score(sliders: int, reach: float, gain: float) -> Score:
        values = {"slip_stiffness_share": 1e-3, "slip_reach_share": reach, "sliders": sliders}
        return Score(Term(slip, values, (2,)), gain, 1, 1.0, 0.0)

    scores = [score(8, 0.1, 1000.0), score(8, 0.2, 990.0), score(1, 0.1, 900.0), score(1, 0.2, 890.0)]
    assert variants(scores, POLICY.hopeful) == [scores[0], scores[2]]
    assert variants([scores[0], score(1, 0.1, 500.0)], POLICY.hopeful) == [scores[0]]


@pytest.mark.parametrize("exponent", [1 / 3, 0.42, 0.6, 1.0])
def test_the_growth_of_the_stiffness_speaks_against_a_force_law(exponent: float) -> None:
    constants = linear().constants
    loads = np.array(linear().problem.experiment.loads_n)
    fitted = replace(linear(), constants=replace(constants, load=np.c_[2e6 * loads**exponent, np.ones(loads.size)]))
    against = -stiffness_evidence(listed("hertz_stiffness"), fitted)
    assert against == pytest.approx(((exponent - 1 / 3) / 0.03) ** 2, abs=1e-6)
    assert stiffness_evidence(listed("micro_slip"), fitted) == 0.0


@pytest.mark.parametrize(
    ("begun", "wanted", "begins_at"),
    [
        (("contact_loss",), ("contact_loss", "double_hit"), "those left"),
        (("contact_loss",), ("contact_loss", "frame_compliance"), "those of each segment alone"),
        (("contact_loss",), ("frame_compliance", "contact_loss"), "those of each segment alone"),
        (("frame_compliance",), ("frame_compliance", "contact_loss"), "the linear rig's"),
        ((), ("contact_loss",), "the linear rig's"),
    ],
)
def test_amplitudes_that_a_fit_beside_laws_begins_at(
    monkeypatch: pytest.MonkeyPatch, begun: tuple[str, ...], wanted: tuple[str, ...], begins_at: str
) -> None:
    asked: list[Start] = []

    def recorded(problem: Any, terms: Any, begin: Any, start: Start, stop: Any) -> Any:
        asked.append(start)
        return begin

    monkeypatch.setattr(candidates, "fit", recorded)  # where a fit began cannot be seen from its end
    frame = {"frame_mass_kg": 1e-2, "frame_stiffness_n_per_m": 1e8, "frame_damping_n_s_per_m": 1.0}
    begin = replace(linear(), terms=tuple(at_work(n, frame) for n in begun))
    competing(begin.problem, tuple(at_work(n, frame) for n in wanted), begin)
    (start,) = asked
    if begins_at == "those of each segment alone":
        modes = {len(one) for one in begin.amplitudes}
        assert {len(one) for one in start.amplitudes} == {n + 1 for n in modes}
    else:
        assert tuple(start.amplitudes) == (begin.amplitudes if begins_at == "those left" else ())


@pytest.mark.slow
def test_when_a_second_impact_fell_is_looked_for_again_beside_what_came_later() -> None:
    share, late, gain = 0.2, 120, 0.02
    session = session_of(with_law(), noise=0.02)

    def hit_again(y: np.ndarray) -> np.ndarray:
        # the rig is linear: the second impact adds the whole response once more, later and weaker
        later = np.zeros_like(y)
        later[:, PRETRIGGER + late :] = share * y[:, PRETRIGGER:-late]
        return (y + later) * np.array([[1.0], [1 + gain]])

    impacts = tuple(replace(s, acceleration=hit_again(s.acceleration)) for s in session.impacts)
    problem = problem_of(replace(session, impacts=impacts)).only((0, 3, 5, 10))
    terms = [
        at_work("double_hit", {"second_impulse_fraction": 0.02}),
        at_work("channel_gain", {"gain_error_of_b": 0.0}),
    ]
    with np.errstate(all="ignore"):  # of a trial step
        wrong = fit(problem, terms, fit(problem), Start(delays=[400.0] * 4))
        found = looked_for_again(wrong)
    assert found.objective < 0.5 * wrong.objective
    assert [t.mechanism.id for t in found.terms] == ["double_hit", "channel_gain"]
    assert found.terms[0].values["second_impulse_fraction"] == pytest.approx(share, rel=0.02)
    rate = problem.experiment.sample_rate_hz
    for segment in found.segments:
        assert segment.second + segment.since_tap_s * rate == pytest.approx(late, abs=20)


@pytest.mark.slow
def test_masses_that_a_fit_moved_far_are_sought_again_from_where_they_were_declared() -> None:
    problem = problem_of(session_of(with_law("hertz_stiffness"), noise=0.02)).only((0, 3, 5, 10))
    masses = tuple(problem.arrangement.masses)
    with np.errstate(all="ignore"):  # of a trial step
        right = fit(problem, [at_work("hertz_stiffness")], fit(problem))
        moved = right.constants.rig.copy()
        moved[right.constants.names()[0].index("m1")] *= 1.03
        begin = replace(right, constants=replace(right.constants, rig=moved))
        off = fit(problem, right.terms, begin, Start(amplitudes=right.amplitudes, kept=masses))
        found = _with_scales_found_again(off)
    assert off.objective > right.objective + 100
    assert found.objective < right.objective + 1
    assert _with_scales_found_again(right) is right
