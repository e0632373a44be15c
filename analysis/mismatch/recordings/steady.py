"""Steady responses to a force of one frequency: what amplitude does when time does not come into it.

At a steady response with deformation amplitude X, first-harmonic balance gives the force that keeps it up:
``G F = (k - m w^2 + i w c) X + N(X)``, with N the first harmonic of the mechanisms' forces. Whoever measured them may
have hung a shaker on the rig: k, c and the gain G are fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from analysis.mismatch.parameters import FreeParameter, Term, with_values
from analysis.mismatch.rig_description import DescribedRig
from analysis.session import AnalysisError
from daq.exchange.tables import Table
from sim_backend.arrangement import DERIVATIVES
from sim_backend.arrays import Complex, Real
from sim_backend.force_law import MEMORY, along
from sim_backend.mechanisms.kinds import AtRest, ForceLaw

CYCLES: Final = 3  # a hysteresis is steady from the second on
POINTS: Final = 96  # in a cycle
HELD_OUT_EVERY: Final = 3
FEWEST: Final = 3  # sweeps
GRID: Final = 40  # amplitudes at which the mechanisms' forces are worked out
STARTS: Final = (0.3, 1.0, 10.0)  # factors on the strengths that fitting begins with


@dataclass(frozen=True, slots=True)
class Sweep:
    """Steady responses at frequencies (n,) rad/s: force (n,) and displacement (n,), complex."""

    name: str
    omega: Real
    force: Complex
    moved: Complex


@dataclass(frozen=True, slots=True)
class SteadyFit:
    """Mechanisms fitted to sweeps, and each sweep's mean square relative force error, fitted and held out."""

    terms: tuple[Term, ...]
    fitted: Real
    held: Real

    @property
    def mean_square(self) -> float:
        """Mean square of the relative force error over all sweeps, each with the same weight."""
        return float(np.mean(np.concatenate([self.fitted, self.held])))

    @property
    def held_rms(self) -> float:
        """Relative force error on the sweeps held out."""
        return math.sqrt(float(np.mean(self.held)))


def sweeps_of(rig: DescribedRig, tables: Sequence[Table], source: str) -> list[Sweep]:
    """Return the sweeps in tables; a table whose frequency falls back begins another.

    Raises
    ------
    AnalysisError
        The rig has more than one body, or there are too few sweeps.
    """
    columns = rig.sweeps
    if columns is None or len(rig.arrangement.bodies) != 1:
        raise AnalysisError(f"{source}: steady responses are understood of rigs with one body only")
    found = []
    for table in tables:
        hz, force, amplitude, phase = (
            table.columns[str(c)] for c in (columns.frequency, columns.force, columns.amplitude, columns.phase)
        )
        steps = np.flatnonzero(np.diff(hz) * np.sign(np.median(np.diff(hz))) < 0) + 1
        for at in np.split(np.arange(hz.size), steps):
            good = at[(hz[at] > 0) & (force[at] != 0) & (amplitude[at] > 0)]
            if good.size < 5:
                continue
            omega = 2 * math.pi * hz[good]
            moved = amplitude[good] * np.exp(1j * phase[good]) / (1j * omega) ** DERIVATIVES[columns.sensor.quantity]
            found.append(Sweep(table.name, omega, np.asarray(force[good], np.complex128), moved))
    if len(found) < FEWEST:
        raise AnalysisError(f"{source}: holds {len(found)} sweeps, {FEWEST} of different strength are needed")
    return found


def harmonic(term: Term, amplitude: float, omega: float) -> complex:
    """Return the first harmonic of a mechanism's force at a deformation ``amplitude cos(omega t)``."""
    mechanism = term.mechanism
    if not isinstance(mechanism, ForceLaw) or mechanism.with_time:
        return 0.0
    angle = 2 * np.pi * np.arange(CYCLES * POINTS + 1) / POINTS
    d, v = amplitude * np.cos(angle), -amplitude * omega * np.sin(angle)
    h = 2 * np.pi / omega / POINTS
    p = mechanism.packed(term.values, AtRest(), h)
    force = along(mechanism.law, p[None], d, v, 0.0, h, np.zeros(MEMORY))[0]
    last = slice((CYCLES - 1) * POINTS, CYCLES * POINTS)
    return complex(2 / POINTS * np.sum(force[last] * np.exp(-1j * angle[last])))


