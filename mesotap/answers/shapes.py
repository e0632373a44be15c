"""How the channels of a mode move together, as a table shows it: with signs, or with phases where signs do not do."""

from __future__ import annotations

import cmath
import math

from analysis.results import Mode
from mesotap.answers.rounding import UNKNOWN, significant

REAL = 0.05
"""Root mean square of a shape's imaginary part over that of its size, 1 for the channel that moves most, up to which
signs say enough: an angle of 3 degrees. A tap of 100 noise standard deviations leaves 0.01."""


def shown_shape(mode: Mode, digits: int = 3) -> list[str]:
    """Write the amplitude of each channel with its sign, or with its phase where the channels move in many.

    Parameters
    ----------
    mode
        With its shape; without, sizes alone are known.
    digits
        Of the amplitudes.

    Examples
    --------
    >>> from calibration.estimate import Estimate
    >>> one = Estimate(1.0, 0.1)
    >>> shown_shape(Mode(one, one, (0.4, 1.0), shape=(-0.4, 1.0)))
    ['−0.400', '1.00']
    >>> shown_shape(Mode(one, one, (0.4, 1.0), shape=(-0.4j, 1.0)))
    ['0.400 ∠ −90°', '1.00 ∠ 0°']
    """
    sizes = [abs(amplitude) for amplitude in mode.amplitude]
    if len(mode.shape) != len(sizes) or not all(map(cmath.isfinite, mode.shape)):
        return [significant(size, digits) for size in sizes]
    power = sum(abs(z) ** 2 for z in mode.shape)
    if sum(z.imag**2 for z in mode.shape) <= REAL**2 * power:
        signed = [math.copysign(size, z.real) for size, z in zip(sizes, mode.shape, strict=True)]
        return [significant(value, digits).replace("-", "\N{MINUS SIGN}") for value in signed]
    phases = [round(math.degrees(cmath.phase(z))) for z in mode.shape]
    return [
        f"{significant(size, digits)} ∠ {phase}°".replace("-", "\N{MINUS SIGN}") if math.isfinite(size) else UNKNOWN
        for size, phase in zip(sizes, phases, strict=True)
    ]
