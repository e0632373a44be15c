"""From codes of the MCC USB-1608FS-Plus to m/s2 and mV, by its calibration and the declared wiring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.drivers.usb1608_protocol import BITS, CHANNELS, NAME, RANGE_CODES
from rig.errors import RigError
from rig.settings import Wiring

CODES = 1 << BITS
MIDDLE = CODES // 2


class Scale:
    """What a code of each wired input means.

    Parameters
    ----------
    wiring
        Inputs in the order A, B, strain gauge, hammer; ranges, sensitivities, gains and polarities.
    """

    def __init__(self, wiring: Wiring) -> None:
        self._units_per_volt = np.array(wiring.units_per_volt())[:, None]
        self._volts_per_code = np.array(wiring.ranges_v())[:, None] / MIDDLE
        self.calibrate([(1.0, 0.0)] * len(wiring.inputs()))

    def calibrate(self, lines: list[tuple[float, float]]) -> None:
        """Take slope and intercept of each input, in codes, from the device's memory."""
        self._slope, self._intercept = (np.array(column)[:, None] for column in zip(*lines, strict=True))

    def units(self, codes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (inputs, n) in m/s2, the strain gauge in mV and the hammer in N, from codes of that shape.

        The correction is that of the device's manual: ``code * slope + intercept``, held within the codes.
        """
        corrected = np.clip(codes * self._slope + self._intercept, 0.0, CODES - 1.0)
        return (corrected - MIDDLE) * self._volts_per_code * self._units_per_volt

    def full_scale_m_s2(self) -> float:
        """Return the acceleration at which the first of A and B reaches an end of its scale, m/s2."""
        inputs = len(self._slope)
        ends = np.abs(self.units(np.tile([0.0, CODES - 1.0], (inputs, 1))))[:2]
        step = np.abs(self._volts_per_code * self._units_per_volt)[:2, 0]
        return float(min(ends[:, 0].min(), (ends[:, 1] + step).min()))  # upwards there is one code less


def check_wiring(wiring: Wiring) -> None:
    """Hold the wiring against what the recorder has.

    Raises
    ------
    RigError
        Names the key, its value and what is possible.
    """
    possible = ", ".join(f"{r:g}" for r in RANGE_CODES)
    for key in ("input_range_v", "strain_gauge_range_v"):
        range_v = getattr(wiring, key)
        if range_v not in RANGE_CODES:
            raise RigError(f"rig.wiring.{key}: the {NAME} has no range of {range_v:g} V; it has {possible}")
    if wiring.hammer is not None and wiring.hammer.range_v not in RANGE_CODES:
        range_v = wiring.hammer.range_v
        raise RigError(f"rig.wiring.hammer.range_v: the {NAME} has no range of {range_v:g} V; it has {possible}")
    if max(wiring.inputs()) >= CHANNELS:
        raise RigError(f"rig.wiring: the {NAME} has no input {max(wiring.inputs())}; its inputs are 0 to 7")
    if wiring.bits != BITS:
        raise RigError(f"rig.wiring.bits: the {NAME} has {BITS} bits, not {wiring.bits}")
