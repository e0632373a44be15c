"""How well answers fit the truth: counts with their intervals, all of them functions of a list of entries."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import binomtest, chi2, kstest, ncx2

from mesotap.proof.entries import CONSISTENT, LEVEL, MISSING, NEW, UNEXPLAINED, Entry, Named
from mesotap.proof.parameters import true_parameters

GRADES = (3.0, 10.0, 30.0, 100.0, 300.0)
CONFIDENT = 0.9
TRULY_ALIKE = 0.9  # cosine of two surviving signals from which they count as look-alikes
ERROR_ALLOWED = 1.02  # held-out error over that of the fit that knows the answer
STATED = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Edges of the bins of stated probabilities in the calibration."""


@dataclass(frozen=True, slots=True)
class Count:
    """So many of so many, with the exact 95 % interval of the share (Clopper and Pearson)."""

    hits: int
    of: int

    @property
    def share(self) -> float:
        """Share, NaN of nothing."""
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share."""
        if not self.of:
            return 0.0, 1.0
        found = binomtest(self.hits, self.of).proportion_ci(0.95)
        return float(found.low), float(found.high)


def counted(answers: Iterable[bool]) -> Count:
    """Count the true ones."""
    listed = list(answers)
    return Count(sum(listed), len(listed))


def grade(d: float) -> float:
    """Return the grade that a ``d`` is nearest to, on a logarithmic scale."""
    return min(GRADES, key=lambda g: abs(math.log(max(d, 1e-9) / g)))


@dataclass(frozen=True, slots=True)
class Nulls:
    """What was said of sessions in which nothing is hidden.

    ``uniform`` is the p-value of Kolmogorov and Smirnov's test that the p-values are uniform.
    """

    alarms: Count
    not_consistent: Count
    uniform: float
    p_values: tuple[float, ...]


def nulls(entries: Sequence[Entry]) -> Nulls:
    """Score the sessions in which nothing is hidden."""
    mine = [e for e in entries if e.kind == "null"]
    p = tuple(sorted(e.p_value for e in mine))
    uniform = float(kstest(p, "uniform").pvalue) if p else math.nan
    return Nulls(counted(e.detected for e in mine), counted(e.verdict != CONSISTENT for e in mine), uniform, p)


def power(d: float) -> float:
    """Return how often a test at `LEVEL` that knows the signature detects it: chi-squared of one degree about d^2."""
    return float(ncx2.sf(chi2.isf(LEVEL, 1), 1, d**2)) if d > 0 else LEVEL


@dataclass(frozen=True, slots=True)
class AtGrade:
    """What was said of single effects of one grade.

    Attributes
    ----------
    detected
        Of all.
    component
        Right, of the detected.
    right, covered
        First name right; right or the true one among its declared look-alikes.
    false_sets
        Of those covered by a declared look-alike whose cosine was computed: below `TRULY_ALIKE`.
    confident_wrong
        With a name, not only the first, that is neither and has a probability above `CONFIDENT`.
    unexplained, missed
        Verdicts.
    """

    grade: float
    detected: Count
    component: Count
    right: Count
    covered: Count
    false_sets: Count
    confident_wrong: Count
    unexplained: Count
    missed: Count


def by_grade(entries: Sequence[Entry]) -> list[AtGrade]:
    """Score the sessions with one listed effect, a grade a line."""
    out = []
    for g in GRADES:
        mine = [e for e in entries if e.kind == "single" and grade(e.d) == g]
        sets = [e for e in mine if e.covered and not e.right and e.likeness is not None]
        out.append(
            AtGrade(
                g,
                counted(e.detected for e in mine),
                counted(e.located in e.components for e in mine if e.detected),
                counted(e.right for e in mine),
                counted(e.covered for e in mine),
                counted((e.likeness or 0.0) < TRULY_ALIKE for e in sets),
                counted(confidently_wrong(e) for e in mine),
                counted(e.verdict == UNEXPLAINED for e in mine),
                counted(e.verdict == CONSISTENT for e in mine),
            )
        )
    return out


def true_of(m: Named, e: Entry) -> bool:
    """Return whether a name, or a look-alike that is declared beside it, is hidden in the session."""
    return bool({m.id, *m.alike} & set(e.effects))


def confidently_wrong(e: Entry) -> bool:
    """Return whether any name is stated with confidence that is neither true nor said to look like what is.

    A law that was learned names nothing: it is wrong where nothing is hidden in its component.
    """
    return any(
        m.probability > CONFIDENT and not (m.component in e.components if m.learned else true_of(m, e)) for m in e.named
    )


@dataclass(frozen=True, slots=True)
class Unlisted:
    """What was said, at one grade, where no listed name can be right.

    ``unexplained`` counts laws that were learned (`new_physics`), too; ``confident_wrong`` listed names first.
    """

    grade: float
    unexplained: Count
    confident_wrong: Count
    missed: Count


def unlisted(entries: Sequence[Entry], kind: str) -> list[Unlisted]:
    """Score sessions whose effect is excluded from the list, or was never on it, one line per grade."""
    out = []
    for g in GRADES[2:]:
        mine = [e for e in entries if e.kind == kind and grade(e.d) == g]
        confident = counted(
            e.first is not None and not e.first.learned and e.first.probability > CONFIDENT for e in mine
        )
        out.append(
            Unlisted(
                g,
                counted(e.verdict in (UNEXPLAINED, NEW) for e in mine),
                confident,
                counted(e.verdict == CONSISTENT for e in mine),
            )
        )
    return out


@dataclass(frozen=True, slots=True)
class Pairs:
    """What was said of two effects at once; look-alikes declared beside a name count as that name."""

    both: Count
    one: Count
    confident_wrong: Count
    detected: Count
    unexplained: Count


def pairs(entries: Sequence[Entry]) -> Pairs:
    """Score the sessions with two effects."""
    mine = [e for e in entries if e.kind == "two"]
    found = [_found(e) for e in mine]
    return Pairs(
        counted(n >= 2 for n in found),
        counted(n >= 1 for n in found),
        counted(confidently_wrong(e) for e in mine),
        counted(e.detected for e in mine),
        counted(e.verdict == UNEXPLAINED for e in mine),
    )


def _found(e: Entry) -> int:
    """How many hidden effects the names account for, a name for one effect at most."""
    left = list(e.effects)
    rest = []
    for m in e.named:
        if m.id in left:
            left.remove(m.id)
        else:
            rest.append(m)
    for m in rest:
        match = next((x for x in left if x in m.alike), None)
        if match is not None:
            left.remove(match)
    return len(e.effects) - len(left)


@dataclass(frozen=True, slots=True)
class Covering:
    """How often the 95 % intervals of one parameter hold its true value."""

    mechanism: str
    parameter: str
    inside: Count


def coverage(entries: Sequence[Entry]) -> list[Covering]:
    """Score the intervals of effects that are named rightly, alone or of two, a parameter a line."""
    seen: dict[tuple[str, str], list[bool]] = {}
    for e in entries:
        if e.kind not in ("single", "two"):
            continue
        for m in e.named:
            true = true_parameters(e.truth, m.id) if m.id in e.effects else {}
            for name, value in true.items():
                if name in m.intervals:
                    low, high = m.intervals[name]
                    seen.setdefault((m.id, name), []).append(low <= value <= high)
    return [Covering(*key, counted(inside)) for key, inside in sorted(seen.items())]


def together(lines: Sequence[Covering]) -> Count:
    """Return the count over all parameters."""
    return Count(sum(c.inside.hits for c in lines), sum(c.inside.of for c in lines))


def limits(entries: Sequence[Entry]) -> list[tuple[float, Count]]:
    """Return by grade how often the upper limit of a single hidden effect that is not named holds its strength."""
    held: dict[float, list[bool]] = {g: [] for g in GRADES}
    for e in entries:
        if e.kind != "single" or e.effects[0] not in e.limits:
            continue
        name, limit = e.limits[e.effects[0]]
        true = true_parameters(e.truth, e.effects[0])
        if name in true:
            held[grade(e.d)].append(abs(true[name]) <= limit)
    return [(g, counted(inside)) for g, inside in held.items() if inside]


def complete(e: Entry) -> bool:
    """Whether what is named, and nothing else, is hidden."""
    return {m.id for m in e.named} == set(e.effects)


@dataclass(frozen=True, slots=True)
class Reliability:
    """Names stated with a probability from ``low`` to ``high``: the mean of it, and how often they were right."""

    low: float
    high: float
    mean: float
    right: Count


def calibration(entries: Sequence[Entry]) -> tuple[list[Reliability], float]:
    """Score the stated probabilities of all names, and return Brier's score of them (NaN without any).

    A name is right where it, or one of its declared look-alikes, is hidden in the session and on the list. Learned laws
    are left out.
    """
    stated = [
        (m.probability, e.kind not in ("excluded", "outside") and true_of(m, e))
        for e in entries
        for m in e.named
        if not m.learned
    ]
    out = []
    for low, high in pairwise(STATED):
        inside = [(p, right) for p, right in stated if low <= p < high or (high == STATED[-1] and p == high)]
        mean = float(np.mean([p for p, _ in inside])) if inside else math.nan
        out.append(Reliability(low, high, mean, counted(right for _, right in inside)))
    brier = float(np.mean([(p - right) ** 2 for p, right in stated])) if stated else math.nan
    return out, brier


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Held-out error over that of the fit that knows the answer, of sessions whose verdict is right."""

    ratios: tuple[float, ...]
    within: Count

    @property
    def median(self) -> float:
        """Median ratio, NaN of none."""
        return float(np.median(self.ratios)) if self.ratios else math.nan


