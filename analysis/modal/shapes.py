"""Shapes of modes: how far two are the same, and how far one moves in a single phase."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


def modal_assurance(first: Complex, second: Complex) -> Real:
    """Modal assurance criterion between two sets of shapes over the same channels.

    1 where two shapes differ by a factor alone, 0 where they are orthogonal. With one channel all shapes are the same.

    Parameters
    ----------
    first
        (c, m) shapes, real or complex, a column a mode.
    second
        (c, n) shapes.

    Returns
    -------
    ndarray
        (m, n), each |a^H b|^2 / (a^H a)(b^H b); NaN for a shape of zeros.

    Raises
    ------
    ValueError
        The shapes have not the same channels.

    References
    ----------
    Allemang and Brown, "A correlation coefficient for modal vector analysis", IMAC 1, 1982.

    Examples
    --------
    >>> import numpy as np
    >>> bending = np.array([[1.0, 1.0], [2.0, -1.0], [3.0, 0.5]])
    >>> modal_assurance(bending, -2j * bending).round(3)
    array([[1.   , 0.008],
           [0.008, 1.   ]])
    """
    if first.shape[0] != second.shape[0]:
        raise ValueError(f"shapes of {first.shape[0]} and of {second.shape[0]} channels")
    inner = np.abs(first.conj().T @ second) ** 2
    with np.errstate(invalid="ignore"):
        criterion: Real = inner / np.outer((np.abs(first) ** 2).sum(axis=0), (np.abs(second) ** 2).sum(axis=0))
    return criterion


def phase_collinearity(shapes: Complex) -> Real:
    """Modal phase collinearity (m,) of shapes (c, m): 1 where all channels of a mode move in one phase or against it.

    NaN for shapes over one channel, of which it says nothing.

    References
    ----------
    Juang and Pappa, "An eigensystem realization algorithm for modal parameter identification", J. Guidance 8, 1985.
    """
    if shapes.shape[0] == 1:
        return np.full(shapes.shape[1], np.nan)
    x, y = shapes.real, shapes.imag
    sxx, syy, sxy = (x * x).sum(axis=0), (y * y).sum(axis=0), (x * y).sum(axis=0)
    total = np.where(sxx + syy > 0, sxx + syy, 1.0)
    mpc: Real = ((sxx - syy) ** 2 + 4 * sxy**2) / total**2
    return mpc


def scaled(shape: Complex) -> Complex:
    """Return a shape (c,) divided by its largest component; zeros stay zeros."""
    largest = shape[np.argmax(np.abs(shape))]
    return shape / largest if largest else shape
