"""From recordings of a described rig to the answer: what was left out, where, how sure, and what would settle it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from threadpoolctl import threadpool_limits

from analysis.mismatch.diagnosis import Location, Named, NextExperiment
from analysis.mismatch.intervals import NORMAL_95, Interval
from analysis.mismatch.rigs.contest import LEFT_OVER, LEVEL, TIE, Entry, Outcome, Round, confounded, held_out_rms, run
from analysis.mismatch.rigs.described import DescribedRig
from analysis.mismatch.rigs.estimate import Fitted, residuals
from analysis.mismatch.rigs.recorded import HELD, UNUSED, Recorded, level, prepare
from analysis.mismatch.rigs.screening import innovation
from analysis.mismatch.rigs.steady import Sweep
from analysis.session import AnalysisError
from daq.errors import one_line
from daq.exchange import Recording
from sim_backend.mechanisms.mechanism import Mechanism

Real = NDArray[np.float64]

SOMETHING_ELSE: Final = -12.0  # evidence of what is not listed where nothing is left over
CERTAIN: Final = -6.0  # evidence against an explanation, beside steady responses, from which on it is told apart
ALIKE: Final = 2.0  # factor in misfit within which two explanations count as alike
CLOSE: Final = 10.0  # factor in misfit within which an explanation is a rival that an experiment should rule out
MOSTLY: Final = 0.1  # of what the linear rig misses, that a rival in time may leave to count as an equal
MOST_ENERGY: Final = 0.9  # of a residual, by which it is located
AMPLITUDES: Final = 12  # at which frequency and damping of a decay are read
FADED: Final = 0.02  # of the largest amplitude, below which they are not
LEAST_PER_POINT: Final = 2.0  # periods
FORETOLD: Final = 10.0  # error over what is unforeseeable of it: noise that wanders (a pole at 0.99) makes it 7 to 9.4
MISSED: Final = (
    0.5  # of a channel's rms; wrong constants that no score test sees miss 0.97 or more, sound rigs their noise
)
STRONGER: Final = 3.0  # tap over the one made, that parts amplitude from time


@dataclass(frozen=True, slots=True)
class AtAmplitude:
    """Frequency (Hz) and damping ratio of a decay about one amplitude, in the channel's unit, and when (s)."""

    time_s: float
    amplitude: float
    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class RigDiagnosis:
    """The answer; ``outcome`` holds all that is behind it.

    Attributes
    ----------
    noise_rms, rms_before, rms_after
        In ``unit``: what nothing can foretell; held-out error of the linear rig and of the rig with what was named.
    stretches
        Error before and after on each declared held-out stretch.
    decay
        Of a decay of one body: frequency and damping against amplitude.
    far_off
        Whether the rig as described misses so much that its own constants must be wrong; see `_far_off`.
    steady_before, steady_after
        Relative force error on held-out sweeps; None without sweeps.
    """

    source: str
    verdict: str
    p_value: float
    mechanisms: tuple[Named, ...]
    location: Location | None
    unit: str
    noise_rms: float
    rms_before: float
    rms_after: float | None
    held_out: int
    stretches: dict[str, tuple[float, float | None]]
    decay: tuple[AtAmplitude, ...]
    steady_before: float | None
    steady_after: float | None
    next_experiment: NextExperiment | None
    outcome: Outcome
    far_off: bool = False


def diagnose_rig(
    rig: DescribedRig,
    recordings: Sequence[Recording],
    known: Sequence[Mechanism],
    progress: Callable[[str], None] = lambda stage: None,
    sweeps: Sequence[Sweep] = (),
) -> RigDiagnosis:
    """Find out what physics a described rig lacks to have made these recordings.

    Parameters
    ----------
    known
        Mechanisms that may be named.
    progress
        Called with what is being done.
    sweeps
        Steady responses of the same rig.

    Raises
    ------
    AnalysisError
        The recordings cannot carry a diagnosis of this rig.
    """
    # the matrices are small: further threads of the linear algebra would only get in each other's way
    source = ", ".join(r.source for r in recordings)
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            outcome = run(rig, [prepare(r, rig) for r in recordings], known, progress, sweeps)
            progress("comparing with what was held out")
            return _answer(source, outcome)
        except (np.linalg.LinAlgError, ArithmeticError) as error:
            raise AnalysisError(
                f"{source}: cannot be computed with {rig.name} as described: its constants or its times are far from "
                f"what was recorded; check their units ({one_line(str(error))})"
            ) from error


