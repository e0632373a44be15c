"""How one channel follows another through a tap: gain, delay and correlation, each with its uncertainty.

Both see one motion, B = g A delayed by tau, each with noise of its own whose spectrum is known from the quiet before
the tap. g and tau are those of least chi-squared with the noise of both channels (errors in variables), in the
frequency domain, where a delay need not be a whole sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

LONGEST_DELAY_S = 5e-4
"""Within which the delay is looked for: under half a period of the contact resonance at the smallest loads (1 kHz)."""

LOWEST_HZ, HIGHEST_SHARE = 20.0, 0.45
"""Band that is compared: above the high-pass, below the edge of the converter's (a share of the sampling rate)."""

FINENESS = 4
"""Steps per sample of the first search."""

TAPERED = 0.2
"""Share of the record at its end that is faded out: what still rings is not cut."""

SMOOTHED_BINS = 5
"""Over which a noise spectrum is averaged."""

FEWEST_SEGMENTS = 4
LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class ChannelRelation:
    """B against A.

    Attributes
    ----------
    gain, gain_half
        g, negative where the polarity is opposite, and half of its 95 % interval.
    delay_samples, delay_half
        tau, positive where B comes later, and half of its 95 % interval.
    correlation, correlation_low, correlation_high
        Coefficient of correlation of what both saw without noise, and its 95 % interval.
    sign_chi2
        By how much chi-squared, over its expected value where that is above one, speaks for this polarity against the
        other.
    """

    gain: float
    gain_half: float
    delay_samples: float
    delay_half: float
    correlation: float
    correlation_low: float
    correlation_high: float
    sign_chi2: float


def relate(record: Real, quiet: Real, sample_rate_hz: float) -> ChannelRelation:
    """Return how channel B follows A.

    Parameters
    ----------
    record
        (2, n) A and B, from just before the tap on.
    quiet
        (2, m) before it, at least four times as long.
    sample_rate_hz
        Sampling rate, Hz.

    Raises
    ------
    ValueError
        ``quiet`` is too short.
    """
    n = record.shape[1]
    segments = quiet.shape[1] // n
    if segments < FEWEST_SEGMENTS:
        raise ValueError(f"{quiet.shape[1]} quiet samples are too few for a record of {n}")
    fade = np.ones(n)
    faded = round(TAPERED * n)
    fade[n - faded :] = 0.5 * (1 + np.cos(np.pi * np.arange(1, faded + 1) / faded))
    frequency = np.asarray(np.fft.rfftfreq(n, 1 / sample_rate_hz), dtype=np.float64)
    band = (frequency >= LOWEST_HZ) & (frequency <= HIGHEST_SHARE * sample_rate_hz)
    rest = quiet[:, : segments * n]
    base = rest.mean(axis=1)
    a, b = np.fft.rfft(fade * (record - base[:, None]), axis=1)[:, band]
    before = fade * (rest - base[:, None]).reshape(2, segments, n)
    noise_a, noise_b = (_smoothed(row)[band] for row in np.mean(np.abs(np.fft.rfft(before, axis=2)) ** 2, axis=1))
    omega, longest = 2 * np.pi * frequency[band] / sample_rate_hz, LONGEST_DELAY_S * sample_rate_hz
    return _Spectra(a, b, noise_a, noise_b, omega, segments, longest).relation()


def _smoothed(power: Real) -> Real:
    """Running mean over neighbouring bins; never zero, which a channel that is dead would have."""
    kernel = np.ones(SMOOTHED_BINS)
    mean = np.convolve(power, kernel, "same") / np.convolve(np.ones(len(power)), kernel, "same")
    return np.maximum(mean, np.finfo(np.float64).tiny)


