"""The contest on a described rig: what has to be added to it so that recordings are foretold that took no part.

Blocks of the recordings fit, others choose, others are held out. Further mechanisms are added as long as the choosing
blocks get better by more than chance and by a share of all that the linear rig missed; a force of any shape is always
among the competitors, and where it takes away much that what is named leaves, nothing is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from analysis.mismatch.rigs.described import DescribedRig
from analysis.mismatch.rigs.estimate import Fitted, fit, residuals
from analysis.mismatch.rigs.recorded import CHOOSE, FIT, HELD, Recorded, level
from analysis.mismatch.rigs.regression import regressed
from analysis.mismatch.rigs.screening import Score, Screening, free_terms, screen
from analysis.mismatch.rigs.simulation import Placed, Simulation
from analysis.mismatch.rigs.start import start_values
from analysis.mismatch.rigs.steady import SteadyFit, Sweep, fit_sweeps
from sim_backend.mechanisms.mechanism import Mechanism
from sim_backend.modal_march import SLOTS

Real = NDArray[np.float64]

LEVEL: Final = 0.01  # of the test whether anything is missing
MOST_TERMS: Final = 3
POLISHED: Final = 3  # of them, fitted until they have converged
BOTH: Final = 4  # of them, held against steady responses too
FINALISTS: Final = 16  # mechanisms that are fitted in full
LEAST_SHARE: Final = 0.03  # of what the linear rig missed, that a mechanism must take away
LEFT_OVER: Final = 0.05  # of the same, that a force of any shape may still take away
CHANCE: Final = 0.05  # p-value of the choosing blocks' getting better
STRONGEST_START: Final = 30.0  # trial strengths that a fit begins with at most
TIE: Final = 4.0  # factor in misfit within which time is not preferred to amplitude where one decay cannot part them


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A mechanism in a round: fitted to the fitting blocks (``fitted``) with what was accepted before.

    ``misfit`` is the mean square on each choosing block, in levels of the channels, empty where it was only screened.
    """

    score: Score
    fitted: Fitted | None
    misfit: Real

    @property
    def id(self) -> str:
        """Name of the mechanism."""
        return self.score.term.mechanism.id

    @property
    def mean(self) -> float:
        """Mean square on the choosing blocks."""
        return float(np.mean(self.misfit)) if self.misfit.size else math.inf

    @property
    def rank(self) -> float:
        """``mean``, worse by `TIE` where it takes a parameter at the end of what is believable."""
        return self.mean * (TIE if self.fitted is not None and pinned(self.fitted) else 1.0)


