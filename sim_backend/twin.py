"""Eq. 9 with mechanisms in it: what a tap leaves behind on the rig that a diagnosis describes.

The rig with whatever bodies and springs the mechanisms add is linear; it is carried along in its modes, with the
mechanisms' forces and the tap itself as extra forces (`sim_backend.modal_march`), and what all of them together do to
the filtered channels follows from partial fractions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from sim_backend.adopted import Adopted
from sim_backend.arrangement import LOWER, UPPER, Arrangement, Element, Parameter, tester
from sim_backend.mechanisms.mechanism import AtRest, law
from sim_backend.modal_march import MEMORY, REST, SLOTS, march, no_law, respond, step_weights
from sim_backend.pulses import COS, END, LINEAR, OFFSET, OMEGA, SIN, START, Pulse
from sim_backend.state_space import StateSpace
from sim_backend.two_mass import TwoMass

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

SUBSTEPS = 16  # of a sample: forces are straight lines between them
COLUMNS = 7  # of a pulse's table
SMALL = 1e-9  # |Im s| over |s| below which a pole counts as real
TAP = "tap"


@law
def tap_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Force of a tap on the body, whatever it does; p[4] number of segments, then their table row by row."""
    total = 0.0
    for i in range(int(p[4])):
        at = 5 + COLUMNS * i
        if p[at + START] <= t < p[at + END]:
            tau = t - p[at + START]
            phase = p[at + OMEGA] * tau
            total += p[at + OFFSET] + p[at + LINEAR] * tau + p[at + SIN] * np.sin(phase) + p[at + COS] * np.cos(phase)
    return force - total


