"""What thinning out a recording makes of an impact in it: it is spread over some samples before and after."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import expm

from analysis.mismatch.recordings.channels import shown_by
from analysis.mismatch.recordings.motion import Motion, backwards
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.recordings.thinning import RINGING, kernel
from analysis.mismatch.rig_description import Seen
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real


def spread_of_impact(
    seen: Sequence[Seen],
    arrangement: Arrangement,
    constants: Mapping[str, float],
    impact: tuple[float, Real],
    recorded: Recorded,
    at: slice,
) -> Real:
    """Return (c, n) what thinning out adds to what channels show of an impact, at some samples of a recording.

    Before it they show some of it, and after it not all. What an accelerometer shows while it lasts is not in it.

    Parameters
    ----------
    impact
        When, s after the first sample, and the state (2n,) right after it of what it alone does to the linear rig.
    """
    factor, (seconds, start) = recorded.every, impact
    when = seconds * recorded.rate_hz
    first, count = math.floor(when) - RINGING, 2 * RINGING + 1
    # on the samples as they were taken, from the earliest to the latest that the filter weighs
    fine = np.arange((first - RINGING) * factor, (first + count - 1 + RINGING) * factor + 1)
    after = fine >= when * factor
    step = 1 / (recorded.rate_hz * factor)
    slope = -backwards(*arrangement.matrices(constants))
    states = _followed(slope, start, (fine[after][0] - when * factor) * step, step, int(after.sum()))
    states = np.concatenate([states, np.zeros((1, start.size))])  # at rest, to take the offsets away
    n, elements = start.size // 2, len(arrangement.elements)
    free = Motion(states, np.zeros((len(states), elements)), np.zeros((len(states), n)))
    moved = shown_by(seen, arrangement, constants, free)
    shown = np.zeros((len(seen), fine.size))
    shown[:, after] = moved[:, :-1] - moved[:, -1:]
    weighed = np.lib.stride_tricks.sliding_window_view(shown, 2 * RINGING * factor + 1, axis=1)[:, ::factor]
    place, out = np.arange(first, first + count) - at.start, np.zeros((len(seen), at.stop - at.start))
    kept = (place >= 0) & (place < out.shape[1])
    out[:, place[kept]] = (weighed @ kernel(factor) - weighed[:, :, RINGING * factor])[:, kept]
    return out


def _followed(slope: Real, start: Real, before: float, step: float, count: int) -> Real:
    """Return (count, 2n) states of a linear rig, the first so long after its start and then step by step."""
    states, power = (expm(slope * before) @ start)[None], expm(slope * step)
    while len(states) < count:
        states, power = np.concatenate([states, states @ power.T]), power @ power
    return np.asarray(states[:count], np.float64)
