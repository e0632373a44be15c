"""Other constants with which the channels of a linear rig show exactly the same.

Two frequencies and one channel may belong to two rigs: of two bodies on a shaken base, whose upper one alone is seen,
stiffnesses of 30,000 and 14,000 N/m show what 37,300 and 11,300 N/m show. No direction is flat (`determined`), and no
recording tells which of them it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.mismatch.recordings.determined import SEED, TYPICAL, VARIED, flat_directions, shown_by, unknown
from analysis.mismatch.recordings.spectral_model import SpectralModel, Unknowns
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.arrays import Real

STARTS: Final = 16  # of the search: half of them or more lead to a rig that shows the same (chains of two and three)
TRIALS: Final = 2  # rigs at random, of which one has another one that shows the same
WIDE: Final = 0.3  # rate over the mean mode at which all that is shown fades, so that resonances are wide
NEAR: Final = 1e-3  # of the sum of squares of all that is shown: beyond it no step leads to the same
SAME: Final = 1e-16  # likewise, that is rounding
STEPS: Final = 20
ANOTHER: Final = 0.02  # in the logarithm of a constant, from which on it is another one


@dataclass(frozen=True, slots=True)
class SameShown:
    """Constants that show what others show: by how much each of those that differ is multiplied, by name."""

    factors: Mapping[str, float]

    @property
    def statement(self) -> str:
        """Say so of a rig that nothing was recorded of."""
        names = [f"the {name}" for name in self.factors]
        listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
        return (
            f"{listed} can have another set of values, far from the first one, with which all channels show the same: "
            f"give one of them, best {names[0]}, or let a sensor show a body that none shows"
        )


def undetermined_between(rig: DescribedRig) -> SameShown | None:
    """Return what all channels of a rig like this one show the same with; None where there is no such thing.

    Asked of rigs with constants at random, where everything is determined otherwise.

    Examples
    --------
    >>> from mesotap.configuration.rig_files import parse_rig
    >>> rig = parse_rig('''
    ... bodies: {a: 1.0, b: 0.6}
    ... springs: [{between: [a, ground]}, {between: [b, a]}]
    ... dampers: [{between: [a, ground]}, {between: [b, a]}]
    ... inputs: [{channel: u, base_acceleration: true}]
    ... sensors: [{channel: y, of: b, shows: acceleration}]
    ... ''')
    >>> sorted(undetermined_between(rig).factors)
    ['damping of damper 1', 'damping of damper 2', 'stiffness of spring 1', 'stiffness of spring 2']
    """
    unknowns, random = Unknowns(rig, TYPICAL), np.random.default_rng(SEED)
    for _ in range(TRIALS):
        x = np.concatenate([VARIED * random.standard_normal(len(unknowns.bent)), np.ones(len(unknowns.gains))])
        values = unknowns.constants(x)
        for other in other_values(rig, values):
            return SameShown({name: value / values[name] for name, value in other.items()})
    return None


def other_values(rig: DescribedRig, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Return the values in which constants that show the same differ from these, by name; see `same_shown`."""
    names = [p.name for p in unknown(rig)]
    try:
        found = same_shown(rig, values)
    except (ArithmeticError, np.linalg.LinAlgError):  # a rig without a response shows nothing: no answer is lost for it
        return []
    return [{k: other[k] for k in names if _differ(other[k], values[k])} for other in found]


def same_shown(rig: DescribedRig, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Return other constants with which all channels of the linear rig show the same; what is declared stays.

    Nothing where a direction is flat: there any number of them do. And nothing where every body is seen: what moves
    them is then linear in stiffnesses and dampings, and least squares have one solution.
    """
    names, rows = [p.name for p in unknown(rig)], [rig.arrangement.vector(s.sensor.row, values) for s in rig.seen]
    if not names or np.linalg.matrix_rank(rows) == len(rig.arrangement.bodies):
        return []
    if len(flat_directions(rig, names, np.random.default_rng(SEED))):
        return []
    unknowns = Unknowns(_as_declared(rig, values), TYPICAL)
    at, random = unknowns.point(values), np.random.default_rng(SEED)
    model = shown_by(unknowns, at, random, WIDE)
    found: list[Real] = []
    for start in unknowns.drawn(random, STARTS):
        start[: len(unknowns.bent)] += at[: len(unknowns.bent)]
        other = _the_same(model, model.improved(model.begun(start)))
        if other is not None and all(_apart(other, one, unknowns) for one in (at, *found)):
            found.append(other)
    return [unknowns.constants(x) for x in found]


def _as_declared(rig: DescribedRig, values: Mapping[str, float]) -> DescribedRig:
    """Return a rig of which what is declared with an uncertainty is known."""
    parameters = (
        replace(p, value=values[p.name], uncertainty=0.0) if 0 < p.uncertainty < math.inf else p
        for p in rig.arrangement.parameters
    )
    return replace(rig, arrangement=replace(rig.arrangement, parameters=tuple(parameters)))


def _the_same(model: SpectralModel, x: Real) -> Real | None:
    """Return the point beside this one that shows the same; None where there is none."""
    if not model.cost(x) < NEAR:
        return None
    for _ in range(STEPS):
        off, slopes = model.evaluated(x)
        if float(off @ off) <= SAME:
            return x
        x = x - np.linalg.lstsq(slopes, off, rcond=None)[0]
    return None


def _apart(x: Real, other: Real, unknowns: Unknowns) -> bool:
    first, second = unknowns.constants(x), unknowns.constants(other)
    return any(_differ(first[name], second[name]) for name in unknowns.names)


def _differ(one: float, other: float) -> bool:
    if one == other:
        return False
    return not one * other > 0 or abs(math.log(one / other)) > ANOTHER
