"""Which constants of a described rig its inputs and sensors determine, before anything is fitted.

What the channels show at some frequencies is differentiated with respect to the logarithms of all unknown constants.
Directions in which nothing changes are combinations that no recording of these channels tells, however long it is and
however little noise it has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.mismatch.rig_description import DescribedRig
from sim_backend.arrangement import DERIVATIVES, LOAD, Parameter
from sim_backend.arrays import Complex, Real

DRAWS: Final = 3  # of unknown constants: a direction that is flat by chance in one is not in another
SEED: Final = 11
LINES: Final = 160  # frequencies
STEP: Final = 1e-4  # of the differences, in the logarithm
FLAT: Final = 1e-6  # relative singular value below which a direction changes nothing; differences are good to 1e-8
TAKES_PART: Final = 1e-3  # share of a combination from which on a constant belongs to it
QUIETEST: Final = 1e-3  # of a channel's largest line, below which lines count less
TYPICAL_HZ, TYPICAL_RATIO = 10.0, 0.02  # of a rig of which nothing is declared
PREFERRED: Final = ("mass", "gain of input", "gain of sensor", "stiffness", "damping")  # to be declared


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A constant that the channels do not determine unless one of others, which change with it, is declared.

    Attributes
    ----------
    name
        The constant that is best declared.
    with_it
        Constants that change with it while all channels show the same; none where no channel shows it at all.
    powers
        For each of them, the power of the constant's factor by which it is multiplied.
    """

    name: str
    with_it: tuple[str, ...] = ()
    powers: tuple[float, ...] = ()

    @property
    def statement(self) -> str:
        """Say what cannot be told, and what to do."""
        if not self.with_it:
            return f"no channel shows the {self.name}: give its value, or leave out what it belongs to"
        together = all(abs(p - 1) < TAKES_PART for p in self.powers)
        how = "by the same factor" if together else "against each other"
        others = (
            f"{', the '.join(self.with_it[:-1])} and the {self.with_it[-1]}" if self.with_it[1:] else self.with_it[0]
        )
        return (
            f"the {self.name} and the {others} can change {how} and all channels show the same: give one of them, "
            f"best the {self.name}"
        )


def unknown(rig: DescribedRig) -> list[Parameter]:
    """Return the constants that nothing declares; offsets, which every recording shows as its mean, are left out."""
    return [p for p in rig.arrangement.parameters if p.unit and math.isinf(p.uncertainty)]


def undetermined(rig: DescribedRig) -> tuple[Undetermined, ...]:
    """Return the constants that have to be declared for all others to be determined, with what depends on them.

    Examples
    --------
    >>> from mesotap.configuration.rig_files import parse_rig
    >>> rig = parse_rig('''
    ... bodies: {mass: 1.0}
    ... springs: [{between: [mass, ground]}]
    ... inputs: [{channel: u, force_on: mass, gain: unknown}]
    ... sensors: [{channel: x, of: mass, shows: displacement, gain: unknown}]
    ... ''')
    >>> [(u.name, u.with_it) for u in undetermined(rig)]
    [('gain of input 1', ('gain of sensor 1',))]
    """
    free = sorted(unknown(rig), key=_preference)
    if not free:
        return ()
    random = np.random.default_rng(SEED)
    found = [flat_directions(rig, free, drawn(rig, random), random) for _ in range(DRAWS)]
    flat = min(found, key=len)
    return tuple(_told([p.name for p in free], row) for row in reduced(flat))


def _preference(p: Parameter) -> int:
    return next((i for i, kind in enumerate(PREFERRED) if p.name.startswith(kind)), len(PREFERRED))


def _told(names: Sequence[str], row: Real) -> Undetermined:
    first = int(np.argmax(np.abs(row) > TAKES_PART))
    others = [i for i in range(len(names)) if i != first and abs(row[i]) > TAKES_PART]
    return Undetermined(names[first], tuple(names[i] for i in others), tuple(float(row[i]) for i in others))


def drawn(rig: DescribedRig, random: np.random.Generator) -> dict[str, float]:
    """Return values of all constants: those declared, and for the others some that such a rig might have."""
    known = {p.name: p.value for p in rig.arrangement.parameters}
    masses = [known[m] for m in rig.arrangement.masses if math.isfinite(known[m])]
    mass = float(np.exp(np.mean(np.log(masses)))) if masses else 1.0
    stiff = [known[e.stiffness] for e in rig.arrangement.elements if e.stiffness and math.isfinite(known[e.stiffness])]
    k = float(np.exp(np.mean(np.log(stiff)))) if stiff else mass * (2 * math.pi * TYPICAL_HZ) ** 2
    usual = {"kg": mass, "N/m": k, "N s/m": TYPICAL_RATIO * 2 * math.sqrt(k * mass)}
    return {
        p.name: p.value
        if math.isfinite(p.value) and p.uncertainty < math.inf and p.scope != LOAD
        else usual.get(p.unit, 1.0 if p.unit else 0.0) * math.exp(0.4 * random.standard_normal())
        for p in rig.arrangement.parameters
    }


