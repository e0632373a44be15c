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
DRAWS = 50  # of white noise that all tests are made on: as how many independent ones they count is known to 15 %
TOLD = 1e-9  # p-value of what is left by frequency or time below which that number changes nothing


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

    @property
    def beyond_one(self) -> float:
        """Of what is unexplained, what no single mechanism would take away."""
        return self.unexplained - max((s.gain for s in self.scores), default=0.0)


def screen(problem: Problem[FitOf], fitted: FitOf, known: Iterable[Mechanism], ranks: bool = False) -> Screening:
    """Score every mechanism against the residual of a fit.

    Parameters
    ----------
    fitted
        Of the linear rig (or of a rig with mechanisms already in it: then scores are to first order about it).
    ranks
        Only the order of the scores is asked for: nothing is made of forces of any shape.
    """
    known = list(known)
    terms = problem.trials(fitted, [m for m in known if not isinstance(m, SecondImpact)])
    rings = [isinstance(t.mechanism, AddedBody | Tones) for t in terms]
    ringing = [t for t, r in zip(terms, rings, strict=True) if r]
    named = [t for t, r in zip(terms, rings, strict=True) if not r]
    free = [] if ranks else free_terms(problem, fitted)
    problem.budget.spent += (SCREENED + EACH * len(known)) * problem.samples
    by_power, left = problem.unmodelled(fitted)
    wide = problem.draws(fitted)
    # where the power of what is left tells already, as how many tests all of them count does not matter
    draws = wide or (DRAWS if min(by_power, default=1.0) > TOLD else 0)
    sums = _summed(problem, fitted, [*named, *free], ringing, draws)
    precision = problem.precision(fitted)
    size = precision.size
    schur = eliminated(sums.gram, size, precision)
    count = len(named) + len(free)
    inner, score = schur[:count, :count], schur[:count, -1]
    scale = _Noise(problem.noise_known, float(schur[-1, -1]), sums.count - size, wide > 0)
    power = np.maximum(np.diag(inner), REPEATED * np.diag(sums.gram)[size : size + count] + 1e-300)
    drawn = _drawn(schur, np.sqrt(power), sums.count - size)
    wider = scale.wider(drawn)
    drawn /= wider[:, None]
    z = scale.standardised(score / np.sqrt(power)) / wider
    scores = [
        _scored(t, float(value), float(s), float(g), scale.deviation * float(w))
        for t, value, s, g, w in zip(named, z, score, power, wider, strict=False)
    ]
    rung, rung_by_chance = _rung_scores(ringing, sums.tests, precision, scale)
    again = [problem.second_impact(fitted, m) for m in known if isinstance(m, SecondImpact) and problem.allows(m)]
    scores += [*rung, *again]
    cosines = inner / np.outer(np.sqrt(power), np.sqrt(power))
    rest, rest_by_chance = _free(cosines, z, drawn, len(named), [t.mechanism for t in free], scale)
    at = slice(len(named))
    signs = np.array([t.mechanism.one_signed for t in named], bool)
    chances = np.concatenate([_tail(drawn[at], signs[:, None]), rung_by_chance, rest_by_chance[None]])
    least = min([*(s.p_value for s in scores), rest.p_value, *by_power])
    p_value = p_of(max(least, 1e-300), effective_number(chances) + len(again) + len(by_power))
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


def _tail(z: Real, one_sided: NDArray[np.bool_] | bool) -> Real:
    """Return p-values of standard normal scores."""
    return np.where(one_sided, norm.sf(z), 2 * norm.sf(np.abs(z)))


def effective_number(chances: Real) -> float:
    """Return as how many independent tests so many count, from their p-values (tests, draws) in draws of noise.

    The smallest of N independent p-values is below p with the probability 1 - (1 - p)^N; N is the likeliest one.
    """
    if not chances.size:  # as many as they are, without draws
        return float(len(chances))
    smallest = np.minimum(chances.min(axis=0), 1 - 1e-12)
    return float(smallest.size / -np.sum(np.log1p(-smallest)))


def _scored(term: Term, z: float, score: float, power: float, deviation: float) -> Score:
    """Return the score of a term whose strength is one number, in noise of this deviation along it."""
    one_sided = term.mechanism.one_signed
    gain = z**2 if z > 0 or not one_sided else 0.0
    p = float(_tail(np.array(z), one_sided))
    return Score(term, gain, 1, score / power, p, deviation / math.sqrt(power))


@dataclass(frozen=True, slots=True)
class _Noise:
    """The residual's variance, one where it is ``known``; else from what is left of it, ``total`` over ``count``.

    Scores spread more than by it, as draws of the noise do, where that is ``wide``: not white along the segments.
    """

    known: bool
    total: float
    count: int
    wide: bool = False

    @property
    def deviation(self) -> float:
        return 1.0 if self.known else math.sqrt(max(self.total, 1e-300) / max(self.count, 1))

    def standardised(self, z: Real) -> Real:
        """Return scores as standard normal ones."""
        if self.known:
            return z
        share = np.minimum(z**2 / max(self.total, 1e-300), 1 - 1e-12)
        return np.asarray(np.sign(z) * np.sqrt(-self.count * np.log1p(-share)), np.float64)

    def wider(self, drawn: Real) -> Real:
        """Return by how much scores (terms, draws) of noise spread more than those of white noise would."""
        return np.sqrt(np.maximum(np.mean(drawn**2, axis=1), 1.0)) if self.wide else np.ones(len(drawn))

    def larger(self, drawn: Real, dof: int) -> float:
        """Return by how much gains (draws,) in noise are larger on average than so many free numbers make them."""
        return max(float(drawn.mean()) / max(dof, 1), 1.0) if self.wide else 1.0

    def chi_squared(self, gain: float) -> float:
        """Return a fall of the sum of squares as chi-squared."""
        return float(self.standardised(np.array([math.sqrt(max(gain, 0.0))]))[0] ** 2)


