"""The score test of a second impact: its delay may lie anywhere in each segment."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.signal import oaconvolve

from analysis.mismatch.limits import likelihood_bound
from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.added_response import second_impact
from analysis.mismatch.ring_downs.modes import Nuisance
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.ring_downs.response import whiten
from analysis.mismatch.score_test import Score
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import SecondImpact

FROM_S, TO_S = 1.0e-3, 40e-3  # after the tap: where a second impact is looked for
SHARES = np.geomspace(5e-4, 0.5, 60)  # of the first one's impulse
LEAST_SAMPLES = 200  # of a segment behind it


def second_impact_score(fitted: RingDownFit, mechanism: SecondImpact) -> Score:
    """Likelihood of a second impact of one share of the first in all segments, its delay anywhere in each."""
    evidence = np.zeros(SHARES.size)
    delays, per_segment = [], []
    nuisance = fitted.problem.nuisance(fitted.terms)
    for number in range(len(fitted.segments)):
        s, g, first = _along(fitted, number, nuisance)
        log_ratio = SHARES[:, None] * s - SHARES[:, None] ** 2 * g / 2
        top = log_ratio.max(axis=1)
        evidence += top + np.log(np.mean(np.exp(log_ratio - top[:, None]), axis=1))
        per_segment.append((s, g, first))
    best = int(np.argmax(evidence))
    share = float(SHARES[best])
    highest = 0.0
    for s, g, first in per_segment:
        log_ratio = share * s - share**2 * g / 2
        delays.append(first + float(np.argmax(log_ratio)))
        highest += float(log_ratio.max())
    found = float(evidence[best])
    term = Term(mechanism, {mechanism.parameters[0].name: share})
    # the likelihood ratio has mean one under the null, so that it exceeds e^x with a probability below e^-x
    p = min(1.0, math.exp(-min(max(found - math.log(SHARES.size), 0.0), 700.0)))
    bound = likelihood_bound(SHARES, evidence)
    return Score(
        term, max(2 * found, 0.0), 1, share, p, delays=tuple(delays), choice=2 * (highest - found), bound=bound
    )


def _along(fitted: RingDownFit, number: int, nuisance: Nuisance) -> tuple[Real, Real, float]:
    """Return products (m,) of its response with the residual and with itself at each delay, and the first delay."""
    experiment = fitted.problem.experiment
    rate, segment = experiment.sample_rate_hz, fitted.segments[number]
    samples = segment.y.shape[1]
    soonest = segment.pulse.shape[1] - segment.since_tap_s * rate  # so that all of the pulse is in the segment
    h = whiten(
        second_impact(
            fitted.responded(segment.group), fitted.amplitudes[number], replace(segment, second=soonest), rate
        ),
        experiment.noise,
    )
    first = max(0, int(FROM_S * rate - segment.start_s * rate - soonest))
    last = min(int(TO_S * rate - soonest), samples - LEAST_SAMPLES)
    q, _ = nuisance.basis(fitted.modes[segment.group], segment)
    # where terms bend the response the residual is orthogonal to their slopes, not to these columns
    left = fitted.residuals[number].ravel()
    residual = left - q @ (q.T @ left)
    both = np.concatenate([residual.reshape(*segment.y.shape, 1), q.reshape(*segment.y.shape, -1)], axis=2)
    flipped = h[:, ::-1]
    parts = [oaconvolve(both[c], flipped[c][:, None], axes=0)[samples - 1 :] for c in range(len(h))]
    seen = np.sum(parts, axis=0)
    square = np.cumsum(np.sum(h**2, axis=0))[::-1]
    use = slice(first, last)
    g = np.maximum(square[use] - np.sum(seen[use, 1:] ** 2, axis=1), 1e-12)
    return seen[use, 0], g, first + soonest
