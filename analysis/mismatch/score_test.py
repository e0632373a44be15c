"""Score tests: what each mechanism would do to the segments, projected off all that the rig itself can do.

A little of a mechanism changes the whitened segments; what each segment may do by itself and what the constants of the
rig can explain is taken out; the rest is compared with the residual. All of it is inner products of a few columns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from analysis.mismatch.chi_squared import p_of
from analysis.mismatch.elimination import eliminated
from analysis.mismatch.free_form import channel_trials, free_places, free_trials
from analysis.mismatch.limits import amplitude_bound
from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Columns, FitOf, Problem
from analysis.mismatch.ringing_tests import RingingTests
from sim_backend.mechanisms.kinds import AddedBody, Mechanism, SecondImpact, Tones

Real = NDArray[np.float64]

FREE_FLOOR = 1e-5  # eigenvalue of the free terms' cosines below which they repeat each other
REPEATED = 1e-12  # share of a signature that must be left beside what the rig can do
SCREENED, EACH = 35.0, 5.0  # work of a screening, and of each mechanism in it, of a sample
DRAWS = 4000  # of the null distribution of the largest score


@dataclass(frozen=True, slots=True)
class Score:
    """How a mechanism fares against the residual.

    Attributes
    ----------
    gain
        Chi-squared that it would take away, and for how many free numbers (``dof``).
    strength, error
        Estimate of its strength relative to the trial's and its standard error (NaN where it has none; of a mechanism
        without a strength 1 is expected).
    p_value
        Of this trial alone.
    delays, choice
        For a second impact: its sample after each segment's first one, and the chi-squared that choosing these took.
    bound
        95 % upper bound of the strength of what is free in every segment, in its own unit: of tones in ring-downs
        (m/s2) and of a second impact (its share of the first). NaN elsewhere.
    """

    term: Term
    gain: float
    dof: int
    strength: float
    p_value: float
    error: float = math.nan
    delays: tuple[float, ...] = ()
    choice: float = 0.0
    bound: float = math.nan

    @property
    def own_numbers(self) -> int:
        """Numbers of the mechanism that are free in every segment."""
        return self.dof if self.dof > 1 else 0


@dataclass(frozen=True, slots=True)
class FreeForm:
    """What forces and channels of any shape would take away: together, by component, and the best one alone."""

    gain: float
    dof: int
    p_value: float
    by_component: dict[str, float]
    best_alone: float


@dataclass(frozen=True, slots=True)
class Screening:
    """All scores, best first; ``cosines`` of the projected signatures of ``labels`` with each other.

    ``unexplained`` is the chi-squared beyond chance that forces and channels of any shape, or lines in the spectra,
    would take away.
    """

    scores: tuple[Score, ...]
    p_value: float
    labels: tuple[str, ...]
    cosines: Real
    free: FreeForm
    unexplained: float


def screen(problem: Problem[FitOf], fitted: FitOf, known: Iterable[Mechanism]) -> Screening:
    """Score every mechanism against the residual of a fit.

    Parameters
    ----------
    fitted
        Of the linear rig (or of a rig with mechanisms already in it: then scores are to first order about it).
    """
    known = list(known)
    terms = problem.trials(fitted, [m for m in known if not isinstance(m, SecondImpact)])
    rings = [isinstance(t.mechanism, AddedBody | Tones) for t in terms]
    ringing = [t for t, r in zip(terms, rings, strict=True) if r]
    named = [t for t, r in zip(terms, rings, strict=True) if not r]
    free = free_terms(problem, fitted)
    problem.budget.spent += (SCREENED + EACH * len(known)) * problem.samples
    sums = _summed(problem, fitted, [*named, *free], ringing)
    precision = problem.precision(fitted)
    size = precision.size
    schur = eliminated(sums.gram, size, precision)
    count = len(named) + len(free)
    inner, score = schur[:count, :count], schur[:count, -1]
    scale = _Noise(problem.noise_known, float(schur[-1, -1]), sums.count - size)
    power = np.maximum(np.diag(inner), REPEATED * np.diag(sums.gram)[size : size + count] + 1e-300)
    drawn = _drawn(schur, np.sqrt(power), sums.count - size)
    wider = np.sqrt(np.maximum(np.mean(drawn**2, axis=1), 1.0)) if drawn.size else np.ones(count)
    z = scale.standardised(score / np.sqrt(power)) / wider
    scores = [
        _scored(t, float(value), float(s), float(g), scale.deviation * float(w))
        for t, value, s, g, w in zip(named, z, score, power, wider, strict=False)
    ]
    scores += _rung_scores(ringing, sums.tests, precision, scale)
    for mechanism in known:
        if isinstance(mechanism, SecondImpact) and problem.allows(mechanism):
            scores.append(problem.second_impact(fitted, mechanism))
    cosines = inner / np.outer(np.sqrt(power), np.sqrt(power))
    rest = _free(cosines, z, drawn / wider[:, None], len(named), [t.mechanism for t in free])
    others, left = problem.unmodelled(fitted)
    at = slice(len(named))
    # ring-downs tell a frame by the tap's phase alone: one number in all, and p-values are large enough without it
    tests = [s.dof != 1 or isinstance(s.term.mechanism, SecondImpact) for s in scores[at.stop :]]
    alone = sum(tests) if problem.noise_known else len(tests)
    signs = [t.mechanism.one_signed for t in named]
    p_value = _overall(scores, [rest.p_value, *others], cosines[at, at], signs, alone)
    scores.sort(key=lambda s: (s.dof - s.gain) / math.sqrt(s.dof + 1) if s.dof > 1 else -s.gain)
    unexplained = max(rest.gain - rest.dof, left, 0.0)
    return Screening(tuple(scores), p_value, tuple(t.mechanism.id for t in named), cosines[at, at], rest, unexplained)


def free_terms(problem: Problem[FitOf], fitted: FitOf) -> list[Term]:
    """Return the competitor that names nothing: forces of any shape in the elements and changes of the channels."""
    rig = problem.arrangement
    found = [t for place in free_places(rig) for t in free_trials(rig, place, problem.scale_of(fitted, place))]
    return found + [t for t in channel_trials(len(rig.sensors)) if problem.allows(t.mechanism)]


def _drawn(schur: Real, size: Real, count: int) -> Real:
    """Return (terms, draws) the standardised scores of terms of this size in draws of the noise."""
    terms = size.size
    total = np.maximum(np.diag(schur)[terms:-1], 1e-300)
    return np.asarray(schur[:terms, terms:-1] / size[:, None] / np.sqrt(total / max(count, 1)), np.float64)


def _scored(term: Term, z: float, score: float, power: float, deviation: float) -> Score:
    """Return the score of a term whose strength is one number, in noise of this deviation along it."""
    one_sided = term.mechanism.one_signed
    gain = z**2 if z > 0 or not one_sided else 0.0
    p = float(norm.sf(z)) if one_sided else float(2 * norm.sf(abs(z)))
    return Score(term, gain, 1, score / power, p, deviation / math.sqrt(power))


@dataclass(frozen=True, slots=True)
class _Noise:
    """The residual's variance, one where it is ``known``; else from what is left of it, ``total`` over ``count``."""

    known: bool
    total: float
    count: int

    @property
    def deviation(self) -> float:
        return 1.0 if self.known else math.sqrt(max(self.total, 1e-300) / max(self.count, 1))

    def standardised(self, z: Real) -> Real:
        """Return scores as standard normal ones."""
        if self.known:
            return z
        share = np.minimum(z**2 / max(self.total, 1e-300), 1 - 1e-12)
        return np.asarray(np.sign(z) * np.sqrt(-self.count * np.log1p(-share)), np.float64)

    def chi_squared(self, gain: float) -> float:
        """Return a fall of the sum of squares as chi-squared."""
        return float(self.standardised(np.array([math.sqrt(max(gain, 0.0))]))[0] ** 2)


