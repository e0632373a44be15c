"""Errors over the Cramer-Rao bound, coverage, lost modes, and the bias that scatter between impacts makes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from modal_data import (
    IMPACTS,
    PRETRIGGER,
    RATE_HZ,
    SAMPLES,
    Case,
    Real,
    declared_rig,
    free_decay_bounds,
    free_decays,
    taps,
    truth,
)
from scipy import stats

from analysis.modal.exponentials import FitFailure
from analysis.modal.free_decay import identify_free_decays
from analysis.modal.modes import ModeEstimate
from analysis.modal.noise import NoiseModel
from analysis.modal.tester import identify_impacts

LOST = 6.0  # bounds by which an estimate may be off before its mode counts as lost
NORMAL_95 = float(stats.norm.ppf(0.975))
QUANTITIES = ("f1", "f2", "zeta1", "zeta2")


def values(modes: Sequence[ModeEstimate | None]) -> tuple[Real, Real]:
    """(f1, f2, zeta1, zeta2) and their standard errors; NaN where a mode is missing."""
    found = np.full((2, 2, 2), np.nan)
    for j, mode in enumerate(modes):
        if mode is not None:
            f, zeta = mode.frequency_hz, mode.damping_ratio
            found[:, :, j] = (f.value, zeta.value), (f.standard_error, zeta.standard_error)
    return found[0].ravel(), found[1].ravel()


def summary(case: Case, error: Real, least: Real, stated: Real) -> dict[str, Any]:
    """What one combination came to; all arrays (N, 4)."""
    missing = ~np.isfinite(error)
    ratio = np.where(missing, 0.0, error / least)
    counted = np.maximum((~missing).sum(axis=0), 1)
    inside = (np.abs(error) <= NORMAL_95 * stated) & ~missing
    off = missing | (np.abs(ratio) > LOST)
    return {
        "case": [case.f1_hz, case.f2_hz, case.zeta2, case.snr_db],
        "rms": np.sqrt((ratio**2).sum(axis=0) / counted).tolist(),
        "inside": inside.mean(axis=0).tolist(),
        "impacts": int(error.shape[0]),
        "lost": [int((off[:, 0] | off[:, 2]).sum()), int((off[:, 1] | off[:, 3]).sum())],
        "none": int(missing.any(axis=1).sum()),
    }


def of_free_decays(case: Case, draws: int, seed: Sequence[int]) -> dict[str, Any]:
    """`identify_free_decays` on draws of eight free decays."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(draws):
        y, poles, amplitudes, sigmas = free_decays(case, rng)
        least = free_decay_bounds(poles, amplitudes, sigmas, SAMPLES)
        try:
            found = identify_free_decays(y, RATE_HZ)
        except FitFailure:
            found = None
        for i in range(IMPACTS):
            value, stated = values((None, None) if found is None else found.modes(i))
            rows.append((value - truth(poles[i]), least[i], stated))
    return summary(case, *(np.array(column) for column in zip(*rows, strict=True)))


def of_taps(case: Case, draws: int, seed: Sequence[int]) -> dict[str, Any]:
    """`identify_impacts` on draws of eight whole taps: pre-trigger, pulse, band-pass."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(draws):
        records, true, least, sigma, tester = taps(case, rng)
        rig = declared_rig(tester)
        noise = NoiseModel(np.ones(1), sigma**2)
        for impact, floor in zip(
            identify_impacts(records, [PRETRIGGER] * IMPACTS, RATE_HZ, rig, noise), least, strict=True
        ):
            value, stated = values((impact.system, impact.contact))
            rows.append((value - true, floor, stated))
    return summary(case, *(np.array(column) for column in zip(*rows, strict=True)))


def of_scatter(case: Case, draws: int, seed: Sequence[int], scatter: float) -> dict[str, Any]:
    """Relative bias of zeta2 with f2 scattered between impacts: fitted one by one, and their average fitted."""
    rng = np.random.default_rng(seed)
    single: list[float] = []
    averaged: list[float] = []
    refused = [0, 0]
    for _ in range(draws):
        y, *_ = free_decays(case, rng, scatter=scatter, alike=True)
        for together, records, into in ((0, y, single), (1, y.mean(axis=0)[None], averaged)):
            try:
                found = identify_free_decays(records, RATE_HZ)
            except FitFailure:
                refused[together] += 1
                continue
            into += [found.modes(i)[1].damping_ratio.value / case.zeta2 - 1 for i in range(records.shape[0])]
    return {
        "case": [case.f1_hz, case.f2_hz, case.zeta2, case.snr_db],
        "bias": float(np.mean(single)),
        "bias_error": float(np.std(single) / np.sqrt(len(single))),
        "bias_of_average": float(np.median(averaged)) if averaged else None,
        "refused": refused,
    }
