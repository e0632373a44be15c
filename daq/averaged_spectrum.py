"""Spectrum of a stream as it comes: modified periodograms of segments that overlap by half, averaged (Welch)."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy import signal


class AveragedSpectrum:
    """Mean spectrum of the last segments of a stream.

    Parameters
    ----------
    channels
        Number of channels of the stream.
    sample_rate_hz
        Sampling rate, Hz.
    segment_samples
        Length of a segment; the bins are ``sample_rate_hz / segment_samples`` apart.
    averages
        Number of segments that are averaged at most.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> spectrum = AveragedSpectrum(2, 25000.0, 1024, 100)
    >>> spectrum.add(0.01 * rng.standard_normal((2, 60000)))
    >>> spectrum.count, spectrum.amplitude_density().shape
    (100, (2, 513))
    """

    def __init__(self, channels: int, sample_rate_hz: float, segment_samples: int, averages: int) -> None:
        self._channels = channels
        self.sample_rate_hz = sample_rate_hz
        self.segment_samples = segment_samples
        self._powers: deque[NDArray[np.float64]] = deque(maxlen=averages)
        self._waiting = np.zeros((channels, 0))

    @property
    def averages(self) -> int:
        """Number of segments that are averaged at most."""
        return self._powers.maxlen or 0

    @property
    def count(self) -> int:
        """Number of segments in the average now."""
        return len(self._powers)

    def frequency_hz(self) -> NDArray[np.float64]:
        """Return the frequencies, (bins,)."""
        return np.asarray(np.fft.rfftfreq(self.segment_samples, 1 / self.sample_rate_hz), dtype=np.float64)

    def average_over(self, averages: int) -> None:
        """Average so many segments from now on; those that there are stay, the latest first."""
        self._powers = deque(self._powers, maxlen=averages)

    def reset(self) -> None:
        """Begin anew."""
        self._powers.clear()
        self._waiting = np.zeros((self._channels, 0))

    def break_off(self) -> None:
        """See samples lost: no segment spans the gap."""
        self._waiting = np.zeros((self._channels, 0))

    def add(self, samples: NDArray[np.float64]) -> None:
        """Take in the next samples, (channels, n), in their unit."""
        self._waiting = np.concatenate([self._waiting, samples], axis=1)
        n = self.segment_samples
        while self._waiting.shape[1] >= n:
            _, power = signal.periodogram(self._waiting[:, :n], self.sample_rate_hz, "hann", detrend="constant")
            self._powers.append(power)
            self._waiting = self._waiting[:, n // 2 :]

    def amplitude_density(self) -> NDArray[np.float64]:
        """Return the square root of the mean power spectral density, (channels, bins), unit per root hertz.

        NaN where there is no segment yet.
        """
        if not self._powers:
            return np.full((self._channels, self.segment_samples // 2 + 1), np.nan)
        return np.asarray(np.sqrt(np.mean(np.stack(self._powers), axis=0)), dtype=np.float64)
