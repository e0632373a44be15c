"""The contact mode from spectra alone, as an independent check of ERA and maximum likelihood (Sec. 3.4).

Near its resonance the spectrum of a free decay is ``(smooth) / (j omega - s)``. Multiplied out, with the smooth part a
short polynomial of its own for every impact, this is linear in the pole s, which all impacts share. An exponential
window makes every record die within its length; the decay it adds is known and taken off again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from calibration.estimate import Estimate

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

WINDOW_END = 1e-2  # of the exponential window at the end of a record
HALF_WIDTHS = 3.0  # of the resonance to each side
SMOOTH_DEGREE = 3
FEWEST_LINES = 3 * (SMOOTH_DEGREE + 1)
MOST_STEPS = 12
SETTLED = 1e-4
PADDING = 2
SMOOTHED_LINES = 5
LEAST_PROMINENCE = 0.7  # of a peak, in the logarithm of the power


@dataclass(frozen=True, slots=True)
class SpectralMode:
    """A mode read off spectra; its errors are those of leaving out one impact at a time."""

    frequency_hz: Estimate
    damping_ratio: Estimate


def spectral_mode(decays: Sequence[Real], sample_rate_hz: float, from_hz: float, to_hz: float) -> SpectralMode | None:
    """Read the strongest mode of a band off the spectra of several free decays.

    Parameters
    ----------
    decays
        One-dimensional free decays, cut to the shortest.
    from_hz, to_hz
        Band in which the peak of the averaged spectrum is looked for.

    Returns
    -------
    SpectralMode or None
        None where fewer than three decays are there or the band holds no peak that can be read.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> rng = np.random.default_rng(1)
    >>> found = spectral_mode([y + 1e-3 * rng.standard_normal(t.size) for _ in range(4)], 1e4, 200.0, 400.0)
    >>> round(found.frequency_hz.value)
    300
    """
    length = min((len(d) for d in decays), default=0)
    if length < 64 or len(decays) < 3:
        return None
    added = -np.log(WINDOW_END) / length * sample_rate_hz  # 1/s
    window = np.exp(-added * np.arange(length) / sample_rate_hz)
    spectra = np.array([np.fft.rfft(d[:length] * window, PADDING * length) for d in decays])
    omega = 2 * np.pi * np.fft.rfftfreq(PADDING * length, 1 / sample_rate_hz).astype(np.float64)
    band = np.flatnonzero((omega > 2 * np.pi * from_hz) & (omega < 2 * np.pi * to_hz))
    if band.size < FEWEST_LINES:
        return None
    guess = _first_guess(omega, spectra, band, added)
    if guess is None:
        return None
    pole = guess
    for _ in range(MOST_STEPS):
        sums = _sums(omega, spectra, band, pole)
        if sums is None:
            return None
        new = complex(sums[0].sum() / sums[1].sum())
        if not new.real < 0:
            return None
        # half way: the band follows the pole, and the pole the band
        moved, pole = abs(new - pole), 0.5 * (new + pole)
        if moved < SETTLED * abs(pole.real):
            break
    sums = _sums(omega, spectra, band, pole)
    if sums is None or not omega[band[0]] < pole.imag < omega[band[-1]]:
        return None
    over, under = sums
    whole = _mode(complex(over.sum() / under.sum()), added)
    m = len(decays)
    without = np.array([_mode(complex((over.sum() - over[i]) / (under.sum() - under[i])), added) for i in range(m)])
    spread = np.sqrt((m - 1) / m * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    return SpectralMode(Estimate(whole[0], float(spread[0]), m - 1), Estimate(whole[1], float(spread[1]), m - 1))


def _first_guess(omega: Real, spectra: Complex, band: NDArray[np.int64], added: float) -> complex | None:
    """Most prominent peak of the averaged power in the band, and its width at half of that; None without a peak."""
    power = ndimage.uniform_filter1d((np.abs(spectra) ** 2).mean(axis=0), SMOOTHED_LINES)
    peaks, found = signal.find_peaks(np.log(power[band] + np.finfo(np.float64).tiny), prominence=LEAST_PROMINENCE)
    if not peaks.size:
        return None
    # prominence alone would fall for a notch in the noise: a peak also has to be high
    peak = int(band[peaks[np.argmax(found["prominences"] + np.log(power[band[peaks]]))]])
    high = np.flatnonzero(np.cumprod(power[peak:] > 0.5 * power[peak]))
    width = max(float(omega[1]) * high.size, added)
    return complex(-width, omega[peak])


def _sums(omega: Real, spectra: Complex, band: NDArray[np.int64], pole: complex) -> tuple[Complex, Real] | None:
    """Numerator and denominator of the least-squares pole, (m,) each, over the lines about ``pole``."""
    lines = band[np.abs(omega[band] - pole.imag) <= HALF_WIDTHS * abs(pole.real)]
    if lines.size < FEWEST_LINES:
        return None
    x = (omega[lines] - pole.imag) / (HALF_WIDTHS * abs(pole.real))
    weight = 1 / np.abs(1j * omega[lines] - pole)  # so that the error of every line counts as it was recorded
    smooth, _ = np.linalg.qr(weight[:, None] * np.vander(x, SMOOTH_DEGREE + 1))
    y = (spectra[:, lines] * weight).T
    target = 1j * omega[lines, None] * y
    y = y - smooth @ (smooth.T @ y)
    target = target - smooth @ (smooth.T @ target)
    over = (y.conj() * target).sum(axis=0)
    under = (np.abs(y) ** 2).sum(axis=0)
    return (over, under) if (under > 0).all() else None


def _mode(pole: complex, added: float) -> tuple[float, float]:
    """Frequency, Hz, and damping ratio of a pole without what the window added."""
    own = complex(pole.real + added, pole.imag)
    return abs(own) / (2 * np.pi), -own.real / abs(own)
