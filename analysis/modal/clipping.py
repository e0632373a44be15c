"""Samples at which a recorder was at the end of its range: they say only that the motion was larger."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

IN_A_ROW = 3  # equal extreme samples that no unclipped oscillation has
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
    14
    """
    y = np.atleast_2d(y)
    found = np.zeros(y.shape[1], np.bool_)
    for channel in y:
        low, high = float(channel.min()), float(channel.max())
        span = high - low
        if not span > 0:
            continue
        for extreme in (low, high):
            at = np.abs(channel - extreme) <= ALIKE * span
            if _longest_run(at) >= IN_A_ROW:
                found |= at
    return np.flatnonzero(found)


def _longest_run(flags: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))
