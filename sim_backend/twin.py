"""Eq. 9 with mechanisms in it: what a tap leaves behind on the rig that a diagnosis describes.

The rig with whatever bodies and springs the mechanisms add is linear, and its response to the tap is exact. The
mechanisms' forces are found by `sim_backend.propagate`, and what they add to the filtered channels follows from partial
fractions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.errors import RigError
from rig.tube import OwnMode
from sim_backend.acting import Acting, extended, laws_in
from sim_backend.arrangement import LOWER, UPPER, Arrangement, Element, Parameter, tester
from sim_backend.arrays import Real
from sim_backend.force_law import SLOTS
from sim_backend.mechanisms import tube_mode
from sim_backend.mechanisms.kinds import AtRest, ChannelDistortion
from sim_backend.modal_response import respond, step_weights
from sim_backend.propagate import Clock, Given, Laws, Motion, Rigs, laws_of, propagate
from sim_backend.pulses import Pulse
from sim_backend.state_space import StateSpace, exact_response, pairs
from sim_backend.two_mass import TUBE_MODE_DAMPING, TwoMass

SUBSTEPS = 16  # of a sample
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)  # of quadrature between the knots of a pulse


def twin_record(
    rig: TwoMass,
    preload_n: float,
    found: Sequence[Acting],
    pulse: Pulse,
    onset_s: float,
    samples: int,
    sample_rate_hz: float,
    analog: StateSpace,
) -> tuple[Real, Real]:
    """Return filtered accelerations A and B, (2, samples) m/s2, and x2, (samples,) m, after a tap from rest.

    Parameters
    ----------
    rig
        Eq. 9 with the contact at this load.
    found
        Mechanisms with their places; tones are not part of a tap, and a second impact is part of the pulse.
    pulse, onset_s
        Force on the upper mass, N, and its onset after sample 0, s.

    Raises
    ------
    RigError
        More force laws than can act together.
    """
    arrangement = _arrangement(rig, found)
    values = arrangement.declared()
    h = 1 / sample_rate_hz / SUBSTEPS
    bodies = _Rig(arrangement)
    nothing = StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros((1, 0)), np.ones(1))
    seen = [(arrangement.vector(s.row, values), 2, analog) for s in arrangement.sensors]
    seen.append((arrangement.vector(((LOWER, 1.0),), values), 0, nothing))
    tapped = arrangement.vector(((arrangement.tapped, 1.0),), values) / bodies.mass

    def exact(row: Real, order: int, chain: StateSpace) -> Real:
        return exact_response(bodies.system(tapped, row, order).then(chain), pulse, onset_s, samples, sample_rate_hz)[0]

    shown = np.array([exact(row, order, chain) for row, order, chain in seen])
    for channel, sensor in zip(shown, arrangement.sensors, strict=False):  # without what the laws' forces strain
        if sensor.strained is not None:
            for order, row in enumerate(arrangement.strain(sensor, values)):
                channel += exact(row, order, analog)
    slots = laws_in(found)
    if len(slots) > SLOTS:
        raise RigError(f"The simulated rig cannot have more than {SLOTS} force laws at work together.")
    if slots:
        rest = [AtRest.of(element, values, preload_n) for element in arrangement.elements]
        laws = laws_of(
            [(m.law, e) for _, m, e in slots], [[m.packed(found[i].values, rest[e], h) for i, m, e in slots]],
            [m.jumps for _, m, _ in slots],
        )  # fmt: skip
        motion = _motion(bodies, laws, tapped * bodies.mass, pulse, onset_s, h, (samples - 1) * SUBSTEPS)
        for i in sorted({e for *_, e in slots}):
            push = -bodies.elements[i] / bodies.mass
            for channel, (row, order, chain) in zip(shown, seen, strict=True):
                system = bodies.system(push, row, order).then(chain)
                channel += _response(system, motion.forces[:, i], motion.bends[:, i], h)
    acceleration, lower = shown[:-1], shown[-1]
    for a in found:
        if isinstance(a.mechanism, ChannelDistortion):
            at, peak = list(a.place), {"peak": float(np.abs(acceleration).max())}
            acceleration[at] = a.mechanism.distort(acceleration[at], dict(a.values) | peak, sample_rate_hz)
    return acceleration, lower


def _motion(bodies: _Rig, laws: Laws, tapped: Real, pulse: Pulse, onset_s: float, h: float, steps: int) -> Motion:
    """Return the extra forces after a pulse that acts on the bodies as ``tapped`` (n,), from rest."""
    parts = (bodies.mass, bodies.damping, bodies.stiffness, bodies.elements, tapped[:, None])
    rigs = Rigs(*(part[None] for part in parts))
    clock = Clock(np.array([-onset_s]), h, steps, 0)
    given = given_pulse(pulse, onset_s, h, steps)
    motion = propagate(rigs, laws, np.zeros((1, 2 * len(bodies.mass))), clock, given)
    if not np.all(np.isfinite(motion.forces)):
        raise RigError(
            "The simulated tap could not be computed: the mechanisms are too stiff for a tap this hard. "
            "Lower sim_backend.pulse.peak_force_ratio or choose other mechanisms."
        )
    return motion


def given_pulse(pulse: Pulse, onset_s: float, h: float, steps: int) -> Given:
    """Return a pulse as an input of steps of length h, s: in each the parabola that has its first three moments."""
    knots = pulse.knots + onset_s
    first, last = max(math.floor(knots[0] / h), 0), min(math.ceil(knots[-1] / h), steps)
    edges = np.unique(np.concatenate([knots, h * np.arange(first, last + 1)]))
    left, width = edges[:-1], np.diff(edges)
    at = np.floor((left + width / 2) / h).astype(int)
    inside = (at >= first) & (at < last)
    left, width, at = left[inside], width[inside], at[inside]
    t = left[:, None] + width[:, None] * (NODES + 1) / 2
    u = t / h - at[:, None]
    force = pulse(t - onset_s) * WEIGHTS * width[:, None] / h / 2
    moments = np.zeros((3, steps))
    for moment, shape in zip(moments, (1.0, 2 * u - 1, 6 * u * (u - 1) + 1), strict=True):
        np.add.at(moment, at, np.sum(force * shape, axis=1))
    mean, slope, bend = moments
    start, end = mean - 3 * slope + 5 * bend, mean + 3 * slope + 5 * bend
    return Given(start[None, None], end[None, None], 30 * bend[None, None], 1)


def _arrangement(rig: TwoMass, found: Sequence[Acting]) -> Arrangement:
    """Build Eq. 9 as a fit has it, with dampers beside the springs where there are any, and what mechanisms add."""
    m1, m2, own = rig.m1, rig.m2, rig.tube_mode
    if own is not None:
        m1, m2 = m1 - own.mass_kg, m2 - own.mass_kg
    out = tester(m1, m2, rig.k1, rig.k2, rig.kc, rig.cc, mass_uncertainty=0.0, spring_uncertainty=0.0)
    if rig.c1 or rig.c2:
        out = out.extended(
            elements=(
                Element("upper damper", "body", "tube springs", ((UPPER, 1.0),), damping="c1"),
                Element("lower damper", "body", "tube springs", ((LOWER, 1.0),), damping="c2"),
            ),
            parameters=(Parameter("c1", "N s/m", rig.c1), Parameter("c2", "N s/m", rig.c2)),
        )
    return extended(out, found if own is None else [_own_mode(own, out), *found])


def _own_mode(own: OwnMode, rig: Arrangement) -> Acting:
    """Return the declared own mode of the tube springs as the mechanism that it is."""
    damping = 2 * TUBE_MODE_DAMPING * math.sqrt(own.mass_kg * own.stiffness)
    values = dict(zip(tube_mode.MECHANISM.body or (), (own.mass_kg, own.stiffness, damping), strict=True))
    return Acting(tube_mode.MECHANISM, values, tube_mode.at(rig)[0])


class _Rig:
    """Matrices of an arrangement, and its elements' rows."""

    def __init__(self, arrangement: Arrangement):
        values = arrangement.declared()
        self.mass, self.damping, self.stiffness = arrangement.matrices(values)
        self.elements = np.array([arrangement.vector(e.row, values) for e in arrangement.elements])
        n = len(self.mass)
        self.matrix = np.zeros((2 * n, 2 * n))
        self.matrix[:n, n:] = np.eye(n)
        self.matrix[n:, :n] = -self.stiffness / self.mass[:, None]
        self.matrix[n:, n:] = -self.damping / self.mass[:, None]

    def system(self, push: Real, row: Real, order: int) -> StateSpace:
        """From a force that accelerates the bodies by ``push`` to a derivative of what ``row`` sees."""
        n = len(self.mass)
        b = np.concatenate([np.zeros(n), push])
        c = np.concatenate([row, np.zeros(n)])[None]
        if order == 0:
            return StateSpace(self.matrix, b, c, np.zeros(1))
        c = np.concatenate([np.zeros(n), row])[None]
        if order == 1:
            return StateSpace(self.matrix, b, c, np.zeros(1))
        c = c @ self.matrix
        return StateSpace(self.matrix, b, c, np.array([float(row @ push)]))


def _response(system: StateSpace, force: Real, bends: Real, h: float) -> Real:
    """Response (samples,) from rest of the first output to a force (1, n) at every substep and its bends (1, n - 1)."""
    poles, residues = system.fractions()
    weights, direct = step_weights(poles, h)[None], system.d[None, None, :1].copy()
    forces, bent = np.ascontiguousarray(force[None]), np.ascontiguousarray(bends[None])
    return np.asarray(respond(forces, bent, weights, residues[None, None, None], pairs(poles), direct, SUBSTEPS)[0, 0])
