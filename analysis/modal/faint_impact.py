"""Modes that begin in the noise of a record: an impact that is no louder than the noise, and when it may have been.

Noise explains the samples ahead of such an impact better than modes that are continued backwards. How much better, over
all samples at which the modes may begin, is the likelihood of the onset. A mode that decays fast is read too slow if it
is taken to begin before it does, so that what the onset leaves open counts towards its interval; one of which little is
left when the impact is surely over is not told from the impact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.model_order import groups, modes_of, price_of_a_mode
from analysis.modal.ring_down_model import Model, Record, fitted, without_modes, worth_of
from analysis.modal.sums import all_poles, data_sums, grams, normal_equations, squares

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SOON_S = 1e-3  # that a pulse may last
STEPS = 4  # onsets that are tried within that time
LEAST = 64  # samples of free decay
WORTH_A_LOOK = 4.0  # twice the log-likelihood ratio of the best onset, below which modes begin with the record
POSSIBLE = 20.0  # the same, by which an onset may be worse than the best one and still be fitted anew
FITTED = 24  # onsets at most that are fitted anew
AGAIN = 3  # times that modes are counted, each from the onset on that the last ones show
LOUD = 8.0  # standard deviations of the noise: a sample that no noise makes, and by which an impact is seen at once
LATE = 0.975  # probability that the impact was over by the sample at which a mode has to be heard


class Begun(NamedTuple):
    """Modes of a record from where they begin on.

    Attributes
    ----------
    start
        First sample used.
    model
        The modes from there on.
    shift
        (J,) by which the logarithms of their poles, averaged over all onsets, differ from the model's.
    scatter
        (J, 2, 2) covariance of real and imaginary part of these logarithms that the onset leaves open.
    notes
        Sentences for the reader.
    """

    start: int
    model: Model
    shift: Complex
    scatter: Real
    notes: tuple[str, ...] = ()


def is_loud(y: Real) -> bool:
    """Whether a record (c, n) stands so far out of its noise that what begins in it is seen.

    The noise is told from third differences at the end of the record, of which what oscillates slowly leaves little.
    """
    last = np.diff(y[:, -max(LEAST, y.shape[1] // 4) :], 3, axis=1)
    noise = stats.median_abs_deviation(last, axis=1, scale="normal") / np.sqrt(20.0)  # 1 + 9 + 9 + 1 variances
    return bool((np.abs(y).max(axis=1) > LOUD * noise).any())


def begun_in_noise(record: Record, model: Model, sample_rate_hz: float) -> Begun | None:
    """Modes that begin later than the record does; None if they begin with it.

    Parameters
    ----------
    record
        Its mean taken off.
    model
        The modes from its first sample on.
    sample_rate_hz
        Samples a second.
    """
    plain = _strongest(record, model)
    n, pulse = record.y.shape[1], max(2, int(SOON_S * sample_rate_hz))
    at = np.arange(0, min(n // 2, n - LEAST - pulse), max(1, pulse // STEPS))
    if plain is None or at.size < 2:
        return None
    weight = record.samples / np.maximum(model.left, 1e-300)
    later, counted = plain, -1
    for _ in range(AGAIN):
        rise = _rise(record, later, at[::STEPS], weight)
        best = int(np.argmax(rise))
        if best == 0 or rise[best] - rise[0] < WORTH_A_LOOK:
            return None
        later = modes_of(_from(record, int(at[::STEPS][best]) + pulse))
        if later.fit is None:
            return None
        if later.poles.size == counted:
            break
        counted = later.poles.size
    rise = _rise(record, later, at, weight)
    possible = np.flatnonzero((rise > rise.max() - POSSIBLE) & (at > 0))
    onsets = _fitted_from(record, model, later, at[possible[:: max(1, -(-possible.size // FITTED))]], pulse)
    return None if onsets is None else _averaged(record, onsets, pulse, sample_rate_hz)


def _strongest(record: Record, model: Model) -> Model | None:
    """The strongest mode of each group that overlaps: modes beside each other cancel where none is."""
    if model.fit is None:
        return None
    worth = worth_of(record, model)
    strongest = [group[int(np.argmax(worth[group]))] for group in groups(model.poles, record.y.shape[1])]
    if len(strongest) == model.poles.size:
        return model
    return fitted(record, model.poles[strongest], without_modes(record))


def _from(record: Record, first: int) -> Record:
    missing = record.missing[record.missing >= first] - first
    return Record(record.y[:, first:], record.known, missing)


def _rise(record: Record, model: Model, at: NDArray[np.int64], weight: Real) -> Real:
    """Twice the log-likelihood, but for a constant, of noise up to each sample and modes from there on."""
    z = all_poles(model.poles, record.known)
    return -_left(np.ascontiguousarray(record.y), weight, z, at)


@njit(cache=True)
def _left(y: Real, weight: Real, z: Complex, at: NDArray[np.int64]) -> Real:
    """What decays that begin at each of some samples, their amplitudes free, leave of a record, weighted."""
    found = np.empty(at.size)
    none = np.zeros((y.shape[0], 0), np.complex128)
    s0 = np.empty((y.shape[0], z.size), np.complex128)
    for i in range(at.size):
        rest = np.ascontiguousarray(y[:, at[i] :])
        m0, m1, m2 = grams(z, rest.shape[1])
        for ch in range(y.shape[0]):
            for a in range(z.size):
                s0[ch, a] = data_sums(rest[ch], np.conj(z[a]))[0]
        quiet = (weight * squares(np.ascontiguousarray(y[:, : at[i]]))).sum()
        found[i] = quiet + normal_equations(m0, m1, m2, s0, none, squares(rest), weight, 0)[0]
    return found


@dataclass(frozen=True, slots=True)
class _Onsets:
    """Samples at which modes may begin, the probability of each, and the modes from the end of a pulse there on."""

    at: NDArray[np.int64]
    probability: Real
    models: list[Model]


def _fitted_from(record: Record, model: Model, later: Model, at: NDArray[np.int64], pulse: int) -> _Onsets | None:
    """Modes fitted from each onset on; None if they begin with the record, at even odds of a decay and an impact."""
    samples, rises, models = [], [], []
    for k in at:
        whole, decay = _from(record, int(k)), _from(record, int(k) + pulse)
        begun = fitted(whole, later.poles, without_modes(whole))
        over = fitted(decay, later.poles, without_modes(decay))
        if begun is None or over is None or over.poles.size != later.poles.size:
            continue
        left = (record.y[:, :k] ** 2).sum(axis=1) + begun.left
        samples.append(int(k))
        rises.append(record.samples * float(np.log(np.maximum(model.left, 1e-300) / np.maximum(left, 1e-300)).sum()))
        models.append(over)
    if not samples:
        return None
    price = price_of_a_mode(*record.y.shape) * (later.poles.size - model.poles.size)
    spacing = float(np.median(np.diff(samples))) if len(samples) > 1 else 1.0
    log = 0.5 * (np.array(rises) - price)
    if float(np.logaddexp.reduce(log)) + np.log(spacing / (record.y.shape[1] / 2)) < 0:
        return None
    return _Onsets(np.array(samples), np.exp(log - np.logaddexp.reduce(log)), models)


def _averaged(record: Record, onsets: _Onsets, pulse: int, sample_rate_hz: float) -> Begun | None:
    """Modes from the most probable onset on, and what the others say of them."""
    best = int(np.argmax(onsets.probability))
    start, model = int(onsets.at[best]) + pulse, onsets.models[best]
    latest = int(np.searchsorted(np.cumsum(onsets.probability), LATE))
    over = int(onsets.at[min(latest, onsets.at.size - 1)]) + pulse
    price = price_of_a_mode(*_from(record, start).y.shape)
    told = [
        f"the modes begin {1e3 * (start - pulse) / sample_rate_hz:.3g} ms into the record, in its noise; a mode shows "
        f"there if its squares sum to more than {price:.0f} variances of the noise"
    ]
    s = np.log(model.poles)
    kept = worth_of(_from(record, start), model) * np.exp(2 * s.real * max(0, over - start))
    heard = kept > price
    for lost in s[~heard]:
        f = abs(lost) * sample_rate_hz / (2 * np.pi)
        told.append(
            f"an oscillation at {f:.3g} Hz has sunk in the noise when the impact is surely over, "
            f"{1e3 * over / sample_rate_hz:.3g} ms into the record: it may be part of the impact and is left out"
        )
    if not heard.any():
        return Begun(start, without_modes(_from(record, start)), s[:0], np.zeros((0, 2, 2)), tuple(told))
    logs = np.array([np.log(m.poles) for m in onsets.models])  # (K, J)
    mean = onsets.probability @ logs
    off = np.stack([(logs - mean).real, (logs - mean).imag], axis=-1)
    scatter = np.einsum("k,kja,kjb->jab", onsets.probability, off, off)
    if not heard.all():
        decay = _from(record, start)
        again = fitted(decay, model.poles[heard], without_modes(decay))
        if again is None:
            return None
        model = again
    return Begun(start, model, (mean - s)[heard], scatter[heard], tuple(told))
