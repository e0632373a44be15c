"""The noise that is left of taps when their modes are taken off: what a few samples ahead of one tap do not tell.

The samples before a single tap show how loud the noise is, but hardly its colour, and the lower mode's interval is too
short by as much as the noise at its frequency is louder than on the whole. A ring-down holds twenty times as many
samples, and its modes take up a handful of numbers of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.modal.noise import NoiseModel, noise_model
from analysis.modal.tester import ImpactModes

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LARGEST_RATIO = 1.5  # of residual to noise variance, above which a tap holds more than its modes and noise


def left_over(record: Real, modes: ImpactModes, known: Complex, sample_rate_hz: float) -> Real | None:
    """What both modes and the recorder's filter leave of a record; None where that is more than noise.

    Parameters
    ----------
    record
        (n,) mean of A and B.
    modes
        From `identify_impacts`.
    known
        Sampled poles of the filter.

    Examples
    --------
    >>> from analysis.modal.tester import ImpactModes
    >>> left_over(np.zeros(9), ImpactModes(None, None, 0, 1.0), np.ones(1, complex), 25e3) is None
    True
    """
    if modes.system is None or modes.contact is None or not modes.residual_ratio < LARGEST_RATIO:
        return None
    y = record[modes.start :]
    s = np.array([modes.system.pole, modes.contact.pole]) / sample_rate_hz
    waves = np.exp(s[:, None] * np.arange(y.size))
    columns = np.concatenate([waves.real, waves.imag, (known[:, None] ** np.arange(y.size)).real]).T
    left: Real = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return left


def noise_with_residuals(
    quiet: Sequence[Real],
    records: Sequence[Real],
    modes: Sequence[ImpactModes],
    known: Complex,
    sample_rate_hz: float,
) -> NoiseModel:
    """Noise of samples before taps and of what the taps' modes leave, together.

    Parameters
    ----------
    quiet
        Records of noise alone.
    records, modes
        (n,) taps, and what was identified in each.
    known
        Sampled poles of the recorder's filter.
    sample_rate_hz
        Samples a second.
    """
    left = [left_over(y, m, known, sample_rate_hz) for y, m in zip(records, modes, strict=True)]
    return noise_model([*quiet, *(rest for rest in left if rest is not None)])