def _answer(source: str, outcome: Outcome) -> RigDiagnosis:
    before, before_by, pieces = held_out_rms(outcome.baseline)
    far_off = outcome.chosen is None and _far_off(outcome.best)
    found = outcome.p_value < LEVEL or far_off
    verdict = "consistent" if not found else "unexplained" if outcome.chosen is None else "missing_physics"
    after: float | None = None
    after_by: dict[str, float] = {}
    named: tuple[Named, ...] = ()
    if outcome.chosen is not None:
        after, after_by, _ = held_out_rms(outcome.chosen)
        accepted = [r for r in outcome.rounds if r.accepted is not None]
        named = tuple(_named(outcome, outcome.chosen, i, r) for i, r in enumerate(accepted))
    decay = (
        decay_of(outcome.recordings[0], outcome.recordings[0].outputs[0])
        if confounded(outcome.recordings) and _one_body(outcome)
        else ()
    )
    steady = outcome.steady
    after_steady = None
    if steady.linear is not None and outcome.chosen is not None:
        after_steady = steady.with_terms(outcome.chosen.terms).held_rms
    return RigDiagnosis(
        source,
        verdict,
        outcome.p_value,
        named,
        _location(outcome, named, decay, far_off) if found else None,
        outcome.rig.seen[0].unit,
        _noise(outcome.best),
        before,
        after,
        pieces,
        {name: (value, after_by.get(name)) for name, value in before_by.items()},
        decay,
        None if steady.linear is None else steady.linear.held_rms,
        after_steady,
        _next_experiment(outcome, named) if found else None,
        outcome,
        far_off,
    )


def _one_body(outcome: Outcome) -> bool:
    return len(outcome.rig.arrangement.bodies) == 1


def unit_of(rig: DescribedRig, unit: str) -> str:
    """Return a unit of N and m in the rig's own units."""
    if (rig.length_unit, rig.force_unit) == ("m", "N"):
        return unit
    swapped = re.sub(r"\bm(?=\d|\b)", f"({rig.length_unit})" if "/" in rig.length_unit else rig.length_unit, unit)
    return re.sub(r"\bN\b", f"({rig.force_unit})" if "/" in rig.force_unit else rig.force_unit, swapped)


def _place_name(outcome: Outcome, mechanism: Mechanism, place: int) -> str:
    rig = outcome.rig
    if mechanism.distort is not None:
        return rig.drives[place].name if mechanism.drives else rig.seen[place].sensor.name
    return rig.arrangement.elements[place].name


def component_of(outcome: Outcome, mechanism: Mechanism, place: int) -> str:
    """Return the component of the contract that a mechanism in this place stands for."""
    if mechanism.distort is not None:
        return mechanism.component
    return outcome.rig.components[outcome.rig.arrangement.elements[place].name]


def _settled(outcome: Outcome) -> bool:
    return outcome.steady.linear is not None


def _named(outcome: Outcome, fitted: Fitted, number: int, step: Round) -> Named:
    accepted = step.accepted
    term = fitted.terms[number]
    mechanism = term.mechanism
    entries = [e for e in step.entries if e.fitted is not None]
    blocks = max(int(step.before.size), 2)
    own = accepted.rank if accepted is not None else math.nan
    in_decay = confounded(outcome.recordings) and not _settled(outcome)
    rival = outcome.rival.id if outcome.rival is not None else ""
    evidence: dict[str, float] = {}
    misfits = {i: e for i, e in enumerate(step.entries) if e.fitted is not None}
    own_steady = next((step.steady[i] for i, e in misfits.items() if e is accepted and i in step.steady), 0.0)
    for i, e in misfits.items():
        if e.score.term.mechanism.with_time and confounded(outcome.recordings):
            continue  # weighed below
        if step.steady and i not in step.steady:
            continue  # too far behind to be held against the steady responses
        against = step.steady[i] - own_steady if step.steady else 0.0
        evidence[e.id] = max(-blocks * math.log(e.rank / own) - against, evidence.get(e.id, -math.inf))
    if in_decay and outcome.rival is not None and mechanism.id != rival and number == 0:
        whole = float(np.mean(outcome.best_misfit))
        # one decay cannot say which of two that foretell it alike: they are as likely as each other
        level_with = max(TIE * whole, MOSTLY * float(np.mean(outcome.base_misfit)))
        evidence[rival] = 0.0 if outcome.rival.mean < level_with else -blocks * math.log(outcome.rival.mean / whole)
    if in_decay and mechanism.with_time:
        others = [
            e for e in entries if not e.score.term.mechanism.with_time and e.mean < 0.5 * float(np.mean(step.before))
        ]
        evidence.update({e.id: evidence.get(e.id, -blocks * math.log(e.mean / own)) for e in others})
        evidence[mechanism.id] = 0.0
    evidence["something else"] = SOMETHING_ELSE * (1 - min(outcome.left_over / LEFT_OVER, 1.0))
    top = max(evidence.values())
    weights = {k: math.exp((v - top) / 2) for k, v in evidence.items()}
    alike = {
        e.id
        for e in entries
        if e is not accepted
        and e.mean < ALIKE * own
        and e.id != mechanism.id
        and evidence.get(e.id, -math.inf) > (CERTAIN if step.steady else -math.inf)
    }
    statement = mechanism.statement(term.values).replace("{element}", _place_name(outcome, mechanism, term.place))
    if in_decay and outcome.rival is not None and mechanism.id != rival and number == 0:
        alike.add(rival)
        statement += (
            " In one decay amplitude and time go together: a stiffness and damping that change with time "
            f"({rival.replace('_', ' ')}) foretell the recording as well, and only impacts of different strength or a "
            "steady excitation at several levels can part the two."
        )
    elif confounded(outcome.recordings) and _settled(outcome) and number == 0 and not mechanism.with_time:
        statement += (
            " One decay cannot part amplitude from time; the steady responses can: they change with amplitude at "
            "steady levels, so that amplitude is the cause."
        )
    return Named(
        mechanism.id,
        weights[mechanism.id] / sum(weights.values()),
        component_of(outcome, mechanism, term.place),
        statement,
        _intervals(outcome, fitted, number),
        tuple(sorted(alike)),
    )


