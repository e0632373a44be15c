"""In which numbers the rig's constants are fitted.

A body that a mechanism adds shows its resonance and its damping ratio far better than its mass. In mass, stiffness and
damping the objective is a narrow curved valley; in mass, resonance and ratio it is a straight one. A body on a mount so
lossy that it hardly rings is not a resonance; it would stand in for anything that turns a phase.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody

MOST_STEP = 1.0  # of a logarithm at once
MOST_RATIO = 0.15  # admissible damping ratio of an added body
AT_LIMIT = 0.99  # share of it that counts as being there
MOST_GROWTH = 2.5  # factor by which a positive constant may change in one step


def admissible(term: Term, values: Mapping[str, float]) -> bool:
    """Whether the body that a term adds, if it adds one, rings: its damping is not at the limit of what is admissible.

    ``values`` are the rig's constants with the body in it.
    """
    if not isinstance(term.mechanism, AddedBody) or term.mechanism.body is None:
        return True
    m, k, c = (values[name] for name in term.mechanism.body)
    return c < AT_LIMIT * 2 * MOST_RATIO * math.sqrt(k * m)


class Coordinates:
    """The constants ``names`` of a rig with some terms: added bodies' by mass, stiffness over mass and damping ratio.

    A body whose effect vanishes as it grows heavy goes by the logarithm of its mass.
    """

    def __init__(self, names: Sequence[str], positive: NDArray[np.bool_], terms: Sequence[Term]):
        self.positive = positive
        added = [t.mechanism for t in terms if isinstance(t.mechanism, AddedBody)]
        self.bodies = [(*map(names.index, m.body), m.strength is None) for m in added if m.body is not None]
        admissible = {q.name: (q.low, q.high) for m in added for q in m.parameters}
        self.limits = np.array([admissible.get(name, (-np.inf, np.inf)) for name in names]).reshape(-1, 2).T

    def basis(self, rig: Real) -> Real:
        """Return (n, n) what a unit step of each coordinate does to each constant."""
        out = np.eye(rig.size)
        for mass, stiffness, damping, by_log in self.bodies:
            m, k, c = rig[[mass, stiffness, damping]]
            own = np.array([[1.0, 0.0, 0.0], [k / m, k, 0.0], [c / m, c / 2, c]])
            if by_log:
                own[:, 0] *= m
            out[np.ix_([mass, stiffness, damping], [mass, stiffness, damping])] = own
        return out

    def moved(self, rig: Real, step: Real) -> Real:
        """Return the constants after a step of the coordinates, within what is admissible."""
        new = rig + step
        limited = np.clip(new, rig / MOST_GROWTH, rig * MOST_GROWTH)
        new = np.where(self.positive, limited, new)
        for mass, stiffness, damping, by_log in self.bodies:
            by = np.clip(step[[mass, stiffness, damping]], -MOST_STEP, MOST_STEP)
            if by_log:
                new[mass] = rig[mass] * np.exp(by[0])
            share = new[mass] / rig[mass]
            new[stiffness] = rig[stiffness] * share * np.exp(by[1])
            new[damping] = rig[damping] * share * np.exp(by[1] / 2 + by[2])
            new[damping] = min(new[damping], 2 * MOST_RATIO * np.sqrt(new[stiffness] * new[mass]))
        return np.clip(new, *self.limits)
