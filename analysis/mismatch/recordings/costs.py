"""What a mechanism pays of the evidence for what was free: its parameters, and where its resonance was found."""

from __future__ import annotations

import math

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit
from sim_backend.mechanisms.kinds import AddedBody


def cost_of(fitted: SimulatedFit, term: Term) -> float:
    """Return the evidence that a mechanism of a fit must exceed, chi-squared.

    A parameter costs `SelectionPolicy.parameter_cost`. A resonance that could have been anywhere was found where it
    explains most: of ``n`` that are told apart by their widths, the best explains ``2 ln n`` of noise, and as much of
    what another mechanism does to one of the rig's modes.
    """
    cost = fitted.problem.policy.parameter_cost * len(term.mechanism.parameters)
    return cost + 2 * math.log(max(_resonances(fitted, term), 1.0))


def _resonances(fitted: SimulatedFit, term: Term) -> float:
    """Return how many resonances as narrow as that of an added body the recordings can show, at all frequencies."""
    mechanism = term.mechanism
    if not isinstance(mechanism, AddedBody) or not mechanism.body or not set(mechanism.body) <= term.values.keys():
        return 1.0
    mass, stiffness, damping = (term.values[name] for name in mechanism.body)
    scale, omega = fitted.problem.scale_of(fitted, term.place[0]), math.sqrt(stiffness / mass)
    width = max(damping / mass / omega, 2 * math.pi / (omega * scale.duration_s))
    return math.log(max(scale.shown_hz * scale.duration_s, 1.0)) / width
