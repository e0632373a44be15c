"""Where a full fit may begin for a rig of one body: the equation of motion as a regression.

With one body a recorded displacement, velocity or acceleration gives the other two by differentiating and integrating
its spectrum, so that every force's size stands in the equation of motion linearly. Noise biases it: it is a start only.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.rigs.simulation import ORDER, Placed, Simulation
from sim_backend.mechanisms.mechanism import AtRest
from sim_backend.modal_march import MEMORY, along

Real = NDArray[np.float64]

ENERGY: Final = 0.9999  # of the output, on whose spectral lines the equation is held to
TAPER: Final = 0.05  # of the stretch, at either end


def regressed(
    simulation: Simulation, constants: dict[str, float], terms: tuple[Placed, ...]
) -> tuple[dict[str, float], tuple[Placed, ...]] | None:
    """Return constants and terms whose forces' sizes fit the equation of motion; None where that cannot be told."""
    rig, recorded = simulation.rig, simulation.recordings[0]
    seen, arrangement = rig.seen[0], rig.arrangement
    if simulation.n != 1 or any(t.mechanism.law is None for t in terms) or constants[seen.gain] == 0:
        return None
    free = [p.name for p in arrangement.parameters if p.uncertainty > 0]
    stiff = [e.stiffness for e in arrangement.elements if e.stiffness in free]
    damped = [e.damping for e in arrangement.elements if e.damping in free]
    if len(stiff) > 1 or len(damped) > 1 or arrangement.masses[0] in free:
        return None
    at = recorded.fitted
    y = (recorded.outputs[0, at] - recorded.outputs[0, at].mean()) / constants[seen.gain]
    n = y.size
    omega = 2 * math.pi * np.fft.rfftfreq(n, 1 / recorded.rate_hz)
    taper = np.minimum(1.0, np.minimum(np.arange(n), np.arange(n)[::-1]) / (TAPER * n))
    spectrum = np.fft.rfft(y * taper)
    power = np.abs(spectrum) ** 2
    order = np.argsort(power[1:])[::-1] + 1
    grown = np.cumsum(power[order])
    used = order[: int(np.searchsorted(grown, ENERGY * grown[-1])) + 1]
    kept = np.zeros(omega.size, bool)
    kept[1 : used.max() + 1] = True

    def moved(derivative: int) -> Real:
        out = np.zeros(omega.size, np.complex128)
        out[kept] = spectrum[kept] * (1j * omega[kept]) ** (derivative - ORDER[seen.sensor.quantity])
        return np.asarray(np.fft.irfft(out, n), np.float64)

    x, v, a = moved(0), moved(1), moved(2)
    mass = constants[arrangement.masses[0]]
    known = mass * a
    names: list[str] = []
    columns: list[Real] = []
    for name, motion, all_names in (
        (stiff[0] if stiff else None, x, [e.stiffness for e in arrangement.elements]),
        (damped[0] if damped else None, v, [e.damping for e in arrangement.elements]),
    ):
        known = known + sum(constants[e] for e in all_names if e is not None and e != name) * motion
        if name is not None:
            names.append(name)
            columns.append(motion)
    for i, term in enumerate(terms):
        strength = term.mechanism.strength
        if strength is None:
            return None
        element = arrangement.elements[term.place]
        way = float(arrangement.vector(element.row, constants)[0])
        given = term.mechanism.constants(term.values, AtRest(0.0, 0.0, 0.0))
        p = np.array([0.0, 0.0, 0.0, 1 / recorded.rate_hz, *given])
        force = along(term.mechanism.law, p, way * x, way * v, 0.0, 1 / recorded.rate_hz, np.zeros(MEMORY)) * way
        names.append(f"{i}:{strength}")
        columns.append(force / term.values[strength] if term.values[strength] else force)
    for i, drive in enumerate(rig.drives):
        u = recorded.inputs[i, at] - recorded.inputs[i, at].mean()
        push = -mass if drive.base else float(arrangement.vector(drive.row, constants)[0])
        if drive.gain in free:
            names.append(drive.gain)
            columns.append(-push * u)
        else:
            known = known - constants[drive.gain] * push * u
    if not columns:
        return None
    lines = [np.fft.rfft(c * taper)[used] for c in columns]
    matrix = np.stack([np.concatenate([c.real, c.imag]) for c in lines], axis=1)
    target = np.fft.rfft(known * taper)[used]
    scale = np.linalg.norm(matrix, axis=0)
    if not np.all(scale > 0):
        return None
    solved = np.linalg.lstsq(matrix / scale, -np.concatenate([target.real, target.imag]), rcond=1e-8)[0] / scale
    found = dict(zip(names, solved.tolist(), strict=True))
    if any(found[k] <= 0 for k in stiff):
        return None
    found.update({c: max(found[c], 0.0) for c in damped})
    sized = []
    for i, term in enumerate(terms):
        q = next(q for q in term.mechanism.parameters if q.name == term.mechanism.strength)
        value = min(max(found.pop(f"{i}:{q.name}"), q.low), q.high)
        if value == 0.0:
            return None
        sized.append(term.moved({q.name: value}))
    return {**constants, **found}, tuple(sized)
