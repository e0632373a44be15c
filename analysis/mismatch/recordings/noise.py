"""The noise of recordings, as what a fit leaves shows it: of measured inputs and of sensors, white and coloured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import signal
from scipy.fft import next_fast_len

from analysis.mismatch.recordings.recorded import CHOOSE, FIT, HELD, UNUSED, Recorded, level
from sim_backend.arrays import Complex, Real

Left = tuple[Real, NDArray[np.bool_]]  # (c, n) residual, and (n,) which samples of it are used

MOST_CORRELATED: Final = 0.05  # correlation that still counts when independent samples are counted
AUTOREGRESSION: Final = 16  # order of the noise model
MEMORY: Final = 4096  # samples, in which noise is taken to have forgotten what was before
COUNTS: Final = 0.01  # of a channel's residual, from which on the inputs' noise is taken out
LEAST_WHITE: Final = 0.01  # of a channel's residual that is its own noise at least
ROUNDED: Final = 1e-12  # of a signal's power, that rounding leaves white
FILTERED: Final = 1e-4  # likewise, that a filtered signal is taken to have (chosen on the bolted beam)
LEAST_NOISE: Final = 1e-5  # of a channel's rms, that a recording is believed to have
SAMPLES_OF_A_TAP: Final = 20  # that a recording has at least, of each of its channels


@dataclass(frozen=True)
class Whitening:
    """An autoregression of several channels, each given the past of all and the present of those before it.

    What drives a rig beside its measured inputs (their noise above all) rings in all channels together. The first
    samples are given what little past they have: with zeros for what came before, slow noise would stand out there
    (of a first-order one of 0.9 the first sample by a variance of 5), where a decay and what rings by itself begin.

    Attributes
    ----------
    taps
        (c, c, order + 1) weights of the present and the past of channels in what cannot be predicted of each.
    noise
        (c,) rms of that.
    """

    taps: Real
    noise: Real

    @classmethod
    def of(cls, rows: Real, used: NDArray[np.bool_], floor: float = ROUNDED) -> Whitening:
        """Return the autoregression that fits signals (c, n) best, by least squares over what is used of them.

        ``floor`` is the share of white noise that they are taken to have at least.
        """
        channels = len(rows)
        order = max(min(AUTOREGRESSION, int(np.sum(used)) // (SAMPLES_OF_A_TAP * channels)), 1)
        whole = np.all(sliding_window_view(used, order + 1), axis=1)
        size = np.maximum(np.sqrt(np.mean(rows[:, used] ** 2, axis=1)), 1e-300)
        past = sliding_window_view(rows / size[:, None], order + 1, axis=1)[:, whole, ::-1]  # (c, m, order + 1)
        past = past.transpose(2, 0, 1).reshape((order + 1) * channels, -1)  # the present of all channels first
        gram = past @ past.T
        taps, noise = np.zeros((channels, channels, order + 1)), np.zeros(channels)
        for c in range(channels):
            given = np.r_[:c, channels : len(gram)]
            normal = gram[np.ix_(given, given)]
            normal[np.diag_indices_from(normal)] *= 1 + floor
            weights = np.zeros(len(gram))
            weights[given] = -np.linalg.lstsq(normal, gram[given, c], rcond=None)[0]
            weights[c] = 1.0
            noise[c] = math.sqrt(max(float(weights @ gram @ weights), 0.0) / max(past.shape[1] - given.size, 1))
            taps[c] = weights.reshape(order + 1, channels).T / size[:, None]
        return cls(taps * size[:, None, None], np.maximum(noise * size, 1e-300))

    def response(self, size: int) -> Complex:
        """Return (lines, c, c) its response at the lines of a spectrum of so many samples."""
        angles = 2 * np.pi * np.arange(size // 2 + 1) / size
        lags = np.exp(-1j * np.outer(angles, np.arange(self.taps.shape[2])))
        return np.asarray(np.tensordot(lags, self.taps, axes=(1, 2)) / self.noise[:, None], np.complex128)

    def __call__(self, rows: Real) -> Real:
        """Return rows (..., c, n) whitened, of variance one where they are like those it was fitted to."""
        found = np.zeros(rows.shape)
        for c, (weights, noise) in enumerate(zip(self.taps, self.noise, strict=True)):
            for other, weight in enumerate(weights):
                if np.any(weight):
                    found[..., c, :] += signal.lfilter(weight / noise, [1.0], rows[..., other, :])
        begun = rows[..., : self.taps.shape[2] - 1].swapaxes(-2, -1)  # (..., t, c)
        count = begun.shape[-2] * begun.shape[-1]
        white = begun.reshape(*begun.shape[:-2], count) @ self.beginning[:count, :count].T
        found[..., : begun.shape[-2]] = white.reshape(begun.shape).swapaxes(-2, -1)
        return found

    @cached_property
    def beginning(self) -> Real:
        """The (order c, order c) weights that whiten the first samples of all channels, sample after sample."""
        channels, order = self.taps.shape[0], self.taps.shape[2] - 1
        coloured = np.linalg.inv(self.response(MEMORY))  # (lines, c, c)
        covariance = np.fft.irfft(coloured @ coloured.conj().swapaxes(1, 2), axis=0)[:order]  # of y[t + lag] and y[t]
        lags = np.subtract.outer(np.arange(order), np.arange(order))
        blocks = covariance[np.abs(lags)]  # (t, s, c, d)
        whole = np.where((lags >= 0)[..., None, None], blocks, blocks.swapaxes(2, 3))
        whole = whole.swapaxes(1, 2).reshape(order * channels, order * channels)
        size = np.sqrt(np.diag(whole))
        correlated = whole / np.outer(size, size) + ROUNDED * np.eye(size.size)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(correlated)) / size, np.float64)


@dataclass(frozen=True, slots=True)
class InputNoiseMade:
    """What draws of the noise of measured inputs make of a recording, in its units, and what a fit leaves of that.

    Attributes
    ----------
    used
        (n,) which samples were fitted, m of them.
    whole, left
        (draws, c, m) before and after the fit.
    """

    used: NDArray[np.bool_]
    whole: Real
    left: Real


@dataclass(frozen=True, slots=True)
class InputNoise:
    """A filter without phase that takes out what noise of the measured inputs makes in the channels.

    It rings at the rig's resonances, which no autoregression of a few samples follows; where forces bend or jump, these
    are not the linear rig's, and noise moves the moments of the jumps.

    Attributes
    ----------
    samples
        Longest rows that it is for.
    share
        (c,) of what draws of that noise make, that is taken to be in the recording.
    power
        (c,) mean square of that, in units of the recording.
    white
        (c,) variance of the channels' own white noise, in units of the recording.
    roots
        (lines, c, c) inverse square roots of the spectrum of both, in units of ``white``.
    """

    samples: int
    share: Real
    power: Real
    white: Real
    roots: Complex

    @classmethod
    def of(cls, made: InputNoiseMade, samples: int, left: Left) -> InputNoise | None:
        """Return it, from what draws of it make and what a fit leaves; None where it does not count."""
        off, used = left
        total, powers = np.mean(off[:, used] ** 2, axis=1), np.mean(made.left**2, axis=2)  # (c,), (draws, c)
        power = powers.mean(axis=0)
        if np.any(total <= 0) or not np.all(np.isfinite(power)) or np.all(power < COUNTS * total):
            return None
        # the inputs' noise is less than their spectra show where no draw leaves as little as there is
        share = np.sqrt(np.minimum(1.0, total / np.maximum(powers.min(axis=0), 1e-300)))
        rows = np.zeros((len(made.left), len(off), made.used.size))
        rows[:, :, made.used] = made.left * share[:, None]
        spectrum = np.fft.rfft(rows, _padded(samples), axis=2)
        own = np.einsum("mcl,mdl->lcd", spectrum, spectrum.conj()) / (len(rows) * np.count_nonzero(made.used))
        whole = np.abs(np.fft.rfft(np.where(used, off, 0.0), _padded(samples), axis=1)) ** 2 / np.count_nonzero(used)
        white = np.maximum(_beside(whole, np.real(np.einsum("lcc->cl", own))), LEAST_WHITE * total)
        own /= np.sqrt(np.outer(white, white))
        sizes, vectors = np.linalg.eigh(own + np.eye(len(off)))
        roots = (vectors / np.sqrt(sizes)[:, None, :]) @ vectors.conj().transpose(0, 2, 1) / np.sqrt(white)
        return cls(samples, share, power * share**2, white, roots)

    def __call__(self, rows: Real) -> Real:
        """Return rows (..., c, n) without it, in units of the channels' own white noise."""
        spectrum = np.fft.rfft(rows, _padded(self.samples), axis=-1)
        whitened = np.fft.irfft(np.einsum("lcd,...dl->...cl", self.roots, spectrum))
        return np.asarray(whitened[..., : rows.shape[-1]], np.float64)


