"""The measurement beside theory, and the simulated rig's truth beside what was recovered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.contact.theory import TheoryCurve
from analysis.results import LoadResult, SessionResults
from calibration.estimate import Estimate
from mesotap.answers.results_files import QUANTITIES

N_PER_MN = 1e-3  # newtons in a millinewton


@dataclass(frozen=True, slots=True)
class Ratio:
    """Measured stiffness of one load over what each theory predicts there."""

    load: LoadResult
    ratios: tuple[Estimate | None, ...]


@dataclass(frozen=True, slots=True)
class Recovery:
    """One quantity of one load against the truth of the simulated rig; ``inside`` its 95 % interval or not.

    The deviation is None where the true value is smaller than half of the interval: a share of next to nothing.
    """

    estimate: Estimate | None
    true: float | None
    deviation_percent: float | None
    inside: bool | None


@dataclass(frozen=True, slots=True)
class SpectralCheck:
    """Contact mode of one load from the spectra alone, in % of the fitted one."""

    load: LoadResult
    frequency_percent: float | None
    damping_percent: float | None


def theory_ratios(results: SessionResults, theory: Sequence[TheoryCurve]) -> list[Ratio]:
    """Return measured over predicted stiffness at each load where both are known."""
    rows = []
    for load in results.loads:
        k = load.contact_stiffness_n_per_m
        if k is None or load.load_mn is None or load.load_mn.value <= 0:
            continue
        preload = np.array([load.load_mn.value * N_PER_MN])
        predicted = [float(np.asarray(curve.stiffness(preload))[0]) for curve in theory]
        usable = [value if math.isfinite(value) and value > 0 else None for value in predicted]
        rows.append(Ratio(load, tuple(None if p is None else _scaled(k, 1 / p) for p in usable)))
    return rows


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    return replace(estimate, value=estimate.value * factor, standard_error=estimate.standard_error * factor)


def recovered_against(
    results: SessionResults, truth: Sequence[Mapping[str, Any]]
) -> list[tuple[LoadResult, dict[str, Recovery]]]:
    """Return each load of known truth with every quantity compared with it."""
    by_set = {int(entry["load_set"]): entry for entry in truth if entry.get("load_set") is not None}
    return [
        (load, {q: _recovery(getattr(load, q), by_set[load.load_set].get(q)) for q in QUANTITIES})
        for load in results.loads
        if load.load_set in by_set
    ]


def spectral_check(load: LoadResult) -> SpectralCheck | None:
    """Hold the contact mode that was fitted against the one read off the spectra; None where one of them is missing."""
    spectral, f2, zeta2 = load.spectral_mode, load.f2_hz, load.zeta2
    if spectral is None or f2 is None or zeta2 is None:
        return None
    return SpectralCheck(
        load,
        _difference_percent(spectral.frequency_hz.value, f2.value),
        _difference_percent(spectral.damping_ratio.value, zeta2.value),
    )


def _difference_percent(value: float, reference: float) -> float | None:
    return 100 * (value / reference - 1) if reference else None


def _recovery(estimate: Estimate | None, true: float | None) -> Recovery:
    if estimate is None or true is None or not math.isfinite(true):
        return Recovery(estimate, true, None, None)
    nothing = true == 0 or abs(true) < estimate.half_width
    deviation = None if nothing else 100 * (estimate.value / true - 1)
    return Recovery(estimate, true, deviation, estimate.low <= true <= estimate.high)


def count_inside(recovered: list[tuple[LoadResult, dict[str, Recovery]]] | None) -> tuple[int, int]:
    """Return how many true values lie inside their intervals, and of how many."""
    verdicts = [r.inside for _, row in recovered or [] for r in row.values() if r.inside is not None]
    return sum(verdicts), len(verdicts)
