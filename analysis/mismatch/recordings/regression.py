"""Where a full fit may begin for a rig of one body: the equation of motion as a regression.

With one body a recorded displacement, velocity or acceleration gives the other two by differentiating and integrating
its spectrum, so that every force's size stands in the equation of motion linearly. Noise biases it: it is a start only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.simulation import Simulation
from sim_backend.arrangement import DERIVATIVES
from sim_backend.arrays import Real, Whole
from sim_backend.force_law import MEMORY, along
from sim_backend.mechanisms.kinds import AtRest, ForceLaw

ENERGY: Final = 0.9999  # of the output, on whose spectral lines the equation is held to
TAPER: Final = 0.05  # of the stretch, at either end


def regressed(
    simulation: Simulation, constants: dict[str, float], terms: tuple[Term, ...]
) -> tuple[dict[str, float], tuple[Term, ...]] | None:
    """Return constants and terms whose forces' sizes fit the equation of motion; None where that cannot be told.

    Free may be one stiffness and one damping at most, gains of inputs, and the strengths of force laws.
    """
    arrangement = simulation.rig.arrangement
    free = {p.name for p in arrangement.parameters if p.uncertainty > 0}
    stiffness = [e.stiffness for e in arrangement.elements if e.stiffness in free]
    damping = [e.damping for e in arrangement.elements if e.damping in free]
    one_body = simulation.n == 1 and arrangement.masses[0] not in free and constants[simulation.rig.seen[0].gain] != 0
    laws = _with_strength(terms)
    if not one_body or len(stiffness) > 1 or len(damping) > 1 or len(laws) < len(terms):
        return None
    motion = _motion(simulation, constants)
    columns, known = _linear_forces(simulation, constants, free, motion)
    for i, (term, mechanism) in enumerate(laws):
        columns[f"{i}:{mechanism.strength}"] = _force(simulation, constants, term, mechanism, motion)
    solved = _solved(columns, known, motion) if columns else None
    if solved is None or any(solved[str(name)] <= 0 for name in stiffness):
        return None
    solved |= {str(name): max(solved[str(name)], 0.0) for name in damping}
    return _placed(solved, constants, terms)


def _with_strength(terms: tuple[Term, ...]) -> list[tuple[Term, ForceLaw]]:
    """Return the terms that are force laws whose size is a parameter."""
    laws = [(t, t.mechanism) for t in terms if isinstance(t.mechanism, ForceLaw)]
    return [(t, m) for t, m in laws if m.strength is not None and t.values[m.strength] != 0]


def _linear_forces(
    simulation: Simulation, constants: dict[str, float], free: set[str], motion: _Motion
) -> tuple[dict[str, Real], Real]:
    """Return (n,) the forces of unit size whose size is free, by constant, and the sum of those that are known."""
    arrangement = simulation.rig.arrangement
    known = constants[arrangement.masses[0]] * motion.acceleration
    pushes = [(e.stiffness, motion.displacement) for e in arrangement.elements]
    pushes += [(e.damping, motion.velocity) for e in arrangement.elements]
    columns: dict[str, Real] = {}
    for name, push in pushes + [(gain, -push) for gain, push in _pushes(simulation, constants)]:
        if name in free:
            columns[str(name)] = push
        elif name is not None:
            known = known + constants[name] * push
    return columns, known


@dataclass(frozen=True, slots=True)
class _Motion:
    """Displacement, velocity, acceleration (n,) of the body, and where the equation is held to."""

    displacement: Real
    velocity: Real
    acceleration: Real
    taper: Real
    lines: Whole


def _motion(simulation: Simulation, constants: dict[str, float]) -> _Motion:
    """Differentiate and integrate the first channel's spectrum."""
    seen, recorded = simulation.rig.seen[0], simulation.recordings[0]
    at = recorded.fitted
    y = (recorded.outputs[0, at] - recorded.outputs[0, at].mean()) / constants[seen.gain]
    n = y.size
    omega = 2 * math.pi * np.fft.rfftfreq(n, 1 / recorded.rate_hz)
    taper = np.minimum(1.0, np.minimum(np.arange(n), np.arange(n)[::-1]) / (TAPER * n))
    spectrum = np.fft.rfft(y * taper)
    power = np.abs(spectrum) ** 2
    order = np.argsort(power[1:])[::-1] + 1
    grown = np.cumsum(power[order])
    lines = order[: int(np.searchsorted(grown, ENERGY * grown[-1])) + 1]
    kept = slice(1, int(lines.max()) + 1)

    def moved(derivative: int) -> Real:
        out = np.zeros(omega.size, np.complex128)
        out[kept] = spectrum[kept] * (1j * omega[kept]) ** (derivative - DERIVATIVES[seen.sensor.quantity])
        return np.asarray(np.fft.irfft(out, n), np.float64)

    return _Motion(moved(0), moved(1), moved(2), taper, lines)


