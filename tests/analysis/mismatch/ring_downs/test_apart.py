"""What a single impact shows is no physics of the rig: it is set aside and said, never named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.apart import (
    apart,
    borne_out,
    follow_strength,
    hardest_of_their_loads,
    share_of,
    without,
)
from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.ring_downs.selecting import _without_odd_ones
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate
from daq.records import Session
from sim_backend.adopted import adopted
from sim_backend.mechanisms.rocking import at
from sim_backend.pulses import Pulse
from sim_backend.recorder import analog_filter
from sim_backend.twin import twin_record
from sim_backend.two_mass import TwoMass
from tests.analysis.ring_downs import (
    FILTER,
    ONSET_S,
    RATE_HZ,
    SAMPLES,
    diagnosed,
    problem_of,
    session_of,
    with_law,
)
from tests.analysis.terms import listed

KNOWN = [listed("rocking"), listed("channel_gain"), listed("guide_friction")]
T = np.arange(SAMPLES) / RATE_HZ - ONSET_S - 3e-4
OFF_CENTRE = np.array([[1.0], [-1.0]])


def ringing(hz: float, size: float, damping: float = 0.02) -> np.ndarray:
    """What rings on after the pulse, m/s2."""
    w = 2 * np.pi * hz
    return np.where(T > 0, size * np.exp(-damping * w * np.maximum(T, 0)) * np.sin(w * np.maximum(T, 0)), 0.0)


def with_added(session: Session, added: Mapping[int, np.ndarray]) -> Session:
    """The session with (2, n) or (n,) more acceleration in some of its impacts."""
    impacts = tuple(replace(s, acceleration=s.acceleration + added.get(s.number, 0.0)) for s in session.impacts)
    return replace(session, impacts=impacts)


@pytest.fixture(scope="module")
def linear() -> Session:
    return session_of(with_law())


def test_a_tap_off_centre_is_said_and_no_mechanism_is_named(linear: Session) -> None:
    found = diagnosed([with_added(linear, {5: OFF_CENTRE * ringing(4000.0, 0.3)})], KNOWN).answer
    assert found.verdict == "consistent"
    assert [a.name for a in found.set_aside] == [linear.impacts[5].name]
    assert found.set_aside[0].group == "400 mN"
    assert "Tap 6 (at 400 mN) was off centre: A and B differ at 4" in found.set_aside[0].statement
    assert found.fit.segments == len(linear.impacts) - 1


def test_two_taps_off_centre_that_ring_each_at_a_frequency_of_its_own_are_both_set_aside(linear: Session) -> None:
    turned = {2: OFF_CENTRE * ringing(3900.0, 0.3), 9: OFF_CENTRE * ringing(4050.0, 0.2)}
    found = diagnosed([with_added(linear, turned)], KNOWN).answer
    assert (found.verdict, [a.name for a in found.set_aside]) == (
        "consistent",
        [linear.impacts[i].name for i in turned],
    )


@pytest.mark.slow
def test_a_knock_at_the_table_during_one_record_is_said(linear: Session) -> None:
    found = diagnosed([with_added(linear, {0: ringing(1500.0, 0.2, 0.05)})], KNOWN).answer
    assert (found.verdict, [a.name for a in found.set_aside]) == ("consistent", [linear.impacts[0].name])
    assert "off centre" not in found.set_aside[0].statement
    assert "that no other does" in found.set_aside[0].statement


@pytest.mark.long
def test_beneath_a_strong_law_an_odd_tap_is_set_aside_and_nothing_is_left() -> None:
    session = session_of(with_law("hertz_stiffness"), ratios=(0.9, 0.3, 0.5, 0.7))
    odd = {5: OFF_CENTRE * ringing(4000.0, 0.3)}
    found = diagnosed([with_added(session, odd)], [listed("hertz_stiffness"), listed("contact_creep")]).answer
    assert [m.id for m in found.mechanisms] == ["hertz_stiffness"]
    assert [a.name for a in found.set_aside] == [session.impacts[5].name]
    assert found.remainder.p_value > 0.01


@pytest.mark.slow
def test_what_many_impacts_show_is_not_set_aside(linear: Session) -> None:
    turned = {i: OFF_CENTRE * ringing(4000.0, 0.3) for i in range(0, 12, 3)}
    assert len(turned) > problem_of(linear).policy.set_aside * 12
    session = with_added(linear, turned)
    assert apart(fit(problem_of(session))) == ()
    assert diagnosed([session], KNOWN).answer.verdict != "consistent"


@pytest.mark.parametrize(("noisier", "again"), [(0.0, True), (0.02, False)])
def test_all_is_looked_for_again_without_an_odd_impact_if_it_holds_most_of_what_is_left(
    linear: Session, noisier: float, again: bool
) -> None:
    problem = problem_of(linear)
    best = fit(problem)
    residuals = [(1 + noisier) * r for r in best.residuals]
    residuals[5][:, :100] += 1.5 * OFF_CENTRE
    best = replace(best, residuals=tuple(residuals))
    assert apart(best) == (5,)
    assert (share_of(best, (5,)) > problem.policy.odd_share) is again
    said: list[str] = []
    _without_odd_ones(problem, KNOWN, said.append, best)
    assert bool(said) is again


VALUES = {"contact_offset_share": 0.02, "rocking_stiffness_n_per_m": 2.3e7, "rocking_damping_n_s_per_m": 36.0}


def turning(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
    """A rig whose lower mass is turned by the contact, off its axis."""
    found = [adopted("rocking", VALUES)]
    return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]


def rocking_in(session: Session) -> tuple[RingDownFit, Candidate[RingDownFit]]:
    """The linear rig, and rocking fitted to a session."""
    problem = problem_of(session)
    term = Term(listed("rocking"), VALUES, at(problem.arrangement)[0])
    before = fit(problem)
    after = fit(problem, [term], before)
    score = Score(term, 0.0, 25, 1.0, 0.0)
    return before, Candidate(score, after, before.objective - after.objective, own=24)


def test_a_body_that_the_rig_turns_at_every_tap_is_borne_out() -> None:
    assert borne_out(*rocking_in(session_of(turning)))


@pytest.mark.parametrize("shown", [(5,), tuple(range(12))], ids=["one tap", "every tap"])
def test_a_body_that_rings_without_being_driven_by_the_rig_is_not(linear: Session, shown: tuple[int, ...]) -> None:
    turned = {i: OFF_CENTRE * ringing(4000.0, 0.3) for i in shown}
    before, rocking = rocking_in(with_added(linear, turned))
    assert rocking.evidence > 1e4
    assert not borne_out(before, rocking)


def test_an_impact_stronger_than_all_others_is_told_from_the_rest(linear: Session) -> None:
    fitted = fit(problem_of(linear))
    peak = [float(np.abs(s.raw).max()) for s in fitted.segments]
    strongest, weakest = int(np.argmax(peak)), int(np.argmin(peak))
    assert follow_strength(fitted, [strongest])
    assert not follow_strength(fitted, [weakest])


def test_impacts_are_the_hardest_of_their_loads_or_are_so_by_chance(linear: Session) -> None:
    fitted = fit(problem_of(linear))
    loads = sorted({s.preload_n for s in fitted.segments})
    own = [[i for i, s in enumerate(fitted.segments) if s.preload_n == load] for load in loads]
    hardest = [sorted(at, key=lambda i: -float(np.abs(fitted.segments[i].raw).max())) for at in own]
    assert all(len(at) == 4 for at in hardest)
    each = [at[0] for at in hardest]
    assert hardest_of_their_loads(fitted, each[:3])  # 1 in 64 by chance
    assert not hardest_of_their_loads(fitted, each[:2])  # 1 in 16
    assert not hardest_of_their_loads(fitted, each[:1])
    assert not hardest_of_their_loads(fitted, [*each[:2], hardest[2][1]])
    assert not hardest_of_their_loads(fitted, [])


def test_no_load_loses_all_its_impacts(linear: Session) -> None:
    problem = problem_of(linear)
    names = [s.name for s in problem.experiment.segments]
    assert without(problem, names[:4]) is None
    rest = without(problem, names[:3])
    assert rest is not None
    assert [s.name for s in rest.experiment.segments] == names[3:]
