"""What of a signal survives the refit of Eq. 9: the root of chi-squared that the refit leaves.

Refitted are the state of both masses after each tap, an offset and the high-pass's ringing of each channel, k_c and c_c
of each load, and masses and springs as far as their declared values allow. Free decays make this small: Eq. 9's poles
follow from its constants, and the rest is linear in their amplitudes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.generator.plan import MASS_ERROR, RATE_HZ, Plan
from mesotap.proof.generator.recorder import innovations, whitened

Real = NDArray[np.float64]

SPRING_UNCERTAINTY = 0.01  # standard, as a laboratory declares it
LARGEST_STEP = 0.3  # relative, of a constant in one step
SMALL = 1e-6  # relative step of the differences
MOST_STEPS = 12
ENOUGH = 1e-4  # relative decrease of chi-squared that ends the refit


@dataclass(frozen=True, slots=True)
class Refit:
    """Eq. 9 fitted to a session.

    Attributes
    ----------
    d
        Root of chi-squared, priors included, over the whole session: in standard deviations of the noise. Infinite
        where the session holds values that are not finite.
    left
        For each load (impacts, 2, samples): what is left of sum and difference of the channels, whitened.
    constants
        (2 L + 4,) k_c of the loads, c_c of the loads, k1, k2, m1, m2, relative to the true ones.
    """

    d: float
    left: tuple[Real, ...]
    constants: Real


def refit(plan: Plan, y: Real) -> Refit:
    """Fit Eq. 9 to the (n, 2, samples) session ``y``, m/s2.

    Parameters
    ----------
    plan
        The rig as it is, where the fit starts; its noise is the weight.
    """
    data = _by_load(plan, y)
    loads = plan.loads.size
    theta = np.ones(2 * loads + 4)
    left, prior = _left(plan, data, theta), _prior(theta)
    cost = _cost(left, prior)
    damping = 0.0
    if not math.isfinite(cost):
        return Refit(math.inf, tuple(left), theta)
    for _ in range(MOST_STEPS):
        step = _step(plan, data, theta, left, prior, damping)
        trial = theta + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        trial_left, trial_prior = _left(plan, data, trial), _prior(trial)
        trial_cost = _cost(trial_left, trial_prior)
        if not trial_cost <= cost:
            damping = max(10 * damping, 1e-3)
            continue
        fell = (cost - trial_cost) / max(cost, 1e-300)
        theta, left, prior, cost, damping = trial, trial_left, trial_prior, trial_cost, damping / 10
        if fell < ENOUGH:
            break
    return Refit(math.sqrt(cost), tuple(left), theta)


def alike(a: Refit, b: Refit) -> float:
    """Return the cosine of two surviving signals, from 0 (nothing in common) to 1; their sign does not count."""
    product = sum(float(np.vdot(x, y)) for x, y in zip(a.left, b.left, strict=True))
    return abs(product) / math.sqrt(_cost(a.left, None) * _cost(b.left, None))


def knowing_rms(plan: Plan, noise: Real) -> float:
    """Return the rms that the noise (n, 2, samples) of a session leaves when all constants are known, m/s2.

    Each impact's own freedom (state of both masses, offset and ringing of each channel) is fitted to it, so this is the
    held-out error of a fit that knows the answer. It is in units of the noise's innovations: what is left after
    whitening, times their standard deviation.
    """
    left = _left(plan, _by_load(plan, noise), np.ones(2 * plan.loads.size + 4))
    total = sum(float(np.sum(r**2)) for r in left)
    return math.sqrt(total / sum(r.size for r in left)) * innovations(plan.noise)[1]


def _by_load(plan: Plan, y: Real) -> list[Real]:
    """Sum and difference of the channels after the taps, whitened; (impacts, 2, samples) for each load."""
    turned = np.stack([y[:, 0] + y[:, 1], y[:, 0] - y[:, 1]], axis=1) / math.sqrt(2)
    white = whitened(plan.noise, turned[:, :, plan.settled :])
    return [white[plan.group == g] for g in range(plan.loads.size)]


def _left(plan: Plan, data: list[Real], theta: Real) -> list[Real]:
    """What the impacts' own freedom leaves at these constants."""
    n = data[0].shape[2]
    t = np.arange(n) / RATE_HZ
    own = np.column_stack([np.ones(n), np.exp(-2 * math.pi * plan.highpass_hz * t)])
    own = whitened(plan.noise, own.T).T
    slow = np.linalg.qr(own)[0]
    out = []
    for g, y in enumerate(data):
        modes = whitened(plan.noise, _modes(plan, g, theta, t).T).T
        q = np.linalg.qr(np.column_stack([own, modes]))[0]
        total = y[:, 0] - (y[:, 0] @ q) @ q.T
        difference = y[:, 1] - (y[:, 1] @ slow) @ slow.T
        out.append(np.stack([total, difference], axis=1))
    return out


