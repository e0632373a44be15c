"""Where the free decay of any recording begins: at its first sample, or where the impact in it has ended.

What may be the pulse is not fitted. The modes are counted from a sample on that is surely late, then from earlier
ones, each half as far from the onset, as long as what is found continues: the same modes at each, modes more only if
they had sunk in the noise by the later sample, and nothing left over in between. From the earliest the fit is continued
backwards and begins where that continuation and the record part. A pulse can be made of a few oscillations, too; they
are heard for hardly a period, and none of them is taken for a mode.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.model_order import groups, modes_of, price_of_a_mode, without_slices
from analysis.modal.pulse_end import innovations, samples_before
from analysis.modal.ring_down_model import LEAST_LEFT, Model, Record, fitted, record_from, without_modes, worth_of

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SOON_S = 1e-3  # that a pulse is expected to last
LATEST = 0.5  # of what is recorded after the onset, by which impacts are over
FIRST = 4  # samples after the onset: the earliest start
CHANGED = 1e-4  # chance of what differs between the modes from two starts, below which they are not the same
PERIODS = 0.6  # that a mode is heard at least: of 111 starts within pulses 8 show only oscillations that are heard for
# more; of 29 modes of 15 to 30 % damping in free decays all are
TAIL = 0.5  # of a pulse that is seen, that may follow unseen
SPARED = 0.2  # of the energy of the fastest mode, that is given up for it
MOVES = 6  # of the start, each by a quarter of the pulse
TAIL_SEEN = 0.02  # chance of what a mode from two starts differs by, below which the earlier is within the pulse
SUNK = 1.5  # exponent of the energy that a mode loses between two starts, beyond which the later says little
CROWD = 3  # modes within each other's width that appear at once: a step along the record is made of them (a second hit)
SURELY_HEARD = 3.0  # times what a mode costs, at which it is found
LEAST = 24  # samples of free decay
LEAST_APART = 1e-3  # of a variance, by which it differs between two starts
CURVED = 3.0  # relative errors of a decay, by which its variance is uncertain


@dataclass(frozen=True, slots=True)
class _Counted:
    """Modes of a record from one sample on."""

    start: int
    record: Record
    model: Model

    @property
    def price(self) -> float:
        """What a mode costs, in variances of the noise."""
        return price_of_a_mode(*self.record.y.shape)

    @property
    def worth(self) -> Real:
        """Energy of each mode, in variances of the noise."""
        return worth_of(self.record, self.model) if self.model.fit is not None else np.zeros(0)

    @property
    def periods(self) -> Real:
        """Periods of each mode until it sinks in the noise; those of a faint one while its amplitude falls to 0.6."""
        s = np.log(self.model.poles)
        e_folds = np.maximum(np.log(np.maximum(self.worth / self.price, 1e-300)), 1.0) / 2
        heard: Real = np.minimum(e_folds / np.maximum(-s.real, 1e-300), self.record.y.shape[1]) * s.imag / (2 * np.pi)
        return heard

    @property
    def are_modes(self) -> bool:
        """Whether there are modes, and all are heard for longer than what a pulse is made of."""
        return self.model.fit is not None and bool((self.periods > PERIODS).all())

    @property
    def rounding(self) -> float:
        """Factor by which rounding errors exceed the noise, or 1."""
        energy, left = (self.record.y**2).sum(), self.model.left.sum()
        return float(max(1.0, LEAST_LEFT * energy / max(left, 1e-300)))


def from_the_impact_on(
    y: Real, onset: int, clipped: NDArray[np.int64], sample_rate_hz: float, longest: int, unseen: bool = False
) -> tuple[int, Model, list[str]]:
    """Modes of the free decay after an impact, from the sample on at which its pulse has ended.

    Parameters
    ----------
    y
        (c, n) record.
    onset
        Of the impact, from `impact_onset`; where there is none, the first sample that may be used.
    clipped
        Samples that say nothing.
    sample_rate_hz
        Samples a second.
    longest
        Samples by which the modes are counted.
    unseen
        Whether no impact begins at ``onset``: the record may begin with the decay as well as within the impact.

    Returns
    -------
    start, model, notes
        First sample used, the modes from there on, and sentences for the reader.
    """
    starts = _starts(y.shape[1], onset)
    if unseen:
        starts = [onset, *starts]
    chosen, last = _earliest(y, starts, clipped, longest)
    if chosen is None and last.start > onset and last.model.fit is not None:
        # decays of which no part is like another, or an impact that is not over: from where it should be
        start = min((k for k in starts if k - onset >= SOON_S * sample_rate_hz), default=last.start)
        last = _counted_from(y, start, None, clipped, longest)
        if (last.periods > PERIODS).any():
            told = NEVER_THE_SAME.format(1e3 * (start - onset) / sample_rate_hz)
            heard = _heard(y, last, clipped)
            return start, without_slices(heard.record, heard.model, white=False), [told]
    if chosen is None and last.start == onset and last.model.poles.size == 1:
        return last.start, last.model, [HARDLY_HEARD]  # and nothing else is heard that it could be the impact of
    if chosen is None:
        record = record_from(y, last.start, clipped, longest)
        return last.start, without_modes(record), [NONE_HEARD] if last.model.fit is not None else []
    if chosen.start > onset:
        back = _reach(y, onset, chosen.start, chosen.model, clipped)
        chosen = _fitted_from(y, chosen.start - back, chosen, clipped) or chosen
        chosen = _heard(y, _past_the_tail(y, onset, chosen, clipped), clipped)
    return chosen.start, chosen.model, _told(chosen.start, onset, unseen, sample_rate_hz)


def _heard(y: Real, begun: _Counted, clipped: NDArray[np.int64]) -> _Counted:
    """The same without modes that have sunk by a later start: what little is left of them may be anything."""
    heard = begun.periods > PERIODS
    if heard.all() or not heard.any():
        return begun
    record = record_from(y, begun.start, clipped, begun.record.y.shape[1])
    less = fitted(record, begun.model.poles[heard], without_modes(record))
    return begun if less is None else _Counted(begun.start, record, less)


def _past_the_tail(y: Real, onset: int, begun: _Counted, clipped: NDArray[np.int64]) -> _Counted:
    """Modes from where what is not seen of a pulse is over, too, as far as the modes can spare the samples."""
    last = y.shape[1] - LEAST

    def moved(to: int, by: int) -> _Counted | None:
        return _fitted_from(y, to + by, begun, clipped) if to + by <= last else None

    fastest = float(np.max(-2 * np.log(begun.model.poles).real))
    spare = -np.log1p(-SPARED) / max(fastest, 1e-300)
    now = moved(begun.start, int(min(TAIL * (begun.start - onset), spare))) or begun
    for _ in range(MOVES):
        step = max(1, (now.start - onset) // 4)
        later = [moved(now.start, k * step) for k in (1, 2, 4, 8)]
        if later[0] is None or all(_agree(now, other) for other in later if other is not None):
            break
        now = later[0]
    return now


def _fitted_from(y: Real, start: int, begun: _Counted, clipped: NDArray[np.int64]) -> _Counted | None:
    """The same modes, fitted from another sample on; None if that fails."""
    record = record_from(y, start, clipped, begun.record.y.shape[1])
    model = fitted(record, begun.model.poles, without_modes(record))
    return None if model is None or model.poles.size != begun.model.poles.size else _Counted(start, record, model)


def _agree(now: _Counted, later: _Counted) -> bool:
    """Whether the modes from a start are those from a later one, as far as these have not sunk."""
    here, there = np.log(now.model.poles), np.log(later.model.poles)
    own, other = optimize.linear_sum_assignment(np.abs(here[:, None] - there))
    rounding = max(now.rounding, later.rounding)
    for i, j in zip(own, other, strict=True):
        if -2 * here[i].real * (later.start - now.start) > SUNK:
            continue
        if _differ(now, later, int(i), int(j)) > stats.chi2.isf(TAIL_SEEN, 2) * rounding:
            return False
    return True


def _differ(now: _Counted, later: _Counted, i: int, j: int) -> float:
    """Squared distance of a mode from two starts, in what they may differ by: of one model, Hausman's (1978)."""
    here, there = np.log(now.model.poles[i]), np.log(later.model.poles[j])
    covariance, own = later.model.modes.log_pole_covariance[j], now.model.modes.log_pole_covariance[i]
    if not np.linalg.eigvalsh(covariance)[0] > 1e-12 * np.trace(covariance):
        return float("inf")  # it is no pole of what is there
    root = np.linalg.cholesky(covariance)
    off = np.linalg.solve(root, [(here - there).real, (here - there).imag])
    share = np.linalg.solve(root, np.linalg.solve(root, own).T)
    same = now.model.poles.size == later.model.poles.size
    values, axes = np.linalg.eigh(np.eye(2) - share if same else np.eye(2) + share)
    # a covariance is as uncertain as the pole that it is of
    least = LEAST_APART + CURVED * np.sqrt(np.trace(covariance)) / abs(there.real)
    return float(((axes.T @ off) ** 2 / np.maximum(values, least)).sum())