def _intervals(outcome: Outcome, fitted: Fitted, number: int) -> dict[str, Interval]:
    found = {}
    widened = _widening(fitted)
    for q in fitted.terms[number].mechanism.parameters:
        knob, x, error = fitted.knob(number, q.name)
        ends = sorted(knob.outward(x + sign * NORMAL_95 * widened * error) for sign in (-1, 1))
        found[q.name] = Interval(
            knob.outward(x), max(ends[0], q.low), min(ends[1], q.high), unit_of(outcome.rig, q.unit)
        )
    return found


def _widening(fitted: Fitted) -> float:
    """Return by what standard errors grow as the residual is no white noise: samples over independent ones."""
    longest = 1.0
    for number in range(len(fitted.simulation.recordings)):
        for row in residuals(fitted.simulation, fitted.x, number)[0]:
            r = signal.correlate(row - row.mean(), row - row.mean(), method="fft")[row.size - 1 :]
            r = r / r[0] if r[0] > 0 else np.ones(1)
            end = int(np.argmax(np.abs(r) < 0.05)) or r.size
            longest = max(longest, 1 + 2 * float(np.sum(r[1 : max(4 * end, 2)] ** 2)))
    return math.sqrt(longest)


def _noise(fitted: Fitted) -> float:
    """Return the rms of what an autoregression cannot foretell of the residual, in the first channel's unit."""
    off, _ = residuals(fitted.simulation, fitted.x, 0)
    return innovation(off[0]) * float(level(fitted.simulation.recordings[0])[0])


def _far_off(fitted: Fitted) -> bool:
    """Whether a channel's error is most of what it shows, and could have been foretold from the error itself.

    A rig that is far from the one recorded hardly moves where the recording does. What it misses is then the motion,
    which an autoregression takes away as it takes away coloured noise, and the score tests see nothing.
    """
    for number, recorded in enumerate(fitted.simulation.recordings):
        off, at = residuals(fitted.simulation, fitted.x, number, whole=True)
        part = recorded.part[at]
        moved = recorded.outputs[:, at] / level(recorded)[:, None]
        for row, shown in zip(off, moved, strict=True):
            unforeseeable = innovation(row[recorded.fitted])
            for kept in (part != UNUSED, part == HELD):
                error = math.sqrt(float(np.mean(row[kept] ** 2))) if np.any(kept) else 0.0
                # a decay has faded where it is held out: there it is held against the whole of the recording
                all_of_it = max(float(np.std(shown[kept])), 1.0) if np.any(kept) else 1.0
                if error > MISSED * all_of_it and error > FORETOLD * unforeseeable:
                    return True
    return False


