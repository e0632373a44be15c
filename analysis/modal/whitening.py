"""Records whose noise is white: whitened by what is heard before an impact, or else by what their modes leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.modal.model_order import is_white_noise
from analysis.modal.noise import LARGEST_ORDER, NoiseModel, noise_model
from analysis.modal.ring_down_model import Model, Record, without_weak

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LEAST_QUIET = 200  # samples of noise from which its colour is told
SAMPLES_A_COEFFICIENT = 100  # of noise, from which on more than the usual number of coefficients is tried
LONGEST_MEMORY = 32  # samples: the most coefficients that are tried
MOSTLY = 0.5  # of a record's energy, that its modes leave where it is rather noise than a ring-down
COLOURED = (
    "the noise is coloured, as the later half of the record shows; with no samples before an impact its lowest "
    "frequencies may look like modes"
)


@dataclass(frozen=True, slots=True)
class Whitened:
    """A record whose noise is white in each channel, of the length that it had; its first samples are not filtered.

    Attributes
    ----------
    y
        (c, n) record.
    clipped
        Samples that say nothing.
    filters
        Of each channel.
    """

    y: Real
    clipped: NDArray[np.int64]
    filters: tuple[NoiseModel, ...]

    @property
    def order(self) -> int:
        """Samples at its beginning that are not filtered."""
        return max(f.order for f in self.filters)

    def amplitudes(self, amplitudes: Complex, pole: complex) -> Complex:
        """Amplitudes that a mode had before whitening."""
        passed = [np.polyval(f.coefficients[::-1], 1 / pole) for f in self.filters]
        return amplitudes / np.array(passed)

    def before(self, rest: Real) -> Real:
        """A residual as it was before whitening."""
        undone = [signal.lfilter([1.0], f.coefficients, row) for f, row in zip(self.filters, rest, strict=True)]
        return np.array(undone, np.float64)


def whitened(y: Real, noise: list[list[Real]], clipped: NDArray[np.int64]) -> Whitened:
    """Whiten each channel by the autoregressive model of stretches that hold its noise, if they are long enough."""
    enough = [sum(map(len, stretches)) >= LEAST_QUIET for stretches in noise]
    # a drift is no noise: what follows it would be whitened by differences of samples, which make noise of modes
    noise = [[signal.detrend(s) if len(s) >= LEAST_QUIET else s for s in stretches] for stretches in noise]
    filters = tuple(
        noise_model(stretches, _largest_order(stretches)) if e else NoiseModel(np.ones(1), float("nan"))
        for stretches, e in zip(noise, enough, strict=True)
    )
    order = max(f.order for f in filters)
    if order == 0:
        return Whitened(y, clipped, filters)
    white = np.array([signal.lfilter(f.coefficients, [1.0], row) for f, row in zip(filters, y, strict=True)])
    spoiled = np.unique((clipped[:, None] + np.arange(order + 1)).ravel())
    return Whitened(white, spoiled[spoiled < y.shape[1]], filters)


def _largest_order(stretches: list[Real]) -> int:
    """Order that stretches of noise are long enough for: noise of 1 / f has no end to its own."""
    return int(np.clip(sum(map(len, stretches)) // SAMPLES_A_COEFFICIENT, LARGEST_ORDER, LONGEST_MEMORY))


def colour_after_an_impact(white: Whitened, record: Record, model: Model) -> Real | None:
    """What is left, not whitened, of a record with weak modes; None where all stand far out of the noise.

    Weak modes may be the colour of a noise of which too little was heard before the impact.
    """
    rest = without_weak(record, model)
    return None if rest is None else white.before(rest)


def colour_without_an_impact(record: Record, model: Model) -> Real | None:
    """Noise of the later half of a record that is rather noise than a ring-down; None where it is white.

    Decays are over there, noise is not. What the modes of a ring-down leave may be their own: they are no exponentials.
    """
    if model.fit is None or (model.left < MOSTLY * (record.y**2).sum(axis=1)).any():
        return None
    later = model.residual[:, record.y.shape[1] // 2 :]
    return None if is_white_noise(later) else later