def twin_record(
    rig: TwoMass,
    preload_n: float,
    found: Sequence[Adopted],
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
        Mechanisms; tones are not part of a tap, and a second blow is part of the pulse.
    pulse, onset_s
        Force on the upper mass, N, and its onset after sample 0, s.

    Raises
    ------
    RigError
        More force laws than can act together.
    """
    arrangement = _arrangement(rig, found)
    values = arrangement.declared()
    slots = [(a, i) for a in found for i, e in enumerate(arrangement.elements) if a.mechanism.acts == e.role]
    slots = sorted(((a, i) for a, i in slots if a.mechanism.law is not None), key=lambda s: s[0].mechanism.last)
    if len(slots) >= SLOTS:
        raise RigError(f"The simulated rig cannot have more than {SLOTS - 1} force laws at work together.")
    h = 1 / sample_rate_hz / SUBSTEPS
    rows = [_parameters(a, arrangement.elements[i], values, preload_n, h) for a, i in slots]
    struck = next(i for i, e in enumerate(arrangement.elements) if e.name == TAP)
    rows.append(np.concatenate([[0.0, 0.0, 0.0, h, len(pulse.segments)], pulse.segments.ravel()]))
    used = sorted({i for _, i in slots} | {struck})
    places = [used.index(i) for _, i in slots] + [used.index(struck)]
    p = np.zeros((SLOTS, max(map(len, rows))))
    for row, filled in zip(p, rows, strict=False):
        row[: len(filled)] = filled
    laws = [a.mechanism.law for a, _ in slots] + [tap_law] + [no_law] * (SLOTS - len(rows))
    acting = np.array(places + [-1] * (SLOTS - len(rows)))

    modes = _Modes(arrangement)
    deformation = modes.elements[used] @ modes.shapes
    drive = -(modes.elements[used] @ modes.left)
    forces = march(
        tuple(laws), acting, p[None], deformation[None], (deformation * modes.poles)[None], drive[None],
        step_weights(modes.poles, h)[None], np.zeros((1, len(modes.poles)), np.complex128), modes.weight,
        np.array([-onset_s]), h, (samples - 1) * SUBSTEPS, np.zeros((SLOTS, MEMORY)),
        np.array([-1]), np.zeros((1, len(modes.poles)), np.complex128),
    )[0]  # fmt: skip
    acceleration = np.zeros((len(arrangement.sensors), samples))
    lower = np.zeros(samples)
    seen = [arrangement.vector(s.row, values) for s in arrangement.sensors]
    own = arrangement.vector(((LOWER, 1.0),), values)
    nothing = StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros((1, 0)), np.ones(1))
    for force, i in zip(forces, used, strict=True):
        push = -modes.elements[i] / modes.mass
        for channel, row in zip(acceleration, seen, strict=True):
            channel += _response(modes.system(push, row, 2).then(analog), force, h)
        lower += _response(modes.system(push, own, 0).then(nothing), force, h)
    for a in found:
        if a.mechanism.distort is not None:
            peak = {"peak": float(np.abs(acceleration).max())}
            acceleration = a.mechanism.distort(acceleration, dict(a.values) | peak, sample_rate_hz)
    return acceleration, lower


def _arrangement(rig: TwoMass, found: Sequence[Adopted]) -> Arrangement:
    """Build Eq. 9 with dampers beside the springs, a place for the tap, and what the mechanisms add."""
    out = tester(rig.m1, rig.m2, rig.k1, rig.k2, rig.kc, rig.cc, mass_uncertainty=0.0, spring_uncertainty=0.0)
    out = out.extended(
        elements=(
            Element("upper damper", "body", "tube springs", ((UPPER, 1.0),), damping="c1"),
            Element("lower damper", "body", "tube springs", ((LOWER, 1.0),), damping="c2"),
            Element(TAP, "body", "impactor", ((UPPER, 1.0),)),
        ),
        parameters=(Parameter("c1", "N s/m", rig.c1), Parameter("c2", "N s/m", rig.c2)),
    )
    for a in found:
        if a.mechanism.extend is not None:
            out = a.mechanism.extend(out, a.values)
    return out


def _parameters(a: Adopted, element: Element, values: dict[str, float], preload_n: float, h: float) -> Real:
    rest = AtRest(
        preload_n if element.role == "contact" else 0.0,
        values[element.stiffness] if element.stiffness else 0.0,
        values[element.damping] if element.damping else 0.0,
    )
    begin = np.zeros(REST)
    begin[:] = rest.preload, rest.stiffness, rest.damping, h
    return np.concatenate([begin, np.asarray(a.mechanism.constants(a.values, rest), np.float64)])


class _Modes:
    """Modes of an arrangement: ``x = sum w Re(shape b)``, ``b' = s b + left.T force``."""

    def __init__(self, arrangement: Arrangement):
        values = arrangement.declared()
        self.mass, self.damping, self.stiffness = arrangement.matrices(values)
        self.elements = np.array([arrangement.vector(e.row, values) for e in arrangement.elements])
        n = len(self.mass)
        self.matrix = np.zeros((2 * n, 2 * n))
        self.matrix[:n, n:] = np.eye(n)
        self.matrix[n:, :n] = -self.stiffness / self.mass[:, None]
        self.matrix[n:, n:] = -self.damping / self.mass[:, None]
        poles, right, left = _decomposed(self.matrix)
        self.poles, self.shapes = poles, right[:n]
        self.left = left[:, n:].T / self.mass[:, None]
        self.weight = _weight(poles)

    def system(self, push: Real, row: Real, order: int) -> StateSpace:
        """From a force that accelerates the bodies by ``push`` to a derivative of what ``row`` sees."""
        n = len(self.mass)
        b = np.concatenate([np.zeros(n), push])
        c = np.concatenate([row, np.zeros(n)])[None]
        if order == 0:
            return StateSpace(self.matrix, b, c, np.zeros(1))
        c = np.concatenate([np.zeros(n), row])[None] @ self.matrix
        return StateSpace(self.matrix, b, c, np.array([float(row @ push)]))


def _decomposed(a: Real) -> tuple[Complex, Complex, Complex]:
    """Poles (one of each pair), right vectors (n, p) and rows of the inverse (p, n)."""
    size = np.sqrt(np.maximum(np.abs(a).sum(axis=1), 1e-300) / np.maximum(np.abs(a).sum(axis=0), 1e-300))
    scaled = a * size / size[:, None]
    s, right = np.linalg.eig(scaled)
    inverse = np.linalg.inv(right)
    kept = s.imag >= -SMALL * np.abs(s)
    poles = np.where(np.abs(s.imag) < SMALL * np.abs(s), s.real + 0j, s)[kept]
    return poles, right[:, kept] * size[:, None], inverse[kept] / size


def _weight(poles: Complex) -> Real:
    return np.where(np.abs(poles.imag) > SMALL * np.abs(poles), 2.0, 1.0)


def _response(system: StateSpace, force: Real, h: float) -> Real:
    """Response (samples,) from rest of the first output to a force given at every substep."""
    poles, right, left = _decomposed(system.a)
    residues = ((system.c[0] @ right) * (left @ system.b))[None, None, None]
    weights, direct = step_weights(poles, h)[None], system.d[None, None, :1].copy()
    return np.asarray(respond(force[None, None], weights, residues, _weight(poles), direct, SUBSTEPS)[0, 0])
