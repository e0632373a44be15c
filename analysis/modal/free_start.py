"""Where the free decay of any recording begins: at its first sample, or where the impact in it has ended.

What may be the pulse is not fitted: the modes are found from a sample on that is late enough for the fit to be
continued backwards, and begin where that continuation and the record part. If they part at once, the pulse was not
over, and a later sample is tried.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.model_order import MOST, modes_of
from analysis.modal.pulse_end import innovations, samples_before
from analysis.modal.ring_down_model import Model, Record, fitted, without_modes

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SOON_S = 1e-3  # after the largest sample: where the free decay is first looked for
RUNGS = 4  # later samples that are tried, each twice as far from the onset
BACK = 0.15  # share of the way to the onset that a fit has to reach backwards
LOUDER = 50.0  # twice the log-likelihood ratio of a record that is quiet before an onset
SUDDEN = 2.0  # times the energy before it, that an impact has at once
QUIET = 16  # samples that it has to be quiet
LEAST = 64  # samples of free decay


def decay_start(y: Real, sample_rate_hz: float) -> tuple[int, int] | None:
    """Onset of an impact, and a sample by which its pulse may be over; None where the record begins with the decay.

    Parameters
    ----------
    y
        (c, n) record without its mean.

    Examples
    --------
    >>> import numpy as np
    >>> ringing = np.cos(0.3 * np.arange(2000)) * 0.999 ** np.arange(2000)
    >>> decay_start(ringing[None], 1e4) is None
    True
    >>> decay_start(np.append(np.zeros(100), ringing)[None], 1e4)
    (100, 110)
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
    later = max(peak, onset) + max(2, int(SOON_S * sample_rate_hz))
    return onset, min(later, max(0, n - LEAST))


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


def from_the_impact_on(
    y: Real, onset: int, soon: int, clipped: NDArray[np.int64], sample_rate_hz: float, longest: int
) -> tuple[int, Model, list[str]]:
    """Modes of the free decay after an impact, from the sample on at which its pulse has ended.

    Parameters
    ----------
    y
        (c, n) record.
    onset, soon
        From `decay_start`.
    clipped
        Samples that say nothing.
    sample_rate_hz
        Samples a second.
    longest
        Samples by which the modes are counted.

    Returns
    -------
    start, model, notes
        First sample used, the modes from there on, and sentences for the reader.
    """
    n = y.shape[1]
    tried: list[tuple[int, Model]] = []
    for rung in range(RUNGS):
        safe = onset + (soon - onset) * 2**rung
        if safe > n - LEAST:
            break
        model = modes_of(_stretch(y, safe, clipped, longest))
        if model.fit is None:
            break
        tried.append((safe, model))
        if model.poles.size >= MOST:
            break  # no sum of a few exponentials: it would not be continued from anywhere
        back = _reach(y, onset, safe, model, clipped)
        if back >= BACK * (safe - onset):
            start = safe - back
            begun = _stretch(y, start, clipped, longest)
            again = fitted(begun, model.poles, without_modes(begun))
            if again is not None:
                told = [] if rung == 0 else [_longer(soon - onset, start - onset, sample_rate_hz)]
                return start, again, told
    if not tried:
        start = soon
        return start, without_modes(_stretch(y, start, clipped, longest)), []
    start, model = tried[0]
    return start, model, ["where the impact ends does not show: the decay is used from where it should be over"]


def _longer(soon: int, start: int, sample_rate_hz: float) -> str:
    late, used = (1e3 * k / sample_rate_hz for k in (soon, start))
    return f"the impact lasts longer than {late:.2g} ms: the decay is used from {used:.2g} ms after its onset"


def _stretch(y: Real, first: int, clipped: NDArray[np.int64], longest: int) -> Record:
    last = min(y.shape[1], first + longest)
    missing = clipped[(clipped >= first) & (clipped < last)] - first
    stretch = y[:, first:last].copy()
    stretch[:, missing] = 0.0
    return Record(stretch, missing=missing)


def _reach(y: Real, onset: int, safe: int, model: Model, clipped: NDArray[np.int64]) -> int:
    """How many samples a fit can be continued backwards: judged on the strongest common motion of the channels."""
    scaled = y / np.sqrt(np.maximum(model.modes.noise_variance, 1e-300))[:, None]
    direction = np.linalg.eigh(scaled[:, safe:] @ scaled[:, safe:].T)[1][:, -1]
    one = direction @ scaled
    known = np.ones(1, np.complex128)

    later = clipped[clipped >= safe]
    try:
        fit = fit_exponentials(one[safe:][None], model.poles, known, missing=later - safe)
    except (FitFailure, np.linalg.LinAlgError):
        return 0
    before = clipped[(clipped < safe) & (clipped >= onset)]
    trigger = int(before.max()) if before.size else onset
    scores = innovations(one, trigger, safe, fit, known, 1.0, later)
    return samples_before([scores], safe - trigger)[0]
