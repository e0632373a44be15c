"""Intervals and covariance of a described rig's constants as recordings have them."""

from __future__ import annotations

import math

import numpy as np

from analysis.mismatch.intervals import NORMAL_95
from analysis.mismatch.recordings.fit import SimulatedFit
from sim_backend.arrays import Real

LARGEST_LOGARITHM = 50.0
"""Half of an interval in the logarithm from which on nothing is determined: a factor of 1e21."""


def constant_intervals(fitted: SimulatedFit) -> dict[str, tuple[float, float]]:
    """Return the 95 % interval of each constant that was fitted, in its own unit, by name.

    The covariance is that of the fit, in which noise has the colour of the residual. A constant that is fitted as its
    logarithm has the interval ``v exp(-z s) .. v exp(z s)``, another one ``v - z s .. v + z s``, with ``z`` = 1.96 and
    ``s`` the standard error in what is fitted. An infinite one says that the recordings do not determine it. Constants
    that are declared exactly are not fitted and have none.
    """
    values = fitted.values
    found = {}
    for k, p in enumerate(fitted.simulation.parameters):
        if p.scope != "rig" or p.name not in values:
            continue
        if p.name in fitted.simulation.untold:  # they change with each other, and every channel shows the same
            found[p.name] = (p.low, p.high)
            continue
        variance = float(fitted.covariance[k, k])
        reach = NORMAL_95 * math.sqrt(variance) if variance > 0 and math.isfinite(variance) else math.inf
        value = float(values[p.name])
        if p.log:
            wide = reach > LARGEST_LOGARITHM
            low, high = (0.0, math.inf) if wide else (value * math.exp(-reach), value * math.exp(reach))
        else:
            low, high = value - abs(p.scale) * reach, value + abs(p.scale) * reach
        found[p.name] = (max(low, p.low), min(high, p.high))
    return found


def constants_covariance(fitted: SimulatedFit) -> tuple[list[str], Real]:
    """Return the names of the rig's constants that were fitted, and the (k, k) covariance of their values."""
    values = fitted.values
    found = [(k, p) for k, p in enumerate(fitted.simulation.parameters) if p.scope == "rig" and p.name in values]
    places, scale = [k for k, _ in found], [values[p.name] if p.log else p.scale for _, p in found]
    return [p.name for _, p in found], fitted.covariance[np.ix_(places, places)] * np.outer(scale, scale)
