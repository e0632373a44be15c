"""What held-out errors far over the noise do to a name; recordings by SciPy's own integrators."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.blocks import missed_still, over_noise, predicts_no_better
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.motion import ROUGHEST, TOLERANCE, rough_tolerance
from analysis.mismatch.recordings.nearby import roughly
from analysis.mismatch.recordings.recorded import level, prepare
from analysis.mismatch.recordings.signatures import weakened
from analysis.mismatch.recordings.simulation import Simulation
from analysis.mismatch.score_test import screen
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.learned.families import learned_mechanisms
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.mechanisms.kinds import ForceLaw
from tests.analysis.mismatch.recordings.described_rigs import (
    INPUT,
    RATE,
    SAMPLES,
    SPRING,
    duffing,
    motion,
    noise_input,
    sensor,
)
from tests.analysis.terms import at_work

PENDULUM = """
bodies: {bob: 1}
pendulums: [{name: pivot, between: [bob, ground]}]
sensors: [{channel: 0, of: bob, shows: displacement}]
"""
W, DAMPING, FRICTION, DRAG, CUBED = 5.65, 0.03, 0.1, 0.05, 0.012  # rad/s, N s/m, N, N s2/m2, N s3/m3
POWER = 1.2
STICKS, BLUNT = 2e-4, 0.3  # m/s, over which the friction turns
QUANTUM = 2 * math.pi / 4096


@functools.cache
def fits() -> tuple[SimulatedFit, SimulatedFit]:
    """Return the linear rig fitted to a spring with a cube, and the rig with that cube."""
    recording = duffing(noise_input(SAMPLES, RATE, 2, 25, seed=3))
    rig = parse_rig(SPRING + INPUT + sensor("velocity"))
    linear = linear_fit(problem_of(rig, [prepare(recording, rig)]))
    cubic = at_work("tube_spring_cubic", {"cubic_stiffness_n_per_m3": 4e4})
    term = type(cubic)(cubic.mechanism, cubic.values, (0,))
    return linear, fit(linear.problem, (term,), linear)


@pytest.mark.slow
def test_what_is_missed_far_over_the_noise_is_the_share_of_held_out_errors() -> None:
    linear, named = fits()
    assert over_noise(named) < 1.5
    assert missed_still(linear, named) == 0.0
    assert over_noise(linear) > 10
    assert missed_still(linear, linear) == pytest.approx(1 - over_noise(linear) ** -2, rel=1e-9)


@pytest.mark.slow
def test_a_fit_with_larger_held_out_errors_predicts_no_better() -> None:
    linear, named = fits()
    assert not predicts_no_better(linear, named)
    assert predicts_no_better(named, linear)


@pytest.mark.slow
def test_of_a_force_law_next_to_nothing_makes_next_to_nothing() -> None:
    linear, _ = fits()
    laws = [m for m in variants(catalogue()) if isinstance(m, ForceLaw)]
    tried = {}
    for term in linear.problem.trials(linear, laws):
        weak = weakened(term, 1e-6)
        if weak is not None:
            made = []
            for one in (term, weak):
                other = linear.simulation.with_terms((one,), linear.values)
                shown, _ = other.run(other.begin(), other.own(linear.state(0)), 0)
                made.append(float(np.std(shown - linear.simulation.run(linear.x, linear.own[0], 0)[0])))
            tried[term.mechanism.id] = made[1] / made[0]
    assert {"tube_spring_cubic", "contact_creep", "quadratic_damping", "relaxation"} <= set(tried)
    assert max(tried.values()) < 1e-3, tried


Rest = Callable[[np.ndarray], np.ndarray]
HOLDS_BACK: dict[str, Rest] = {
    "guide_friction": lambda v: FRICTION * np.tanh(v / STICKS),
    "blunt_friction": lambda v: FRICTION * np.tanh(v / BLUNT),
    "quadratic_damping": lambda v: DRAG * v * np.abs(v),
    "learned_rate": lambda v: CUBED * v**3,
    "odd_power": lambda v: DRAG * np.sign(v) * np.abs(v) ** POWER,
}


def decays(what: str, begins: Sequence[float], quantum: float = QUANTUM) -> list[Recording]:
    """Return a pendulum of large swings that something holds back beside its linear damping, by an encoder."""

    def rest(s: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -(W**2) * np.sin(x) - DAMPING * v - HOLDS_BACK[what](v)

    moved = [motion(rest, [begin, 0.0], 3000, 100.0)[0] for begin in begins]
    return [Recording(quantum * np.round(x / quantum)[None], 100.0, ("angle",), "", "simulated") for x in moved]


@pytest.mark.parametrize("noise", [1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("quadratic_damping", {"quadratic_damping_n_s2_per_m2": DRAG}),
        ("guide_friction", {"friction_force_n": FRICTION, "rounding": 1e-3}),
        ("large_swing", {"arc_curvature_per_m2": 1.0}),
    ],
)
def test_what_score_tests_try_is_simulated_as_roughly_as_the_noise_allows(
    what: str, values: dict[str, float], noise: float
) -> None:
    laws = (m for m in variants(catalogue()) if m.id == what and {q.name for q in m.parameters} <= values.keys())
    rig, law = parse_rig(PENDULUM), next(laws)
    recorded = prepare(decays("quadratic_damping", (1.0,))[0], rig)
    recorded = replace(recorded, unit=noise * level(recorded))
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    constants |= {name: W**2 if "stiffness" in name else DAMPING for name in constants if "pivot" in name}
    simulation = Simulation(rig, [recorded], constants, W / (2 * math.pi), (Term(law, values, (0,)),))
    rough, place = roughly(simulation), (simulation.begin(), simulation.own(np.array([1.0, 0.0])))
    assert (simulation.rough, rough.rough, rough.with_terms((), constants).rough) == (False, True, True)
    off = (rough.run(*place, 0)[0] - simulation.run(*place, 0)[0]) / recorded.unit[:, None]
    assert np.all(np.isfinite(off))
    assert np.sqrt(np.mean(off**2)) < 0.03
    assert TOLERANCE <= rough_tolerance(recorded) <= ROUGHEST


@pytest.mark.long
@pytest.mark.parametrize(
    ("what", "size", "begins"),
    [
        ("guide_friction", FRICTION, (0.8, 0.4)),
        ("guide_friction", FRICTION, (1.2,)),
        ("quadratic_damping", DRAG, (1.0,)),  # in one decay a change with time resembles both
        ("learned_rate", CUBED, (1.0, 0.5)),
    ],
)
def test_two_effects_that_another_resembles_are_both_named(what: str, size: float, begins: Sequence[float]) -> None:
    said: list[str] = []
    found = diagnose_recordings(decays(what, begins), parse_rig(PENDULUM), variants(catalogue()), said.append).answer
    named = {m.id: m for m in found.mechanisms}
    assert set(named) == {"large_swing", what}
    (arc,) = named["large_swing"].parameters.values()
    assert arc.value == pytest.approx(1.0, abs=2e-3)
    assert found.remainder is not None
    assert found.remainder.p_value > 0.01 or found.remainder.share < 1e-4  # an edge of friction is left
    if what == "learned_rate":
        law = named[what].law
        assert law is not None
        assert (law.kind, law.symmetry) == ("rate", "odd")
        power = law.exponents["rate"]
        assert power is not None
        assert power.low <= 3.0 <= power.high
        assert power.value == pytest.approx(3.0, abs=0.02)
    else:
        assert [v.value for v in named[what].parameters.values()] == pytest.approx([size], rel=5e-3)
    if len(begins) == 1:  # one decay, and yet time is out of the question: it leaves far more
        assert named["large_swing"].probability > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("turns", [STICKS, BLUNT])
def test_friction_in_a_decay_of_27_periods_is_found_from_afar_with_how_abruptly_it_turns(turns: float) -> None:
    rig, known = parse_rig(PENDULUM), {m.id: m for m in variants(catalogue())}
    what = "guide_friction" if turns == STICKS else "blunt_friction"
    with np.errstate(all="ignore"):
        problem = problem_of(rig, [prepare(decays(what, (1.0,), QUANTUM / 16)[0], rig)])
    begun = fit(problem, (Term(known["large_swing"], {"arc_curvature_per_m2": 1.0}, (0,)),), staged=True)
    # from each of the mechanism's own widths, as a diagnosis begins: one that begins far too abruptly may not get away
    widths = [values["rounding"] for values in known["guide_friction"].trials(problem.scale_of(begun, 0))]
    begins = [Term(known["guide_friction"], {"friction_force_n": 3 * FRICTION, "rounding": w}, (0,)) for w in widths]
    firsts = [fit(problem, (*begun.terms, rubbing), begun, fine=True) for rubbing in begins]
    first = min(firsts, key=lambda f: f.objective)
    found = fit(weighed(first), first.terms, first, fine=True).terms[1].values
    assert found["friction_force_n"] == pytest.approx(FRICTION, rel=5e-3)
    if turns == BLUNT:
        assert found["rounding"] == pytest.approx(turns, rel=0.1)
    else:
        assert found["rounding"] < 0.02


@pytest.mark.slow
def test_the_error_of_a_score_is_that_of_a_full_fit_where_a_named_law_is_like_the_mechanism() -> None:
    rig, known = parse_rig(PENDULUM), {m.id: m for m in variants(catalogue())}
    with np.errstate(all="ignore"):
        problem = problem_of(rig, [prepare(decays("odd_power", (1.0,))[0], rig)])
    begun = fit(problem, (Term(known["large_swing"], {"arc_curvature_per_m2": 1.0}, (0,)),), staged=True)
    power = next(m for m in learned_mechanisms() if {q.name for q in m.parameters} == {"force_n", "rate_exponent"})
    (values, *_) = power.trials(problem.scale_of(begun, 0))
    terms = (*begun.terms, Term(power, values | {"force_n": 0.1, "rate_exponent": POWER}, (0,)))
    problem = weighed(fit(problem, terms, begun, fine=True))
    named = fit(problem, terms, begun, fine=True)
    scores = screen(problem, named, [known["guide_friction"]]).scores
    score = min(scores, key=lambda s: s.term.values["rounding"])  # a blunt one is more like the rig's own damper
    rubbing = Term(known["guide_friction"], {**score.term.values, "friction_force_n": 1e-4}, (0,))
    full = fit(problem, (*named.terms, rubbing), named, fine=True)
    # with a trial as large as those beside a linear rig are, it was a twentieth of that
    error = math.sqrt(full.term_covariances[-1][0, 0])
    assert 0.5 < score.error * score.term.values["friction_force_n"] / error < 2.0


@pytest.mark.long
def test_a_law_that_is_not_listed_is_learned_beside_one_that_is() -> None:
    cubic, unlisted = 1.25e6, 7500.0  # N/m3, N s/m3

    def rest(force: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return force - 2500.0 * x - 1.7 * v - cubic * x**3 - unlisted * x**2 * v

    force = 7.0 * noise_input(2400, 150.0, 1, 20, seed=11)
    x, _ = motion(rest, [0.0, 0.0], force.size, 150.0, force)
    seen = x + np.random.default_rng(5).normal(0.0, 1e-5, x.size)
    recording = Recording(np.array([force, seen]), 150.0, ("force", "position"), "", "simulated")
    rig = parse_rig(SPRING + INPUT.replace("gain: unknown", "offset: 0") + sensor("displacement"))
    found = diagnose_recordings([recording], rig, variants(catalogue()), lambda _: None)
    named = {m.id: m for m in found.answer.mechanisms}
    assert set(named) == {"tube_spring_cubic", "learned_rate"}
    (stiffness,) = named["tube_spring_cubic"].parameters.values()
    assert stiffness.value == pytest.approx(cubic, rel=0.01)
    law = named["learned_rate"].law
    assert law is not None
    power = law.exponents["deflection"]
    assert power is not None
    assert power.value == pytest.approx(2.0, abs=0.05)
