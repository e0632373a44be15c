"""What a tap leaves behind: the record type, and the exact ring-down of the linear tester."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend.pulses import Pulse
from sim_backend.state_space import StateSpace, exact_response
from sim_backend.two_mass import UPPER, TwoMass


@dataclass(frozen=True, slots=True)
class RingDown:
    """Response to a tap at the times n / sample_rate_hz, without noise; every array has shape (samples,).

    Attributes
    ----------
    sample_rate_hz
        Sampling rate, Hz.
    acceleration
        Acceleration of the lower mass after the analog filter, m/s2; both accelerometers see it.
    lower_displacement
        x2 about static equilibrium, m.
    contact_force
        Dynamic contact force, N: the total is this plus the preload.
    approach, approach_rate
        x1 - x2, m, and its rate, m/s.
    """

    sample_rate_hz: float
    acceleration: NDArray[np.float64]
    lower_displacement: NDArray[np.float64]
    contact_force: NDArray[np.float64]
    approach: NDArray[np.float64]
    approach_rate: NDArray[np.float64]


def ring_down_linear(
    tester: TwoMass,
    pulse: Pulse,
    onset_s: float,
    samples: int,
    sample_rate_hz: float,
    analog: StateSpace | None = None,
    struck: int = UPPER,
) -> RingDown:
    """Return the exact response of Eq. 9 to a pulse on one mass, from rest.

    Parameters
    ----------
    tester
        Eq. 9 with its contact.
    pulse
        Force on the mass that is struck, N; any pulse of `sim_backend.pulses`.
    onset_s
        Onset after sample 0, s, anywhere between samples.
    samples, sample_rate_hz
        Length, and sampling rate in Hz.
    analog
        Filter between accelerometer and converter; None for none.
    struck
        Which mass.
    """
    system = tester.state_space(struck)
    if analog is not None:
        system = system.then(analog)
    return RingDown(sample_rate_hz, *exact_response(system, pulse, onset_s, samples, sample_rate_hz))
