"""Units as other programs write them: of times, and of accelerations."""

from __future__ import annotations

import re
from pathlib import Path

from daq.errors import RecordingError
from rig.settings import STANDARD_GRAVITY

_SECONDS = {
    unit: seconds
    for seconds, units in (
        (1.0, "s sec secs second seconds sek sekunde sekunden"),
        (1e-3, "ms msec msecs millis millisec millisecond milliseconds"),
        (1e-6, "us µs usec µsec usecs micros microsec microsecond microseconds"),
        (1e-9, "ns nsec nsecs nanos nanosec nanosecond nanoseconds"),
        (60.0, "min mins minute minutes"),
        (3600.0, "h hr hrs hour hours"),
    )
    for unit in units.split()
}
"""Seconds in a unit of time, by its name in small letters; the Greek mu has become the micro sign."""

_TIME_NAME = re.compile(r"(t|time|times|zeit|timestamps?|time[ _]stamps?|elapsed|elapsed[ _]time)", re.IGNORECASE)
_TIME_AND_MORE = re.compile(r"(t[ _]|(?:time|zeit|elapsed[ _]time)[ _]?)([a-zµμ]+)", re.IGNORECASE)
_TIME_WORDS = ("vec", "vector", "axis", "data", "array")
_SHORTEST_TIME_WORD = 3
"""Letters from which the name of a unit of time, alone, is the name of a column of times: "sec", and not "s" or "h"."""

_METRES = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048}
_PER_SECOND_SQUARED = ("/s2", "/s/s", "s-2", "/(s2)", "/(s*s)")
_GRAVITIES = {"g": 1.0, "G": 1.0, "gn": 1.0, "g_n": 1.0, "g0": 1.0, "mg": 1e-3, "mG": 1e-3, "milli-g": 1e-3, "ug": 1e-6}
_OTHERS = re.compile(
    r"[kmMuµn]?(v|volts?|n|newtons?|a|amp|pa|c|w|ohm|hz|m|m/s|um/s|strain|g/v|mv/g|v/g)|p[cC]|lbf|bar|psi|inch|in|mils?"
    r"|in/s|ft/s|rad|deg|°|%|°?c|k|counts?|cts|lsb|bits?|db|kg|kgf",
    re.IGNORECASE,
)
"""Units that are certainly of no acceleration."""


_SYMBOL = (
    r"(?:[YZEPTGMkhdcmuµnpfa]|da)?(?:m|g|s|N|A|V|Pa|Hz|J|W|C|F|T|K|rad|L|eV|B|ohm|Ω|bar|strain|eps|g_?[n0])"
    r"|deg|°C?|h|min|in|inch|ft|mil|lb|lbf|kgf|psi|dB|rpm|counts?|cts|lsb|LSB|FS|volts?|newtons?|ppm|%|1|-"
)
_KNOWN = re.compile(rf"(?:{_SYMBOL})(?:(?:\^|\*\*)?[-−⁻]?[\d²³⁴]+)?", re.IGNORECASE)
_JOINED = re.compile(r"[\s*·⋅./()]+")


def is_known_unit(unit: str) -> bool:
    """Return whether a unit is one, or a product or ratio of such, that people of this field write; empty is, too.

    Examples
    --------
    >>> is_known_unit("m/s2"), is_known_unit("mV/(m/s^2)"), is_known_unit("counts"), is_known_unit("furlongs")
    (True, True, True, False)
    """
    words = [w for w in _JOINED.split(_plain(unit).replace("**", "^")) if w]
    return all(_KNOWN.fullmatch(word) or is_time_unit(word) for word in words)


def kind_of_motion(unit: str) -> str:
    """Return ``displacement``, ``velocity`` or ``acceleration`` where a unit is certainly of it; else nothing.

    Examples
    --------
    >>> kind_of_motion("um"), kind_of_motion("mm/s"), kind_of_motion("g"), kind_of_motion("V")
    ('displacement', 'velocity', 'acceleration', '')
    """
    if to_si(unit)[0] == "m/s2":
        return "acceleration"
    text = _plain(unit).replace(" ", "")
    if text in _METRES or text in ("nm", "inch"):
        return "displacement"
    return "velocity" if text.removesuffix("/s") != text and text.removesuffix("/s") in (*_METRES, "nm") else ""


def _plain(unit: str) -> str:
    return unit.strip().rstrip(".").replace("μ", "µ")


def is_time_unit(unit: str) -> bool:
    """Return whether this is a unit of time."""
    return _plain(unit).lower() in _SECONDS


def is_time_name(name: str) -> bool:
    """Return whether a column of this name holds times."""
    return _of_time(name) is not None


def _of_time(name: str) -> str | None:
    """Return the unit that the name of a column of times ends in, empty if none; None for other columns."""
    text = _plain(name)
    if _TIME_NAME.fullmatch(text):
        return ""
    if len(text) >= _SHORTEST_TIME_WORD and text.lower() in _SECONDS:
        return text
    match = _TIME_AND_MORE.fullmatch(text)
    if match is None:
        return None
    if match[2].lower() in _TIME_WORDS:
        return ""
    return match[2] if match[2].lower() in _SECONDS else None


def time_scale(path: Path, name: str, unit: str) -> float:
    """Return seconds per unit of a column of times, by its unit or the ending of its name; without either they are s.

    Raises
    ------
    RecordingError
        The unit is not known.
    """
    said = _plain(unit) or _of_time(name) or "s"
    seconds = _SECONDS.get(said.lower())
    if seconds is None:
        raise RecordingError(
            f"{path}: the unit {said!r:.40} of the times in {name or 'the first column':.40} is not known: "
            "give them in s, ms, us, ns, min or h"
        )
    return seconds


def to_si(unit: str) -> tuple[str, float]:
    """Return the unit as this program writes it, and the factor that takes samples there; others stay as they are."""
    text = unit.strip()
    if text in _GRAVITIES:
        return "m/s2", _GRAVITIES[text] * STANDARD_GRAVITY
    bare = text.lower().replace("μ", "µ").replace("⁻²", "-2").replace("²", "2").replace("sec", "s")
    bare = re.sub(r"\*\*|[\s^·]|\*(?=s-)", "", bare)
    for ending in _PER_SECOND_SQUARED:
        length = bare.removesuffix(ending)
        if length != bare and length in _METRES:
            return "m/s2", _METRES[length]
    return text, 1.0


_FORCES = {
    unit: newtons
    for newtons, units in (
        (1.0, "n newton newtons"),
        (1e-3, "mn millinewton millinewtons"),
        (1e3, "kn kilonewton kilonewtons"),
        (4.4482216152605, "lbf lb-f lbs lb pound-force"),
        (STANDARD_GRAVITY, "kgf kp"),
    )
    for unit in units.split()
}
"""Newtons in a unit of force, by its name in small letters; a meganewton no recording of a tap holds."""


def newtons(unit: str) -> float | None:
    """Return newtons in a unit of force, None where it is none."""
    return _FORCES.get(_plain(unit).lower())


def is_gravity(unit: str) -> bool:
    """Return whether a unit is the acceleration of gravity or a part of it."""
    return unit.strip() in _GRAVITIES


def is_no_acceleration(unit: str) -> bool:
    """Return whether a unit is known to be of something else than acceleration, such as V."""
    return to_si(unit)[0] != "m/s2" and (is_time_unit(unit) or _OTHERS.fullmatch(_plain(unit)) is not None)