def held_out(entries: Sequence[Entry]) -> HeldOut:
    """Score the held-out error of nulls that are found consistent and of single effects that are named rightly."""
    good = [e for e in entries if (e.kind == "null" and e.verdict == CONSISTENT) or (e.kind == "single" and e.right)]
    ratios = tuple(sorted(e.heldout_rms / e.knowing_rms for e in good if e.knowing_rms > 0 and e.heldout_rms > 0))
    return HeldOut(ratios, counted(r <= ERROR_ALLOWED for r in ratios))


def confusion(entries: Sequence[Entry]) -> dict[str, dict[str, int]]:
    """Return how often each thing was said of each thing hidden.

    What is said is a name, `unexplained` or `consistent`; what is hidden is nothing, a listed effect alone from d = 30
    on, or (in brackets) one outside the list.
    """
    out: dict[str, dict[str, int]] = {}
    for e in entries:
        if e.kind == "null":
            true = "nothing"
        elif e.kind == "single" and grade(e.d) >= 30:
            true = e.effects[0]
        elif e.kind == "outside":
            true = f"({e.effects[0]})"
        else:
            continue
        said = e.first.id if e.verdict == MISSING and e.first is not None else e.verdict
        line = out.setdefault(true, {})
        line[said] = line.get(said, 0) + 1
    return out
