"""Score tests: what each mechanism would do to the records, projected off all that the linear rig can mimic.

A mechanism's force along the fitted linear motion goes through the linear rig, the filter and the whitening; what the
amplitudes of each impact and the constants of the rig can explain is taken out; the rest is compared with the residual.
All of it is inner products of a few columns, kept load by load.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve
from scipy.stats import chi2

from analysis.mismatch.baseline import Nuisance, Sensitivity, slope_columns
from analysis.mismatch.excess import Excess, excess_by_frequency, excess_by_time
from analysis.mismatch.fit import Fit
from analysis.mismatch.free_form import free_terms
from analysis.mismatch.model import struck_again
from analysis.mismatch.problem import Term
from analysis.mismatch.response import Response, response, whiten
from analysis.mismatch.signatures import RecordSignatures, Signatures
from sim_backend.arrangement import LOAD, Element
from sim_backend.mechanisms.mechanism import Mechanism, Scale

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

PARTS = 2  # in which records are gone through side by side
EARLY_S = 2.5e-3  # of a record: where amplitudes are read
BLOW_FROM_S, BLOW_TO_S = 1.0e-3, 40e-3  # after the tap: where a second blow is looked for
SHARES = np.geomspace(5e-4, 0.5, 60)  # of a second blow
FREE_FLOOR = 1e-5  # eigenvalue of the free terms' cosines below which they repeat each other
SCREENED, EACH = 35.0, 5.0  # effort of a screening, and of each mechanism in it, of a sample
DRAWS = 4000  # of the null distribution of the largest score


@dataclass(frozen=True, slots=True)
class Score:
    """How a mechanism fares against the residual of the linear rig.

    Attributes
    ----------
    gain
        Chi-squared that it would take away, and for how many free numbers (``dof``).
    strength
        Estimate of its strength relative to the trial's (of a mechanism without one: 1 is expected).
    p_value
        Of this trial alone.
    delays, choice
        For a second blow: its sample after each record's first one, and the chi-squared that choosing these took.
    """

    term: Term
    gain: float
    dof: int
    strength: float
    p_value: float
    delays: tuple[float, ...] = ()
    choice: float = 0.0


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
    """All scores, best first; ``cosines`` of the projected signatures of ``labels`` with each other."""

    scores: tuple[Score, ...]
    p_value: float
    labels: tuple[str, ...]
    cosines: Real
    free: FreeForm
    bins: Excess

    @property
    def unexplained(self) -> float:
        """Chi-squared beyond chance that forces and channels of any shape, or lines in the spectra, would take away."""
        return max(self.free.gain - self.free.dof, self.bins.gain, 0.0)


def scale_of(fit: Fit, element: Element) -> Scale:
    """Return how far an element moves after the taps."""
    problem, place = fit.problem, fit.arrangement.elements.index(element)
    count = int(EARLY_S * problem.recordings.sample_rate_hz)
    t = np.arange(count) / problem.recordings.sample_rate_hz
    values = [fit.constants.at(g) for g in range(len(fit.modes))]
    to = [response(fit.arrangement, v, m.rig, problem.analog) for v, m in zip(values, fit.modes, strict=True)]
    rows = []
    for record, amplitudes in zip(problem.recordings.records, fit.amplitudes, strict=True):
        d, v = to[record.group].motion(amplitudes, place, t)
        stiffness = _stiffness(fit, element, values[record.group])
        rows.append((np.abs(d).max(), np.abs(v).max(), record.preload_n / stiffness, stiffness * np.abs(d).max()))
    middle = np.median(rows, axis=0)
    frequencies = np.array([np.abs(m.rig.poles) / (2 * np.pi) for m in fit.modes])
    deformation, rate, static, force = map(float, middle)
    return Scale(deformation, rate, static, force, (float(frequencies.min()), float(frequencies.max())))


def _stiffness(fit: Fit, element: Element, values: dict[str, float]) -> float:
    """Of the element; of the first that has one where it has none of its own."""
    names = [element.stiffness, *(e.stiffness for e in fit.arrangement.elements)]
    return next(values[n] for n in names if n is not None)


def trials(fit: Fit, known: Sequence[Mechanism]) -> list[Term]:
    """Return every mechanism with every set of values worth screening in these recordings."""
    found = []
    scales: dict[str, Scale] = {}
    for mechanism in known:
        elements = [e for e in fit.arrangement.elements if e.role == mechanism.acts]
        if (mechanism.law is not None or mechanism.shape is not None) and not elements:
            continue
        element = elements[0] if elements else fit.arrangement.elements[0]
        if element.name not in scales:
            scales[element.name] = scale_of(fit, element)
        found += [Term(mechanism, values) for values in mechanism.trials(scales[element.name])]
    return found


def screen(fit: Fit, known: Sequence[Mechanism]) -> Screening:
    """Score every mechanism against the residual of a fit.

    Parameters
    ----------
    fit
        Of the linear rig (or of a rig with mechanisms already in it: then scores are to first order about it).
    """
    present = {t.mechanism.id for t in fit.terms}
    known = [m for m in known if m.id not in present or m.blow]
    terms = [t for t in trials(fit, known) if not t.mechanism.blow]
    ringing = [t for t in terms if t.mechanism.extend is not None or t.mechanism.lines is not None]
    named = [t for t in terms if t not in ringing]
    free = trials(fit, free_terms(len(fit.problem.recordings.noise)))
    shared = named + free
    problem = fit.problem
    problem.effort.spent += (SCREENED + EACH * len(known)) * problem.samples
    slow = problem.slow
    lines = [hz for t in fit.terms if t.mechanism.lines is not None for hz in t.mechanism.lines(t.values)]
    if lines:
        slow = np.append(slow, 2j * np.pi * np.array(lines))
    signatures = Signatures(fit, ringing)
    known_size = fit.constants.rig.size + fit.constants.load.size
    sums = _summed(signatures, shared, slow)
    gram, tests = sums.gram, sums.tests
    precision = np.array(
        [
            1 / p.uncertainty**2 if np.isfinite(p.uncertainty) else 0.0
            for p in fit.arrangement.parameters
            if p.scope != LOAD
        ]
    )
    schur = _eliminated(gram, known_size, precision)
    inner, score = schur[:-1, :-1], schur[:-1, -1]
    power = np.maximum(np.diag(inner), 1e-12 * np.diag(gram)[known_size:-1] + 1e-300)
    z = score / np.sqrt(power)
    scores = []
    for t, value, g, s_ in zip(named, z, power, score, strict=False):
        one_sided = t.mechanism.one_signed
        gain = float(value**2) if value > 0 or not one_sided else 0.0
        p = _tail(float(value), one_sided)
        scores.append(Score(t, gain, 1, float(s_ / g), p))
    scores += tests.scores(precision)
    for mechanism in known:
        if mechanism.blow:
            scores.append(_second_blow(fit, mechanism, Nuisance(problem.recordings, slow), signatures.to))
    cosines = inner / np.outer(np.sqrt(power), np.sqrt(power))
    rest = _free(cosines, z, len(named), [t.mechanism for t in free])
    bins = excess_by_frequency(fit)
    others = [rest.p_value, bins.p_value, excess_by_time(fit).p_value]
    p_value = _overall(scores, others, cosines[: len(named), : len(named)], [t.mechanism.one_signed for t in named])
    scores.sort(key=lambda s_: (s_.dof - s_.gain) / math.sqrt(s_.dof + 1) if s_.dof > 1 else -s_.gain)
    labels = tuple(t.mechanism.id for t in named)
    return Screening(tuple(scores), p_value, labels, cosines[: len(named), : len(named)], rest, bins)


@dataclass(slots=True)
class _Sums:
    """Inner products of all columns over some records, and the tests of what rings by itself."""

    gram: Real
    tests: _RingingTests


def _summed(signatures: Signatures, shared: Sequence[Term], slow: Complex) -> _Sums:
    """Return the sums over all records: always in the same parts, done side by side."""
    count = len(signatures.fit.records)
    parts = [range(i, min(i + count // PARTS + 1, count)) for i in range(0, count, count // PARTS + 1)]
    with ThreadPoolExecutor(PARTS) as pool:
        first, *others = pool.map(lambda numbers: _part(signatures, shared, slow, numbers), parts)
    for other in others:
        first.gram += other.gram
        first.tests.take(other.tests)
    return first


def _part(signatures: Signatures, shared: Sequence[Term], slow: Complex, numbers: Sequence[int]) -> _Sums:
    fit = signatures.fit
    nuisance = Nuisance(fit.problem.recordings, slow)
    common = fit.constants.rig.size
    groups, each = fit.constants.load.shape
    known = common + groups * each
    gram = np.zeros((known + len(shared) + 1, known + len(shared) + 1))
    tests = _RingingTests(signatures.terms, known)
    for number in numbers:
        record = signatures.of(number)
        group = record.record.group
        s: Sensitivity = fit.modes[group]
        q, _ = nuisance.basis(s, record.record)
        slopes = slope_columns(s, fit.amplitudes[number], record.record, signatures.rate).reshape(len(q), -1)
        made = record.shared(shared).reshape(len(shared), -1).T
        block = np.column_stack([slopes, made, fit.residuals[number].ravel()])
        block -= q @ (q.T @ block)
        where = np.r_[np.arange(common), common + group * each + np.arange(each), known + np.arange(len(shared) + 1)]
        gram[np.ix_(where, where)] += block.T @ block
        tests.add(record, np.column_stack([block[:, : common + each], block[:, -1]]), q, where[: common + each])
    return _Sums(gram, tests)


class _RingingTests:
    """Tests of what rings on by itself in every record (added bodies, tones), beside its effect on the rig's modes."""

    def __init__(self, terms: Sequence[Term], known_size: int):
        self.terms, self.known = terms, known_size
        self.gain = np.zeros(len(terms))
        self.dof = np.zeros(len(terms), int)
        self.gram = np.zeros((len(terms), known_size + 2, known_size + 2))

    def add(self, record: RecordSignatures, block: Real, q: Real, where: NDArray[np.int64]) -> None:
        """Take in a record: ``block`` holds the constants' slopes at ``where`` and the residual, projected by q."""
        if not self.terms:
            return
        made = [record.ringing(i) for i in range(len(self.terms))]
        starts = np.cumsum([0] + [len(o) for _, o in made])
        x = np.concatenate([*(o for _, o in made), [c for c, _ in made]]).reshape(-1, block.shape[0])
        seen, taken = x @ block, x @ q  # what q takes up is subtracted from the products, not from x
        inner = block.T @ block

        def products(a: NDArray[np.int64], b: NDArray[np.int64]) -> Real:
            return np.asarray(x[a] @ x[b].T - taken[a] @ taken[b].T, np.float64)

        local = np.r_[where, self.known, self.known + 1]
        for i in range(len(self.terms)):
            o, c = np.arange(starts[i], starts[i + 1]), np.array([starts[-1] + i])
            small = np.zeros((local.size, local.size))
            rest = np.r_[np.arange(where.size), where.size + 1]
            small[np.ix_(rest, rest)] = inner
            small[where.size, rest] = small[rest, where.size] = seen[c[0]]
            small[where.size, where.size] = products(c, c)[0, 0]
            if o.size:
                across = np.insert(seen[o], where.size, products(o, c)[:, 0], axis=1)
                power = products(o, o)
                if not np.all(np.diag(power) > FREE_FLOOR * np.sum(x[o] ** 2, axis=1)):
                    continue  # the rig rings at this frequency itself
                scale = np.sqrt(np.diag(power))
                values, vectors = np.linalg.eigh(power / np.outer(scale, scale))
                kept = values > 1e-8
                across = (vectors[:, kept] / np.sqrt(values[kept])).T @ (across / scale[:, None])
                self.gain[i] += float(across[:, -1] @ across[:, -1])
                self.dof[i] += int(kept.sum())
                small -= across.T @ across
            self.gram[i][np.ix_(local, local)] += small

    def take(self, other: _RingingTests) -> None:
        """Add what another one was given of further records."""
        self.gain += other.gain
        self.dof += other.dof
        self.gram += other.gram

    def scores(self, precision: Real) -> list[Score]:
        """One for each term."""
        found = []
        for i, t in enumerate(self.terms):
            rest = _eliminated(self.gram[i], self.known, precision)
            alone = t.mechanism.lines is not None or not rest[0, 0] > 1e-9 * self.gram[i][self.known, self.known]
            value = 0.0 if alone else rest[0, 1] / math.sqrt(rest[0, 0])
            signed = value > 0 or not t.mechanism.one_signed
            gain = self.gain[i] + (value**2 if signed else 0.0)
            dof = int(self.dof[i]) + (0 if alone else 1)
            strength = 0.0 if alone else rest[0, 1] / rest[0, 0]
            found.append(Score(t, float(gain), dof, float(strength), float(chi2.sf(gain, dof))))
        return found


