"""Modes with uncertainties, from sampled poles.

Convention throughout: for the pole ``s = log(z) / dt`` the frequency is ``abs(s) / 2 pi`` (the undamped natural
frequency) and the damping ratio ``-Re(s) / abs(s)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate

Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ModeEstimate:
    """One mode of one ring-down.

    Attributes
    ----------
    pole
        s in 1/s, positive imaginary part.
    pole_covariance
        (2, 2) covariance of (Re s, Im s), 1/s2.
    amplitude
        (c,) complex amplitude of each channel at the first sample used; the channel holds ``2 Re(amplitude e^(s t))``.
    """

    pole: complex
    pole_covariance: Real
    amplitude: NDArray[np.complex128]

    @property
    def frequency_hz(self) -> Estimate:
        """abs(s) / 2 pi with its standard error, Hz."""
        turn = abs(self.pole) * 2 * math.pi
        return Estimate(abs(self.pole) / (2 * math.pi), self._error(self.pole.real / turn, self.pole.imag / turn))

    @property
    def damping_ratio(self) -> Estimate:
        """-Re s / abs(s) with its standard error."""
        size, a, b = abs(self.pole), self.pole.real, self.pole.imag
        return Estimate(-a / size, self._error(-b * b / size**3, a * b / size**3))

    def _error(self, by_real: float, by_imag: float) -> float:
        (real, both), (_, imag) = self.pole_covariance.tolist()
        return math.sqrt(max(by_real**2 * real + 2 * by_real * by_imag * both + by_imag**2 * imag, 0.0))


def mode_from_sampled_pole(
    z: complex, log_covariance: Real, amplitude: NDArray[np.complex128], sample_rate_hz: float
) -> ModeEstimate:
    """Mode of a sampled pole z whose log has the covariance ``log_covariance`` (2, 2)."""
    return ModeEstimate(complex(np.log(z) * sample_rate_hz), log_covariance * sample_rate_hz**2, amplitude)


def sampled_pole(frequency_hz: float, damping_ratio: float, sample_rate_hz: float) -> complex:
    """``exp(s dt)`` of a mode with this natural frequency and damping ratio (below 1)."""
    omega = 2 * np.pi * frequency_hz
    s = -damping_ratio * omega + 1j * omega * np.sqrt(1 - damping_ratio**2)
    return complex(np.exp(s / sample_rate_hz))
