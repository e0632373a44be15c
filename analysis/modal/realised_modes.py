"""Modes of a ring-down as the Eigensystem Realization Algorithm gives them, with their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.modal.era import HankelSvd, Realisation, hankel_svd, realise
from analysis.modal.model_order import price_of_a_mode
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.ring_down_model import LEAST_LEFT
from analysis.modal.stabilisation import COLUMNS, SAME_FREQUENCY, lags_of, realisations, stable_poles

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

NEAR = 1.0  # of a decay, by which that without noise may differ from it
SHORTER = (4, 16, 64)  # parts of the record in which modes are sought that are lost in the noise of the whole
SHORTEST = 48  # samples of such a part
SAME_MODE = 1.0  # half-width of the broader, within which a pole of a shorter part is the mode that the longer one has
ORDERS = 10  # at most, over which the scatter of a pole is taken


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A stable pole, the samples it was realised from, and the orders that were realised."""

    pole: complex
    samples: int
    orders: tuple[int, ...]


def realised_modes(
    tail: Real, chosen: Complex, realised: list[Realisation], sample_rate_hz: float, largest_order: int
) -> tuple[tuple[ModeEstimate, ...], float]:
    """Poles of ERA that are worth their price, and the share of the energy that they leave.

    Their covariance is first-order perturbation by the noise plus the scatter over orders, the noise taken off: what it
    adds to a decay grows with it. Modes that decay fast are sought in shorter parts of the record, too: over all of it
    the noise outweighs them.

    Parameters
    ----------
    tail
        (c, n) free decay.
    chosen, realised
        Stable poles of the whole record, and its realisations.
    sample_rate_hz, largest_order
        As of `identify_ring_down`.
    """
    candidates = _candidates(tail, chosen, realised, largest_order)
    candidates = _worth_their_price(tail, candidates)
    if not candidates:
        return (), 1.0
    amplitudes, residual = _explained(tail, np.array([c.pole for c in candidates]))
    scale = np.maximum(residual.std(axis=1), 1e-9 * tail.std(axis=1).max() + 1e-300)
    decomposed: dict[int, list[Realisation]] = {}
    modes = []
    for candidate, own in zip(candidates, amplitudes, strict=True):
        if candidate.samples not in decomposed:
            part = tail[:, : candidate.samples] / scale[:, None]
            decomposed[candidate.samples] = _without_noise(hankel_svd(part, lags_of(part)), candidate.orders)
        found = _median_of_orders(candidate.pole, decomposed[candidate.samples])
        if found is not None:
            modes.append(mode_from_sampled_pole(*found, own, sample_rate_hz))
    modes.sort(key=lambda mode: abs(mode.pole))
    return tuple(modes), float((residual**2).sum() / max((tail**2).sum(), 1e-300))


def _candidates(tail: Real, chosen: Complex, realised: list[Realisation], largest_order: int) -> list[_Candidate]:
    """Stable poles of the whole record, and of shorter parts those that it has not."""
    n = min(tail.shape[1], COLUMNS)
    found = [_Candidate(complex(z), n, tuple(r.order for r in realised)) for z in chosen]
    for part in SHORTER:
        samples = n // part
        if samples < SHORTEST or not tail[:, :samples].any():
            break
        shorter = realisations(tail[:, :samples], largest_order)
        _, poles = stable_poles(shorter, samples, 1.0)
        orders = tuple(r.order for r in shorter)
        old = np.log(np.array([c.pole for c in found], np.complex128))
        for z in poles:
            s = np.log(z)
            width = SAME_MODE * np.maximum(np.maximum(-old.real, -s.real), 2 * np.pi / samples)
            if not (np.abs(s.imag - old.imag) < width).any():
                found.append(_Candidate(complex(z), samples, orders))
    return found


def _explained(tail: Real, poles: Complex) -> tuple[Complex, Real]:
    """(J, c) least-squares amplitudes of decays, and the (c, n) residual."""
    k = np.arange(tail.shape[1])
    if not poles.size:
        return np.zeros((0, tail.shape[0]), np.complex128), tail
    waves = poles[:, None] ** k
    design = np.concatenate([waves.real, -waves.imag]).T
    found, *_ = np.linalg.lstsq(design, tail.T, rcond=None)
    amplitudes = found[: poles.size] + 1j * found[poles.size :]
    return amplitudes / 2, tail - (design @ found).T


def _worth_their_price(tail: Real, candidates: list[_Candidate]) -> list[_Candidate]:
    """Leave out, one after another, what raises the likelihood by no more than chance would anywhere in the record."""
    c, n = tail.shape
    price = price_of_a_mode(c, n)
    least = LEAST_LEFT * np.maximum((tail**2).sum(axis=1), 1e-300)

    def left(kept: list[_Candidate]) -> float:
        residual = _explained(tail, np.array([k.pole for k in kept], np.complex128))[1]
        return float(n * np.log(np.maximum((residual**2).sum(axis=1), least)).sum())

    while candidates:
        now = left(candidates)
        gains = [left(candidates[:i] + candidates[i + 1 :]) - now for i in range(len(candidates))]
        weakest = int(np.argmin(gains))
        if gains[weakest] > price:
            break
        candidates = candidates[:weakest] + candidates[weakest + 1 :]
    return candidates


def _without_noise(decomposed: HankelSvd, orders: tuple[int, ...]) -> list[Realisation]:
    return [realise(decomposed, order, 1.0) for order in orders[:: max(1, len(orders) // ORDERS)]]


def _median_of_orders(z: complex, noisy: list[Realisation]) -> tuple[complex, Real] | None:
    """Pole and covariance of a mode over the orders in which it is; None if it is in none of them."""
    own = np.log(z)
    near = [
        (complex(r.poles[m]), r.log_pole_covariance[m])
        for r in noisy
        for m in range(r.poles.size)
        if abs(np.log(r.poles[m]) - own) < np.hypot(SAME_FREQUENCY * abs(own), NEAR * own.real)
    ]
    if not near:
        return None
    near.sort(key=lambda found: float(np.trace(found[1])))
    pole, covariance = near[len(near) // 2]
    if len(near) > 2:
        logs = np.log([found[0] for found in near])
        covariance = covariance + np.cov(np.array([logs.real, logs.imag]))
    return pole, covariance
