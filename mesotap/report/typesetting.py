"""Sentences that a terminal shows too, as a page sets them: powers of ten, symbols, units, minus signs."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

from mesotap.answers.rounding import SUPERSCRIPTS, unit

__all__ = ["parameter", "prose", "unit"]

NO_BREAK = "\N{NO-BREAK SPACE}"
POWER = re.compile(r"(?<![\w.])(?<!/ )(\d+(?:\.\d+)?)e([+-]?\d+)(?![\w.]*\w)")
"""Not in a formula, which is to be copied."""
MINUS = re.compile(r"(?<=[\s(])-(?=\d)|^-(?=\d)")
RAISED = re.compile(r"(?<![\w/])(kg/m|m/s|um)([23])\b|\^([0-9])\b|\^\((\d/\d)\)")
PERCENT = re.compile(r"(?<=\d) ?%")
SYMBOL = re.compile(r"(?<![\w./\\-])(k_[cs]|c_c|R_[qas]|P_[a0]|A_n|zeta(?:_?[12c])?|[fmk][12])(?![\w/\\-]|\.\w)")
"""Of the rig; not a part of a name, of a path or of a key."""
LETTER = re.compile(r"(?<![\w/>])[PFHR](?![\w<])")
"""That stands for a quantity where a parameter is named; elsewhere it may be a unit or a name."""


def prose(text: str) -> Markup:
    """Set a sentence for a page.

    Parameters
    ----------
    text
        As it is printed at a terminal; what is Markup is not escaped again.

    Returns
    -------
    Markup
        The same with 10⁻¹² for 1e-12, symbols with their index, − for -, m/s² and a number that stays with its %.

    Examples
    --------
    >>> print(prose("k_c falls by -0.3% (p < 1e-12)"))
    <i>k</i><sub>c</sub> falls by −0.3\N{NO-BREAK SPACE}% (p &lt; 10⁻¹²)
    """
    said = str(escape(text))
    said = POWER.sub(_power, said)
    said = RAISED.sub(_raised, PERCENT.sub(f"{NO_BREAK}%", MINUS.sub("−", said)))
    said = re.sub(r"(?<=[\d ])um(?=[²\W]|$)", "µm", said)
    return Markup(SYMBOL.sub(_symbol, said))  # escaped above


def parameter(text: str) -> Markup:
    """Set a parameter's name with its value for a page.

    Examples
    --------
    >>> print(parameter("c_c / P -0.5 (-1 to 0) s/m"))
    <i>c</i><sub>c</sub> / <i>P</i> −0.5 (−1 to 0) s/m
    """
    return Markup(LETTER.sub(r"<i>\g<0></i>", str(prose(text))))  # escaped by prose


def _power(found: re.Match[str]) -> str:
    mantissa, power = found[1], str(int(found[2])).translate(SUPERSCRIPTS)
    return f"10{power}" if mantissa == "1" else f"{mantissa} × 10{power}"


def _raised(found: re.Match[str]) -> str:
    unit_of, power, of_a_number, fraction = found.groups()
    return f"<sup>{fraction}</sup>" if fraction else f"{unit_of or ''}{(power or of_a_number).translate(SUPERSCRIPTS)}"


def _symbol(found: re.Match[str]) -> str:
    base, index = found[0][0], found[0][-1]
    if found[0] == "zeta":
        return "<i>ζ</i>"
    return f"<i>{'ζ' if base == 'z' else base}</i><sub>{index}</sub>"