NONE_HEARD = (
    f"nothing is heard for {PERIODS:g} periods: what there is may be an impact as well as a mode that decays so fast "
    "(say when the free decay begins, if that is known)"
)
NEVER_THE_SAME = (
    "the modes are others from whichever sample one begins: they change along the decay, or the impact is not over; "
    "they are used from {:.2g} ms after its onset on"
)
HARDLY_HEARD = f"the mode is heard for less than {PERIODS:g} periods: it may be an impact as well"


def _starts(samples: int, onset: int) -> list[int]:
    """Samples after an onset by which its pulse may be over, each about twice as far from it as the one before."""
    latest = int(min(LATEST * (samples - onset), samples - onset - LEAST))
    away = [max(0, min(FIRST, latest))]
    while 2 * away[-1] <= latest and away[-1] > 0:
        away.append(2 * away[-1])
    return [onset + k for k in (*away, *([latest] if latest > away[-1] else []))]


def _earliest(y: Real, starts: list[int], clipped: NDArray[np.int64], longest: int) -> tuple[_Counted | None, _Counted]:
    """Modes from the earliest start from which on a record is a free decay, if any; and from the last one tried."""
    later = _counted_from(y, starts[-1], None, clipped, longest)
    chosen: _Counted | None = None
    for start in reversed(starts[:-1]):
        now = _counted_from(y, start, later.model, clipped, longest)
        if not _continues(now, later):
            return chosen, later if chosen is not None else now
        if chosen is None and later.are_modes:
            chosen = later
        chosen = now if now.are_modes else chosen
        later = now
    return chosen or (later if later.are_modes else None), later


