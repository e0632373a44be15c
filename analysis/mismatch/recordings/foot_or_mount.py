"""A spring whose foot gives way, and a part on a mount: the fit of one begun from that of the other.

Both add a mode, and without damping both do the same to the body between them: what the body feels of a part of mass
``m`` on a mount ``q`` beside a spring ``p``, it feels of a spring ``k = p + q`` on a frame of mass ``k**2 m / q**2``
that resonates, the spring held, where the part on its mount does (partial fractions of either impedance). Only damping
tells one from the other, so that a fit of one which misses more than the other's is in a minimum of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.score_test import Score
from sim_backend.arrangement import Arrangement, Element
from sim_backend.mechanisms.kinds import AddedBody

LEAST_RATIO = 0.001  # damping ratio where the element's own damping is more than all of the mode has

Fits = list[tuple[Score, SimulatedFit]]


def begun_from_another(problem: SimulatedRecordings, current: SimulatedFit, fits: Fits) -> Fits:
    """Fit again, from the best that does the same, each frame or part that misses more than it; keep the better fit."""
    return [(score, min(_again(problem, current, score, f, fits), key=lambda g: g.scatter)) for score, f in fits]


def _again(
    problem: SimulatedRecordings, current: SimulatedFit, score: Score, fitted: SimulatedFit, fits: Fits
) -> list[SimulatedFit]:
    """Return a fit, and what it becomes from the best of those that do the same with less missed."""
    for other in sorted((f for _, f in fits if f.scatter < fitted.scatter), key=lambda f: f.scatter):
        start = mapped(problem.arrangement, score.term, other.terms[-1], other.values)
        if start is not None:
            states = tuple(other.state(n) for n in range(len(other.own)))
            begun = replace(problem, constants=start[0], states=states)
            return [fitted, fit(begun, (*current.terms, start[1]))]
    return [fitted]


def mapped(
    rig: Arrangement, term: Term, found: Term, constants: Mapping[str, float]
) -> tuple[dict[str, float], Term] | None:
    """Return constants of the rig and values of a term that do what another does; None where there are none.

    Parameters
    ----------
    term, found
        A frame and a part on a mount, or the other way round, at a spring that is grounded and the body it carries.
    constants
        The rig's, beside which ``found`` was found.
    """
    to, of = term.mechanism, found.mechanism
    element = _foot(rig, term, found) or _foot(rig, found, term)
    if element is None or not isinstance(to, AddedBody) or not isinstance(of, AddedBody) or not to.body or not of.body:
        return None
    names = str(element.stiffness), str(element.damping)
    (k, c), (mass, stiffness, damping) = (constants[n] for n in names), (found.values[n] for n in of.body)
    if to.on_body:  # the spring gives a part of itself to the mount
        given = k / (stiffness + k)
        part = given**2 * mass
        values = part, given * k, (damping + c) * part / mass
        k, c = k - values[1], c - values[2]
    else:
        k, c = k + stiffness, c + damping
        frame = (k / stiffness) ** 2 * mass
        values = frame, frame * stiffness / mass - k, frame * damping / mass - c
    if min(values[0], values[1], k) <= 0:
        return None
    least = LEAST_RATIO * 2 * math.sqrt(values[0] * values[1])
    free = {p.name for p in rig.parameters if p.uncertainty > 0}
    moved = {name: value for name, value in zip(names, (k, max(c, 0.0)), strict=True) if name in free}
    sizes = *values[:2], max(values[2], least)
    return {**constants, **moved}, term.within(dict(zip(to.body, sizes, strict=True)))


def _foot(rig: Arrangement, frame: Term, part: Term) -> Element | None:
    """Return the element whose foot a frame gives, where a part rides on the body that it carries."""
    one, other = frame.mechanism, part.mechanism
    if not isinstance(one, AddedBody) or not isinstance(other, AddedBody) or not one.body or not other.body:
        return None
    if one.on_body or not one.phase_locked or len(frame.place) != 1 or not other.on_body:
        return None
    element = rig.elements[frame.place[0]]
    carried = len(element.row) == 1 and element.row[0][0] == rig.bodies[part.place[0]]
    return element if carried and element.stiffness and element.damping else None
