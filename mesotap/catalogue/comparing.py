"""Sessions held against each other: the difference at each load and over all of them, with its uncertainty."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from calibration.budget import Budget, Contribution
from mesotap.catalogue.curves import DAMPING, QUANTITIES, SLOPE_UNSURE, STIFFNESS, Compared, Curve, Point, merged

CLOSE = 0.1
"""Relative difference of two loads up to which they are compared, each number taken to their mean by the slope."""


@dataclass(frozen=True, slots=True)
class Difference:
    """B against A: a ratio of k_c, or a difference of zeta, with its 95 % interval.

    Attributes
    ----------
    load_mn
        At which, None for the mean over all loads that both have.
    value, low, high
        k_c of B over that of A; zeta of B less that of A.
    p_value
        Of the hypothesis that they are equal (two-sided); at single loads adjusted for their number (Holm, 1979).
    separate_half_width
        Half of the interval, of the logarithm for a ratio, had nothing been taken to be common.
    """

    quantity: str
    a: str
    b: str
    load_mn: float | None
    value: float
    low: float
    high: float
    p_value: float
    half_width: float
    separate_half_width: float


def differences(sessions: Sequence[Compared]) -> list[Difference]:
    """Return the differences of every pair of sessions, each with the mean over loads first."""
    found = []
    for a, b in itertools.combinations(sessions, 2):
        for quantity in QUANTITIES:
            found += _of_pair(a, b, quantity)
    return found


def matched(a: Curve, b: Curve) -> list[tuple[Point, Point]]:
    """Return points of two curves at loads that are `CLOSE`, each of them once, the closest first taken."""
    near = sorted(
        (abs(math.log(p.load_mn / q.load_mn)), i, j)
        for i, p in enumerate(a.points)
        for j, q in enumerate(b.points)
        if abs(math.log(p.load_mn / q.load_mn)) <= CLOSE
    )
    pairs: dict[int, int] = {}
    for _, i, j in near:
        if i not in pairs and j not in pairs.values():
            pairs[i] = j
    return [(a.points[i], b.points[j]) for i, j in sorted(pairs.items())]


def _of_pair(a: Compared, b: Compared, quantity: str) -> list[Difference]:
    pairs = [_at_one_load(p, q, quantity) for p, q in matched(a.curves[quantity], b.curves[quantity])]
    if not pairs:
        return []
    weight = 1 / len(pairs)
    loads = [math.sqrt(p.load_mn * q.load_mn) for p, q in matched(a.curves[quantity], b.curves[quantity])]
    single = [merged([(-1.0, p), (1.0, q)], q.value - p.value, quantity) for p, q in pairs]
    signed = [(sign * weight, point) for pair in pairs for sign, point in zip((-1.0, 1.0), pair, strict=True)]
    mean = merged(signed, float(np.mean([q.value - p.value for p, q in pairs])), quantity)
    adjusted = holm([p_value(budget) for budget in single])
    apart = [math.sqrt(sum(_own(p, 1.0) + _own(q, 1.0) for p, q in [pair])) for pair in pairs]
    whole = math.sqrt(_own_mean([p for p, _ in pairs]) + _own_mean([q for _, q in pairs]))
    names = (quantity, a.name, b.name)
    return [
        _difference(names, None, mean, p_value(mean), whole),
        *(
            _difference(names, load, budget, p, separate)
            for load, budget, p, separate in zip(loads, single, adjusted, apart, strict=True)
        ),
    ]


def _at_one_load(p: Point, q: Point, quantity: str) -> tuple[Point, Point]:
    """Return both points taken to the mean of their loads along their slopes, and what is unsure about that.

    Both slopes are of one curve, as far as can be known: by how much they are off is the same.
    """
    middle = math.sqrt(p.load_mn * q.load_mn)
    moved = []
    for point in (p, q):
        by = math.log(middle / point.load_mn)
        unsure = SLOPE_UNSURE * (1.0 if quantity == STIFFNESS else max(abs(p.value), abs(q.value), abs(p.slope)))
        parts = dict(point.parts)
        if by and unsure > 0:
            parts[f"slope at {middle}"] = Contribution("slope between loads", math.nan, "1", unsure, by)
        moved.append(replace(point, value=point.value + point.slope * by, parts=parts))
    return moved[0], moved[1]


def _own(point: Point, weight: float) -> float:
    return weight**2 * sum(part.uncertainty**2 for part in point.parts.values())


def _own_mean(points: Sequence[Point]) -> float:
    budget = merged([(1 / len(points), point) for point in points], 0.0, "")
    return budget.standard_uncertainty**2


def p_value(budget: Budget) -> float:
    """Return the two-sided p-value of a number against zero, by Student's t with its degrees of freedom."""
    u = budget.standard_uncertainty
    if u == 0:
        return 0.0 if budget.value else 1.0
    dof = budget.dof
    tail = stats.norm.sf if math.isinf(dof) else lambda t: stats.t.sf(t, dof)
    return float(2 * tail(abs(budget.value) / u))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for their number (Holm, 1979): the chance of any false one stays at the level.

    Examples
    --------
    >>> holm([0.01, 0.5, 0.03])
    [0.03, 0.5, 0.06]
    """
    order = np.argsort(p_values)
    adjusted, most = [0.0] * len(p_values), 0.0
    for rank, i in enumerate(order):
        most = max(most, min((len(p_values) - rank) * p_values[i], 1.0))
        adjusted[i] = most
    return adjusted


def _difference(
    names: tuple[str, str, str], load: float | None, budget: Budget, p: float, separate: float
) -> Difference:
    half = budget.coverage_factor * budget.standard_uncertainty
    ends = (budget.value, budget.value - half, budget.value + half)
    value, low, high = map(math.exp, ends) if names[0] == STIFFNESS else ends
    return Difference(*names, load, value, low, high, p, half, budget.coverage_factor * separate)


def comparison_json(sessions: Sequence[Compared]) -> dict[str, Any]:
    """Return sessions and their differences as JSON types."""
    return {
        "format": "mesotap-comparison",
        "version": 1,
        "sessions": [
            {
                "name": session.name,
                "path": session.path,
                "drifted": session.drifted,
                "loads": [
                    {key: load[key] for key in ("load_set", "target_load_mn", "load_mn", STIFFNESS, DAMPING)}
                    for load in session.loads
                ],
            }
            for session in sessions
        ],
        "differences": [
            {
                "quantity": d.quantity,
                "of": "ratio" if d.quantity == STIFFNESS else "difference",
                **{"a": d.a, "b": d.b, "load_mn": d.load_mn, "value": d.value, "low": d.low, "high": d.high},
                **{"p_value": d.p_value, "half_width": d.half_width, "separate_half_width": d.separate_half_width},
            }
            for d in differences(sessions)
        ],
    }