def _beside(whole: Real, made: Real) -> Real:
    """Return (c,) the power per line of channels' own white noise, from spectra (c, lines) of all there is and of this.

    From the half of the lines where inputs' noise makes least: at a resonance it scatters as much as it is.
    """
    quiet = made <= np.median(made, axis=1, keepdims=True)
    return np.asarray(np.sum((whole - made) * quiet, axis=1) / np.sum(quiet, axis=1), np.float64)


def _padded(samples: int) -> int:
    return 2 * int(next_fast_len(samples, real=True))


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Noise of all channels of a recording: what inputs' noise makes, and what an autoregression follows beside it."""

    driven: InputNoise | None
    own: Whitening

    @classmethod
    def of(cls, recorded: Recorded, left: Left, made: InputNoiseMade | None = None) -> NoiseModel:
        """Return the model of what a fit leaves, given what draws of the inputs' noise make."""
        samples = recorded.samples - recorded.fitted.start
        driven = None if made is None else InputNoise.of(made, samples, left)
        rows = left[0] if driven is None else driven(left[0])
        return cls(driven, Whitening.of(rows, left[1], floor_of(recorded)))

    @property
    def unpredicted(self) -> float:
        """Mean square of what cannot be predicted of the noise, the geometric mean of the channels."""
        channels = self.own.noise.size
        driven = 0.0 if self.driven is None else float(np.mean(np.linalg.slogdet(self.driven.roots)[1]))
        return math.exp(2 * (float(np.sum(np.log(self.own.noise))) - driven) / channels)

    def white(self, rows: Real) -> Real:
        """Return rows (..., c, n) whitened, of variance one where they are noise."""
        return self.own(rows if self.driven is None else self.driven(rows))

    def information(self, columns: Real, used: NDArray[np.bool_], made: InputNoiseMade | None) -> Real:
        """Return (k, k) the covariance of the products with the noise of columns (c, m, k) at the samples ``used``.

        What inputs' noise makes is taken from draws of it, however little is left of it: a fit's numbers took the rest.
        """
        share = np.ones(len(columns)) if self.driven is None else self.driven.share
        by_inputs = np.zeros((0, columns.shape[2]))
        if made is not None:
            products = np.tensordot(made.whole, columns * share[:, None, None], axes=((1, 2), (0, 1)))  # (draws, k)
            by_inputs = products / math.sqrt(len(products))
        if self.driven is None:
            own = self._by_own(columns, used)
        else:
            own = (columns * np.sqrt(self.driven.white)[:, None, None]).reshape(-1, columns.shape[2])
        return np.asarray(by_inputs.T @ by_inputs + own.T @ own, np.float64)

    def _by_own(self, columns: Real, used: NDArray[np.bool_]) -> Real:
        """Return (lines, k) columns as the autoregression of the channels' own noise weighs them."""
        rows = np.zeros((len(columns), used.size, columns.shape[2]))
        rows[:, used] = columns
        size = _padded(used.size)
        spectrum = np.fft.rfft(rows, size, axis=1).transpose(1, 0, 2)  # (lines, c, k)
        shaped = np.linalg.solve(self.own.response(size).conj().transpose(0, 2, 1), spectrum)
        weights = np.full(len(spectrum), 2.0)
        weights[0] = weights[-1] = 1.0
        flat = (shaped * np.sqrt(weights / size)[:, None, None]).reshape(-1, rows.shape[2])
        return np.concatenate([flat.real, flat.imag])


