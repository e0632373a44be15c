"""Numbers as a journal prints them: rounded to what their uncertainty leaves."""

from __future__ import annotations

import math
import re

from calibration.estimate import Estimate

UNKNOWN = "–"
LARGEST_PLAIN = 1e7  # beyond, and below the smallest, powers of ten are split off
SMALLEST_PLAIN = 1e-3
MOST_DIGITS = 10
EXACT = 1e-12  # an interval this much smaller than its value is only rounding error
OPEN = 1e3  # times the value above it, and below it: an end so far away is none
LOOSE = 10.0  # times the value: a lower end that is none is not written where the upper one is that far away, too
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def with_uncertainty(estimate: Estimate | None, scale: float = 1.0) -> str:
    """Write an estimate as value ± half of its 95 % interval.

    Parameters
    ----------
    estimate
        The number, or None where there is none.
    scale
        What value and interval are multiplied by, such as 1e-6 from N/m to MN/m.

    Returns
    -------
    str
        The interval with two significant digits and the value with as many decimals, such as
        ``"7.031 ± 0.012"``; a dash where there is no number.

    Examples
    --------
    >>> with_uncertainty(Estimate(7.0312e6, 6.2e3), 1e-6)
    '7.031 ± 0.012'
    """
    if estimate is None or not math.isfinite(estimate.value * scale):
        return UNKNOWN
    value, half_width = estimate.value * scale, abs(estimate.half_width * scale)
    if not math.isfinite(half_width):
        return f"{value:z.4g} (interval unknown)"
    if half_width <= EXACT * abs(value):
        return f"{value:z.10g}"
    size = max(abs(value), half_width)
    if SMALLEST_PLAIN <= size < LARGEST_PLAIN:
        return _plain(value, half_width)
    power = math.floor(math.log10(size))
    shift = 10.0 ** (-power)
    return f"({_plain(value * shift, half_width * shift)}) × 10{str(power).translate(SUPERSCRIPTS)}"


def significant(value: float | None, digits: int = 3) -> str:
    """Write a number without a stated uncertainty; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    rounded = float(f"{value:.{digits - 1}e}")
    if rounded and not SMALLEST_PLAIN <= abs(rounded) < LARGEST_PLAIN:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa} × 10{str(int(power)).translate(SUPERSCRIPTS)}"
    decimals = digits - 1 - (math.floor(math.log10(abs(rounded))) if rounded else 0)
    return f"{rounded:z.{max(decimals, 0)}f}"


def between(value: float, low: float, high: float, digits: int = 4) -> tuple[str, str, str]:
    """Write a number and the ends of its interval with as many decimals, so that two digits of its width are seen.

    Parameters
    ----------
    digits
        Significant digits of each at least; there are `MOST_DIGITS` at most.

    Examples
    --------
    >>> between(1.0000872, 0.99998, 1.00019)
    ('1.00009', '0.99998', '1.00019')
    >>> between(0.2, 0.1, 0.4)
    ('0.2000', '0.1000', '0.4000')
    """
    width = high - low
    seen = math.isfinite(width) and width > EXACT * abs(value)
    last = math.floor(math.log10(width)) - 1 if seen else 0  # power of ten of the last digit

    def written(number: float) -> str:
        if not (seen and math.isfinite(number) and number):
            return significant(number, digits)
        needed = math.floor(math.log10(abs(number))) - last + 1
        return significant(number, max(digits, min(needed, MOST_DIGITS)))

    return written(value), written(low), written(high)


def with_ends(value: float, low: float, high: float) -> str:
    """Write a number with its interval in brackets; see `between`. An end that is no end is not written.

    Examples
    --------
    >>> with_ends(1.0000872, 0.99998, 1.00019)
    '1.00009 (0.99998 to 1.00019)'
    >>> with_ends(0.001, 1e-20, 0.04), with_ends(0.001, 2e-21, 1.3e11)
    ('0.001000 (at most 0.0400)', '0.001000 (not determined by these data)')
    """
    written, lower, upper = between(value, low, high)
    below, above = 0 <= low < value / OPEN, high > OPEN * value > 0
    if below and above:
        return f"{written} (not determined by these data)"
    if below and high > LOOSE * value:
        return f"{written} (at most {significant(high)})"
    return f"{written} ({lower} to {upper})"


def _plain(value: float, half_width: float) -> str:
    mantissa, _, power = f"{half_width:.1e}".partition("e")
    decimals = 1 - int(power)
    uncertainty = float(f"{mantissa}e{power}")
    if decimals < 0:
        return f"{round(value, decimals):z.0f} ± {uncertainty:.0f}"
    return f"{value:z.{decimals}f} ± {uncertainty:.{decimals}f}"


def unit(text: str) -> str:
    """Write a unit as pages and terminal do; nothing for a plain number.

    Examples
    --------
    >>> unit("m/s2"), unit("N/m3"), unit("m/N s2"), unit("1")
    ('m/s²', 'N/m³', 'm/(N s²)', '')
    """
    if text == "1":
        return ""
    raised = re.sub(r"(?<=[A-Za-z])\d", lambda found: found[0].translate(SUPERSCRIPTS), text)
    over, _, under = raised.partition("/")
    return f"{over}/({under})" if " " in under else raised


def counted(number: int, what: str) -> str:
    """Return how many of something there are, in words that fit one of them too.

    Examples
    --------
    >>> counted(1, "session"), counted(2, "session")
    ('1 session', '2 sessions')
    """
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
