"""The covariances of a fit's parameters, made when they are first asked for: most fits that compete are never asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.noise import NoiseModel
from analysis.mismatch.recordings.simulation import Simulation
from sim_backend.arrays import Real

Spread = Callable[[], tuple[Real, tuple[NoiseModel, ...]]]
"""Makes the covariance (k, k) of all parameters of a fit, and the noise of each recording."""


def covariances(simulation: Simulation, terms: Sequence[Term], spread: Spread | None) -> tuple[Real, tuple[Real, ...]]:
    """Return the covariance of all parameters and of each term's; zero where a fit was not made for it."""
    count, found = len(simulation.parameters), []
    whole = np.zeros((count, count)) if spread is None else spread()[0]
    for i, term in enumerate(terms):
        at = [
            k for q in term.mechanism.parameters for k, p in enumerate(simulation.parameters)
            if p.scope == "mechanism" and (p.owner, p.name) == (i, q.name)
        ]  # fmt: skip
        scale = np.array([1.0 if simulation.parameters[k].log else simulation.parameters[k].scale for k in at])
        found.append(whole[np.ix_(at, at)] * np.outer(scale, scale))
    return whole, tuple(found)