def floor_of(recorded: Recorded) -> float:
    """Return the share of white noise that a recording's residual is taken to have; a filtered one has none of its own.

    Without a floor what the filter left of its stop band would be all that counts.
    """
    return ROUNDED if recorded.band is None else FILTERED


def innovation_rms(row: Real, floor: float = ROUNDED) -> float:
    """Return the rms of what an autoregression cannot predict of a signal (n,)."""
    return float(Whitening.of(row[None], np.ones(row.size, np.bool_), floor).noise[0])


def correlation(row: Real) -> float:
    """Return samples over independent ones, of a residual that is no white noise."""
    r = signal.correlate(row - row.mean(), row - row.mean(), method="fft")[row.size - 1 :]
    r = r / r[0] if r[0] > 0 else np.ones(1)
    end = int(np.argmax(np.abs(r) < MOST_CORRELATED)) or r.size
    return max(1.0, 1 + 2 * float(np.sum(r[1 : max(4 * end, 2)] ** 2)))


def mostly_missed(recorded: Recorded, error: Real, at: slice, share: float, predictable: float) -> bool:
    """Whether an error (c, n) is more than a share of a channel, and than so many times what it does not foretell."""
    part = recorded.part[at]
    for row, shown, size in zip(error, recorded.outputs[:, at], level(recorded), strict=True):
        innovation = innovation_rms(row[recorded.fitted], floor_of(recorded))
        for kept in (k for k in (part != UNUSED, part == HELD) if np.any(k)):
            # a decay has faded where it is held out: there it is held against the whole of the recording
            all_of_it = max(float(np.std(shown[kept])), float(size))
            if math.sqrt(float(np.mean(row[kept] ** 2))) > max(share * all_of_it, predictable * innovation):
                return True
    return False


def noise_of(recorded: Recorded, error: Real, at: slice) -> Real:
    """Return (c,) the rms of what cannot be predicted of an error (c, n) at some samples, in the channels' units."""
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    found = np.array([float(Whitening.of(row[None], used, floor_of(recorded)).noise[0]) for row in error])
    return np.asarray(np.maximum(found, LEAST_NOISE * level(recorded)), np.float64)
