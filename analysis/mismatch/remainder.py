"""What a model leaves over: where it lies, and how that is said."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.answer import Location

Real = NDArray[np.float64]

NARROW = 0.15  # of its middle frequency: a band narrower than this is reported by its centre frequency
MOST = 0.9  # of the excess power, by which it is located
SEEN = 0.5  # chi-squared below which it is written as 0
SURE = 1e-12  # p-values below are not worth their digits
LARGE = 1e6  # chi-squared from which on it is written with three digits and a power of ten
LEAST_PERCENT = 0.01  # below which a share is worth no digits
SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def spread_of(edges: Real, power: Real, sure: NDArray[np.bool_]) -> tuple[float, float]:
    """Return between which edges most of the power beyond noise lies.

    Parameters
    ----------
    edges
        (n + 1,) of the bins.
    power, sure
        (channels, n) power over that of the noise, and where it is certainly more; without any such bin all count.
    """
    beyond = np.maximum(power - 1, 0.0)
    excess = np.where(sure, beyond, 0.0).sum(axis=0) if np.any(sure) else beyond.sum(axis=0)
    if not excess.sum() > 0:
        return float(edges[0]), float(edges[-1])
    grown = np.cumsum(excess) / excess.sum()
    low, high = np.searchsorted(grown, [(1 - MOST) / 2, (1 + MOST) / 2])
    return float(edges[low]), float(edges[min(high, excess.size - 1) + 1])


def frequency_words(band_hz: tuple[float, float]) -> str:
    """Say where a band lies, such as ``at 4.1 kHz`` or ``from 3.3 to 4.1 kHz``."""
    low, high = band_hz
    scale, unit = (1e-3, "kHz") if high >= 1000 else (1.0, "Hz")
    middle = (low + high) / 2
    if high - low <= NARROW * middle:
        return f"at {scale * middle:.3g} {unit}"
    return f"from {scale * low:.3g} to {scale * high:.3g} {unit}"


def p_words(p_value: float) -> str:
    """Write a p-value; one that is certainty anyway without its digits."""
    return f"p = {p_value:.2g}" if p_value > SURE else f"p < {SURE:g}"


def count_words(value: float) -> str:
    """Write a chi-squared, or what else is counted; a large one with three digits.

    Examples
    --------
    >>> count_words(2606.7), count_words(14050730806.0)
    ('2607', '1.41 × 10¹⁰')
    """
    if not LARGE <= abs(value) < np.inf:
        return f"{value:.0f}"
    digits, power = f"{value:.2e}".split("e+")
    return f"{digits} × 10{str(int(power)).translate(SUPERSCRIPTS)}"


def place_words(where: Location) -> str:
    """Say where something lies, such as ``in the lower mass at 4.1 kHz``."""
    return f"in the {_acting(where)} {frequency_words(where.frequency_hz)}"


def _acting(where: Location) -> str:
    element = f" ({where.element})" if where.element not in (None, where.component) else ""
    return f"{where.component}{element}"


def remainder_statement(
    linear: str, share: float, chi_squared: float, p_value: float, where: Location | None, held_out: str = ""
) -> str:
    """Say what is left over; ``linear`` is how the linear rig is called, ``held_out`` what is said of its errors there.

    Examples
    --------
    >>> remainder_statement("Eq. 9", 0.0, 0.0, 0.4, None)
    'Nothing beyond noise is left (p = 0.4).'
    """
    if where is None:
        return f"Nothing beyond noise is left ({p_words(p_value)}).{held_out}"
    beyond = f"Something is left beyond noise ({p_words(p_value)})"
    if chi_squared < SEEN:
        return (
            f"{beyond} {frequency_words(where.frequency_hz)}. No force or channel of any shape would take it away; of "
            f"what was tried, what fits it best acts in the {_acting(where)}.{held_out}"
        )
    percent = 100 * share
    part = f"{float(f'{percent:.2g}'):g} %" if percent >= LEAST_PERCENT else f"less than {LEAST_PERCENT:g} %"
    return (
        f"{beyond}, {part} of what {linear} misses: forces or channels of any shape would take away a chi-squared of "
        f"{count_words(chi_squared)} beyond chance; it lies {place_words(where)}.{held_out}"
    )
