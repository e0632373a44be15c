"""H1, H2 and Hv of a force and its responses, with coherence and random error.

Bendat and Piersol, Random Data (4th ed., 2010), Sec. 6.2 and 9.2, for H1, H2, the coherence and the random error of
H1; Rocklin, Crowley and Vold (Proc. 3rd IMAC, 1985) for Hv, which of one input is the geometric mean of both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.errors import MesotapError

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

FORCE_LIMIT_DB = 20.0
"""Below the highest value of the force spectrum by which the force counts as exciting: usual in impact testing."""

HIGHEST_SHARE = 0.4
"""Of the sampling rate, up to which lines are looked at: above it is the recorder's own low-pass."""


class ForceError(MesotapError, ValueError):
    """A force channel from which no frequency response can be had; one sentence."""


@dataclass(frozen=True, slots=True)
class Spectra:
    """Sums over averages of the products of discrete Fourier transforms; their ratios are the estimators.

    Attributes
    ----------
    force
        (d, k) transforms of the force, one row an average.
    response
        (d, c, k) transforms of the responses.
    """

    force: Complex
    response: Complex

    def without(self, average: int) -> Spectra:
        """Return the same without one average."""
        return Spectra(np.delete(self.force, average, axis=0), np.delete(self.response, average, axis=0))

    @property
    def force_power(self) -> Real:
        """Sum of |F|^2, (k,)."""
        return np.asarray((np.abs(self.force) ** 2).sum(axis=0), np.float64)

    @property
    def response_power(self) -> Real:
        """Sum of |X|^2, (c, k)."""
        return np.asarray((np.abs(self.response) ** 2).sum(axis=0), np.float64)

    @property
    def cross(self) -> Complex:
        """Sum of F* X, (c, k)."""
        return np.asarray(np.einsum("dk,dck->ck", self.force.conj(), self.response), np.complex128)


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Frequency responses of one force.

    Attributes
    ----------
    frequency_hz
        (k,) lines, Hz, from the first above 0.
    h1, h2, hv
        (c, k) response over force: H1 takes noise of the responses out, H2 that of the force, Hv shares it.
    coherence
        (c, k) ordinary coherence; 1 throughout where there is but one average, which tells nothing.
    random_error
        (c, k) relative standard error of the size of H1, and that of its phase in rad; NaN for one average.
    force_spectrum
        (k,) root mean square over the averages of the force's Fourier transform, N/Hz, for impacts; the root of its
        power spectral density, N/sqrt(Hz), for a lasting force.
    force_limit_hz
        Frequency up to which the force excites: there it has fallen by 20 dB.
    averages
        Impacts, or independent stretches, that were averaged; not always whole where stretches overlap.
    channels, unit
        Name of each response, and what H is in.
    window
        What was done to the samples, in words.
    decay_per_s
        Rate of the exponential window, 1/s, 0 without one: H is then that at s = j 2 pi f + decay_per_s.
    notes
        What was left out and why, and what is to be known of the force.
    """

    frequency_hz: Real
    h1: Complex
    h2: Complex
    hv: Complex
    coherence: Real
    random_error: Real
    force_spectrum: Real
    force_limit_hz: float
    averages: float
    channels: tuple[str, ...]
    unit: str
    window: str
    decay_per_s: float = 0.0
    notes: tuple[str, ...] = ()

    def interval(self, channel: int = 0) -> tuple[Real, Real]:
        """Return the ends of the 95 % interval of the magnitude of H1 of a channel, (k,) each; NaN for one average."""
        size, error = np.abs(self.h1[channel]), 1.959964 * self.random_error[channel]
        return size * np.maximum(0.0, 1 - error), size * (1 + error)


def laplace(frequency_hz: Real, decay_per_s: float = 0.0) -> Complex:
    """Return s = j 2 pi f + decay of lines, rad/s: where H was measured under an exponential window."""
    return np.asarray(2j * math.pi * frequency_hz + decay_per_s, np.complex128)


def transforms(force: Real, response: Real) -> Spectra:
    """Return the transforms of windowed stretches: force (d, n), response (d, c, n), without the line at 0."""
    return Spectra(
        np.asarray(np.fft.rfft(force)[:, 1:], np.complex128), np.asarray(np.fft.rfft(response)[..., 1:], np.complex128)
    )


def estimators(spectra: Spectra) -> tuple[Complex, Complex, Complex, Real]:
    """Return H1, H2, Hv and the coherence, (c, k) each; NaN where force or response is nothing at all.

    Examples
    --------
    >>> import numpy as np
    >>> force = np.random.default_rng(1).standard_normal((4, 64))
    >>> h1, h2, hv, coherence = estimators(transforms(force, 2 * force[:, None]))
    >>> np.allclose([h1, h2, hv], 2.0), np.allclose(coherence, 1.0)
    (True, True)
    """
    ff, xx, fx = spectra.force_power, spectra.response_power, spectra.cross
    with np.errstate(divide="ignore", invalid="ignore"):
        h1 = fx / ff
        h2 = xx / fx.conj()
        hv = np.sqrt(xx / ff) * fx / np.abs(fx)
        coherence = np.abs(fx) ** 2 / (ff * xx)
    return h1, h2, hv, np.minimum(coherence, 1.0)


def random_error(coherence: Real, averages: float) -> Real:
    """Return the relative standard error of the size of H1, that of its phase in rad (Bendat and Piersol, Eq. 9.90).

    NaN for one average, whose coherence is 1 whatever the noise.

    Examples
    --------
    >>> round(float(random_error(np.array(0.9), 8)), 4)
    0.0833
    """
    if averages < 2:
        return np.full(np.shape(coherence), math.nan)
    gamma2 = np.asarray(coherence, np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt((1 - gamma2) / (2 * averages * gamma2)), np.float64)


def excited_up_to(frequency_hz: Real, force_spectrum: Real, below_db: float = FORCE_LIMIT_DB) -> float:
    """Return the first frequency above its maximum at which the force spectrum has fallen by ``below_db``, Hz."""
    if not force_spectrum.size or not force_spectrum.max() > 0:
        return 0.0
    top = int(np.argmax(force_spectrum))
    fallen = force_spectrum[top:] < force_spectrum[top] * 10 ** (-below_db / 20)
    return float(frequency_hz[top + int(np.argmax(fallen))] if fallen.any() else frequency_hz[-1])


def averaged(
    spectra: Spectra,
    frequency_hz: Real,
    force_scale: float,
    averages: float,
    channels: Sequence[str],
    unit: str,
    window: str,
    decay_per_s: float = 0.0,
    notes: Sequence[str] = (),
) -> FrequencyResponse:
    """Return the frequency responses of transforms; ``force_scale`` takes the root mean square |F| to its unit."""
    h1, h2, hv, coherence = estimators(spectra)
    size = np.sqrt(spectra.force_power / len(spectra.force)) * force_scale
    return FrequencyResponse(
        frequency_hz=frequency_hz,
        h1=h1,
        h2=h2,
        hv=hv,
        coherence=coherence,
        random_error=random_error(coherence, averages),
        force_spectrum=size,
        force_limit_hz=excited_up_to(frequency_hz, size),
        averages=averages,
        channels=tuple(channels),
        unit=unit,
        window=window,
        decay_per_s=decay_per_s,
        notes=tuple(notes),
    )
