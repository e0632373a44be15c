"""What a mechanism pays of the evidence, which of two fits leads, and bodies that stand for harmonics."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.blocks import likelihood_ratio, of_least_noise
from analysis.mismatch.recordings.fit import SimulatedFit
from sim_backend.mechanisms.kinds import AddedBody

HARMONICS: Final = (2, 3)  # of a mode, that a law that is not linear makes most of
COINCIDES: Final = 0.005  # of a harmonic, within which a mode is taken for it (case of decision 180: 2e-4)


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


def lead_of(one: SimulatedFit, other: SimulatedFit) -> float:
    """Return the evidence of one fit over another, in samples as independent as those of what the better one leaves."""
    more = sum(cost_of(one, t) for t in one.terms) - sum(cost_of(other, t) for t in other.terms)
    return likelihood_ratio(other, one, of_least_noise((one, other))) - more


def rings_at_a_harmonic(fitted: SimulatedFit) -> bool:
    """Whether a body that a free rig was given puts a mode at a multiple of another one's frequency.

    A law that is not linear makes harmonics, and a part that rings by itself makes up for them.
    """
    free = any(r.free for r in fitted.problem.recordings)
    if not free or not any(isinstance(t.mechanism, AddedBody) for t in fitted.terms):
        return False
    modes = fitted.arrangement.undamped_hz(fitted.values)
    ratios = np.divide.outer(modes, modes[modes > 0])
    return any(bool(np.any(np.abs(ratios / n - 1) < COINCIDES)) for n in HARMONICS)
