"""What candidates ring in a segment, against their waves written out."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Rung
from analysis.mismatch.ring_downs.fit import RingDownFit, fit
from analysis.mismatch.ring_downs.linear import linear_rig
from analysis.mismatch.ring_downs.ringing import wave_products
from analysis.mismatch.ring_downs.signatures import SegmentSignatures, Signatures
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.mechanisms.kinds import AddedBody, Tones
from tests.analysis.ring_downs import problem_of, session_of, with_law

NAMES = ("attached_mass", "frame_compliance", "tube_spring_damping", "mains_hum")


@pytest.fixture(scope="module")
def fitted() -> RingDownFit:
    with np.errstate(all="ignore"):  # of a trial step
        return fit(problem_of(session_of(with_law(), noise=0.05)).only((0, 3, 5)))


def candidates(fitted: RingDownFit) -> list[Term]:
    terms = fitted.problem.trials(fitted, [m for name in NAMES for m in catalogue()[name]])
    return [t for i, t in enumerate(terms) if i % 7 == 0 or t.mechanism.id in NAMES[2:]]


def written_out(fitted: RingDownFit, term: Term, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Waves (w, c n) that a term adds to a segment, and what its change of the rig does (c n,), to first order."""
    segment, experiment, problem = fitted.segments[number], fitted.problem.experiment, fitted.problem
    rate, noise = experiment.sample_rate_hz, experiment.noise
    t = np.arange(segment.y.shape[1]) / rate
    if isinstance(term.mechanism, Tones):
        rows = []
        for hz in term.mechanism.lines(term.values):
            s = np.array([2j * np.pi * hz])
            shown = np.array([m.gain(s, rate)[0] * np.exp(s * t) for m in noise])
            rows += [shown.real.ravel(), shown.imag.ravel()]
        return np.array(rows), np.zeros(segment.y.size)
    assert isinstance(term.mechanism, AddedBody)
    rig = term.mechanism.extend(fitted.arrangement, term.values, term.place)
    own = linear_rig(rig, rig.declared() | fitted.constants.at(segment.group), problem.analog, noise, rate)
    base, left = fitted.modes[segment.group].rig, list(range(own.poles.size))
    effect, b = np.zeros(segment.y.shape), fitted.amplitudes[number]
    for j, s in enumerate(base.poles):
        near = min(left, key=lambda i: abs(own.poles[i] - s))
        left.remove(near)
        wave = base.weight[j] * b[j] * np.exp(s * t)
        change = (own.gains[:, near] - base.gains[:, j])[:, None] + np.outer(
            base.gains[:, j] * (own.poles[near] - s), t
        )
        effect += (change * wave).real
    if term.phase_locked:
        for i in left:
            begun = own.left[rig.bodies.index(rig.tapped), i] / base.drive[0] * b[0]
            late = np.exp((own.poles[i] - base.poles[0]) * segment.since_tap_s + own.poles[i] * t)
            effect += (2 * begun * own.gains[:, i, None] * late).real
        return np.zeros((0, segment.y.size)), effect.ravel()
    waves = [own.gains[:, i, None] * np.exp(own.poles[i] * t) for i in left]
    return np.array([part.ravel() for w in waves for part in (w.real, w.imag)]).reshape(
        -1, segment.y.size
    ), effect.ravel()


def test_products_are_those_of_the_waves(fitted: RingDownFit) -> None:
    terms = candidates(fitted)
    assert {t.mechanism.id for t in terms} == set(NAMES)
    assert {t.phase_locked for t in terms} == {True, False}
    signatures = Signatures(fitted, terms)
    for number in range(3):
        columns = np.random.default_rng(number).standard_normal((fitted.segments[number].y.size, 3))
        found = SegmentSignatures(signatures, number).rung(columns)
        assert sorted(i for rung in found for i in rung.numbers) == list(range(len(terms)))
        for rung in found:
            for i, seen, gram in zip(rung.numbers, rung.seen, rung.gram, strict=True):
                waves, rest = written_out(fitted, terms[i], number)
                expected = Rung.of_each(np.array([i]), waves[None], rest[None], columns)
                size = np.sqrt(np.diag(expected.gram[0]))
                np.testing.assert_allclose(gram, expected.gram[0], rtol=1e-7, atol=1e-9 * float(size.max()) ** 2)
                np.testing.assert_allclose(
                    seen, expected.seen[0], rtol=1e-6, atol=1e-8 * float(size.max()) * np.sqrt(len(columns))
                )


def test_waves_that_decay_grow_or_stand_still_are_summed_over_any_length() -> None:
    poles = np.array([-30 + 9000j, -2e4 + 100j, 5 + 400j, 0j, -8.0])
    for n in (1, 255, 256, 1000):
        columns = np.random.default_rng(n).standard_normal((n, 2))
        expected = np.exp(np.outer(poles, np.arange(n) * 4e-5)) @ columns
        np.testing.assert_allclose(wave_products(poles, 4e-5, columns), expected, rtol=1e-9, atol=1e-9)
