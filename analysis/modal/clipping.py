"""Samples at which a recorder was at the end of its range: they say only that the motion was larger."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Real = NDArray[np.float64]

IN_A_ROW = 3  # equal extreme samples that no unclipped oscillation has
STEEP = 1.5  # steps of the converter, by which a sample beside them differs: a peak that is rounded is flat
ALIKE = 1e-6  # of the range, within which samples are equal


def clipped_samples(y: Real) -> NDArray[np.int64]:
    """Samples at which a channel stays at its largest or smallest value.

    Parameters
    ----------
    y
        (c, n) record as it came from the recorder.

    Returns
    -------
    (m,) sample numbers, ascending: those of all channels together.

    Examples
    --------
    >>> import numpy as np
    >>> y = np.clip(np.cos(0.2 * np.arange(100)), -0.9, 2.0)
    >>> clipped_samples(y[None]).size
    13
    """
    y = np.atleast_2d(np.asarray(y, np.float64))
    found = np.zeros(y.shape[1], np.bool_)
    for channel in y:
        low, high = float(channel.min()), float(channel.max())
        span = high - low
        if not span > 0:
            continue
        step = float(np.diff(np.unique(channel)).min())
        for extreme in (low, high):
            if _longest_run(channel, extreme, ALIKE * span, STEEP * step) >= IN_A_ROW:
                found |= np.abs(channel - extreme) <= ALIKE * span
    return np.flatnonzero(found)


@njit(cache=True)
def _longest_run(y: Real, value: float, within: float, steep: float) -> int:
    """Samples in a row, at most, that are this value, with a sample beside them that is far from it."""
    longest, run, begun = 0, 0, np.inf
    for i in range(y.size):
        off = abs(y[i] - value)
        if off <= within:
            run += 1
            continue
        if run > longest and max(off, begun) > steep:
            longest = run
        run, begun = 0, off
    return run if run > longest and begun > steep else longest
