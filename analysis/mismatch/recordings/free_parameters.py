"""What is free in a fit of a simulation."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from analysis.mismatch.parameters import FreeParameter, Term, rounding_of
from sim_backend.arrays import Real
from sim_backend.learned.curves import Curve
from sim_backend.mechanisms.kinds import AddedBody, SecondImpact

if TYPE_CHECKING:
    from analysis.mismatch.recordings.simulation import Simulation

LITTLE_DAMPING: Final = 1e-4  # ratio to the critical one
HELD: Final = 1e-6  # standard error of an offset that nothing tells, over its size: it stays where it is


def free_parameters(simulation: Simulation) -> list[FreeParameter]:
    """Return the constants and the mechanisms' parameters that a fit of a simulation moves."""
    found = []
    offsets = _offset_scale(simulation)
    added = {
        q.name: i for i, t in enumerate(simulation.terms) if isinstance(t.mechanism, AddedBody)
        for q in t.mechanism.parameters
    }  # fmt: skip
    quantities = {q.name: q for t in simulation.terms for q in t.mechanism.parameters}
    for p in simulation.arrangement.parameters:
        if p.uncertainty == 0.0:
            continue
        value = simulation.constants[p.name]
        if p.name in added:
            found.append(FreeParameter.of(quantities[p.name], added[p.name], value))
            continue
        scale = abs(value) if value else (abs(p.value) if math.isfinite(p.value) and p.value else 1.0)
        prior, low = None, -math.inf
        if p.name in offsets:  # weakly held: a linear rig cannot tell an input's offset from its sensor's
            scale, prior = offsets[p.name], (0.0, 1.0)
            if p.name in simulation.untold and p.name in {d.offset for d in simulation.rig.drives}:
                prior = value / scale, HELD
        elif math.isfinite(p.uncertainty):
            inner = math.log(p.value / scale) if p.positive else p.value / scale
            prior = (inner, p.uncertainty / (p.value if p.positive else scale))
        elif p.unit == "N s/m":
            low, scale = 0.0, max(scale, _little_damping(simulation))
        found.append(FreeParameter(p.name, p.unit, scale, p.positive, low, prior=prior))
    for i, term in enumerate(simulation.terms):
        if term.nonlinear and not isinstance(term.mechanism, SecondImpact):  # that is each recording's own
            law = term.mechanism
            each = [FreeParameter.of(q, i, term.values[q.name]) for q in law.parameters]
            found += _of_a_curve(law, i, term) if isinstance(law, Curve) else each
            found += rounding_of(term, i)
    return found


def _of_a_curve(curve: Curve, owner: int, term: Term) -> list[FreeParameter]:
    """Return the parameters of a curve, all counted in the largest of them, each no larger than it may well be."""
    size, spread = max((abs(term.values[n]) for n in curve.weights), default=1.0) or 1.0, curve.spread(term.values)
    each = [(FreeParameter.of(q, owner, size), spread[q.name]) for q in curve.parameters]
    return [replace(p, prior=(0.0, error / p.scale)) for p, error in each]


def _little_damping(simulation: Simulation) -> float:
    """A damping (N s/m) that is little, but no rounding of none: a fit may end at the bound."""
    mass = simulation.arrangement.matrices(simulation.constants)[0]
    return LITTLE_DAMPING * 2 * float(np.mean(mass)) * 2 * math.pi * simulation.highest_hz


def _offset_scale(simulation: Simulation) -> dict[str, float]:
    """Return how large offsets may well be: as large as what they are added to."""
    sizes = {d.offset: _rms(simulation.recordings[0].inputs[i]) for i, d in enumerate(simulation.rig.drives)}
    sizes |= {s.offset: _rms(simulation.recordings[0].outputs[c]) for c, s in enumerate(simulation.rig.seen)}
    return {name: max(size, 1e-300) for name, size in sizes.items()}


def _rms(row: Real) -> float:
    return float(np.sqrt(np.mean(row**2)))