@dataclass(slots=True)
class _Sums:
    """Inner products of all columns and draws of noise over some segments, and the tests of what rings by itself."""

    gram: Real
    tests: RingingTests
    count: int = 0

    def add(self, columns: Columns, size: int) -> None:
        """Take in a segment."""
        noise = np.zeros((columns.residual.size, 0)) if columns.noise is None else columns.noise
        block = np.column_stack([columns.slopes, columns.made, noise, columns.residual])
        block -= columns.own @ (columns.own.T @ block)
        known = columns.slopes.shape[1]
        where = np.r_[columns.where, size + np.arange(block.shape[1] - known)]
        self.gram[np.ix_(where, where)] += block.T @ block
        self.count += columns.residual.size - columns.own.shape[1]
        self.tests.add(columns, np.delete(block, np.s_[known : known + columns.made.shape[1]], axis=1))

    def take(self, other: _Sums) -> None:
        """Add what another one was given of further segments."""
        self.gram += other.gram
        self.count += other.count
        self.tests.take(other.tests)


def _summed(problem: Problem[FitOf], fitted: FitOf, terms: Sequence[Term], ringing: Sequence[Term]) -> _Sums:
    """Return the sums over all segments: always in the same parts, done side by side."""
    size, draws = problem.precision(fitted).size, problem.draws(fitted)
    lines = [len(_lines_of(t)) if problem.noise_known else 0 for t in ringing]

    def part(columns: Iterable[Columns]) -> _Sums:
        width = size + len(terms) + draws + 1
        sums = _Sums(np.zeros((width, width)), RingingTests(lines, size, draws))
        for one in columns:
            sums.add(one, size)
        return sums

    parts = list(problem.columns(fitted, terms, ringing))
    with ThreadPoolExecutor(max(len(parts), 1)) as pool:
        first, *others = pool.map(part, parts)
    for other in others:
        first.take(other)
    return first


