"""Modes beyond the two of Eq. 9: found where they are, not added where they are not.

What the two modes leave of all impacts of a load is realised together. A pole is taken if its singular value stands
above what noise of that size can reach, if it is no slice of a mode that is there already, and if fitting it lowers
the likelihoods of all impacts together by more than the parameters it costs (Bayes' information criterion).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.modal.era import hankel_svd, realise
from analysis.modal.exponentials import ExponentialFit, FitFailure, fit_exponentials, subtracted

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

MOST = 2  # further modes that are looked for
LAGS = 60
LONGEST = 2000  # samples of each residual that are realised
MARGIN = 1.05  # over the largest singular value that noise reaches
APART = 4.0  # half-widths between a further mode and one that is there: closer ones are slices of it
APART_SHARE = 0.04  # the same as a share of the frequency
LARGEST_DAMPING = 0.3
SAME = 0.03  # within which the impacts have to agree on its frequency
NOISELESS = 1e-18  # share of a record's power below which what is left is rounding
PARAMETERS = 4  # of a mode in one impact


@dataclass(frozen=True, slots=True)
class Decay:
    """A whitened record, the first sample of its free decay, and the fit of the modes in it."""

    y: Real
    start: int
    fit: ExponentialFit


def with_further_modes(decays: Sequence[Decay], known: Complex) -> tuple[list[Decay], Complex]:
    """Fit again with further modes where there are any.

    Returns
    -------
    decays, poles
        The decays with fits whose first poles are those that were there, in order, and the mean poles of what was
        added; the same decays and an empty array where nothing was.
    """
    kept = list(decays)
    added = np.zeros(0, np.complex128)
    for _ in range(MOST):
        candidate = _candidate(kept, known)
        if candidate is None:
            break
        extended = _extended(kept, candidate, known)
        if extended is None:
            break
        kept, mean = extended
        added = np.append(added, mean)
    return kept, added


def _candidate(decays: Sequence[Decay], known: Complex) -> complex | None:
    """Return the strongest pole in what the fits leave, if it stands out of the noise."""
    length = min(min(d.y.size - d.start for d in decays), LONGEST)
    if length < 4 * LAGS:
        return None
    rest = []
    for d in decays:
        if not d.fit.noise_variance[0] > NOISELESS * float(np.mean(d.y[d.start :] ** 2)):
            return None  # nothing but rounding is left
        stretch = d.y[None, d.start : d.start + length]
        left = subtracted(stretch, d.fit.amplitudes, d.fit.poles, d.fit.fixed_amplitudes, known)[0]
        rest.append(left / np.sqrt(d.fit.noise_variance[0]))
    decomposed = hankel_svd(np.array(rest)[:, None, :], LAGS)
    edge = np.sqrt(len(rest) * decomposed.columns) + np.sqrt(LAGS)
    if decomposed.singular_values[1] < MARGIN * edge:
        return None
    for order in (2, 4, 6):
        for z in realise(decomposed, order).poles:
            s = np.log(z)
            if not 0 < -s.real < LARGEST_DAMPING * abs(s):
                continue
            if _apart(complex(z), decays[0].fit.poles):
                return complex(z)
    return None


def _apart(z: complex, poles: Complex) -> bool:
    """Whether a pole is another mode than those that are there, not a slice of one of them."""
    s, there = np.log(z), np.log(poles)
    room = np.maximum(APART * np.maximum(-there.real, -s.real), APART_SHARE * np.abs(there))
    return bool((np.abs(s.imag - there.imag) > room).all())


def _extended(decays: Sequence[Decay], candidate: complex, known: Complex) -> tuple[list[Decay], complex] | None:
    """Fit all impacts with one mode more; None unless they agree on it and it pays."""
    gain, price = 0.0, 0.0
    out, found = [], []
    for d in decays:
        before = d.fit.poles
        try:
            fit = fit_exponentials(d.y[d.start :], np.append(before, candidate), known)
        except FitFailure:
            return None
        strayed = np.abs(np.abs(np.log(fit.poles[:-1])) / np.abs(np.log(before)) - 1)
        if (strayed > SAME).any() or not _apart(complex(fit.poles[-1]), fit.poles[:-1]):
            return None
        n = d.y.size - d.start
        smallest = np.finfo(np.float64).tiny
        gain += n * np.log(max(d.fit.residual_sum, smallest) / max(fit.residual_sum, smallest))
        price += PARAMETERS * np.log(n)
        out.append(Decay(d.y, d.start, fit))
        found.append(complex(fit.poles[-1]))
    middle = complex(np.median(np.real(found)), np.median(np.imag(found)))
    agree = np.abs(np.abs(np.log(found)) / abs(np.log(middle)) - 1) < SAME
    if gain < price or agree.mean() < 0.7:
        return None
    return out, middle