def _location(
    outcome: Outcome, named: Sequence[Named], decay: Sequence[AtAmplitude], far_off: bool = False
) -> Location:
    recorded = outcome.recordings[0]
    before, at = residuals(outcome.baseline.simulation, outcome.baseline.x, 0)
    after, _ = residuals(outcome.best.simulation, outcome.best.x, 0)
    taken = np.sum(before**2, axis=0)
    t = recorded.start_s + np.arange(at.start, at.stop) / recorded.rate_hz
    time = _middle(taken, t)
    spectrum = np.sum(np.abs(np.fft.rfft(before * np.hanning(before.shape[1]), axis=1)) ** 2, axis=0)
    frequency = _middle(spectrum, np.asarray(np.fft.rfftfreq(before.shape[1], 1 / recorded.rate_hz), np.float64))
    shares = np.sum(before**2 - after**2, axis=1)
    channels = tuple(n for n, s in zip(("A", "B"), shares, strict=False) if s > 0.1 * shares.max())
    if named:
        component, what = named[0].where, f"what is named explains {_percent(outcome.base_misfit, outcome.best_misfit)}"
    else:
        place = int(next((s.term.place for s in outcome.screening.scores if s.term.mechanism.law is not None), 0))
        component = outcome.rig.components[outcome.rig.arrangement.elements[place].name]
        what = "nothing listed explains it"
        if far_off:
            what = "is most of the motion: check the stiffness and mass described, their units, and the channels"
    why = f"The residual of the linear rig lies from {frequency[0]:.4g} to {frequency[1]:.4g} Hz, and {what}."
    if decay:
        first, last = decay[0], decay[-1]
        why += (
            f" Along the decay from {first.amplitude:.3g} to {last.amplitude:.3g} {outcome.rig.seen[0].unit} the "
            f"frequency goes from {first.frequency_hz:.5g} to {last.frequency_hz:.5g} Hz and the damping ratio from "
            f"{100 * first.damping_ratio:.3g} to {100 * last.damping_ratio:.3g} %."
        )
    return Location(component, channels or ("A",), (1e3 * time[0], 1e3 * time[1]), frequency, (), why)


def _percent(base: Real, best: Real) -> str:
    share = 100 * (1 - float(np.mean(best)) / float(np.mean(base)))
    return f"{min(share, 99.99):.4g} % of it"


def _middle(energy: Real, at: Real) -> tuple[float, float]:
    """Return between which places most of the energy lies."""
    grown = np.cumsum(energy) / max(float(np.sum(energy)), 1e-300)
    edge = (1 - MOST_ENERGY) / 2
    low, high = np.searchsorted(grown, [edge, 1 - edge])
    return float(at[low]), float(at[min(high, at.size - 1)])


def decay_of(recorded: Recorded, row: Real) -> tuple[AtAmplitude, ...]:
    """Read frequency and damping along a decay (n,) from its analytic signal."""
    z = signal.hilbert(row - row.mean())
    inside = slice(max(recorded.edge, 1), row.size - max(recorded.edge, 1))
    size, phase = np.abs(z)[inside], np.unwrap(np.angle(z))[inside]
    t = recorded.start_s + np.arange(row.size)[inside] / recorded.rate_hz
    faded = np.flatnonzero(size < FADED * size.max())
    last = int(faded[0]) if faded.size else size.size
    found = []
    logs = np.log(size[:last])
    marks = np.linspace(logs[: max(last // 50, 1)].max(), logs[-max(last // 50, 1) :].min(), AMPLITUDES + 1)
    edges = [int(np.argmax(logs <= m)) if np.any(logs <= m) else last for m in marks]
    for a, b in itertools.pairwise(edges):
        if b - a < 8 or (phase[b - 1] - phase[a]) < LEAST_PER_POINT * 2 * math.pi:
            continue
        w = float(np.polyfit(t[a:b], phase[a:b], 1)[0])
        sigma = -float(np.polyfit(t[a:b], np.log(size[a:b]), 1)[0])
        found.append(AtAmplitude(float(t[a:b].mean()), float(size[a:b].mean()), w / (2 * math.pi), sigma / w))
    return tuple(found)


def _next_experiment(outcome: Outcome, named: Sequence[Named]) -> NextExperiment | None:
    """Return what would part the best explanations."""
    if confounded(outcome.recordings) and not _settled(outcome) and outcome.rival is not None and named:
        amplitude = next((n.id for n in named if n.id != outcome.rival.id), None)
        if amplitude is None:
            best = [e for e in outcome.rounds[0].entries if e.fitted and not e.score.term.mechanism.with_time]
            amplitude = best[0].id if best else "micro_slip"
        return NextExperiment(
            0.0,
            STRONGER,
            (amplitude, outcome.rival.id),
            "In one decay amplitude and time are confounded. Taps of different strength settle it (one "
            f"{STRONGER:g} times stronger or weaker than this one): what goes with amplitude then comes earlier or "
            "later in the decay, what goes with time does not move. So does a steady excitation at two or more levels.",
        )
    first = outcome.rounds[0].entries if outcome.rounds else ()
    fitted: list[Entry] = [e for e in first if e.fitted is not None]
    if len(fitted) < 2 or not named:
        return None
    own = next(e.mean for e in fitted if e.id == named[0].id)
    rivals = [
        e.id
        for e in fitted
        if e.id != named[0].id and e.mean < CLOSE * own and not (_settled(outcome) and e.score.term.mechanism.with_time)
    ]
    if not rivals:
        return None
    return NextExperiment(
        0.0,
        STRONGER / 2,
        (named[0].id, rivals[0]),
        f"The two best explanations differ most at the largest amplitude: a recording {STRONGER / 2:g} times as strong "
        "would part them further.",
    )