def _free(cosines: Real, z: Real, first: int, free: Sequence[Mechanism]) -> FreeForm:
    """Joint test of the free-form terms, which follow the named ones."""

    def gain(kept: NDArray[np.int64]) -> tuple[float, int]:
        values, vectors = np.linalg.eigh(cosines[np.ix_(kept, kept)])
        strong = values > FREE_FLOOR
        return float(np.sum((vectors[:, strong].T @ z[kept]) ** 2 / values[strong])), int(strong.sum())

    everything = first + np.arange(len(free))
    total, dof = gain(everything)
    by = {}
    for component in sorted({m.component for m in free}):
        kept = first + np.flatnonzero([m.component == component for m in free])
        alone, own_dof = gain(kept)
        by[component] = alone - own_dof
    return FreeForm(total, dof, float(chi2.sf(total, dof)), by, float(np.max(z[everything] ** 2)))


def _eliminated(gram: Real, count: int, precision: Real) -> Real:
    """Schur complement of the first ``count`` rows, the rig's constants having a known precision."""
    a = gram[:count, :count].copy()
    a[np.arange(precision.size), np.arange(precision.size)] += precision
    scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
    b = gram[:count, count:] / scale[:, None]
    out: Real = gram[count:, count:] - b.T @ np.linalg.lstsq(a / np.outer(scale, scale), b, rcond=1e-12)[0]
    return out