def flat_directions(
    rig: DescribedRig, free: Sequence[Parameter], values: Mapping[str, float], random: np.random.Generator
) -> Real:
    """Return (r, k) orthonormal directions of the free constants' logarithms in which no channel changes."""
    n = len(rig.arrangement.bodies)
    mass, _, stiffness = rig.arrangement.matrices(values)
    modes = np.sqrt(np.abs(np.linalg.eigvals(stiffness / mass[:, None])))
    modes = modes[modes > FLAT * modes.max()] if np.any(modes > 0) else np.ones(1)
    omega = np.geomspace(0.2 * modes.min(), 3 * modes.max(), LINES)
    start = random.standard_normal(2 * n) * np.repeat([1.0, float(np.mean(modes))], n)
    middle = spectra(rig, values, omega, start)
    weight = 1 / np.maximum(np.abs(middle), QUIETEST * np.abs(middle).max(axis=-1, keepdims=True))

    def stacked(lines: Complex) -> Real:
        row = (lines * weight).ravel()
        return np.concatenate([row.real, row.imag])

    columns = []
    for p in free:
        ends = [
            stacked(spectra(rig, {**values, p.name: values[p.name] * math.exp(s)}, omega, start)) for s in (STEP, -STEP)
        ]
        columns.append((ends[0] - ends[1]) / (2 * STEP))
    slopes = np.stack(columns, axis=1)
    if not rig.drives:  # what rings freely began somehow
        unit = np.stack([stacked(spectra(rig, values, omega, e)) for e in np.eye(2 * n)], axis=1)
        q, _ = np.linalg.qr(unit / np.maximum(np.linalg.norm(unit, axis=0), 1e-300))
        slopes -= q @ (q.T @ slopes)
    _, s, v = np.linalg.svd(slopes, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(free) - s.size)])
    return np.asarray(v[s <= FLAT * max(s[0], 1.0)], np.float64)


def spectra(rig: DescribedRig, values: Mapping[str, float], omega: Real, start: Real) -> Complex:
    """Return what the channels show at angular frequencies, (channels, inputs, lines), or of a decay (channels, lines).

    Parameters
    ----------
    start
        (2n,) state that a free decay begins with.
    """
    arrangement = rig.arrangement
    mass, damping, stiffness = arrangement.matrices(values)
    s = 1j * omega[:, None, None]
    inertia = np.diag(mass)
    dynamic = s**2 * inertia + s * damping + stiffness
    n = mass.size
    if rig.drives:
        pushed = np.stack(
            [values[d.gain] * (-mass if d.base else 1.0) * arrangement.vector(d.row, values) for d in rig.drives],
            axis=1,
        )
        pushes = np.broadcast_to(pushed.astype(np.complex128), (omega.size, *pushed.shape))
    else:
        x, v = start[:n], start[n:]
        pushes = np.asarray((s * inertia + damping) @ x + mass * v, np.complex128)[..., None]
    moved = np.linalg.solve(dynamic, pushes)
    out: list[Complex] = []
    for seen in rig.seen:
        row = arrangement.vector(seen.sensor.row, values)
        order = DERIVATIVES[seen.sensor.quantity]
        turned = np.asarray((row @ moved) * (1j * omega[:, None]) ** order, np.complex128)  # (lines, inputs)
        if not rig.drives and order:
            turned = turned - _begun(order, omega, row, (mass, damping, stiffness), start)[:, None]
        out.append(values[seen.gain] * turned.T)
    found = np.stack(out)
    return np.asarray(found if rig.drives else found[:, 0], np.complex128)


def _begun(order: int, omega: Real, row: Real, matrices: tuple[Real, Real, Real], start: Real) -> Complex:
    """Return what the transform of a derivative lacks for the values at the beginning."""
    n = len(row)
    x, v = start[:n], start[n:]
    if order == 1:
        return np.full(omega.size, row @ x, np.complex128)
    return np.asarray(1j * omega * (row @ x) + row @ v, np.complex128)


def reduced(directions: Real) -> Real:
    """Return the same space (r, k) by rows in reduced echelon form: each begins with a one that no other row has."""
    rows = directions.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) < TAKES_PART:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        for other in range(len(rows)):
            if other != done:
                rows[other] -= rows[other, column] * rows[done]
        done += 1
    return rows[:done]
