"""What ring-downs cannot tell: how heavy the rig is.

A rig that is heavier and stiffer by a factor, under forces larger by the same factor, moves in the same way. Of a tap
that was not measured, recordings of the motion hold no force at all, so that nothing but the declared masses says how
large a force in an element is. Slopes by differences hold this only as well as they are computed; of a force that jumps
that is far less than the declared masses are known.
"""

from __future__ import annotations

import re

import numpy as np

from analysis.mismatch.parameters import FreeParameter
from analysis.mismatch.ring_downs.added_response import AddedResponse
from sim_backend.acting import laws_in
from sim_backend.arrangement import LOAD
from sim_backend.arrays import Real

FORCES = ("N", "kg")  # units that grow with it


def exponent(unit: str) -> int:
    """Return the power of the factor with which a quantity of this unit grows.

    Examples
    --------
    >>> [exponent(unit) for unit in ("kg", "N s/m", "N/m3", "m/N s2", "m/s", "1")]
    [1, 1, 1, -1, 0, 0]
    """
    over, _, under = unit.partition("/")
    return sum(sign * _bare(t) for part, sign in ((over, 1), (under, -1)) for t in part.split())


def _bare(factor: str) -> int:
    return int(re.sub(r"\d+$", "", factor) in FORCES)


def undetermined_mass(added: AddedResponse) -> int | None:
    """Return the place of a mass among the rig's constants where laws act and a common factor changes nothing.

    None where a law knows the load, which was measured as a force, or where no law acts: linear slopes are exact.
    """
    elements, laws = added.arrangement.elements, laws_in(added.terms)
    if not laws or any(elements[e].preload for *_, e in laws):
        return None
    return next((i for i, p in enumerate(added.rig_parameters) if p.name in added.arrangement.masses), None)


def growth(added: AddedResponse, basis: Real, rig: Real, load: Real, free: Real) -> Real:
    """Return (k,) how the coordinates of a fit change per unit of the factor's logarithm: rig, one load, terms.

    Parameters
    ----------
    basis, rig, load, free
        Of the coordinates (n, n), and the present values: the rig's constants, those of a load, the terms' parameters.
    """
    of_load = [exponent(p.unit) for p in added.arrangement.parameters if p.scope == LOAD]
    of_rig = np.array([exponent(p.unit) for p in added.rig_parameters]) * rig
    return np.concatenate([np.linalg.solve(basis, of_rig), of_load * load, _of_terms(added.free, free)])


def _of_terms(parameters: list[FreeParameter], x: Real) -> Real:
    return np.array([exponent(q.unit) * (1.0 if q.log else v) for q, v in zip(parameters, x, strict=True)])


def without_scale(columns: Real, grown: Real, mass: int) -> Real:
    """Return slopes (N, k) in which a common factor does nothing: a mass has the slope that the others leave it."""
    out = columns.copy()
    out[:, mass] -= columns @ grown / grown[mass]
    return out