def _counted_from(y: Real, start: int, begun: Model | None, clipped: NDArray[np.int64], longest: int) -> _Counted:
    """Modes from a sample on, beginning with those of a model."""
    record = record_from(y, start, clipped, longest)
    if begun is None or begun.fit is None:
        return _Counted(start, record, modes_of(record))
    return _Counted(start, record, modes_of(record, fitted(record, begun.poles, without_modes(record))))


def _continues(now: _Counted, later: _Counted) -> bool:
    """Whether the modes from one start are those from a later one, and nothing else is in between."""
    apart = later.start - now.start
    limit = float(stats.chi2.isf(CHANGED, 2))
    here, there = np.log(now.model.poles), np.log(later.model.poles)
    own, other = optimize.linear_sum_assignment(np.abs(here[:, None] - there))
    rounding = max(now.rounding, later.rounding)
    same_here, same_there = np.zeros(here.size, np.bool_), np.zeros(there.size, np.bool_)
    for i, j in zip(own, other, strict=True):
        same_here[i] = same_there[j] = _differ(now, later, int(i), int(j)) < limit * rounding
    sunk = now.worth * np.exp(2 * here.real * apart) < SURELY_HEARD * now.price
    faint = later.worth < SURELY_HEARD * later.price
    if not ((same_here | sunk).all() and (same_there | faint).all()):
        return False
    more = now.model.poles[~same_here]
    if any(len(group) >= CROWD for group in groups(more, now.record.y.shape[1])):
        return False  # that is what a step along the record is made of
    between = now.record.samples * (now.model.residual[:, :apart] ** 2).sum(axis=1) / np.maximum(now.model.left, 1e-300)
    noise = float(stats.chi2.isf(CHANGED, between.size * apart))
    return bool(between.sum() < noise * rounding)


def _told(start: int, onset: int, unseen: bool, sample_rate_hz: float) -> list[str]:
    """Sentences about where the decay is used from."""
    if unseen and start > onset:
        return [
            f"the record begins with more than its modes, an impact perhaps: they are used from "
            f"{1e3 * start / sample_rate_hz:.2g} ms on (say when the free decay begins, if that is known)"
        ]
    if start - onset > SOON_S * sample_rate_hz:
        return [
            f"the decay is used from {1e3 * (start - onset) / sample_rate_hz:.2g} ms after the onset of the impact: "
            "from there on the modes are the same however late one begins"
        ]
    return []


def _reach(y: Real, onset: int, safe: int, model: Model, clipped: NDArray[np.int64]) -> int:
    """How many samples a fit can be continued backwards: judged on the strongest common motion of the channels."""
    scaled = y / np.sqrt(np.maximum(model.modes.noise_variance, 1e-300))[:, None]
    direction = np.linalg.eigh(scaled[:, safe:] @ scaled[:, safe:].T)[1][:, -1]
    one = direction @ scaled
    known = np.ones(1, np.complex128)

    later = clipped[clipped >= safe]
    try:
        fit = fit_exponentials(one[safe:][None], model.poles, known, missing=later - safe)
    except (FitFailure, np.linalg.LinAlgError):
        return 0
    before = clipped[(clipped < safe) & (clipped >= onset)]
    trigger = int(before.max()) if before.size else onset
    scores = innovations(one, trigger, safe, fit, known, 1.0, later)
    return samples_before([scores], safe - trigger)[0]