def _force(
    simulation: Simulation, constants: dict[str, float], term: Term, mechanism: ForceLaw, motion: _Motion
) -> Real:
    """Return (n,) the force on the body of a law of unit strength."""
    arrangement, h = simulation.rig.arrangement, 1 / simulation.recordings[0].rate_hz
    way = float(arrangement.vector(arrangement.elements[term.place[0]].row, constants)[0])
    rest = AtRest.of(arrangement.elements[term.place[0]], constants, simulation.rig.preload_n)
    p = mechanism.packed(term.values, rest, h)
    d, v = way * motion.displacement, way * motion.velocity
    force = along(mechanism.law, p[None], d, v, 0.0, h, np.zeros(MEMORY))[0]
    return np.asarray(way * force / term.values[str(mechanism.strength)], np.float64)


def _pushes(simulation: Simulation, constants: dict[str, float]) -> list[tuple[str | None, Real]]:
    """Return the name of each input's gain, and (n,) what it does to the body for a gain of one."""
    rig, recorded = simulation.rig, simulation.recordings[0]
    mass, at = constants[rig.arrangement.masses[0]], recorded.fitted
    found: list[tuple[str | None, Real]] = []
    for i, drive in enumerate(rig.drives):
        u = recorded.inputs[i, at] - recorded.inputs[i, at].mean()
        push = -mass if drive.base else float(rig.arrangement.vector(drive.row, constants)[0])
        found.append((drive.gain, np.asarray(push * u, np.float64)))
    return found


def _solved(columns: dict[str, Real], known: Real, motion: _Motion) -> dict[str, float] | None:
    """Return the sizes of all free forces by least squares on the strongest lines of the spectrum."""
    lines = [np.fft.rfft(c * motion.taper)[motion.lines] for c in columns.values()]
    matrix = np.stack([np.concatenate([c.real, c.imag]) for c in lines], axis=1)
    target = np.fft.rfft(known * motion.taper)[motion.lines]
    scale = np.linalg.norm(matrix, axis=0)
    if not np.all(scale > 0):
        return None
    solved = np.linalg.lstsq(matrix / scale, -np.concatenate([target.real, target.imag]), rcond=1e-8)[0] / scale
    return dict(zip(columns, solved.tolist(), strict=True))


def _placed(
    found: dict[str, float], constants: dict[str, float], terms: tuple[Term, ...]
) -> tuple[dict[str, float], tuple[Term, ...]] | None:
    """Return constants and terms of these sizes; None where they make no sense."""
    sized = []
    for i, term in enumerate(terms):
        q = next(q for q in term.mechanism.parameters if q.name == term.mechanism.strength)
        value = min(max(found.pop(f"{i}:{q.name}"), q.low), q.high)
        if value == 0.0:
            return None
        sized.append(term.moved({q.name: value}))
    return {**constants, **found}, tuple(sized)
