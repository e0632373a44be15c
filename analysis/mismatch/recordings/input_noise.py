"""The noise of measured inputs: how much there is, and what the inputs likeliest were beneath it.

A force cell's noise is in what a rig is simulated with and not in what drove it. At frequencies where the force has
nothing else, the best fit would be a rig that does not answer there, and a mechanism that takes response away seems to
explain. What a mechanism would do is therefore computed from the expectation of the input given what was measured,
while the residual keeps all of the noise: system identification calls that an instrumental variable.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from analysis.mismatch.recordings.noise import Whitening, innovation_rms
from analysis.mismatch.recordings.outliers import NORMAL_MEDIAN
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.arrays import Real

PIECES: Final = 8  # of an input
BANDS: Final = 16  # of its spectrum
QUIET: Final = 4  # one of so many of them is quiet enough to show the input's noise
ALIKE: Final = 2.0  # times the power of the quietest, up to which others are as quiet: of 75 lines it scatters by 16 %
ROUNDING: Final = 1e-9  # of an input's largest value, below which what cannot be predicted is no noise
MULTIPLE: Final = 1e-3  # of a quantum, by which a multiple of it may be off
SELDOM: Final = 0.02  # share of samples with a step, of a staircase
MOST_INPUT_NOISE: Final = 0.05  # of an input's rms, that is taken as noise and not as what drives
MOST_BEYOND_A_BAND: Final = 0.15  # likewise, of one that has nothing else in half of its spectrum
SMOOTHED: Final = 25  # lines of a spectrum, over which its power is taken to be even
FORETOLD: Final = 200  # samples before and after an input, that are foretold
AT_ENDS: Final = 12  # first and last samples that stay as they were measured; as many again pass over
PEAK_OF_NOISE: Final = 6.0  # times its rms, that noise does not reach: what does is an edge or a pulse


def rms_of_inputs(rig: DescribedRig, recorded: Recorded) -> Real:
    """Return (inputs,) the noise (rms) of each measured input, as declared or as it shows it; 0 where unknown."""
    if recorded.free or recorded.band is not None:
        return np.zeros(len(rig.drives))
    each = zip(recorded.inputs, rig.drives, strict=True)
    return np.array([_quietest(u) if drive.noise is None else drive.noise for u, drive in each], np.float64)


def _quietest(u: Real) -> float:
    """Return the noise (rms) of a measured input, from when least happens or from where its spectrum is lowest.

    0 where that is much: an input that is noise itself does not tell how well it was measured; one in a band does.
    And of one that stands exactly still, most of the time and for no rounding or but for a step now and then: it is
    what was asked for, and its spectrum that of its steps and pulses.
    """
    moved = np.abs(np.diff(u))
    quantum = float(min(moved[moved > 0], default=0.0))
    if np.count_nonzero(moved) < SELDOM * u.size or (not np.median(moved) > 0 and not _rounded(moved, quantum)):
        return 0.0
    window = np.hanning(u.size)
    power = np.abs(np.fft.rfft((u - u.mean()) * window)) ** 2 / np.sum(window**2)
    bands = np.array([float(np.median(band)) for band in np.array_split(power[1:], BANDS)])
    pieces = np.array([innovation_rms(piece - piece.mean()) for piece in np.array_split(u, PIECES)])
    still = float(np.median(moved)) / (NORMAL_MEDIAN * math.sqrt(2)) or quantum / math.sqrt(12)
    found = math.sqrt(_of_the_quiet(bands) / math.log(2)), math.sqrt(_of_the_quiet(pieces**2)), still
    least = min(f for f in found if f > 0)
    in_a_band = np.count_nonzero(bands <= ALIKE * bands.min()) >= BANDS / 2
    most = MOST_BEYOND_A_BAND if in_a_band else MOST_INPUT_NOISE
    return least if ROUNDING * np.abs(u).max() < least < most * np.std(u) else 0.0


def _rounded(moved: Real, quantum: float) -> bool:
    """Whether steps (n,) are multiples of one quantum, as of a converter."""
    counts = moved / quantum
    return bool(np.abs(counts - np.round(counts)).max() < MULTIPLE)


def _of_the_quiet(powers: Real) -> float:
    """Return the mean of the powers that are alike to the lowest ones: of these alone it would be too low."""
    lowest = float(np.sort(powers)[: powers.size // QUIET].mean())
    return float(powers[powers <= ALIKE * lowest].mean())


def likeliest(u: Real, noise: float) -> Real:
    """Return the expectation of an input (n,) given what was measured of it with white noise of this rms.

    By Wiener's filter; what does not stand out of the noise in the spectrum counts as none. The input is as measured
    at its ends, and where what is taken off does not look like noise: beside edges and pulses a filter that is the
    same at all times takes off some of them.

    Examples
    --------
    >>> t = np.arange(2000) / 1000
    >>> force = np.sin(2 * np.pi * 30 * t)
    >>> measured = force + 0.05 * np.random.default_rng(1).standard_normal(2000)
    >>> bool(np.std(likeliest(measured, 0.05) - force) < 0.4 * 0.05)
    True
    """
    if noise <= 0:
        return u
    longer = _foretold(u - u.mean())
    spectrum = np.fft.rfft(longer)
    power = uniform_filter1d(np.abs(spectrum) ** 2 / longer.size, SMOOTHED, mode="reflect")
    share = np.where(power > ALIKE * noise**2, 1 - noise**2 / np.maximum(power, 1e-300), 0.0)
    off = (longer - np.fft.irfft(share * spectrum, longer.size))[FORETOLD:-FORETOLD]
    away = np.minimum(np.arange(u.size), np.arange(u.size)[::-1])
    off *= np.clip(away / AT_ENDS - 1, 0.0, 1.0)
    return u if np.abs(off).max() > PEAK_OF_NOISE * np.std(off) else np.asarray(u - off, np.float64)


def _foretold(u: Real) -> Real:
    """Return an input (n,) about its mean with what an autoregression foretells before and after it, faded out.

    A spectrum of what ends in the middle of a motion reaches to all frequencies, and noise hides in it.
    """
    taps = Whitening.of(u[None], np.ones(u.size, np.bool_)).taps[0, 0]
    order, weights = taps.size - 1, -taps[:0:-1] / taps[0]  # of the samples before, oldest first
    fade = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, FORETOLD + 1) / (FORETOLD + 1))

    def after(rows: Real) -> Real:
        told = np.concatenate([rows[-order:], np.zeros(FORETOLD)])
        for i in range(order, told.size):
            told[i] = weights @ told[i - order : i]
        return np.asarray(told[order:] * fade, np.float64)

    return np.concatenate([after(u[::-1])[::-1], u, after(u)])
