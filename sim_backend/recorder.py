"""From an acceleration to what the recorder stores: analog band-pass, noise, converter (Sec. 4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from rig.settings import Filter, Wiring
from sim_backend.settings import SimulatedNoise, SimulatedRecorder
from sim_backend.state_space import StateSpace

RANGES_V = (10.0, 5.0, 2.5, 2.0, 1.25, 1.0, 0.625, 0.3125)  # of the recorder that is simulated


def analog_filter(settings: Filter) -> StateSpace:
    """Return the declared Butterworth high-pass followed by the low-pass; family ``none`` has no states.

    First- and second-order sections in a row, each state of the size of the input, which keeps the matrices well
    scaled.
    """
    if settings.family == "none":
        return StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros((1, 0)), np.ones(1))
    sections = [
        *_butterworth(settings.highpass_hz, settings.highpass_order, True),
        *_butterworth(settings.lowpass_hz, settings.lowpass_order, False),
    ]
    whole = sections[0]
    for section in sections[1:]:
        whole = whole.then(section)
    return whole


def _butterworth(corner_hz: float, order: int, highpass: bool) -> list[StateSpace]:
    """Return the sections of a Butterworth filter: poles evenly on the left half circle of radius omega."""
    w = 2 * math.pi * corner_hz
    sections = []
    if order % 2:
        # z' = w (u - z); low-pass z, high-pass u - z
        c, d = (-1.0, 1.0) if highpass else (1.0, 0.0)
        sections.append(StateSpace(np.array([[-w]]), np.array([w]), np.array([[c]]), np.array([d])))
    for k in range(order // 2):
        two_zeta = 2 * math.sin(math.pi * (2 * k + 1) / (2 * order))
        # z1' = w z2, z2' = w (u - z1 - 2 zeta z2); low-pass z1, high-pass z2' / w
        a = np.array([[0.0, w], [-w, -w * two_zeta]])
        c2, d = (np.array([[-1.0, -two_zeta]]), 1.0) if highpass else (np.array([[1.0, 0.0]]), 0.0)
        sections.append(StateSpace(a, np.array([0.0, w]), c2, np.array([d])))
    return sections


@dataclass(frozen=True, slots=True)
class Converter:
    """Analog-to-digital converter of one input, with the errors that its calibration takes out again.

    Attributes
    ----------
    full_scale
        Largest magnitude it holds, V.
    bits
        Codes run from 0 to ``2**bits - 1``, the middle one is 0 V.
    slope, intercept
        Calibration: the code of an ideal converter is ``code * slope + intercept``.
    """

    full_scale: float
    bits: int
    slope: float = 1.0
    intercept: float = 0.0

    def codes(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest code of each voltage (any shape), clipped at the first and last one."""
        half = 2.0 ** (self.bits - 1)
        ideal = volts / (self.full_scale / half) + half
        return np.clip(np.round((ideal - self.intercept) / self.slope), 0.0, 2 * half - 1)

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return voltages (any shape) as they are read: to the nearest code, clipped, corrected by the calibration."""
        return self._corrected(self.codes(volts))

    def reach(self) -> float:
        """Return the voltage at which the nearer end of the scale is reached, V."""
        half = 2.0 ** (self.bits - 1)
        low, high = np.abs(self._corrected(np.array([0.0, 2 * half - 1])))
        return float(min(low, high + self.full_scale / half))  # upwards there is one code less

    def _corrected(self, codes: NDArray[np.float64]) -> NDArray[np.float64]:
        half = 2.0 ** (self.bits - 1)
        corrected = np.clip(codes * self.slope + self.intercept, 0.0, 2 * half - 1)
        return (corrected - half) * (self.full_scale / half)


CHANNELS = 8


def calibration_table(settings: SimulatedRecorder, seed: int, ranges: int = 8) -> NDArray[np.float32]:
    """Return slope and intercept (last axis) of each input at each range, (ranges, 8, 2), as the device keeps them.

    Without errors in the settings every converter is ideal.
    """
    rng = np.random.default_rng([seed, 6])
    table = np.empty((ranges, CHANNELS, 2), dtype=np.float32)
    table[..., 0] = 1 + settings.gain_error_percent / 100 * rng.uniform(-1, 1, (ranges, CHANNELS))
    table[..., 1] = settings.offset_error_codes * rng.uniform(-1, 1, (ranges, CHANNELS))
    return table


def converters(wiring: Wiring, settings: SimulatedRecorder, seed: int) -> list[Converter]:
    """Return the converter behind each wired input: A, B, and the strain gauge if the recorder samples it."""
    table = calibration_table(settings, seed, len(RANGES_V))
    found = []
    for channel, range_v in zip(wiring.inputs(), wiring.ranges_v(), strict=True):
        # a range that no table is kept for has the first one's errors
        place = RANGES_V.index(range_v) if range_v in RANGES_V else 0
        slope, intercept = map(float, table[place, channel % CHANNELS])
        found.append(Converter(range_v, wiring.bits, slope, intercept))
    return found


class Noise:
    """White noise and first-order low-pass noise of several channels, drawn in blocks without a seam.

    The total rms is that of the settings; ``coloured_share`` is the low-pass part of the power. The low-pass part is
    the low-passed process sampled exactly: x[n+1] = r x[n] + sqrt(1 - r^2) sigma e, r = exp(-2 pi corner / rate),
    begun in its stationary state.
    """

    def __init__(self, settings: SimulatedNoise, channels: int, sample_rate_hz: float, rng: np.random.Generator):
        self._rng = rng
        self._white = settings.rms_m_s2 * math.sqrt(1 - settings.coloured_share)
        self._lowpass = settings.rms_m_s2 * math.sqrt(settings.coloured_share)
        self._pole = math.exp(-2 * math.pi * settings.corner_hz / sample_rate_hz)
        self._last = self._lowpass * rng.standard_normal((channels, 1))

    def draw(self, samples: int) -> NDArray[np.float64]:
        """Return the next (channels, samples)."""
        shape = (len(self._last), samples)
        innovation = self._lowpass * math.sqrt(1 - self._pole**2) * self._rng.standard_normal(shape)
        lowpass, self._last = lfilter([1.0], [1.0, -self._pole], innovation, zi=self._pole * self._last)
        self._last = lowpass[:, -1:]
        return lowpass + self._white * self._rng.standard_normal(shape)
