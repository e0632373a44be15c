"""What a session found, in a few plain sentences."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from analysis.contact.theory import TheoryCurve
from analysis.results import LoadResult, SessionResults
from calibration.estimate import Estimate
from daq.hits import LEFT_OUT
from mesotap.answers.comparison import Ratio
from mesotap.answers.rounding import counted, significant, with_uncertainty


def summary(results: SessionResults, theory: Sequence[TheoryCurve], ratios: Sequence[Ratio]) -> list[str]:
    """Say in a few plain sentences what was found, how theory compares and how good the taps and the gauge were."""
    sentences = []
    measured = [load for load in results.loads if load.contact_stiffness_n_per_m is not None]
    measured.sort(key=lambda load: load.load_mn.value if load.load_mn is not None else load.target_load_mn)
    if not measured:
        sentences.append("No contact stiffness could be estimated; the notes below say why.")
    elif len(measured) == 1:
        sentences.append(f"At {_load_words(measured[0])} the contact stiffness is {_stiffness(measured[0])} MN/m.")
    else:
        first, last = measured[0], measured[-1]
        sentences.append(
            f"The contact stiffness goes from {_stiffness(first)} MN/m at {_load_words(first)}"
            f" to {_stiffness(last)} MN/m at {_load_words(last)}{_exponent_words(measured)}."
        )
        sentences += _damping_words(measured)
    if comparison := _closest_theory(theory, ratios):
        sentences.append(comparison)
    left_out = sum(i.reject_reason.startswith(LEFT_OUT) for i in results.impacts if not i.accepted)
    rejected = sum(not impact.accepted for impact in results.impacts) - left_out
    used = sum(load.impacts_used for load in results.loads)
    taps = f"{counted(len(results.impacts), 'tap')} at {counted(len(results.loads), 'load')}:"
    taps += f" {used} used, {rejected} rejected"
    taps += f", {left_out} left out by the choice of hits." if left_out else "."
    sentences.append(taps)
    if results.calibration is not None and results.calibration.drifted:
        sentences[-1] += " The strain gauge drifted, so the loads are in doubt."
    elif results.calibration is not None:
        tested = results.calibration.drift_p_value is not None
        sentences[-1] += " The strain gauge did not drift." if tested else " The gauge's drift could not be tested."
    else:
        written = any(load.load_mn is not None for load in results.loads)
        loads = "those written in the session file" if written else "targets"
        sentences[-1] += f" There is no calibration of the strain gauge: loads are {loads}."
    return [_typographic_words(sentence) for sentence in sentences]


def _typographic_words(sentence: str) -> str:
    """Set minus signs, and keep a number together with its uncertainty and unit."""
    sentence = sentence.replace(" -", " −").replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[\d)]) (?=MN/m|mN|%)", "\N{NO-BREAK SPACE}", sentence)


def _load_words(load: LoadResult) -> str:
    if load.load_mn is None:
        return f"a target load of {significant(load.target_load_mn, 4)} mN"
    return f"{with_uncertainty(load.load_mn)} mN"


def _stiffness(load: LoadResult) -> str:
    return with_uncertainty(load.contact_stiffness_n_per_m, 1e-6)


def _exponent_words(measured: Sequence[LoadResult]) -> str:
    points = [
        (math.log(load.load_mn.value), math.log(k.value))
        for load in measured
        if load.load_mn is not None and load.load_mn.value > 0
        if (k := load.contact_stiffness_n_per_m) is not None and k.value > 0
    ]
    if len(points) < 3 or len({x for x, _ in points}) < 3:
        return ""
    log_load, log_stiffness = np.array(points).T
    slope = float(np.polynomial.Polynomial.fit(log_load, log_stiffness, 1).convert().coef[1])
    return f", about as the load to the power {slope:.2f}"


def _damping_words(measured: Iterable[LoadResult]) -> list[str]:
    ratios = [load.zeta2 for load in measured if load.zeta2 is not None]
    if len(ratios) < 2:
        return []
    return [f"The contact mode's damping ratio goes from {_percent(ratios[0])} % to {_percent(ratios[-1])} %."]


def _percent(estimate: Estimate) -> str:
    text = with_uncertainty(estimate, 100)
    return f"({text})" if "±" in text else text


def _closest_theory(theory: Sequence[TheoryCurve], ratios: Sequence[Ratio]) -> str:
    best: tuple[float, str] | None = None
    for index, curve in enumerate(theory):
        if not curve.unloads_alike:  # a ring-down never sees the slope of first loading
            continue
        values = [r.ratios[index] for r in ratios]
        numbers = [v.value for v in values if v is not None and v.value > 0]
        if not numbers or len(numbers) < len(ratios):
            continue
        distance = float(np.sqrt(np.mean(np.log(numbers) ** 2)))
        span = f"{min(numbers):.2f} to {max(numbers):.2f} times" if len(numbers) > 1 else f"{numbers[0]:.2f} times"
        equation = f" ({curve.equation})" if curve.equation else ""
        if best is None or distance < best[0]:
            best = (
                distance,
                f"Of the theories, {curve.name}{equation} is closest: the measured stiffness is {span} its prediction.",
            )
    return "" if best is None else best[1]
