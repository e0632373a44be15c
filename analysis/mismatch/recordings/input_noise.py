"""The noise of measured inputs: how much there is, and what the inputs likeliest were beneath it.

A force cell's noise is in what a rig is simulated with and not in what drove it. At frequencies where the force has
nothing else, the best fit would be a rig that does not answer there: constants are biased, and a mechanism that takes
response away seems to explain. Regression calibration, as statistics calls it, simulates with the expectation of the
input given what was measured (Carroll, Ruppert, Stefanski and Crainiceanu, Measurement Error in Nonlinear Models, 2006,
chapter 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from analysis.mismatch.recordings.noise import Whitening, innovation_rms
from analysis.mismatch.recordings.outliers import NORMAL_MEDIAN
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, Recorded, of_the_base
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.arrays import Real, Whole

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

PIECES: Final = 8  # of an input
BANDS: Final = 16  # of its spectrum
QUIET: Final = 4  # one of so many of them is quiet enough to show the input's noise
ALIKE: Final = 2.0  # times the power of the quietest, up to which others are as quiet: of 75 lines it scatters by 16 %
ROUNDING: Final = 1e-9  # of an input's largest value, below which what cannot be predicted is no noise
MULTIPLE: Final = 1e-3  # of a quantum, by which a multiple of it may be off
SELDOM: Final = 0.02  # share of samples with a step, of a staircase
MOST_INPUT_NOISE: Final = 0.05  # of an input's rms, that is taken as noise and not as what drives
# the following were chosen on the sound rigs of decision 174
MOST_TAKEN_OFF: Final = 0.5  # likewise, where the rig does not answer it
SMOOTHED: Final = 25  # lines of a spectrum, over which its power is taken to be even
FORETOLD: Final = 200  # samples before and after an input, that are foretold
AT_ENDS: Final = 12  # first and last samples that stay as they were measured; as many again pass over
PEAK_OF_NOISE: Final = 6.0  # times its rms, that noise does not reach: what does is an edge or a pulse
ABSENT: Final = 0.5  # of what is taken for noise of an input, from which on the rig is taken not to have answered it


def rms_of_inputs(rig: DescribedRig, recorded: Recorded) -> Real:
    """Return (inputs,) the noise (rms) of each measured input, as declared or as it shows it; 0 where unknown."""
    if recorded.measured is None:
        return _shown(rig, recorded, recorded.inputs, [MOST_INPUT_NOISE] * len(rig.drives))
    off = np.any(recorded.measured != recorded.inputs, axis=1)
    return _shown(rig, recorded, recorded.measured, np.where(off, MOST_TAKEN_OFF, MOST_INPUT_NOISE))


def _shown(rig: DescribedRig, recorded: Recorded, measured: Real, most: Sequence[float] | Real) -> Real:
    if recorded.free or recorded.band is not None:
        return np.zeros(len(rig.drives))
    each = zip(measured, rig.drives, most, strict=True)
    return np.array([_quietest(u, limit) if d.noise is None else d.noise for u, d, limit in each], np.float64)


def _quietest(u: Real, most: float) -> float:
    """Return the noise (rms) of a measured input, from when least happens or from where its spectrum is lowest.

    0 where that is more than ``most`` of its rms: an input that is noise itself does not tell how well it was measured.
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
    longer = _foretold(u)
    found = _weighed(longer, _kept(longer, noise))
    off = u - found
    return u if np.abs(off).max() > PEAK_OF_NOISE * np.std(off) else found


def _kept(longer: Real, noise: float) -> Real:
    """Return (lines,) the share of each line of an input's spectrum that is not noise."""
    power = np.abs(np.fft.rfft(longer)) ** 2 / longer.size
    even = uniform_filter1d(power[1:], SMOOTHED, mode="reflect")
    return np.append(1.0, np.where(even > ALIKE * noise**2, 1 - noise**2 / np.maximum(even, 1e-300), 0.0))


def _weighed(longer: Real, weights: Real) -> Real:
    """Return inputs (..., n + 2 FORETOLD) with the lines of their spectra weighed, (..., n); not at the ends."""
    inner = slice(FORETOLD, longer.shape[-1] - FORETOLD)
    found = np.fft.irfft(weights * np.fft.rfft(longer), longer.shape[-1])[..., inner]
    away = np.minimum(np.arange(found.shape[-1]), np.arange(found.shape[-1])[::-1])
    share = np.clip(away / AT_ENDS - 1, 0.0, 1.0)
    return np.asarray(longer[..., inner] + share * (found - longer[..., inner]), np.float64)


