"""Records whose noise is smaller than a step of the converter: what is left of a decay stands still, and is no noise.

Rounding errors of such a record hang together with the motion, and below one step there are none. Noise of the size of
rounding errors, added before anything is fitted, makes them what a fit takes them for (dither; Lipshitz, Wannamaker and
Vanderkooy 1992).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

COARSEST = 4000.0  # steps of a record's range: more are as good as none
STILL = 0.2  # of its samples that are the same as the one before them, from which on the noise is below a step
SEED = 1992


def dithered(y: Real) -> Real:
    """The record (c, n) with noise of half a step to both sides where its own noise is smaller than a step.

    Examples
    --------
    >>> coarse = np.round(10 * np.cos(0.01 * np.arange(500)))[None]
    >>> bool(np.abs(dithered(coarse) - coarse).max() <= 0.5)
    True
    >>> fine = np.random.default_rng(1).standard_normal((1, 500))
    >>> bool((dithered(fine) == fine).all())
    True
    """
    random, found = np.random.default_rng(SEED), y.copy()
    for row in found:
        values = np.unique(row)
        if values.size < 2 or np.mean(np.diff(row) == 0) < STILL:
            continue
        step = float(np.diff(values).min())
        if values[-1] - values[0] < COARSEST * step:
            row += step * random.uniform(-0.5, 0.5, row.size)
    return found
