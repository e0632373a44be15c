"""Where a free decay ends before its recording does: at a second impact, or whatever else happens at once.

The modes of an earlier part are continued. A decay that changes, or of which more modes show in a longer record, parts
from that continuation little by little; what happens at once parts from it within a few samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.counted_modes import CHANGED, CountedModes, counted_from
from analysis.modal.exponentials import subtracted
from analysis.modal.ring_down_model import Model, Recorded, fitted, without_modes

Real = NDArray[np.float64]

SHORTEST = 96  # samples of a decay between two impacts
SUDDEN = 9.0  # variances of the noise, that the record is off the continuation right where it parts from it
STEPS = 32  # into which the decay is divided, to find that sample
FEWEST = 8  # samples in which it has to show


def ends(samples: int, onset: int) -> list[int]:
    """Samples by which a decay may have been ended, each half as far from the onset as the one before.

    Examples
    --------
    >>> ends(1000, 200)
    [600, 400, 300]
    """
    found = []
    length = (samples - onset) // 2
    while length >= SHORTEST:
        found.append(onset + length)
        length //= 2
    return found


def end_before_an_impact(recorded: Recorded, part: CountedModes) -> int | None:
    """Sample before which a decay has ended because something happened at once; None if nothing did.

    Parameters
    ----------
    recorded
        All that was recorded.
    part
        Modes of an earlier part of it.
    """
    start, n = part.start, recorded.y.shape[1]
    length = part.record.y.shape[1]
    low = start + length
    step = max(FEWEST // 2, length // STEPS)
    high = low
    while high == low:  # as long as the decay continues
        if low >= n:
            return None
        high = min(n, start + 2 * (low - start))
        if _goes_on(recorded, part, low, high):
            low = high
    while high - low > step:
        middle = (low + high) // 2
        if _goes_on(recorded, part, low, middle):
            low = middle
        else:
            high = middle
    model = _fitted(recorded, part, low)
    if model is None:
        return None
    decay = CountedModes(start, recorded.until(low).stretch(start), model)
    beside = max(FEWEST, 2 * step)
    off = _continued(recorded, model, start, low + beside)[:, low - start :]
    variance = model.left / decay.record.samples
    if (off**2 / np.maximum(variance, 1e-300)[:, None]).mean() < SUDDEN:
        return None
    return low - step if _rings_on(recorded, decay, step) else None


def _rings_on(recorded: Recorded, decay: CountedModes, step: int) -> bool:
    """Whether the strongest mode after a decay is one of it: what rings is the same, begun anew."""
    n, end = recorded.y.shape[1], decay.start + decay.record.y.shape[1]
    gap = step
    while end + gap + SHORTEST < n and gap < max(decay.record.y.shape[1], SHORTEST):
        last = min(n, end + gap + max(SHORTEST, decay.record.y.shape[1]))
        later = counted_from(recorded.until(last), end + gap, decay.model, last)
        if later.model.fit is not None:
            j = int(np.argmax(later.worth))
            i = int(np.argmin(np.abs(np.log(decay.model.poles / later.model.poles[j]))))
            off = np.log(later.model.poles[j] / decay.model.poles[i])
            both = later.model.modes.log_pole_covariance[j] + decay.model.modes.log_pole_covariance[i]
            apart = np.array([off.real, off.imag])
            if float(apart @ np.linalg.pinv(both) @ apart) < stats.chi2.isf(CHANGED, 2):
                return True
        gap *= 2
    return False


def _fitted(recorded: Recorded, part: CountedModes, end: int) -> Model | None:
    """The same modes, fitted up to a sample."""
    record = recorded.until(end).stretch(part.start)
    model = fitted(record, part.model.poles, without_modes(record))
    return model if model is not None and model.fit is not None else None


def _continued(recorded: Recorded, model: Model, start: int, end: int) -> Real:
    """What a model leaves of a record (c, end - start) that is longer than what it was fitted to."""
    record = recorded.until(end).stretch(start)
    fit, known = model.modes, recorded.until(start + model.residual.shape[1]).stretch(start).known
    left = subtracted(record.y, fit.amplitudes, fit.poles, fit.fixed_amplitudes, known)
    left[:, record.missing] = 0.0
    return left


def _goes_on(recorded: Recorded, part: CountedModes, low: int, high: int) -> bool:
    """Whether the modes explain what follows a sample as well as what is before it, fitted to both."""
    model = _fitted(recorded, part, high)
    if model is None:
        return False
    before, after = np.split(model.residual**2, [low - part.start], axis=1)
    c = before.shape[0]
    free = c * before.shape[1] - 2 * part.model.poles.size * (c + 1) - c
    variance = np.maximum(part.model.left / part.record.samples, 1e-300)
    ratio = (after.sum(axis=1) / variance).sum() / (c * after.shape[1])
    return bool(ratio < stats.f.isf(CHANGED, c * after.shape[1], max(1, free)))