def _modes(plan: Plan, g: int, theta: Real, t: Real) -> Real:
    """(n, 4) free decays of Eq. 9 at load g."""
    loads = plan.loads.size
    kc, cc = plan.kc[g] * theta[g], plan.cc[g] * theta[loads + g]
    k1, k2 = plan.springs[0] * theta[2 * loads], plan.springs[1] * theta[2 * loads + 1]
    m1, m2 = plan.masses[0] * theta[2 * loads + 2], plan.masses[1] * theta[2 * loads + 3]
    motion = np.array(
        [
            [0, 0, 1, 0],
            [0, 0, 0, 1],
            [-(k1 + kc) / m1, kc / m1, -cc / m1, cc / m1],
            [kc / m2, -(k2 + kc) / m2, cc / m2, -cc / m2],
        ]
    )
    poles = np.linalg.eigvals(motion)
    rising = poles[poles.imag > 0]
    decays = np.exp(np.multiply.outer(t, rising))
    return np.column_stack([decays.real, decays.imag])


def _prior(theta: Real) -> Real:
    """How far masses and springs were moved, in the uncertainties of their declared values.

    From the true values and not from the declared ones: an error of the declaration is nobody's effect.
    """
    return np.asarray((theta[-4:] - 1) / ([SPRING_UNCERTAINTY] * 2 + [MASS_ERROR] * 2))


def _cost(left: list[Real] | tuple[Real, ...], prior: Real | None) -> float:
    total = sum(float(np.sum(r**2)) for r in left)
    return total if prior is None else total + float(np.sum(prior**2))


def _step(plan: Plan, data: list[Real], theta: Real, left: list[Real], prior: Real, damping: float) -> Real:
    """Return the damped Gauss-Newton step. The k_c of all loads are moved at once: none is seen at another load."""
    loads = plan.loads.size
    moves = [np.r_[np.ones(loads), np.zeros(loads + 4)], np.r_[np.zeros(loads), np.ones(loads), np.zeros(4)]]
    moves += [np.eye(2 * loads + 4)[2 * loads + j] for j in range(4)]
    slopes = []
    for move in moves:
        moved = _left(plan, data, theta + SMALL * move)
        slopes.append([(a - b) / SMALL for a, b in zip(moved, left, strict=True)])
    size = theta.size
    normal, toward = np.zeros((size, size)), np.zeros(size)
    for g in range(loads):
        columns = np.stack([s[g].ravel() for s in slopes])
        place = [g, loads + g, *range(2 * loads, size)]
        normal[np.ix_(place, place)] += columns @ columns.T
        toward[place] -= columns @ left[g].ravel()
    slope = np.diag((_prior(theta + SMALL * np.r_[np.zeros(2 * loads), np.ones(4)]) - prior) / SMALL)
    normal[-4:, -4:] += slope @ slope
    toward[-4:] -= slope @ prior
    scale = np.sqrt(np.diag(normal))
    system = normal / np.outer(scale, scale) + damping * np.eye(size)
    return np.asarray(np.linalg.solve(system, toward / scale) / scale)
