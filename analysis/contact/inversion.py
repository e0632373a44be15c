"""From load to separation, for laws that give the load of rough flats at a separation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.errors import MesotapError

FloatArray = NDArray[np.float64]
CLOSEST, FARTHEST = -20.0, 35.0  # separations in R_q; beyond, all asperities are flattened or none touches
GRID = np.linspace(CLOSEST, FARTHEST, 1101)


class TheoryError(MesotapError, ValueError):
    """A contact theory does not cover what it was asked for; one sentence."""


def separation_for_load(
    P: ArrayLike,
    table: FloatArray,
    load: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the separation h = d / R_q (shaped like ``P``) at which ``load(h)`` is ``P``, N; infinite where P is zero.

    Newton's method for log P, which is smooth and falls with h, from a table of it.

    Parameters
    ----------
    P
        (...) loads, N.
    table
        P(h) on `GRID`, N.
    load, slope
        P(h) and -dP/dh, N, of arrays.

    Raises
    ------
    TheoryError
        A negative load, or one beyond what separations from -20 to 35 R_q carry.
    """
    wanted = np.asarray(P, dtype=np.float64)
    if not np.all(wanted >= 0):
        raise TheoryError("surfaces in contact carry no negative load")
    outside = (wanted > table[0]) | ((wanted < table[-1]) & (wanted > 0))
    if outside.any():
        raise TheoryError(
            f"a load of {float(wanted[outside].flat[0]):.3g} N is outside the {table[-1]:.3g} to {table[0]:.3g} N that "
            "the asperity model covers for these surfaces"
        )
    touching = wanted > 0
    target = np.log(np.where(touching, wanted, table[0]))
    h = np.interp(-target, -np.log(table), GRID)
    for _ in range(4):
        carried = load(h)
        h = np.clip(h + (np.log(carried) - target) * carried / slope(h), CLOSEST, FARTHEST)
    return np.asarray(np.where(touching, h, np.inf), dtype=np.float64)
