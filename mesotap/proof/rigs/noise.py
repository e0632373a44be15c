"""Noise of a channel as a causal filter of white noise, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Noise:
    """White, of a first-order autoregression (``ar``), or 1/f^``slope`` (Kasdin, 1995); ``sigma`` of what drives it.

    ``step`` is that of the quantisation, 0 for none.
    """

    sigma: float
    ar: float = 0.0
    slope: float = 0.0
    step: float = 0.0

    @property
    def white(self) -> bool:
        """Whether it has no colour."""
        return self.ar == 0 and self.slope == 0

    def _colours(self, count: int) -> tuple[Array, Array]:
        """Impulse responses of the filter that makes the noise and of that which undoes it."""
        k = np.arange(1, count)
        if self.slope:
            make = np.cumprod(np.append(1.0, (k - 1 + self.slope / 2) / k))
            return make, np.cumprod(np.append(1.0, (k - 1 - self.slope / 2) / k))
        make = self.ar ** np.arange(count, dtype=np.float64) if self.ar else np.append(1.0, np.zeros(count - 1))
        undo = np.zeros(count)
        undo[:2] = 1.0, -self.ar
        return make, undo

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return ``count`` samples."""
        make, _ = self._colours(count)
        return np.asarray(fftconvolve(self.sigma * rng.standard_normal(count), make)[:count])

    def rms(self, count: int) -> float:
        """Root of its mean square over ``count`` samples, quantisation included."""
        make, _ = self._colours(count)
        mean_square = float(np.mean(np.cumsum(make**2))) * self.sigma**2
        return float(np.sqrt(mean_square + self.step**2 / 12))

    def whitened(self, signal: Array) -> Array:
        """Return the signal (count, ...) in standard deviations of the noise, filtered as makes the noise white.

        Quantisation counts as white noise, and so little of it is allowed that it does not colour coloured noise.
        """
        _, undo = self._colours(len(signal))
        sigma = float(np.hypot(self.sigma, self.step / np.sqrt(12.0)))
        if self.white:
            return np.asarray(signal / sigma)
        shape = (-1,) + (1,) * (signal.ndim - 1)
        return np.asarray(fftconvolve(signal, undo.reshape(shape), axes=0)[: len(signal)] / sigma)