def _tail(z: float, one_sided: bool) -> float:
    """P-value of a standard normal score."""
    from scipy.stats import norm

    return float(norm.sf(z)) if one_sided else float(2 * norm.sf(abs(z)))


def _overall(scores: Sequence[Score], others: Sequence[float], cosines: Real, one_signed: Sequence[bool]) -> float:
    """P-value of the smallest p-value among all scores."""
    from scipy.stats import norm

    count = len(one_signed)
    rng = np.random.default_rng(0)
    values, vectors = np.linalg.eigh((cosines + cosines.T) / 2)
    z = rng.standard_normal((DRAWS, count)) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    sided = np.array(one_signed)
    p = np.where(sided, norm.sf(z), 2 * norm.sf(np.abs(z))).min(axis=1, initial=1.0)
    independent = [s for s in scores if s.dof != 1 or s.term.mechanism.blow]
    least = max(min([*(s.p_value for s in scores), *others]), 1e-300)
    # as many independent tests as give the drawn minima: exact for the drawn levels, and extrapolated beyond them
    effective = 0.0 if not count else float(DRAWS / -np.sum(np.log1p(-np.minimum(p, 1 - 1e-12))))
    tests = effective + len(independent) + len(others)
    return float(-math.expm1(tests * math.log1p(-min(least, 1 - 1e-12))))