@dataclass(frozen=True, slots=True)
class Round:
    """A step: what stood before, all entries (best first), and what was accepted.

    ``steady`` holds, where there are steady responses, the misfit to them of those held against them
    (`Steady.evidence`), by the entry's place among the entries.
    """

    before: Real
    screening: Screening
    entries: tuple[Entry, ...]
    accepted: Entry | None
    steady: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Steady:
    """Steady responses beside the recordings; ``linear`` is their fit without any mechanism."""

    rig: DescribedRig
    sweeps: tuple[Sweep, ...]
    linear: SteadyFit | None

    @classmethod
    def of(cls, rig: DescribedRig, sweeps: Sequence[Sweep]) -> Steady:
        """Fit the linear rig to the sweeps."""
        return cls(rig, tuple(sweeps), fit_sweeps(rig, sweeps) if sweeps else None)

    def with_terms(self, terms: Sequence[Placed]) -> SteadyFit:
        """Return the fit of mechanisms, from the values they have in the recordings on; time changes nothing here."""
        acting = [t for t in terms if t.mechanism.law is not None and not t.mechanism.with_time]
        if not acting and self.linear is not None:
            return self.linear
        return fit_sweeps(self.rig, self.sweeps, acting)

    def evidence(self, fitted: Fitted | None) -> float:
        """Return sweeps times the logarithm of their mean square error with a fit's mechanisms."""
        if fitted is None or self.linear is None:
            return 0.0
        return len(self.sweeps) * math.log(self.with_terms(fitted.terms).misfit)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came out.

    Attributes
    ----------
    rival
        Where amplitude and time are confounded: the best that goes with time.
    baseline, chosen
        The linear rig and the rig with what was named (None without), fitted to all but what is held out.
    free_misfit
        Mean squares on the choosing blocks with a force of any shape added to the best; NaN where not tried.
    best
        The best explanation there is, even where it does not explain enough.
    """

    rig: DescribedRig
    recordings: tuple[Recorded, ...]
    screening: Screening
    rounds: tuple[Round, ...]
    rival: Entry | None
    steady: Steady
    baseline: Fitted
    chosen: Fitted | None
    best: Fitted
    base_misfit: Real
    best_misfit: Real
    free_misfit: Real

    @property
    def p_value(self) -> float:
        """That the linear rig with its constants refitted made the recordings."""
        return self.screening.p_value

    @property
    def left_over(self) -> float:
        """Share of what the linear rig missed, that forces of any shape take away beside the best explanation."""
        free, best, base = (float(np.mean(m)) for m in (self.free_misfit, self.best_misfit, self.base_misfit))
        return max(best - free, 0.0) / max(base - free, 1e-300) if math.isfinite(free) else 0.0


def run(
    rig: DescribedRig,
    recordings: Sequence[Recorded],
    known: Sequence[Mechanism],
    progress: Callable[[str], None] = lambda stage: None,
    sweeps: Sequence[Sweep] = (),
) -> Outcome:
    """Find what the recordings hold beyond the linear rig.

    Parameters
    ----------
    sweeps
        Steady responses of the same rig, in which amplitude is at work without time.

    Raises
    ------
    AnalysisError
        The recordings cannot carry it.
    """
    progress("fitting the linear rig")
    baseline = linear_fit(rig, recordings)
    base = block_misfit(baseline, CHOOSE)
    progress("screening")
    screening = screen(baseline, known)
    current, misfit, rounds, rival = baseline, base, list[Round](), None
    steady = Steady.of(rig, sweeps)
    free = np.full(base.shape, math.nan)
    if screening.p_value < LEVEL:
        one_decay = confounded(recordings)
        current, misfit, rounds = _steps(baseline, base, screening, known, one_decay, steady, progress)
        rival = _in_time(rounds) if one_decay else None
        if rival is not None and rival.fitted is not None and _time_wins(misfit, current, rival, steady):
            current, misfit = rival.fitted, rival.misfit
            rounds = [replace(rounds[0], accepted=rival)]
        free = misfit
        if float(np.mean(misfit)) > LEFT_OVER * float(np.mean(base)):
            progress("trying forces of any shape")
            free = _free_misfit(current, misfit)
    progress("fitting once more with all that is not held out")
    all_but_held = (FIT, CHOOSE)
    final = fit(_again(baseline), all_but_held, fine=True)
    best = fit(_again(current), all_but_held, fine=True) if current.terms else final
    found = Outcome(
        rig, tuple(recordings), screening, tuple(rounds), rival, steady, final, None, best, base, misfit, free
    )
    return replace(found, chosen=best) if best.terms and found.left_over <= LEFT_OVER else found


def _steps(
    baseline: Fitted,
    base: Real,
    screening: Screening,
    known: Sequence[Mechanism],
    one_decay: bool,
    steady: Steady,
    progress: Callable[[str], None],
) -> tuple[Fitted, Real, list[Round]]:
    """Add mechanisms one by one; where all there is is one decay, those that go with amplitude."""
    current, misfit, rounds = baseline, base, list[Round]()
    while len(current.terms) < MOST_TERMS:
        entries = _full_fits(current, screening, progress)
        allowed = [e for e in entries if e.fitted is not None and not (one_decay and e.score.term.mechanism.with_time)]
        held: dict[int, float] = {}
        if steady.sweeps and allowed:
            progress("holding the best against the steady responses")
            held = {entries.index(e): steady.evidence(e.fitted) for e in allowed[:BOTH]}
            place = min(held, key=lambda i: entries[i].misfit.size * math.log(entries[i].rank) + held[i])
            allowed = [entries[place]]
        best = allowed[0] if allowed else None
        enough = best is not None and _better(base, misfit, best.misfit)
        rounds.append(Round(misfit, screening, entries, best if enough else None, held))
        if best is None or best.fitted is None or not enough:
            break
        current, misfit = best.fitted, best.misfit
        if float(np.mean(misfit)) < LEAST_SHARE * float(np.mean(base)):
            break  # nothing further could take away a share that counts
        progress("looking at what is left")
        screening = screen(current, [m for m in known if not (one_decay and m.with_time)])
    return current, misfit, rounds


def pinned(fitted: Fitted) -> bool:
    """Whether a parameter of a mechanism ends at a bound of its range."""
    for number, term in enumerate(fitted.terms):
        for q in term.mechanism.parameters:
            knob, x, _ = fitted.knob(number, q.name)
            if any(math.isfinite(bound) and abs(x - bound) < 1e-6 * max(abs(bound), 1.0) for bound in knob.bounds):
                return True
    return False


def _time_wins(misfit: Real, current: Fitted, rival: Entry, steady: Steady) -> bool:
    """Whether a change with time explains more than what goes with amplitude; by far, where one decay is all."""
    if not steady.sweeps:
        return float(np.mean(misfit)) > TIE * rival.mean
    size = misfit.size
    amplitude = size * math.log(float(np.mean(misfit))) + steady.evidence(current)
    return amplitude > size * math.log(rival.mean) + steady.evidence(rival.fitted)


def _in_time(rounds: Sequence[Round]) -> Entry | None:
    """Return the best of the entries that go with time, of the first round."""
    fitted = [e for e in rounds[0].entries if e.fitted is not None and e.score.term.mechanism.with_time]
    return fitted[0] if fitted else None


def linear_fit(rig: DescribedRig, recordings: Sequence[Recorded], parts: Sequence[int] = (FIT,)) -> Fitted:
    """Return the linear rig fitted to the recordings."""
    values, highest = start_values(rig, list(recordings))
    states = [first_state(rig, r, values, highest) for r in recordings]
    simulation = Simulation(rig, recordings, values, highest, states)
    return fit(simulation, parts, staged=any(r.free for r in recordings), fine=True)


def first_state(rig: DescribedRig, recorded: Recorded, values: dict[str, float], highest_hz: float) -> Real:
    """Return the state (2n,) that the linear rig must have had for the first periods, by linear least squares."""
    n = len(rig.arrangement.bodies)
    if not recorded.free:
        return np.zeros(2 * n)
    count = min(max(round(4 * recorded.rate_hz / highest_hz), 40), recorded.samples - 2 * recorded.edge)
    window = slice(recorded.edge, recorded.edge + count)
    columns = []
    unit = Simulation(rig, [recorded], values, highest_hz, [np.zeros(2 * n)])
    for j in range(2 * n):
        state = np.zeros(2 * n)
        state[j] = 1.0 if j < n else 2 * math.pi * highest_hz
        moved = unit.with_terms((), values, [state])
        shown, _ = moved.run(moved.begin(), 0, samples=window.stop + recorded.edge + 2)
        columns.append((shown[:, window] / level(recorded)[:, None]).ravel())
    target = (recorded.outputs[:, window] / level(recorded)[:, None]).ravel()
    found = np.linalg.lstsq(np.stack(columns, axis=1), target, rcond=1e-6)[0]
    found[n:] *= 2 * math.pi * highest_hz
    return np.asarray(found, np.float64)


def _again(fitted: Fitted) -> Simulation:
    return fitted.simulation.with_terms(fitted.terms, fitted.constants, fitted.states)


def block_misfit(fitted: Fitted, part: int) -> Real:
    """Return the mean square of the residual on each block of a part, in levels of the channels."""
    found = []
    for number, recorded in enumerate(fitted.simulation.recordings):
        off, at = residuals(fitted.simulation, fitted.x, number)
        kept, block = recorded.part[at] == part, recorded.block[at]
        found += [float(np.mean(off[:, kept & (block == b)] ** 2)) for b in np.unique(block[kept])]
    return np.array(found)


def _better(base: Real, before: Real, after: Real) -> bool:
    """Whether choosing blocks got better by more than chance, and by enough of what the linear rig missed."""
    gained = float(np.mean(before) - np.mean(after))
    missed = float(np.mean(base) - np.mean(after))
    if gained <= 0 or gained < LEAST_SHARE * missed:
        return False
    change = np.log(before / after)
    spread = float(np.std(change, ddof=1)) / math.sqrt(change.size)
    p = float(student.sf(float(np.mean(change)) / max(spread, 1e-300), change.size - 1))
    return p < CHANCE


def _full_fits(current: Fitted, screening: Screening, progress: Callable[[str], None]) -> tuple[Entry, ...]:
    best: dict[tuple[str, int], Score] = {}
    for score in screening.scores:
        best.setdefault((score.term.mechanism.id, score.term.place), score)
    ranked = list(best.values())
    # far from the truth a score test says little of size and sign: what is small in it may be large in full
    entries = []
    for score in ranked[:FINALISTS]:
        progress(f"fitting {score.term.mechanism.id.replace('_', ' ')}")
        fitted = _joined(current, score)
        entries.append(Entry(score, fitted, block_misfit(fitted, CHOOSE)))
    done = {id(e.score) for e in entries}
    entries.sort(key=lambda e: e.rank)
    for place, entry in enumerate(entries[:POLISHED]):
        if entry.fitted is not None:
            polished = fit(_again(entry.fitted), fine=True)
            entries[place] = Entry(entry.score, polished, block_misfit(polished, CHOOSE))
    entries.sort(key=lambda e: e.rank)
    return (*entries, *(Entry(s, None, np.zeros(0)) for s in ranked if id(s) not in done))


def _joined(current: Fitted, score: Score) -> Fitted:
    """Fit a mechanism together with what stands already, from several starts."""
    m, values = score.term.mechanism, dict(score.term.values)
    if m.strength is not None:
        factor = math.copysign(min(max(abs(score.strength), 0.1), STRONGEST_START), score.strength)
        q = next(q for q in m.parameters if q.name == m.strength)
        values[m.strength] = min(max(values[m.strength] * factor, q.low), q.high)
    term = Placed(m, values, score.term.place)
    begun = current.simulation.with_terms((*current.terms, term), current.constants, current.states)
    tried = [fit(begun)]
    if not current.terms and any(r.free for r in current.simulation.recordings):
        tried.append(fit(begun, staged=True))  # the linear rig has lost the phase somewhere along the decay
    start = regressed(current.simulation, current.constants, (*current.terms, term))
    if start is not None:
        tried.append(fit(current.simulation.with_terms(start[1], start[0], current.states)))
    return min(tried, key=lambda f: f.scatter)


def confounded(recordings: Sequence[Recorded]) -> bool:
    """Whether amplitude and time go together in all there is: one free decay."""
    return len(recordings) == 1 and recordings[0].free


def _free_misfit(current: Fitted, before: Real) -> Real:
    """Return the choosing blocks' mean squares with forces of any shape added; no worse than before."""
    added = free_terms(current, min(2, SLOTS - len(current.terms)))
    if not added:
        return before
    begun = current.simulation.with_terms((*current.terms, *added), current.constants, current.states)
    misfit = block_misfit(fit(begun), CHOOSE)
    return misfit if float(np.mean(misfit)) < float(np.mean(before)) else before


def held_out_rms(fitted: Fitted) -> tuple[float, dict[str, float], int]:
    """Return the error on what was held out, in the recordings' unit: all, by declared stretch, how many pieces.

    The recordings are simulated from end to end: nothing is refitted on what was held out.
    """
    total, count, pieces = 0.0, 0, 0
    named: dict[str, list[float]] = {}
    for number, recorded in enumerate(fitted.simulation.recordings):
        off, at = residuals(fitted.simulation, fitted.x, number, whole=True)
        off = off * level(recorded)[:, None]
        part = recorded.part[at]
        kept = part == HELD
        total, count = total + float(np.sum(off[:, kept] ** 2)), count + int(kept.sum()) * len(off)
        pieces += len(recorded.stretches) or np.unique(recorded.block[at][kept]).size
        for name, where in recorded.stretches:
            named.setdefault(name, []).append(float(np.mean(off[:, where] ** 2)))
    return (
        math.sqrt(total / count) if count else math.nan,
        {name: math.sqrt(float(np.mean(v))) for name, v in named.items()},
        pieces,
    )