class _Spectra:
    """Spectra of both channels, (k,) each, with the expected power of their noise; omega in radians per sample."""

    def __init__(
        self, a: Complex, b: Complex, noise_a: Real, noise_b: Real, omega: Real, segments: int, longest: float
    ) -> None:
        self._a, self._b, self._noise_a, self._noise_b, self._omega = a, b, noise_a, noise_b, omega
        self._segments = segments
        self._steps = np.arange(-round(longest * FINENESS), round(longest * FINENESS) + 1) / FINENESS
        self._turns = np.exp(1j * np.outer(self._steps, omega))

    def relation(self) -> ChannelRelation:
        weight = 1 / (self._noise_a + self._noise_b)
        for _ in range(3):  # the weights need the gain, which hardly needs the weights
            delay, other = self._delays(weight)
            gain = self._gain(weight, delay)
            weight = 1 / (self._noise_b + gain**2 * self._noise_a)
        delay, other = self._delays(weight)
        gain = self._gain(weight, delay)
        power = weight * (np.abs(self._a) ** 2 - self._noise_a)
        both = weight**2 * self._noise_a * self._noise_b
        excess = weight * np.abs(self._b - gain * self._delayed(delay)) ** 2
        gain_half = _half(power, both, excess)
        delay_half = _half(power * self._omega**2, both * self._omega**2, excess) / abs(gain)
        against = (gain**2 - self._gain(weight, other) ** 2) * float(power.sum())
        return ChannelRelation(
            gain,
            gain_half,
            delay,
            delay_half,
            *self._correlation(delay),
            2 * against / max(1.0, float(excess.mean())),
        )

    def _delayed(self, delay: float) -> Complex:
        """A as it would be with a delay, samples."""
        return np.asarray(np.exp(-1j * self._omega * delay) * self._a, dtype=np.complex128)

    def _cross(self, weight: Real, delay: float) -> float:
        return float(np.sum(weight * (np.conj(self._delayed(delay)) * self._b).real))

    def _gain(self, weight: Real, delay: float) -> float:
        """Gain of least chi-squared; the power of A is that without its noise."""
        return self._cross(weight, delay) / float(np.sum(weight * (np.abs(self._a) ** 2 - self._noise_a)))

    def _delays(self, weight: Real) -> tuple[float, float]:
        """Return the best delay, samples, and the best one of the other polarity."""
        steps, cross = self._steps, (self._turns @ (weight * np.conj(self._a) * self._b)).real
        best = int(np.argmax(np.abs(cross)))
        sign = 1.0 if cross[best] > 0 else -1.0
        found = optimize.minimize_scalar(
            lambda delay: -sign * self._cross(weight, delay),
            bounds=(steps[best] - 1 / FINENESS, steps[best] + 1 / FINENESS),
            method="bounded",
            options={"xatol": 1e-6},
        )
        return float(found.x), float(steps[np.argmax(-sign * cross)])

    def _correlation(self, delay: float) -> tuple[float, float, float]:
        """Coefficient without noise, and its interval.

        ``cross / sqrt(power_a power_b)``, each freed of what noise adds to it. To first order the noise e of A moves
        its logarithm by ``Re sum conj(e) (B / cross - A / power_a)``; to second order, which alone counts where both
        are alike, by the noise's own powers.
        """
        a, b, noise_a, noise_b = self._delayed(delay), self._b, self._noise_a, self._noise_b
        cross = float(np.sum((np.conj(a) * b).real))
        power_a = float(np.sum(np.abs(a) ** 2 - noise_a))
        power_b = float(np.sum(np.abs(b) ** 2 - noise_b))
        if min(power_a, power_b) <= 0:
            return 0.0, -1.0, 1.0
        first = 0.5 * np.sum(noise_a * np.abs(b / cross - a / power_a) ** 2)
        first += 0.5 * np.sum(noise_b * np.abs(a / cross - b / power_b) ** 2)
        known = 1 + 1 / self._segments  # the noise's mean power is known from so many segments
        second = known / 4 * (np.sum(noise_a**2) / power_a**2 + np.sum(noise_b**2) / power_b**2)
        second += 0.5 * np.sum(noise_a * noise_b) / cross**2
        size = min(1.0, abs(cross) / np.sqrt(power_a * power_b))
        half = float(stats.norm.ppf((1 + LEVEL) / 2) * np.sqrt(first + second))
        sign = np.sign(cross)
        ends = sorted((sign * size * np.exp(-half), sign * min(1.0, size * np.exp(half))))
        return float(sign * size), float(ends[0]), float(ends[1])


def _half(information: Real, both: Real, excess: Real) -> float:
    """Half of the 95 % interval of a parameter.

    Parameters
    ----------
    information
        What the signal of each bin knows of it, (k,).
    both
        What the noises of both channels make together, (k,): it counts where there is little signal.
    excess
        Squared residual over its noise, (k,): where what is left over exceeds the noise (the mass rotates, the sensors
        differ), that counts.
    """
    total = float(information.sum())
    if total <= 0:
        return float("inf")
    weight = np.maximum(information, 0.0)
    scatter = float(np.sum(weight * excess) / weight.sum())
    bins = float(weight.sum() ** 2 / np.sum(weight**2))
    level = (1 + LEVEL) / 2
    factor = float(stats.norm.ppf(level) if scatter <= 1 else stats.t.ppf(level, 2 * bins))
    return factor * float(np.sqrt(max(1.0, scatter) * 0.5 * (total + both.sum()))) / total