def fit_again(rig: DescribedRig, sweeps: Sequence[Sweep], terms: Sequence[Term], linear: SteadyFit | None) -> SteadyFit:
    """Return the fit of what is at work without time; the ``linear`` one where nothing is."""
    acting = [t for t in terms if isinstance(t.mechanism, ForceLaw) and not t.mechanism.with_time]
    return linear if linear is not None and not acting else fit_sweeps(rig, sweeps, acting)


def fit_sweeps(rig: DescribedRig, sweeps: Sequence[Sweep], terms: Sequence[Term] = ()) -> SteadyFit:
    """Fit stiffness, damping, gain and the mechanisms' parameters to two of three sweeps."""
    fitted = [s for i, s in enumerate(sweeps) if i % HELD_OUT_EVERY != HELD_OUT_EVERY - 1]
    held = [s for i, s in enumerate(sweeps) if i % HELD_OUT_EVERY == HELD_OUT_EVERY - 1]
    mass = rig.arrangement.declared()[rig.arrangement.masses[0]]
    free = [
        FreeParameter(q.name, q.unit, abs(t.values[q.name]) or 1.0, q.log, q.low, q.high, scope="mechanism", owner=i)
        for i, t in enumerate(terms) for q in t.mechanism.parameters
    ]  # fmt: skip
    strongest = max(sweeps, key=lambda s: float(np.max(np.abs(s.moved / s.force))))
    at = int(np.argmax(np.abs(strongest.moved / strongest.force)))
    omega = float(strongest.omega[at])
    width = 0.003 * omega

    sizes = np.concatenate([np.abs(s.moved) for s in sweeps])
    grid = np.geomspace(sizes.min(), sizes.max(), GRID)

    def off(x: Real, which: Sequence[Sweep]) -> list[Complex]:
        k, c = mass * (omega + width * x[0]) ** 2, mass * width * x[1]
        gain = first_gain * math.exp(min(float(x[2]), 50.0)) * np.exp(1j * x[3])
        # sweeps keep close to the resonance: the first harmonic's own change with frequency is left out
        acting = with_values(terms, free, x[4:])
        forces = np.sum([[harmonic(t, float(a), omega) for a in grid] for t in acting], axis=0) / grid
        out = []
        for s in which:
            needed = (k - mass * s.omega**2 + 1j * s.omega * c) * s.moved
            if terms:
                needed = needed + np.interp(np.abs(s.moved), grid, forces) * s.moved
            out.append(needed / (gain * s.force) - 1)
        return out

    def objective(x: Real) -> Real:
        joined = np.concatenate(off(x, fitted))
        joined = np.where(np.isfinite(joined), joined, 1e3)
        return np.concatenate([joined.real, joined.imag])

    guess = 1j * omega * mass * width * strongest.moved[at] / strongest.force[at]
    first_gain = complex(guess)
    best: tuple[float, Real] = (math.inf, np.zeros(4 + len(free)))
    for factor in STARTS if terms else (1.0,):
        factors = [factor if p.name == terms[p.owner].mechanism.strength else 1.0 for p in free]
        start = [0.0, 1.0, 0.0, 0.0, *(math.log(b) if p.log else b for b, p in zip(factors, free, strict=True))]
        found = least_squares(objective, start, x_scale="jac", max_nfev=60, ftol=1e-6)
        if float(found.cost) < best[0]:
            best = (float(found.cost), np.asarray(found.x, np.float64))
    made = [np.array([float(np.mean(np.abs(e) ** 2)) for e in off(best[1], which)]) for which in (fitted, held)]
    return SteadyFit(with_values(terms, free, best[1][4:]), *made)
