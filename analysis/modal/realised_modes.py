"""Modes of a ring-down as the Eigensystem Realization Algorithm gives them, with their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from analysis.modal.era import HankelSvd, Realisation, hankel_svd, realise
from analysis.modal.likelihood_interval import spread_along, widened, widening
from analysis.modal.model_order import modes_of, price_of_a_mode
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.ring_down_model import LEAST_LEFT, Record, fitted, without_modes
from analysis.modal.stabilisation import COLUMNS, SAME_FREQUENCY, lags_of, realisations, stable_poles

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

NEAR = 1.0  # of a decay, by which that without noise may differ from it
SHORTER = (4, 16, 64)  # parts of the record in which modes are sought that are lost in the noise of the whole
SHORTEST = 48  # samples of such a part
SAME_MODE = 1.0  # half-width of the broader, within which a pole of a shorter part is the mode that the longer one has
NOT_SETTLED = (
    "least squares did not settle: the intervals are those of first-order perturbation, too short in much noise"
)
NORMAL_95 = float(stats.norm.ppf(0.975))
ORDERS = 10  # at most, over which the scatter of a pole is taken


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A stable pole, the samples it was realised from, and the orders that were realised."""

    pole: complex
    samples: int
    orders: tuple[int, ...]


def realised_modes(
    tail: Real, chosen: Complex, realised: list[Realisation], sample_rate_hz: float, largest_order: int
) -> tuple[tuple[ModeEstimate, ...], float, list[str]]:
    """Poles of ERA that are worth their price, the share of the energy that they leave, and sentences for the reader.

    Modes that decay fast are sought in shorter parts of the record, too: over all of it the noise outweighs them. What
    realisations make of noise has no covariance that holds at 20 dB and less, so that each pole's interval comes from
    how far off it the maximum of the likelihood lies.

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
        return (), 1.0, []
    amplitudes, residual = _explained(tail, np.array([c.pole for c in candidates]))
    scale = np.maximum(residual.std(axis=1), 1e-9 * tail.std(axis=1).max() + 1e-300)
    decomposed: dict[int, list[Realisation]] = {}
    found = []
    for candidate in candidates:
        if candidate.samples not in decomposed:
            part = tail[:, : candidate.samples] / scale[:, None]
            decomposed[candidate.samples] = _without_noise(hankel_svd(part, lags_of(part)), candidate.orders)
        found.append(_median_of_orders(candidate.pole, decomposed[candidate.samples]))
    kept = [(*f, own) for f, own in zip(found, amplitudes, strict=True) if f is not None]
    about = _about(tail, np.array([pole for pole, *_ in kept], np.complex128), sample_rate_hz)
    covariances, told, further = about or ([c for _, c, _ in kept], [True] * len(kept), [])
    notes = [] if about else [NOT_SETTLED]
    notes += [f"the likelihood tells a further mode around {f:.5g} Hz, which ERA does not" for f in further]
    modes = []
    for (pole, _, own), covariance, likely in zip(kept, covariances, told, strict=True):
        mode = mode_from_sampled_pole(pole, covariance, own, sample_rate_hz)
        if likely:
            modes.append(mode)
        else:
            notes.append(f"what ERA tells at {mode.frequency_hz.value:.5g} Hz is part of another mode: it is left out")
    modes.sort(key=lambda mode: abs(mode.pole))
    share = float((residual**2).sum() / max((tail**2).sum(), 1e-300))
    return tuple(modes), share, notes


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
    near = []
    for r in noisy:
        off = np.abs(np.log(r.poles) - own)
        m = int(np.argmin(off)) if off.size else -1
        if m >= 0 and off[m] < np.hypot(SAME_FREQUENCY * abs(own), NEAR * own.real):
            near.append((complex(r.poles[m]), r.log_pole_covariance[m]))
    if not near:
        return None
    near.sort(key=lambda found: float(np.trace(found[1])))
    pole, covariance = near[len(near) // 2]
    if len(near) > 2:
        logs = np.log([found[0] for found in near])
        covariance = covariance + np.cov(np.array([logs.real, logs.imag]))
    return pole, covariance


def _about(tail: Real, poles: Complex, sample_rate_hz: float) -> tuple[Real, NDArray[np.bool_], Real] | None:
    """Covariances (J, 2, 2) by which intervals about realised poles hold, and which of these are modes by likelihood.

    The frequencies, Hz, of modes that the realisation has not come third.

    None where least squares do not settle.

    The maximum of the likelihood near these poles lies off them by what the realisation makes of the noise, and its own
    error is independent of that distance (it is efficient). The interval about the realised pole is the symmetric one
    that holds the truth with 95 %, given the distance. The likelihood is that of all modes which the record holds, also
    of those that the realisation has not: a fit without them would be off by what it makes of these.
    """
    if not poles.size:
        return None
    record = Record(tail)
    model = fitted(record, poles / np.maximum(np.abs(poles) * (1 + 1e-9), 1.0), without_modes(record))
    if model is None or model.fit is None or model.poles.size != poles.size:
        return None
    model = modes_of(record, model)
    if model.fit is None:
        return None
    fit = model.fit
    wider, spread = widening(record.y, fit, record.known), spread_along(record, fit)
    found = np.tile(np.eye(2), (poles.size, 1, 1))
    distances = np.abs(np.log(poles[:, None] / fit.poles))
    rows, columns = optimize.linear_sum_assignment(distances)  # close modes may have changed places
    told = np.isin(np.arange(poles.size), rows)
    for own_index, i in zip(rows, columns, strict=True):
        off = np.log(poles[own_index] / fit.poles[i])
        apart = np.array([off.real, off.imag])
        covariance = widened(fit.log_pole_covariance[i], wider[i]) * spread[i]
        if not np.linalg.det(covariance) > 0:
            return None  # least squares stand where the likelihood has no maximum
        own = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
        both = covariance + np.outer(apart, apart)
        scale = own * half_width_about(np.abs(apart) / own) / NORMAL_95 / np.sqrt(np.diagonal(both))
        found[own_index] = both * np.outer(scale, scale)
    further = np.delete(fit.poles, columns)
    return found, told, np.sort(np.abs(np.log(further))) * sample_rate_hz / (2 * np.pi)


def half_width_about(off: Real) -> Real:
    """Half-widths of intervals about 0 that hold a normal variable of unit variance about ``off`` with 95 %.

    Examples
    --------
    >>> half_width_about(np.array([0.0, 3.0])).round(3).tolist()
    [1.96, 4.645]
    """
    return np.asarray(stats.foldnorm.ppf(0.95, off), np.float64)
