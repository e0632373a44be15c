from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.recordings import signatures
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, prepare
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, SecondImpact, Tones
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input, recorded

N, HZ = 600, 200.0
RIG = """
bodies: {a: 1, b: 0.4}
springs: [{name: lower, between: [a, ground], damping: unknown}, {name: upper, between: [b, a], damping: unknown}]
"""
SENSORS = "sensors: [{channel: %d, of: a, shows: displacement}, {channel: %d, of: b, shows: displacement}]\n"


def pulled(u: float, x: Real, v: Real) -> Real:
    lower, upper = -3000 * x[0] - 0.8 * v[0], 900 * (x[0] - x[1]) + 0.3 * (v[0] - v[1])
    return np.array([u + lower - upper, upper / 0.4])


def fitted(driven: bool) -> SimulatedFit:
    """Return the linear rig fitted to a recording of it."""
    u = 50 * noise_input(N, HZ, 0.5, 40, seed=3) if driven else None
    moved = motion(pulled, [0.02, -0.01, 0.0, 0.0], N, HZ, u)[:2]
    inputs = "inputs: [{channel: 0, force_on: a}]\n" if driven else ""
    rig = parse_rig(RIG + inputs + SENSORS % ((1, 2) if driven else (0, 1)))
    rows = [u, *moved] if u is not None else list(moved)
    with np.errstate(all="ignore"):
        return linear_fit(problem_of(rig, [prepare(recorded(rows, HZ, 1e-5), rig)]))


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("beside", [False, True])
def test_trials_together_make_what_each_makes_alone(driven: bool, beside: bool) -> None:
    begun = fitted(driven)
    problem = weighed(begun)
    begun = linear_fit(problem)
    known = [m for m in variants(catalogue()) if problem.allows(m) and not isinstance(m, SecondImpact | Tones)]
    terms = problem.trials(begun, known)
    if beside:
        cubic = next(t for t in terms if t.mechanism.id == "tube_spring_cubic")
        begun = fit(problem, (cubic,), begun)
        terms = [t for t in terms if t.mechanism.id != "tube_spring_cubic"]
    assert len({(t.mechanism.id, t.place) for t in terms}) < len(terms) / 2  # many differ in values only
    compared = signatures._Compared(problem, begun, 0)
    part = problem.recordings[0].part[compared.at]

    def alone(off: Real) -> Real:
        return begun.noise(0).white(off - compared.shown)[:, np.isin(part, (FIT, CHOOSE))].ravel()

    expected, own = [], begun.own[0]
    for term in terms:
        other = compared.simulation.with_terms((*begun.terms, term), begun.values)
        state = replace(other.own(begun.state(0)), memory=other.own(begun.state(0)).memory * 0)
        shown, at = other.run(other.begin(), state, 0)
        expected.append(alone((shown - problem.recordings[0].outputs[:, at]) / problem.recordings[0].unit[:, None]))
    assert own.tones.size == 0
    made = compared.made(terms)
    size = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(made / size, np.array(expected) / size, rtol=0, atol=1e-9)
    assert size.min() > 0


@pytest.mark.parametrize("driven", [False, True])
def test_what_rings_together_is_what_rings_alone(driven: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = fitted(driven)
    problem = weighed(begun)
    begun = linear_fit(problem)
    known = [m for m in variants(catalogue()) if isinstance(m, AddedBody | Tones) and problem.allows(m)]
    terms = problem.trials(begun, known)
    compared = signatures._Compared(problem, begun, 0)
    against = np.random.default_rng(2).standard_normal((compared.size, 5))
    together = {int(n): (seen, gram) for n, seen, gram in _one_by_one(compared.rungs(terms, against))}
    monkeypatch.setattr(signatures, "TOGETHER", 1)
    for i, term in enumerate(terms):
        ((_, seen, gram),) = _one_by_one(compared.rungs([term], against))
        np.testing.assert_allclose(together[i][0], seen, rtol=1e-9, atol=1e-9 * np.abs(seen).max())
        np.testing.assert_allclose(together[i][1], gram, rtol=1e-9, atol=1e-9 * np.abs(gram).max())
    assert set(together) == set(range(len(terms)))
    assert len(terms) > 20


def test_trials_side_by_side_make_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = fitted(driven=False)
    known = [m for m in variants(catalogue()) if begun.problem.allows(m) and not isinstance(m, SecondImpact | Tones)]
    terms = begun.problem.trials(begun, known)
    compared = signatures._Compared(begun.problem, begun, 0)
    alone = compared.made(terms)
    monkeypatch.setattr(signatures, "SIDE_BY_SIDE", 0)
    np.testing.assert_array_equal(compared.made(terms), alone)


def _one_by_one(rungs: object) -> list[tuple[int, Real, Real]]:
    return [each for rung in rungs for each in zip(rung.numbers, rung.seen, rung.gram, strict=True)]  # type: ignore[attr-defined]


def test_whitening_of_several_is_that_of_each() -> None:
    begun = fitted(driven=True)
    noise = begun.noise(0)
    rows = np.random.default_rng(4).standard_normal((3, 2, N))
    np.testing.assert_allclose(noise.white(rows), [noise.white(one) for one in rows], rtol=1e-12, atol=1e-12)


def test_trials_beside_others_begin_with_the_share_that_made_as_much_as_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = fitted(True)
    problem = weighed(begun)
    begun = linear_fit(problem)
    laws = [m for m in variants(catalogue()) if isinstance(m, ForceLaw) and problem.allows(m)]
    terms = problem.trials(begun, laws)
    cubic = next(t for t in terms if t.mechanism.id == "tube_spring_cubic")
    begun, terms = fit(problem, (cubic,), begun), [t for t in terms if t.mechanism.id != "tube_spring_cubic"]
    made: list[int] = []
    whole = signatures._Compared.made
    monkeypatch.setattr(signatures._Compared, "made", lambda self, some: (made.append(len(some)), whole(self, some))[1])
    first, second = (signatures._Compared(problem, begun, 0).little(terms) for _ in range(2))
    assert made[0] == made[2] == len(terms)
    assert made[1] > len(terms) / 3
    assert made[3] < made[1] / 3  # what makes next to nothing at its whole size is tried twice
    np.testing.assert_allclose(second, first, atol=0.02 * np.abs(first).max())
