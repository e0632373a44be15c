"""Where the free decay of any recording begins: at its first sample, or where the impact in it has ended.

What may be the pulse is not fitted. The modes are counted from a sample on that is surely late, then from earlier
ones, each half as far from the onset, as long as what is found continues: the same modes at each, modes more only if
they had sunk in the noise by the later sample, and nothing left over in between. From the earliest the fit is continued
backwards and begins where that continuation and the record part. A pulse can be made of a few oscillations, too; they
are heard for hardly a period, and none of them is taken for a mode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.modal.counted_modes import CROWD, PERIODS, CountedModes, agree, continues, counted_from, fitted_from
from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.later_impact import end_before_an_impact, ends
from analysis.modal.model_order import groups, is_white, without_slices
from analysis.modal.pulse_end import innovations, samples_before
from analysis.modal.ring_down_model import Model, Recorded, fitted, without_modes

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SOON_S = 1e-3  # that a pulse is expected to last
EARLY = 0.125  # of what is recorded after the onset, by which the decay has to begin where something slow goes on, too
LATEST = 0.5  # of what is recorded after the onset, by which impacts are over
FIRST = 4  # samples after the onset: the earliest start
TAIL = 0.5  # of a pulse that is seen, that may follow unseen
SPARED = 0.2  # of the energy of the fastest mode, that is given up for it
MOVES = 6  # of the start, each by a quarter of the pulse
LEAST = 24  # samples of free decay
CLIPPED = 0.1  # of its samples, from which on a decay is not taken to end at an impact


@dataclass(frozen=True, slots=True)
class FreeDecay:
    """The free decay in a recording.

    Attributes
    ----------
    recorded
        What it is a part of, up to its end.
    start
        Its first sample.
    model
        Its modes.
    scatter
        (J, 2, 2) covariance of real and imaginary part of the logarithms of their poles, by what is not known of its
        onset and by what changes along it.
    shift
        (J,) by which these logarithms, averaged over all onsets that are possible, differ from the model's.
    settled
        Whether its modes are the same however late one begins.
    notes
        Sentences for the reader.
    """

    recorded: Recorded
    start: int
    model: Model
    scatter: Real
    shift: Complex
    settled: bool = False
    notes: tuple[str, ...] = ()

    def with_model(self, model: Model) -> FreeDecay:
        """The same from the same sample on, with other modes."""
        return replace(decay_with(self.recorded, self.start, model), notes=self.notes)

    @property
    def counted(self) -> CountedModes:
        """The same as modes of a record."""
        return CountedModes(self.start, self.recorded.stretch(self.start, self.model.residual.shape[1]), self.model)

    @property
    def clipped(self) -> float:
        """Share of its samples that say nothing."""
        record = self.counted.record
        return record.missing.size / record.y.shape[1]

    @property
    def tells(self) -> float:
        """How much of its modes a decay tells: e-folds of energy over what a mode costs."""
        if self.model.fit is None:
            return 0.0
        counted = self.counted
        return float(np.log(np.maximum(counted.worth / counted.price, 1.0)).sum())

    @property
    def crowded(self) -> bool:
        """Whether its modes may be made of a step along the record: many beside each other."""
        return any(len(g) >= CROWD for g in groups(self.model.poles, self.model.residual.shape[1]))

    @property
    def doubtful(self) -> bool:
        """Whether its modes are none, crowded, or leave more than noise."""
        return self.model.fit is None or self.crowded or not is_white(self.counted.record, self.model)


def decay_with(recorded: Recorded, start: int, model: Model) -> FreeDecay:
    """A decay whose beginning is known."""
    j = model.poles.size
    return FreeDecay(recorded, start, model, np.zeros((j, 2, 2)), np.zeros(j, np.complex128))


def from_the_impact_on(
    recorded: Recorded, onset: int, sample_rate_hz: float, longest: int, unseen: bool = False
) -> FreeDecay:
    """Modes of the free decay after an impact, from the sample on at which its pulse has ended.

    Parameters
    ----------
    recorded
        What was recorded.
    onset
        Of the impact, from `impact_onset`; where there is none, the first sample that may be used.
    sample_rate_hz
        Samples a second.
    longest
        Samples by which the modes are counted.
    unseen
        Whether no impact begins at ``onset``: the record may begin with the decay as well as within the impact.
    """
    found = _searched(recorded, onset, sample_rate_hz, longest, unseen)
    soon = onset + EARLY * (recorded.y.shape[1] - onset)
    if not found.settled or found.start > soon:  # something slow may go on beside the modes
        slow = _searched(replace(recorded, slow=True), onset, sample_rate_hz, longest, unseen)
        more = not found.settled or slow.tells > found.tells
        found = slow if slow.settled and slow.start <= soon and more else found
    late = found.start - onset > SOON_S * sample_rate_hz
    if late or not found.settled or found.doubtful:
        found = _before_an_impact(recorded, onset, sample_rate_hz, longest, unseen, found)
    return found


def _before_an_impact(
    recorded: Recorded, onset: int, sample_rate_hz: float, longest: int, unseen: bool, whole: FreeDecay
) -> FreeDecay:
    """The free decay up to a later impact, where there is one and it tells more than the whole."""
    recorded = whole.recorded if whole.settled else recorded
    best = whole
    explained: list[tuple[int, int]] = []
    for end in ends(recorded.y.shape[1], onset):
        part = _searched(recorded.until(end), onset, sample_rate_hz, longest, unseen)
        if not part.settled or part.clipped > CLIPPED:
            continue  # where a converter's limit shapes the record, it ends at once, too
        last = end_before_an_impact(recorded, part.counted)
        # a longer part whose modes leave noise holds nothing sudden, whatever a few first samples seem to tell
        if last is None or any(first < last < after for first, after in explained):
            explained.append((part.counted.start, end))
            continue
        found = _searched(recorded.until(last), onset, sample_rate_hz, longest, unseen)
        certain = best.settled and not (best is whole and whole.crowded)
        if not found.settled or (certain and found.tells < best.tells):
            continue
        told = UNTIL.format(1e3 * (last - onset) / sample_rate_hz)
        best = replace(found, notes=(*found.notes, told))
    return best


UNTIL = (
    "something sudden happens {:.3g} ms after the onset of the impact, a second one perhaps: the modes are those of "
    "the decay before it"
)


def _searched(recorded: Recorded, onset: int, sample_rate_hz: float, longest: int, unseen: bool) -> FreeDecay:
    """As `from_the_impact_on`, of a decay that lasts to the end of the record."""

    def found(start: int, model: Model, told: list[str], settled: bool = False) -> FreeDecay:
        return replace(decay_with(recorded, start, model), settled=settled, notes=tuple(told))

    starts = _starts(recorded.y.shape[1], onset)
    if unseen:
        starts = [onset, *starts]
    chosen, last = _earliest(recorded, starts, longest)
    if chosen is None and last.start > onset and last.model.fit is not None:
        # decays of which no part is like another, or an impact that is not over: from where it should be
        start = min((k for k in starts if k - onset >= SOON_S * sample_rate_hz), default=last.start)
        last = counted_from(recorded, start, None, longest)
        if (last.periods > PERIODS).any():
            heard = _heard(recorded, last)
            told = NEVER_THE_SAME.format(1e3 * (start - onset) / sample_rate_hz)
            return found(start, without_slices(heard.record, heard.model, white=False), [told])
    if chosen is None and last.start == onset and last.model.poles.size == 1:
        return found(last.start, last.model, [HARDLY_HEARD])  # and nothing else is heard that it could be the impact of
    if chosen is None:
        record = recorded.stretch(last.start, longest)
        return found(last.start, without_modes(record), [NONE_HEARD] if last.model.fit is not None else [])
    if chosen.start > onset:
        back = _reach(recorded, onset, chosen)
        chosen = fitted_from(recorded, chosen.start - back, chosen) or chosen
        chosen = _heard(recorded, _past_the_tail(recorded, onset, chosen))
    told_of = _told(chosen.start, onset, unseen, sample_rate_hz)
    return found(chosen.start, chosen.model, told_of, settled=chosen.model.fit is not None)


def _heard(recorded: Recorded, begun: CountedModes) -> CountedModes:
    """The same without modes that have sunk by a later start: what little is left of them may be anything."""
    heard = begun.periods > PERIODS
    if heard.all() or not heard.any():
        return begun
    record = recorded.stretch(begun.start, begun.record.y.shape[1])
    less = fitted(record, begun.model.poles[heard], without_modes(record))
    return begun if less is None else CountedModes(begun.start, record, less)


def _past_the_tail(recorded: Recorded, onset: int, begun: CountedModes) -> CountedModes:
    """Modes from where what is not seen of a pulse is over, too, as far as the modes can spare the samples."""
    last = recorded.y.shape[1] - LEAST

    def moved(to: int, by: int) -> CountedModes | None:
        return fitted_from(recorded, to + by, begun) if to + by <= last else None

    fastest = float(np.max(-2 * np.log(begun.model.poles).real))
    spare = -np.log1p(-SPARED) / max(fastest, 1e-300)
    now = moved(begun.start, int(min(TAIL * (begun.start - onset), spare))) or begun
    for _ in range(MOVES):
        step = max(1, (now.start - onset) // 4)
        later = [moved(now.start, k * step) for k in (1, 2, 4, 8)]
        if later[0] is None or all(agree(now, other) for other in later if other is not None):
            break
        now = later[0]
    return now


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


def _earliest(recorded: Recorded, starts: list[int], longest: int) -> tuple[CountedModes | None, CountedModes]:
    """Modes from the earliest start from which on a record is a free decay, if any; and from the last one tried."""
    later = counted_from(recorded, starts[-1], None, longest)
    chosen: CountedModes | None = None
    parted: CountedModes | None = None
    for start in reversed(starts[:-1]):
        now = counted_from(recorded, start, later.model, longest)
        if not continues(now, later):
            if parted is not None:
                break
            parted = now  # by chance, if from a still earlier start the modes are the same again
            continue
        parted = None
        if chosen is None and later.are_modes:
            chosen = later
        chosen = now if now.are_modes else chosen
        later = now
    if parted is not None:
        return chosen, later if chosen is not None else parted
    return chosen or (later if later.are_modes else None), later


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


def _reach(recorded: Recorded, onset: int, begun: CountedModes) -> int:
    """How many samples a fit can be continued backwards: judged on the strongest common motion of the channels."""
    y, safe, model, known = recorded.y, begun.start, begun.model, begun.record.known
    scaled = y / np.sqrt(np.maximum(model.modes.noise_variance, 1e-300))[:, None]
    direction = np.linalg.eigh(scaled[:, safe:] @ scaled[:, safe:].T)[1][:, -1]
    one = direction @ scaled
    later = recorded.clipped[recorded.clipped >= safe]
    try:
        fit = fit_exponentials(one[safe:][None], model.poles, known, missing=later - safe)
    except (FitFailure, np.linalg.LinAlgError):
        return 0
    before = recorded.clipped[(recorded.clipped < safe) & (recorded.clipped >= onset)]
    trigger = int(before.max()) if before.size else onset
    scores = innovations(one, trigger, safe, fit, known, 1.0, later)
    return samples_before([scores], safe - trigger)[0]
