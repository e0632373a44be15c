"""Where a fit of ring-downs is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.modes import Nuisance, Sensitivity
from analysis.mismatch.ring_downs.response import Response
from sim_backend.arrays import Complex, Real

SLIGHT = 0.01  # of a segment's rms, added by terms: standard errors with plain slopes are within 5 % up to there


@dataclass(frozen=True, slots=True)
class Point:
    """Where a fit is.

    Attributes
    ----------
    rig, load, free
        The rig's constants, (groups, k) those of each load, and the terms' parameters as they are fitted.
    coefficients
        Of each segment: of the modes and of what rings by itself.
    segments
        With the time of the tap, and of a second impact.
    modes, to
        At each load; no responses where the rig is linear.
    added
        Of each segment, what the terms add to it, whitened.
    """

    rig: Real
    load: Real
    free: Real
    coefficients: tuple[Real, ...]
    segments: tuple[Segment, ...]
    modes: tuple[Sensitivity, ...] = ()
    to: tuple[Response, ...] = ()
    added: tuple[Real, ...] = ()

    @property
    def amplitudes(self) -> list[Complex]:
        """Modal amplitudes of every segment."""
        return [
            Nuisance.amplitudes(self.modes[s.group], c, s)
            for s, c in zip(self.segments, self.coefficients, strict=True)
        ]

    def timed(self) -> Point:
        """Let the phase of the lowest mode say when each tap was made."""
        segments = tuple(
            replace(s, tap_s=s.start_s - self.modes[s.group].since_tap(a, s))
            for s, a in zip(self.segments, self.amplitudes, strict=True)
        )
        return replace(self, segments=segments)

    @property
    def slight(self) -> bool:
        """Whether what the terms add is slight beside every segment."""
        return all(
            np.vdot(a, a) < SLIGHT**2 * np.vdot(s.y, s.y) for a, s in zip(self.added, self.segments, strict=True)
        )
