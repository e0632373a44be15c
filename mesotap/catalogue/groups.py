"""Groups of sessions against each other, by a mixed model: what differs in spite of the scatter between specimens."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.mixed_model import Scatter, TooFew, fit_mixed
from calibration.estimate import Estimate
from mesotap.catalogue.comparing import CLOSE
from mesotap.catalogue.curves import DAMPING, QUANTITIES, STIFFNESS, Compared, Point


@dataclass(frozen=True, slots=True)
class Member:
    """A session with the group that it is of, and its specimen."""

    session: Compared
    group: str
    specimen: str


@dataclass(frozen=True, slots=True)
class GroupAnswer:
    """What a mixed model says of one quantity.

    Attributes
    ----------
    ratios
        Of each further group to the first, as the logarithm, by name.
    scatters
        Relative standard deviations between specimens, sessions of one specimen, loads of one session.
    taps
        Relative standard deviation of taps of one load; NaN where no load has two.
    sessions, specimens, rows
        How many took part; loads that only one session has do not.
    """

    quantity: str
    reference: str
    ratios: dict[str, Estimate]
    scatters: tuple[Scatter, ...]
    taps: float
    sessions: int
    specimens: int
    rows: int


def compare_groups(members: Sequence[Member], intervals: bool = True) -> list[GroupAnswer]:
    """Return what groups differ by, in k_c and in zeta.

    The logarithm of each number is that of its group, its load of the plan, its specimen, its session and of what is
    left over; measurement errors have the covariance of their budgets. All groups have the same shape over load.

    Raises
    ------
    TooFew
        There are no two groups, or too few sessions to tell them apart.
    """
    groups = list(dict.fromkeys(member.group for member in members))
    if len(groups) < 2:
        raise TooFew(f"all sessions are of one group ({groups[0] if groups else 'none'}): there is nothing to compare")
    return [_of_quantity(members, groups, quantity, intervals) for quantity in QUANTITIES]


def _of_quantity(members: Sequence[Member], groups: list[str], quantity: str, intervals: bool) -> GroupAnswer:
    rows = [
        (member, point, point.target_mn)
        for member in members
        for point in member.session.curves[quantity].points
        if quantity != DAMPING or point.value > 0
    ]
    targets = _common([(m.session.path, t) for m, _, t in rows])
    rows = [(m, p, targets[t]) for m, p, t in rows if t in targets]
    loads = sorted({target for *_, target in rows})
    if not rows:
        raise TooFew("no load of the plan is shared by two sessions")
    y = np.array([_logarithm(point, target, quantity) for _, point, target in rows])
    design = np.array(
        [[*(m.group == g for g in groups[1:]), *(t == load for load in loads)] for m, _, t in rows], dtype=np.float64
    )
    components: dict[str, Sequence[str]] = {}
    specimens = [m.specimen for m, *_ in rows]
    sessions = [m.session.path for m, *_ in rows]
    if 1 < len(set(specimens)) < len(set(sessions)):
        components["between specimens"] = specimens
    components["between sessions"] = sessions
    components["between loads"] = [str(i) for i in range(len(rows))]
    fit = fit_mixed(y, design, components, _covariance([p for _, p, _ in rows], quantity), intervals)
    weights = np.eye(design.shape[1])
    taps = [v for m in members for v in m.session.taps[quantity]]
    return GroupAnswer(
        quantity,
        groups[0],
        {group: fit.contrast(weights[i]) for i, group in enumerate(groups[1:])},
        fit.scatters,
        math.sqrt(float(np.mean(taps))) if taps else math.nan,
        len(set(sessions)),
        len(set(specimens)),
        len(rows),
    )


def _common(found: Sequence[tuple[str, float]]) -> dict[float, float]:
    """Return the loads of the plan that two sessions have at least, with the one by which those close to it go."""
    known: list[float] = []
    stands: dict[float, float] = {}
    for target in sorted({t for _, t in found}):
        near = [k for k in known if abs(math.log(target / k)) <= CLOSE / 2]
        stands[target] = near[0] if near else target
        if not near:
            known.append(target)
    counts = Counter(load for _, load in {(path, stands[t]) for path, t in found})
    return {t: s for t, s in stands.items() if counts[s] > 1}


def _logarithm(point: Point, target: float, quantity: str) -> float:
    by = math.log(target / point.load_mn)
    if quantity == STIFFNESS:
        return point.value + point.slope * by
    return math.log(point.value) + point.slope / point.value * by


def _covariance(points: Sequence[Point], quantity: str) -> Any:
    keys = list(dict.fromkeys(key for point in points for key in point.parts))
    place = {key: i for i, key in enumerate(keys)}
    effects = np.zeros((len(points), len(keys)))
    for row, point in enumerate(points):
        per = 1.0 if quantity == STIFFNESS else 1 / point.value
        for key, part in point.parts.items():
            effects[row, place[key]] = per * part.sensitivity * part.standard_uncertainty
    return effects @ effects.T


def groups_json(answers: Sequence[GroupAnswer]) -> list[dict[str, Any]]:
    """Return the answers as JSON types; ratios and relative scatters, null where nothing bounds them."""
    return [
        {
            "quantity": answer.quantity,
            "reference": answer.reference,
            "ratios": [
                {
                    "group": group,
                    **{k: math.exp(v) for k, v in (("value", e.value), ("low", e.low), ("high", e.high))},
                    "degrees_of_freedom": _finite(e.dof),
                }
                for group, e in answer.ratios.items()
            ],
            "scatters": [
                {"of": s.name, "value": s.value, "low": _finite(s.low), "high": _finite(s.high), "levels": s.levels}
                for s in answer.scatters
            ],
            "between_taps": _finite(answer.taps),
            "sessions": answer.sessions,
            "specimens": answer.specimens,
            "loads": answer.rows,
        }
        for answer in answers
    ]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