@dataclass(slots=True)
class _Sums:
    """Inner products of all columns and draws of noise over some segments, and the tests of what rings by itself."""

    gram: Real
    tests: RingingTests
    draws: int
    random: np.random.Generator
    count: int = 0

    def add(self, columns: Columns, size: int) -> None:
        """Take in a segment."""
        noise = columns.noise
        if noise is None:
            noise = self.random.standard_normal((columns.residual.size, self.draws))
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


def _summed(
    problem: Problem[FitOf], fitted: FitOf, terms: Sequence[Term], ringing: Sequence[Term], draws: int
) -> _Sums:
    """Return the sums over all segments: always in the same parts, done side by side."""
    size = problem.precision(fitted).size
    lines = [len(_lines_of(t)) if problem.noise_known else 0 for t in ringing]

    def part(number: int, columns: Iterable[Columns]) -> _Sums:
        width = size + len(terms) + draws + 1
        tests = RingingTests(lines, size, draws)
        sums = _Sums(np.zeros((width, width)), tests, draws, np.random.default_rng(number))
        for one in columns:
            sums.add(one, size)
        return sums

    parts = list(problem.columns(fitted, terms, ringing))
    with ThreadPoolExecutor(max(len(parts), 1)) as pool:
        first, *others = pool.map(part, range(len(parts)), parts)
    for other in others:
        first.take(other)
    return first


def _lines_of(term: Term) -> Sequence[float]:
    """Return the frequencies (Hz) of tones."""
    return term.mechanism.lines(term.values) if isinstance(term.mechanism, Tones) else ()


def _rung_scores(
    terms: Sequence[Term], tests: RingingTests, precision: Real, noise: _Noise
) -> tuple[list[Score], Real]:
    """Return the score of each term that adds vibrations to every segment, and (terms, draws) p-values in noise."""
    found = []
    by_chance = np.ones((len(terms), tests.gain.shape[1] - 1))
    for i, t in enumerate(terms):
        rest, power = tests.beside(i, precision)
        alone = not rest[0] > 1e-9 * tests.gram[i, tests.known, tests.known]
        size = np.inf if alone else math.sqrt(rest[0])
        drawn = rest[1:-1] / size / np.sqrt(np.maximum(power[:-1], 1e-300) / max(noise.count, 1))
        wider = float(noise.wider(drawn[None])[0])
        values = np.append(drawn, rest[-1] / size) / wider
        signed = np.where((values > 0) | (not t.mechanism.one_signed), values**2, 0.0)
        gains = tests.gain[i] / noise.larger(tests.gain[i, :-1], int(tests.dof[i])) + signed
        dof = max(int(tests.dof[i]) + (0 if alone else 1), 1)
        gain = noise.chi_squared(gains[-1])
        by_chance[i] = chi2.sf(gains[:-1], dof)
        strength = rest[-1] / size**2
        error = math.nan if alone else noise.deviation * wider / size
        bounds = [amplitude_bound(*line) for line in tests.lines[i].T if line[1] > 0]
        loudest = max(bounds, default=math.nan)
        p_value = float(chi2.sf(gain, dof))
        found.append(Score(t, gain, dof, float(strength), p_value, error, bound=loudest))
    return found, by_chance


def _free(
    cosines: Real, z: Real, drawn: Real, first: int, free: Sequence[Mechanism], noise: _Noise
) -> tuple[FreeForm, Real]:
    """Joint test of the free-form terms, which follow the named ones; ``drawn`` (terms, draws) are scores of noise.

    The second is (draws,) its p-value in each of these.
    """

    def gain(kept: NDArray[np.int64]) -> tuple[float, int, Real]:
        values, vectors = np.linalg.eigh(cosines[np.ix_(kept, kept)])
        strong = values > FREE_FLOOR
        across = vectors[:, strong].T / np.sqrt(values[strong])[:, None]
        dof, by_noise = int(strong.sum()), np.sum((across @ drawn[kept]) ** 2, axis=0)
        more = noise.larger(by_noise, dof)
        return float(np.sum((across @ z[kept]) ** 2)) / more, dof, by_noise / more

    everything = first + np.arange(len(free))
    total, dof, by_noise = gain(everything)
    by = {}
    for component in sorted({m.component for m in free}):
        alone, own_dof, _ = gain(first + np.flatnonzero([m.component == component for m in free]))
        by[component] = alone - own_dof
    best = float(np.max(z[everything] ** 2, initial=0.0))
    found = FreeForm(total, dof, float(chi2.sf(total, max(dof, 1))), by, best)
    return found, np.asarray(chi2.sf(by_noise, max(dof, 1)), np.float64)
