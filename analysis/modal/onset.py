"""From where on a tap may be used: where it begins, whatever the trigger says, and where the recorder last clipped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.modal.noise import NoiseModel

Real = NDArray[np.float64]

LOUD = 7.0  # standard deviations of the noise, whitened, that none of its samples reaches
LOUD_SHARE = 0.05  # of the loudest sample, whitened: noise that swells ahead of a tap is not its beginning, and a tap
# passes this share within a tenth of its pulse (benchmarks/choosing_hits.py)
WRONG_S = 0.4e-3  # between trigger and first loud sample, from which the trigger is not believed


@dataclass(frozen=True, slots=True)
class Onset:
    """First sample of a record that may belong to its tap and is not clipped, with sentences for the reader."""

    usable: int
    notes: tuple[str, ...] = ()


def onset_of(
    record: Real, pretrigger: int, clipped: NDArray[np.int64], sample_rate_hz: float, noise: NoiseModel
) -> Onset:
    """Return from where on a tap may be used.

    Parameters
    ----------
    record
        (n,) acceleration of one tap, m/s2.
    pretrigger
        Samples before the trigger, as the file has it.
    clipped
        Samples at the end of the recorder's range.
    sample_rate_hz
        Samples a second.
    noise
        Of the record.

    Examples
    --------
    >>> import numpy as np
    >>> tap = np.append(np.zeros(250), np.cos(0.3 * np.arange(1000)))
    >>> onset_of(tap, 275, np.zeros(0, int), 25e3, NoiseModel(np.ones(1), 1e-6)).usable
    250
    """
    y = np.asarray(record, np.float64)
    notes: list[str] = []
    first = pretrigger
    if noise.variance > 0:
        size = np.abs(noise.whiten(y - y.mean()))
        level = max(LOUD * float(np.sqrt(noise.variance)), LOUD_SHARE * float(size.max(initial=0.0)))
        loud = np.flatnonzero(size > level) + noise.order
        if loud.size and abs(loud[0] - pretrigger) > WRONG_S * sample_rate_hz:
            first = int(loud[0])
            apart = 1e3 * (first - pretrigger) / sample_rate_hz
            notes.append(f"the tap begins {apart:+.2g} ms from where its trigger is said to be")
    if clipped.size:
        notes.append(f"{clipped.size} samples are clipped: the decay is used from after them")
        first = max(first, int(clipped[-1]) + 1 + noise.order)
    return Onset(first, tuple(notes))