def _foretold(u: Real) -> Real:
    """Return an input (n,) with what an autoregression foretells before and after it, faded out.

    A spectrum of what ends in the middle of a motion reaches to all frequencies, and noise hides in it.
    """
    about = u - u.mean()
    taps = Whitening.of(about[None], np.ones(u.size, np.bool_)).taps[0, 0]
    order, weights = taps.size - 1, -taps[:0:-1] / taps[0]  # of the samples before, oldest first
    fade = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, FORETOLD + 1) / (FORETOLD + 1))

    def after(rows: Real) -> Real:
        told = np.concatenate([rows[-order:], np.zeros(FORETOLD)])
        for i in range(order, told.size):
            told[i] = weights @ told[i - order : i]
        return np.asarray(told[order:] * fade, np.float64)

    return np.concatenate([after(about[::-1])[::-1], about, after(about)]) + u.mean()


def with_likeliest_inputs(linear: SimulatedFit) -> tuple[Recorded, ...]:
    """Return the recordings that the linear rig was fitted to with their inputs as they likeliest were.

    Where the rig answers what would be taken off, it was no noise: inputs stay as they were measured.
    """
    return tuple(_with_likeliest(linear, number, r) for number, r in enumerate(linear.problem.recordings))


def _with_likeliest(linear: SimulatedFit, number: int, recorded: Recorded) -> Recorded:
    if recorded.measured is not None:
        if np.any(rms_of_inputs(linear.problem.rig, recorded)):
            return recorded
        return replace(_driven_by(recorded.measured, recorded, linear.problem.rig), measured=None)
    noise = _shown(linear.problem.rig, recorded, recorded.inputs, [MOST_TAKEN_OFF] * len(recorded.inputs))
    if not np.any(noise):
        return recorded
    found = np.array([likeliest(u, rms) for u, rms in zip(recorded.inputs, noise, strict=True)])
    (changed,) = np.nonzero(np.any(found != recorded.inputs, axis=1))
    absent = [i for i, share in zip(changed, _answered(linear, number, found, changed), strict=True) if share < ABSENT]
    inputs = recorded.inputs.copy()
    inputs[absent] = found[absent]
    return _driven_by(inputs, recorded, linear.problem.rig) if absent else recorded


def _driven_by(inputs: Real, recorded: Recorded, rig: DescribedRig) -> Recorded:
    """Return a recording with other inputs, and with these taken off channels that show the base's acceleration too."""
    outputs = recorded.outputs + of_the_base(recorded.inputs - inputs, rig)
    base = None if recorded.base is None else of_the_base(inputs, rig)
    return replace(recorded, inputs=inputs, outputs=outputs, measured=recorded.inputs, base=base)


def _answered(linear: SimulatedFit, number: int, found: Real, changed: Whole) -> Real:
    """Return of each changed input which share of what it was changed by the rig answered."""
    recorded, noise = linear.problem.recordings[number], linear.noise(number)
    off, at = linear.off(number)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    rows = []
    for i in changed:
        inputs = recorded.inputs.copy()
        inputs[i] = found[i]
        other = replace(linear, simulation=linear.simulation.with_inputs(number, inputs))
        shown = of_the_base(inputs - recorded.inputs, linear.problem.rig)[:, at] / recorded.unit[:, None]
        rows.append(noise.white(off - other.off(number)[0] - shown)[:, used].ravel())
    if not rows:
        return np.zeros(0)
    change, left = np.array(rows), noise.white(off)[:, used].ravel()
    # what makes less than the noise tells nothing: then none was answered (a standard error of 1 about that)
    normal = change @ change.T + np.eye(len(rows))
    return np.asarray(-np.linalg.solve(normal, change @ (left - change.sum(axis=0))), np.float64)


def drawn(recorded: Recorded, noise: Real, normal: Real) -> Real:
    """Return (draws, inputs, n) draws of what measured inputs are off by, from as many standard normal numbers."""
    found = normal * noise[:, None]
    if recorded.measured is None:
        return np.asarray(found, np.float64)
    for i, (u, rms) in enumerate(zip(recorded.measured, noise, strict=True)):
        if not np.array_equal(u, recorded.inputs[i]):
            longer = np.pad(found[:, i], ((0, 0), (FORETOLD, FORETOLD)), mode="reflect")
            found[:, i] = _weighed(longer, np.sqrt(_kept(_foretold(u), rms)))
    return np.asarray(found, np.float64)