def _second_blow(fit: Fit, mechanism: Mechanism, nuisance: Nuisance, responses: Sequence[Response]) -> Score:
    """Likelihood of a second blow of one share of the first in all records, its delay anywhere in each."""
    recordings = fit.problem.recordings
    rate = recordings.sample_rate_hz
    evidence = np.zeros(SHARES.size)
    delays, per_record = [], []
    for number, record in enumerate(fit.records):
        to = responses[record.group]
        samples = record.y.shape[1]
        soonest = record.pulse.shape[1] - record.since_tap_s * rate  # so that all of the pulse is in the record
        h = whiten(struck_again(to, fit.amplitudes[number], replace(record, second=soonest), rate), recordings.noise)
        first = max(0, int(BLOW_FROM_S * rate - record.start_s * rate - soonest))
        last = min(int(BLOW_TO_S * rate - soonest), samples - 200)
        q, _ = nuisance.basis(fit.modes[record.group], record)
        q = q.reshape(*record.y.shape, -1)
        both = np.concatenate([fit.residuals[number][:, :, None], q], axis=2)
        flipped = h[:, ::-1]
        parts = [oaconvolve(both[c], flipped[c][:, None], axes=0)[samples - 1 :] for c in range(len(h))]
        seen = np.sum(parts, axis=0)
        square = np.cumsum(np.sum(h**2, axis=0))[::-1]
        use = slice(first, last)
        s, g = seen[use, 0], np.maximum(square[use] - np.sum(seen[use, 1:] ** 2, axis=1), 1e-12)
        log_ratio = SHARES[:, None] * s - SHARES[:, None] ** 2 * g / 2
        top = log_ratio.max(axis=1)
        evidence += top + np.log(np.mean(np.exp(log_ratio - top[:, None]), axis=1))
        per_record.append((s, g, first + soonest))
    best = int(np.argmax(evidence))
    share = float(SHARES[best])
    highest = 0.0
    for s, g, first in per_record:
        log_ratio = share * s - share**2 * g / 2
        delays.append(first + float(np.argmax(log_ratio)))
        highest += float(log_ratio.max())
    found = float(evidence[best])
    term = Term(mechanism, {mechanism.parameters[0].name: share})
    # the likelihood ratio has mean one under the null, so that it exceeds e^x with a probability below e^-x
    p = min(1.0, math.exp(-min(max(found - math.log(SHARES.size), 0.0), 700.0)))
    return Score(term, max(2 * found, 0.0), 1, share, p, tuple(delays), 2 * (highest - found))
