"""Score tests about a fitted simulation: what a little of each mechanism would do, beside what the rig itself can do.

A mechanism's signature is the change of the simulation for a little of it. Residual, signatures and the slopes of all
free numbers are whitened by an autoregression of the residual; the slopes are projected out; the rest is compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import solve_toeplitz
from scipy.stats import chi2, norm

from analysis.mismatch.rigs.estimate import STEP, Fitted, residuals
from analysis.mismatch.rigs.free_force import FREE_FORCE, TERMS
from analysis.mismatch.rigs.recorded import CHOOSE, FIT, duration
from analysis.mismatch.rigs.simulation import Placed
from sim_backend.mechanisms.mechanism import Mechanism, Scale

Real = NDArray[np.float64]

ORDER: Final = 16  # of the autoregression
SAME: Final = 0.95  # cosine above which two signatures count as one test
REPEATED: Final = 1e-6  # share of a signature that must be left beside the rig's own slopes


@dataclass(frozen=True, slots=True)
class Score:
    """How a mechanism with some values fares: chi-squared taken away, and its estimated strength over the trial's."""

    term: Placed
    gain: float
    strength: float
    p_value: float


@dataclass(frozen=True, slots=True)
class Screening:
    """All scores, best first, and the p-value that the simulation lacks nothing."""

    scores: tuple[Score, ...]
    p_value: float
    labels: tuple[str, ...]
    cosines: Real


def scale_of(fitted: Fitted, place: int) -> Scale:
    """Return how far an element moves in the recordings."""
    simulation = fitted.simulation
    constants = fitted.constants
    reach, speed = 0.0, 0.0
    for number in range(len(simulation.recordings)):
        d, v = simulation.motion(fitted.x, number)
        reach, speed = max(reach, float(np.abs(d[place]).max())), max(speed, float(np.abs(v[place]).max()))
    reach, speed = max(reach, 1e-300), max(speed, 1e-300)
    element = simulation.rig.arrangement.elements[place]
    mass, _, _ = simulation.rig.arrangement.matrices(constants)
    moved = float(np.mean(mass)) * speed**2 / reach
    force = max(constants[element.stiffness] * reach if element.stiffness else 0.0, moved)
    frequency = speed / reach / (2 * math.pi)
    longest = max(duration(r) for r in simulation.recordings)
    return Scale(reach, speed, 0.0, force, (frequency, max(simulation.highest_hz, frequency)), longest)


def banded(fitted: Fitted) -> bool:
    """Whether the recordings were cut down to a band."""
    return any(r.band is not None for r in fitted.simulation.recordings)


def places(fitted: Fitted, mechanism: Mechanism) -> list[int]:
    """Return where in the rig a mechanism may be at work: elements (one for each deformation), channels or inputs."""
    rig = fitted.simulation.rig
    if mechanism.distort is not None:
        if banded(fitted):
            return []  # what tells a bent scale from a bent spring are harmonics, and the band has none
        return list(range(len(rig.drives if mechanism.drives else rig.seen)))
    by_row: dict[object, list[int]] = {}
    for i, e in enumerate(rig.arrangement.elements):
        by_row.setdefault(e.row, []).append(i)
    found = []
    for group in by_row.values():
        roles = [rig.arrangement.elements[i].role for i in group]
        damped = any(rig.arrangement.elements[i].damping is not None for i in group)
        if mechanism.id == "tube_spring_damping" and damped:
            continue
        fitting = [role for role in mechanism.fits if role in roles]
        if fitting:
            found.append(group[roles.index(fitting[0])])
    return found


def trials(fitted: Fitted, known: Sequence[Mechanism]) -> list[Placed]:
    """Return every mechanism in every place with every set of values worth screening."""
    found = []
    scales: dict[int, Scale] = {}
    present = {(t.mechanism.id, t.place) for t in fitted.terms}
    for mechanism in known:
        for place in places(fitted, mechanism):
            if (mechanism.id, place) in present:
                continue
            at = place if mechanism.distort is None else 0
            if at not in scales:
                scales[at] = scale_of(fitted, at)
            found += [Placed(mechanism, values, place) for values in mechanism.trials(scales[at])]
    return found


def free_places(fitted: Fitted, most: int) -> list[int]:
    """Return elements, one for each deformation, that forces of any shape are tried in."""
    rows: dict[object, int] = {}
    for i, e in enumerate(fitted.simulation.rig.arrangement.elements):
        rows.setdefault(e.row, i)
    return list(rows.values())[:most]


def free_terms(fitted: Fitted, most: int) -> list[Placed]:
    """Return the nameless competitor in so many elements at most."""
    return [Placed(FREE_FORCE, FREE_FORCE.trials(scale_of(fitted, p))[0], p) for p in free_places(fitted, most)]