def _lines_of(term: Term) -> Sequence[float]:
    """Return the frequencies (Hz) of tones."""
    return term.mechanism.lines(term.values) if isinstance(term.mechanism, Tones) else ()


def _rung_scores(terms: Sequence[Term], tests: RingingTests, precision: Real, noise: _Noise) -> list[Score]:
    """Return the score of each term that adds vibrations to every segment."""
    found, known = [], tests.known
    for i, t in enumerate(terms):
        rest = eliminated(tests.gram[i], known, precision)
        alone = not rest[0, 0] > 1e-9 * tests.gram[i][known, known]
        drawn = _drawn(rest, np.sqrt(rest[:1, 0]), noise.count)
        wider = 1.0 if alone or not drawn.size else math.sqrt(max(float(np.mean(drawn**2)), 1.0))
        value = 0.0 if alone else rest[0, -1] / math.sqrt(rest[0, 0]) / wider
        signed = value > 0 or not t.mechanism.one_signed
        gain = noise.chi_squared(tests.gain[i] + (value**2 if signed else 0.0))
        dof = int(tests.dof[i]) + (0 if alone else 1)
        strength = 0.0 if alone else rest[0, -1] / rest[0, 0]
        error = math.nan if alone else noise.deviation * wider / math.sqrt(rest[0, 0])
        bounds = [amplitude_bound(*line) for line in tests.lines[i].T if line[1] > 0]
        loudest = max(bounds, default=math.nan)
        p_value = float(chi2.sf(gain, max(dof, 1)))
        found.append(Score(t, gain, dof, float(strength), p_value, error, bound=loudest))
    return found


def _free(cosines: Real, z: Real, drawn: Real, first: int, free: Sequence[Mechanism]) -> FreeForm:
    """Joint test of the free-form terms, which follow the named ones; ``drawn`` (terms, draws) are scores of noise."""

    def gain(kept: NDArray[np.int64]) -> tuple[float, int]:
        values, vectors = np.linalg.eigh(cosines[np.ix_(kept, kept)])
        strong = values > FREE_FLOOR
        across = vectors[:, strong].T / np.sqrt(values[strong])[:, None]
        dof, by_noise = int(strong.sum()), np.sum((across @ drawn[kept]) ** 2, axis=0)
        more = max(float(by_noise.mean()) / max(dof, 1), 1.0) if by_noise.size else 1.0
        return float(np.sum((across @ z[kept]) ** 2)) / more, dof

    everything = first + np.arange(len(free))
    total, dof = gain(everything)
    by = {}
    for component in sorted({m.component for m in free}):
        alone, own_dof = gain(first + np.flatnonzero([m.component == component for m in free]))
        by[component] = alone - own_dof
    return FreeForm(total, dof, float(chi2.sf(total, max(dof, 1))), by, float(np.max(z[everything] ** 2, initial=0.0)))


def _overall(
    scores: Sequence[Score], others: Sequence[float], cosines: Real, one_signed: Sequence[bool], independent: int
) -> float:
    """P-value of the smallest p-value among all scores: some with ``cosines``, some that count as independent."""
    count = len(one_signed)
    rng = np.random.default_rng(0)
    values, vectors = np.linalg.eigh((cosines + cosines.T) / 2)
    z = rng.standard_normal((DRAWS, count)) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    sided = np.array(one_signed, bool)
    p = np.where(sided, norm.sf(z), 2 * norm.sf(np.abs(z))).min(axis=1, initial=1.0)
    least = max(min([*(s.p_value for s in scores), *others]), 1e-300)
    # as many independent tests as give the drawn minima: exact for the drawn levels, and extrapolated beyond them
    effective = 0.0 if not count else float(DRAWS / -np.sum(np.log1p(-np.minimum(p, 1 - 1e-12))))
    return p_of(least, effective + independent + len(others))
