"""Frequency responses for other programs and for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from analysis.frequency_response.cross_check import CrossCheck
from analysis.frequency_response.estimators import FrequencyResponse
from calibration.estimate import Estimate
from mesotap.answers.rounding import significant, with_uncertainty
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

DIGITS = 6
"""Significant digits of lines in JSON: coherence and random error leave fewer."""


def response_json(response: FrequencyResponse) -> dict[str, Any]:
    """Return frequency responses as JSON types, the lines up to where the force excites; None for no number."""
    kept = response.frequency_hz <= response.force_limit_hz
    return {
        "channels": list(response.channels),
        "unit": response.unit,
        "averages": response.averages,
        "window": response.window,
        "decay_per_s": response.decay_per_s,
        "force_limit_hz": response.force_limit_hz,
        "frequency_hz": _rounded(response.frequency_hz[kept]),
        "force_spectrum": _rounded(response.force_spectrum[kept]),
        **{name: [_complex(row[kept]) for row in getattr(response, name)] for name in ("h1", "h2", "hv")},
        "coherence": [_rounded(row[kept]) for row in response.coherence],
        "random_error": [_rounded(row[kept]) for row in response.random_error],
        "notes": list(response.notes),
    }


def cross_check_json(found: CrossCheck) -> dict[str, Any]:
    """Return what the hammer says of one load as JSON types."""
    fit, score = found.fit, found.standard_errors
    names = {
        "contact_stiffness_n_per_m": None if fit is None else fit.contact_stiffness,
        "contact_damping_n_s_per_m": None if fit is None else fit.contact_damping,
        "mass_sum_kg": None if fit is None else fit.mass_sum,
        "spring_sum_n_per_m": None if fit is None else fit.spring_sum,
        "declared_mass_sum_kg": found.declared_mass_sum,
        "by_ring_down_n_per_m": found.by_ring_down,
        "difference_n_per_m": found.difference,
    }
    return {
        "load_set": int(found.load_set),
        "target_load_mn": found.target_load_mn if math.isfinite(found.target_load_mn) else None,
        **{name: estimate_json(value) for name, value in names.items()},
        "standard_errors": score if math.isfinite(score) else None,
        "agrees": found.agrees,
        "not_identified": "" if fit is None else fit.not_identified,
        "sentence": found.sentence,
        "response": None if found.response is None else response_json(found.response),
        "notes": list(found.notes),
    }


def show_cross_checks(checks: Sequence[CrossCheck], console: Console) -> None:
    """Print k_c and masses by the hammer, beside Eq. 11 and the weighed ones; nothing without a hammer."""
    if not checks:
        return
    shown = Table(title="by the hammer's force, 95 % intervals")
    headings = (
        "target, mN",
        "hits",
        "excites to, Hz",
        "k_c, MN/m",
        "Eq. 11, MN/m",
        "apart, s.e.",
        "m1 + m2, g",
        "weighed, g",
    )
    for heading in headings:
        shown.add_column(heading, justify="right")
    for check in checks:
        fit, response = check.fit, check.response
        shown.add_row(
            f"{check.target_load_mn:.0f}",
            "0" if response is None else f"{response.averages:.0f}",
            "–" if response is None else f"{response.force_limit_hz:.0f}",
            with_uncertainty(None if fit is None else fit.contact_stiffness, 1e-6),
            with_uncertainty(check.by_ring_down, 1e-6),
            significant(check.standard_errors, 2),
            with_uncertainty(None if fit is None else fit.mass_sum, 1e3),
            with_uncertainty(check.declared_mass_sum, 1e3),
        )
    console.print(shown)
    for sentence in said_of(checks):
        console.print(f"- {escape(sentence)}", highlight=False)


def said_of(checks: Sequence[CrossCheck]) -> list[str]:
    """Return in sentences how the loads agree, what was not identified, and the faults, each once."""
    told = [check for check in checks if check.agrees is not None]
    said = []
    if told:
        apart = [check for check in told if not check.agrees]
        worst = max(told, key=lambda check: abs(check.standard_errors))
        which = ", ".join(f"{check.target_load_mn:.0f}" for check in apart)
        said.append(
            f"the hammer's k_c agrees with that of Eq. 11 at {len(told) - len(apart)} of {len(told)} loads"
            + (f", not at {which} mN" if apart else "")
            + f"; furthest apart by {abs(worst.standard_errors):.1f} standard errors ({worst.target_load_mn:.0f} mN). "
            "The hammer's sensitivity is in all of them, so they go up and down together"
        )
    said += dict.fromkeys(check.fit.not_identified for check in told if check.fit is not None)
    for check in checks:
        said += [f"load {check.target_load_mn:.0f} mN: {note}" for note in check.notes]
    return said


def show_response(response: FrequencyResponse, console: Console) -> None:
    """Print what a recording's force gives: channels with their highest peak, averages, how far the force excites."""
    shown = Table(title=f"frequency response, {escape(response.unit)}, over the force")
    for heading in ("channel", "peak of |H1| at, Hz", "|H1| there", "coherence there", "lowest coherence"):
        shown.add_column(heading, justify="right")
    kept = response.frequency_hz <= response.force_limit_hz
    for row, name in enumerate(response.channels):
        size = np.where(kept, np.abs(response.h1[row]), -1.0)
        top = int(np.nanargmax(size))
        error = response.random_error[row, top]
        high = f"{size[top]:.4g}" + (f" ± {100 * 1.96 * error:.2g} %" if math.isfinite(error) else "")
        coherence = response.coherence[row]
        shown.add_row(
            escape(name),
            f"{response.frequency_hz[top]:.5g}",
            high,
            f"{coherence[top]:.3f}" if response.averages > 1 else "–",
            f"{np.nanmin(coherence[kept]):.3f}" if response.averages > 1 else "–",
        )
    console.print(shown)
    for sentence in response_said(response):
        console.print(f"- {escape(sentence)}", highlight=False)


def response_said(response: FrequencyResponse) -> list[str]:
    """Return what is to be known of a frequency response, in sentences."""
    many = f"{response.averages:.3g} averages" if response.averages > 1 else "1 average"
    alone = "" if response.averages > 1 else ", from which no coherence and no random error can be had"
    said = f"{many}{alone}; the force excites up to {response.force_limit_hz:.0f} Hz (-20 dB); {response.window}"
    return [said, *response.notes]


def _rounded(values: NDArray[np.float64]) -> list[float | None]:
    return [float(f"{v:.{DIGITS - 1}e}") if math.isfinite(v) else None for v in values]


def _complex(values: NDArray[np.complex128]) -> list[list[float | None]]:
    return [_rounded(np.array([v.real, v.imag])) for v in values]


def estimate_json(estimate: Estimate | None) -> dict[str, float] | None:
    """Return value and ends of an estimate; None where one of them is not known."""
    if estimate is None:
        return None
    numbers = estimate.as_json()
    return {key: float(v) for key, v in numbers.items()} if all(map(math.isfinite, numbers.values())) else None