def screen(fitted: Fitted, known: Sequence[Mechanism]) -> Screening:
    """Score every mechanism against what a fit leaves over; held-out samples take no part."""
    simulation = fitted.simulation
    candidates = trials(fitted, known)
    shapes = []
    for term in free_terms(fitted, 2):
        for name in TERMS:
            values = {n: (v if n == name or n not in TERMS else 0.0) for n, v in term.values.items()}
            shapes.append(Placed(term.mechanism, values, term.place))
    blocks = [_whitened(fitted, number, [*candidates, *shapes]) for number in range(len(simulation.recordings))]
    slopes, made, rest = (np.concatenate([b[i] for b in blocks], axis=-1) for i in range(3))
    q, _ = np.linalg.qr(slopes.T)
    before = np.sum(made**2, axis=1)
    rest = rest - q @ (q.T @ rest)
    made = made - (made @ q) @ q.T
    power = np.sum(made**2, axis=1)
    alive = power > REPEATED * before
    power = np.maximum(power, 1e-300)
    count = rest.size - len(slopes)
    total = float(rest @ rest)
    inner = made @ rest
    cosine = np.where(alive, inner / np.sqrt(power * total), 0.0)
    chi = -count * np.log1p(-np.minimum(cosine**2, 1 - 1e-12))
    unit = made / np.sqrt(power)[:, None]
    cosines = unit @ unit.T
    scores: list[Score] = []
    tests: list[int] = []
    for i, term in enumerate(candidates):
        if not alive[i]:
            continue
        one_sided = term.mechanism.one_signed
        gain = float(chi[i]) if inner[i] > 0 or not one_sided else 0.0
        p = float(norm.sf(math.copysign(math.sqrt(chi[i]), inner[i]))) if one_sided else float(chi2.sf(chi[i], 1))
        scores.append(Score(term, gain, float(inner[i] / power[i]), p))
        if not any(abs(cosines[i, j]) > SAME for j in tests):
            tests.append(i)
    overall = 1.0
    if scores:
        smallest = min(s.p_value for s in scores)
        overall = -math.expm1(max(len(tests), 1) * math.log1p(-min(smallest, 1 - 1e-12)))
    free = np.flatnonzero(alive[len(candidates) :]) + len(candidates)
    if free.size:
        overall = min(2 * min(overall, _together(unit[free], rest, total, count)), 1.0)
    scores.sort(key=lambda s: -s.gain)
    labels = tuple(t.mechanism.id for t in candidates)
    return Screening(tuple(scores), overall, labels, cosines[: len(candidates), : len(candidates)])


def _together(unit: Real, rest: Real, total: float, count: int) -> float:
    """P-value of all free shapes at once."""
    _, s, basis = np.linalg.svd(unit, full_matrices=False)
    basis = basis[s > 1e-3 * s[0]]
    share = min(float(np.sum((basis @ rest) ** 2)) / total, 1 - 1e-12)
    return float(chi2.sf(-count * math.log1p(-share), len(basis)))


def _whitened(fitted: Fitted, number: int, terms: Sequence[Placed]) -> tuple[Real, Real, Real]:
    """Return slopes (k, m), signatures (terms, m) and residual (m,), whitened, without held-out samples."""
    simulation = fitted.simulation
    recorded = simulation.recordings[number]
    off, at = residuals(simulation, fitted.x, number)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    filters = [_autoregression(np.where(used, row, 0.0)) for row in off]

    def white(y: Real) -> Real:
        return np.concatenate([signal.lfilter(a, [1.0], row)[used] for a, row in zip(filters, y, strict=True)])

    slopes = []
    for i in range(fitted.x.size):
        moved = fitted.x.copy()
        moved[i] += STEP * max(1.0, abs(moved[i]))
        slopes.append(white((residuals(simulation, moved, number)[0] - off) / STEP))
    made = []
    for term in terms:
        other = simulation.with_terms((*fitted.terms, term), fitted.constants, fitted.states)
        made.append(white(residuals(other, other.begin(), number)[0] - off))
    return np.array(slopes).reshape(len(slopes), -1), np.array(made).reshape(len(made), -1), -white(off)


def _autoregression(row: Real) -> Real:
    """Return the whitening filter of a signal, by Yule and Walker's equations."""
    n = row.size
    size = 2 ** math.ceil(math.log2(2 * n))
    power = np.abs(np.fft.rfft(row, size)) ** 2
    r = np.fft.irfft(power)[: ORDER + 1] / n
    if not r[0] > 0:
        return np.ones(1)
    r[0] *= 1 + 1e-9
    return np.concatenate([[1.0], -solve_toeplitz(r[:-1], r[1:])])


def innovation(row: Real) -> float:
    """Return the rms of what an autoregression cannot predict of a signal."""
    a = _autoregression(row)
    return float(np.std(signal.lfilter(a, [1.0], row)[ORDER:]))
