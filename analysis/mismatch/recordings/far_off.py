"""Whether a rig as described is far from the one that was recorded."""

from __future__ import annotations

import math

import numpy as np

from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.recorded import HELD, UNUSED, level
from analysis.mismatch.recordings.signatures import innovation_rms


def far_off(fitted: SimulatedFit) -> bool:
    """Return whether a channel's error is most of what it shows, and predictable from the error itself."""
    policy = fitted.problem.policy
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.off(number, whole=True)
        part = recorded.part[at]
        moved = recorded.outputs[:, at] / level(recorded)[:, None]
        for row, shown in zip(off, moved, strict=True):
            innovation = innovation_rms(row[recorded.fitted])
            for kept in (part != UNUSED, part == HELD):
                error = math.sqrt(float(np.mean(row[kept] ** 2))) if np.any(kept) else 0.0
                # a decay has faded where it is held out: there it is held against the whole of the recording
                all_of_it = max(float(np.std(shown[kept])), 1.0) if np.any(kept) else 1.0
                if error > policy.missed * all_of_it and error > policy.predictable * innovation:
                    return True
    return False
