"""Where an impact begins in a recording of anything."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

SOON_S = 1e-3  # that an impact has to be louder than what was before it
LOUDER = 50.0  # twice the log-likelihood ratio of a record that is quiet before an onset
SUDDEN = 2.0  # times the energy before it, that an impact has at once
OUTSHINES = 30.0  # times the energy before it: more than what swells
FALLEN = 4.0  # times the energy of its last eighth, in the first eighth of what decays
QUIET = 16  # samples that it has to be quiet


def impact_onset(y: Real, sample_rate_hz: float) -> int | None:
    """Onset of an impact; None where the record begins with the decay, or within the impact.

    Parameters
    ----------
    y
        (c, n) record without its mean.

    Examples
    --------
    >>> import numpy as np
    >>> ringing = np.cos(0.3 * np.arange(2000)) * 0.999 ** np.arange(2000)
    >>> impact_onset(ringing[None], 1e4) is None
    True
    >>> impact_onset(np.append(np.zeros(100), ringing)[None], 1e4)
    100
    """
    n = y.shape[1]
    energy = (y**2 / np.maximum((y**2).mean(axis=1, keepdims=True), 1e-300)).sum(axis=0)
    peak = int(np.argmax(energy))
    at_once = max(QUIET, int(SOON_S * sample_rate_hz))
    onset = _onset(energy[: min(n, peak + 1 + at_once)])
    if onset is None:
        return None
    beside = 2 * at_once
    if energy[onset : onset + beside].mean() < SUDDEN * energy[max(0, onset - beside) : onset].mean():
        return None  # what swells is a beat
    return None if _swells_slowly(y, onset, beside) else onset


def decays_before(y: Real) -> bool:
    """Whether what is recorded ahead of an onset (c, n) is itself a decay, and not noise.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> noise = rng.standard_normal((1, 800))
    >>> decays_before(noise), decays_before(noise + 20 * np.exp(-np.arange(800) / 100))
    (False, True)
    """
    eighth = max(1, y.shape[1] // 8)
    return bool((y[:, :eighth].var(axis=1) > FALLEN * y[:, -eighth:].var(axis=1)).any())


def _swells_slowly(y: Real, onset: int, beside: int) -> bool:
    """Whether something slow is in the samples before an onset, and nothing quick begins there: no impact."""
    energy = (y**2).mean(axis=0)
    if onset < 2 * QUIET or energy[onset : 2 * onset].mean() > OUTSHINES * energy[:onset].mean():
        return False
    quick = np.diff(y, 3, axis=1) ** 2 / 20.0  # of white noise as large as itself; of what is slow next to nothing
    before = quick[:, :onset].mean(axis=1)
    ahead = quick[:, max(0, onset - beside) : onset].mean(axis=1)
    begins = quick[:, onset : onset + beside].mean(axis=1) > SUDDEN * ahead
    return bool((before < y[:, :onset].var(axis=1) / SUDDEN).any() and not begins.any())


def _onset(energy: Real) -> int | None:
    """Sample at which a record that was quiet becomes loud, by the likelihood of two variances; None if it is not."""
    n = energy.size
    if n <= 2 * QUIET:
        return None
    total = np.cumsum(energy)
    k = np.arange(QUIET, n - 2)
    floor = 1e-12 * total[-1] / n
    before = np.maximum(total[k - 1] / k, floor)
    after = np.maximum((total[-1] - total[k - 1]) / (n - k), floor)
    ratio = n * np.log(max(total[-1] / n, floor)) - k * np.log(before) - (n - k) * np.log(after)
    best = int(np.argmax(np.where(after > before, ratio, -np.inf)))
    return int(k[best]) if ratio[best] > LOUDER and after[best] > 2 * before[best] else None
