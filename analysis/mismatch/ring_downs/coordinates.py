"""In which numbers the rig's constants are fitted.

A body that a mechanism adds shows its resonance and its damping ratio far better than its mass. In mass, stiffness and
damping the objective is a narrow curved valley; in mass, resonance and ratio it is a straight one. All springs that
hold the body make its resonance, those of the rig that stand on it too, and so does the mass it is mounted on. A body
on a mount so lossy that it hardly rings is not a resonance; it would stand in for anything that turns a phase.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody

MOST_STEP = 1.0  # of a logarithm at once
MOST_RATIO = 0.15  # admissible damping ratio of an added body
AT_LIMIT = 0.99  # share of it that counts as being there
LEAST_LEFT = 3.0  # factor by which its own stiffness may fall in one step
MOST_GROWTH = 2.5  # factor by which a positive constant may change in one step


def admissible(term: Term, values: Mapping[str, float]) -> bool:
    """Whether the body that a term adds, if it adds one, rings: its damping is not at the limit of what is admissible.

    ``values`` are the rig's constants with the body in it.
    """
    if not isinstance(term.mechanism, AddedBody) or term.mechanism.body is None:
        return True
    m, k, c = (values[name] for name in term.mechanism.body)
    return c < AT_LIMIT * 2 * MOST_RATIO * math.sqrt(k * m)


@dataclass(frozen=True, slots=True)
class Body:
    """Places of a body's constants among a rig's.

    Attributes
    ----------
    by_log
        Whether it goes by the logarithm of its mass.
    beside
        Springs that hold it beside its own, with their weights.
    hosts
        Masses that its own spring holds it to.
    """

    mass: int
    stiffness: int
    damping: int
    by_log: bool
    beside: tuple[tuple[int, float], ...]
    hosts: tuple[int, ...]

    @property
    def places(self) -> list[int]:
        """Of mass, stiffness and damping."""
        return [self.mass, self.stiffness, self.damping]

    def held(self, rig: Real) -> float:
        """Return the stiffness of the springs that hold it beside its own."""
        return float(sum(weight * rig[at] for at, weight in self.beside))

    def lightness(self, rig: Real) -> float:
        """Return the inverse of the mass that its own spring moves, of body and host against each other."""
        return float(1 / rig[self.mass] + sum(1 / rig[at] for at in self.hosts))

    def resonance(self, rig: Real) -> float:
        """Return the square of the angular frequency at which it rings."""
        return float(rig[self.stiffness]) * self.lightness(rig) + self.held(rig) / float(rig[self.mass])


class Coordinates:
    """The constants ``names`` of a rig with some terms: added bodies' by mass, stiffness over mass and damping ratio.

    The stiffness is that of all springs that hold the body. One whose effect vanishes as it grows heavy goes by the
    logarithm of its mass.
    """

    def __init__(
        self, names: Sequence[str], positive: NDArray[np.bool_], terms: Sequence[Term], arrangement: Arrangement
    ):
        self.positive = positive
        added = [t.mechanism for t in terms if isinstance(t.mechanism, AddedBody)]
        self.bodies = [
            Body(
                *(names.index(m.body[0]), names.index(m.body[1]), names.index(m.body[2])),
                m.strength is None,
                *_around(arrangement, names, m.body),
            )
            for m in added
            if m.body is not None
        ]
        admissible = {q.name: (q.low, q.high) for m in added for q in m.parameters}
        self.limits = np.array([admissible.get(name, (-np.inf, np.inf)) for name in names]).reshape(-1, 2).T

    def basis(self, rig: Real) -> Real:
        """Return (n, n) what a unit step of each coordinate does to each constant."""
        out = np.eye(rig.size)
        for body in self.bodies:
            m, k, c = rig[body.places]
            light = body.lightness(rig)
            by_mass, by_resonance = (k + body.held(rig)) / (m**2 * light), body.resonance(rig) / light
            own = np.array([[1.0, 0.0, 0.0], [by_mass, by_resonance, 0.0], [c / m, c / 2, c]])
            if body.by_log:
                own[:, 0] *= m
            out[np.ix_(body.places, body.places)] = own
            for at, weight in body.beside:
                out[body.stiffness, at] = -weight / (m * light)
            for at in body.hosts:
                out[body.stiffness, at] = k / (rig[at] ** 2 * light)
        return out

    def moved(self, rig: Real, step: Real) -> Real:
        """Return the constants after a step of the coordinates, within what is admissible."""
        new = rig + step
        limited = np.clip(new, rig / MOST_GROWTH, rig * MOST_GROWTH)
        new = np.where(self.positive, limited, new)
        for body in self.bodies:
            by = np.clip(step[body.places], -MOST_STEP, MOST_STEP)
            if body.by_log:
                new[body.mass] = rig[body.mass] * np.exp(by[0])
            share = new[body.mass] / rig[body.mass]
            beyond = body.resonance(rig) * np.exp(by[1]) - body.held(new) / new[body.mass]
            new[body.stiffness] = max(beyond / body.lightness(new), rig[body.stiffness] / LEAST_LEFT)
            new[body.damping] = rig[body.damping] * share * np.exp(by[1] / 2 + by[2])
            ratio_one = 2 * np.sqrt(new[body.stiffness] * new[body.mass])
            new[body.damping] = min(new[body.damping], MOST_RATIO * ratio_one)
        return np.clip(new, *self.limits)


def _around(
    arrangement: Arrangement, names: Sequence[str], own: tuple[str, str, str]
) -> tuple[tuple[tuple[int, float], ...], tuple[int, ...]]:
    """Return the springs that hold a body beside its own, by place and weight, and the masses its own holds it to."""
    body, beside, hosts = arrangement.bodies[arrangement.masses.index(own[0])], [], []
    for element in arrangement.elements:
        weights = [float(w) for name, w in element.row if name == body and not isinstance(w, str)]
        if not weights or element.stiffness not in names:
            continue
        if element.stiffness != own[1]:
            beside.append((names.index(element.stiffness), weights[0] ** 2))
            continue
        masses = [arrangement.masses[arrangement.bodies.index(name)] for name, _ in element.row if name != body]
        hosts += [names.index(m) for m in masses]
    return tuple(beside), tuple(hosts)
