"""From a session file to a diagnosis: what was left out of Eq. 9, where, how sure, and what would settle it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import pearsonr
from threadpoolctl import threadpool_limits

from analysis.mismatch.baseline import Constants, slow_filter_poles
from analysis.mismatch.colour import Colour
from analysis.mismatch.contest import (
    LEFT_LEVEL,
    LEVEL,
    LOOK_ALIKE,
    TEMPERATURE,
    UNNAMED,
    Contest,
    Entry,
    Round,
    begin_contest,
    evidence,
    held_out_rms,
    may_be_left,
    run_contest,
    stiffness_evidence,
)
from analysis.mismatch.excess import excess_by_frequency, excess_by_time
from analysis.mismatch.fit import Fit, fit
from analysis.mismatch.intervals import NORMAL_95, Interval, intervals
from analysis.mismatch.load_drift import load_drift
from analysis.mismatch.problem import Problem, Term
from analysis.mismatch.records import channel_noise, joined, tester_recordings
from analysis.mismatch.tones import tone_amplitude
from analysis.session import AnalysisError, session_modes
from analysis.settings import AnalysisSettings
from analysis.stiffness import ResonanceError, contact_from_pole, springs_from_system_mode
from daq.records import RigDescription, Session, Shot
from rig.settings import Filter
from sim_backend.arrangement import tester
from sim_backend.mechanisms.mechanism import Mechanism, mechanisms
from sim_backend.recorder import analog_filter
from sim_backend.state_space import StateSpace

Real = NDArray[np.float64]

MASS_UNCERTAINTY = 5e-4  # relative, as weighed
SPRING_UNCERTAINTY = 0.01  # relative, as identified
NOISE_DIFFERENCE = 0.1  # of sessions that are diagnosed together
LOST_COUNT = 0.2  # oscillations of the system mode in a record by which the declared springs may be off to begin with
SCATTER_EVIDENCE = 30.0  # that constants of its own for every impact must have
SCATTER_STEPS = 2  # of the fit that tells whether it does: scatter is small
MOST_OF_IT = 0.5  # of what is left over, that scatter must take up to be looked at further
BOTH = 1.4  # effort of the two contests together, over that of one
MOST_SCATTER = 0.01  # relative standard deviation of k_c between impacts of a load that counts as scatter
UNLISTED = 0.25  # odds of what is not listed over what is, before the data
LIKENESS = 400.0  # chi-squared up to which what is not listed is as a rule like something listed
STRONG_LIKENESS = 0.02  # odds of it however strong it is
LOAD_DRIFT = "load_drift"  # the one mechanism that ring-downs do not show
STRONGER_TAP = 1.5  # over the strongest so far, for the next experiment
MOST_FORCE_RATIO = 0.9  # of the preload: beyond, the surfaces would part


@dataclass(frozen=True, slots=True)
class Named:
    """A mechanism that was left out; ``fixed`` are values in it that were not fitted."""

    id: str
    probability: float
    where: str
    statement: str
    parameters: dict[str, Interval]
    indistinguishable_from: tuple[str, ...]
    fixed: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Location:
    """Where the recordings hold more than Eq. 9."""

    component: str
    channels: tuple[str, ...]
    time_ms: tuple[float, float]
    frequency_hz: tuple[float, float]
    loads_mn: tuple[float, ...]
    why: str


@dataclass(frozen=True, slots=True)
class NextExperiment:
    """What would part the two best explanations."""

    load_mn: float
    peak_force_ratio: float
    separates: tuple[str, str]
    why: str


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The answer; ``contest`` holds all that is behind it."""

    session: str
    verdict: str
    p_value: float
    mechanisms: tuple[Named, ...]
    location: Location | None
    noise_rms: float
    rms_before: float
    rms_after: float | None
    next_experiment: NextExperiment | None
    contest: Contest


def tester_problem(*sessions: Session) -> Problem:
    """Return the fitting problem of a session of the two-mass tester, or of several of one rig.

    Raises
    ------
    AnalysisError
        The rig is unknown, the sessions are of different rigs, or too few impacts show both modes.
    """
    usable = [_usable(session) for session in sessions]
    rig = sessions[0].rig
    noise = _common_noise(usable)
    parts = []
    for one in usable:
        try:
            parts.append(
                tester_recordings(one.session, one.loads_n, one.contact, (rig.k1_n_per_m, rig.k2_n_per_m), noise)
            )
        except ValueError as error:
            raise AnalysisError(f"{_name(one.session)}: {error}") from None
    arrangement = tester(
        rig.m1_kg, rig.m2_kg, rig.k1_n_per_m, rig.k2_n_per_m, 1e6, 1.0,
        mass_uncertainty=MASS_UNCERTAINTY, spring_uncertainty=SPRING_UNCERTAINTY,
    )  # fmt: skip
    start = np.array([one.contact[k] for one in usable for k in sorted(one.contact)])
    highpass = rig.highpass_hz if rig.filter_family == "butterworth" else math.nan
    slow = slow_filter_poles(highpass, int(rig.highpass_order))
    recordings = joined(parts)
    duration = max(r.y.shape[1] for r in recordings.records) / recordings.sample_rate_hz
    springs = _springs_to_begin_with(usable, duration)
    return Problem(recordings, arrangement, declared_filter(rig), slow, start, rig_start=springs)


def _springs_to_begin_with(usable: Sequence[_Usable], duration_s: float) -> dict[str, float]:
    """Return springs (N/m) as the system mode shows them, where with the declared ones a fit would lose count of it."""
    rig = usable[0].session.rig
    f1 = float(np.median([hz for one in usable for hz in one.system_hz] or [math.nan]))
    kc = float(np.median([k for one in usable for k, _ in one.contact.values()]))
    try:
        k1, k2 = springs_from_system_mode(f1, kc, rig.m1_kg, rig.m2_kg, rig.k2_n_per_m / rig.k1_n_per_m)
    except ResonanceError:
        return {}
    off = f1 * (math.sqrt(rig.k1_n_per_m / k1) - 1)
    return {"k1": k1, "k2": k2} if abs(off) * duration_s > LOST_COUNT else {}


@dataclass(frozen=True, slots=True)
class _Usable:
    """What of a session can be fitted: load (N) and linear contact (N/m, N s/m) of each load set; system resonances."""

    session: Session
    loads_n: dict[int, float]
    contact: dict[int, tuple[float, float]]
    system_hz: tuple[float, ...]

    @property
    def shots(self) -> list[Shot]:
        return [s for s in self.session.shots if s.accepted and s.load_set in self.contact]


def _name(session: Session) -> str:
    return session.source or "session"


def _usable(session: Session) -> _Usable:
    rig, name = session.rig, _name(session)
    if not rig.is_tester:
        raise AnalysisError(f"{name}: masses and springs are unknown, so there is no Eq. 9 to compare with")
    rates = {s.sample_rate_hz for s in session.shots if s.accepted}
    if len(rates) != 1:
        raise AnalysisError(f"{name}: a diagnosis needs accepted impacts of one sampling rate, not of {len(rates)}")
    modes = session_modes(session, AnalysisSettings())
    contact: dict[int, tuple[float, float]] = {}
    loads: dict[int, float] = {}
    for load_set in session.load_sets():
        found = []
        for shot in session.accepted(load_set):
            mode = modes[shot.number].contact
            if mode is None:
                continue
            try:
                found.append(contact_from_pole(mode.pole, rig.m1_kg, rig.m2_kg, rig.k1_n_per_m, rig.k2_n_per_m))
            except ResonanceError:
                continue
        if not found:
            continue
        middle = np.median(found, axis=0)
        contact[load_set] = (float(middle[0]), float(middle[1]))
        loads[load_set] = 1e-3 * _load(session, load_set)
    if sum(len(session.accepted(k)) for k in contact) < 4:
        raise AnalysisError(f"{name}: a diagnosis needs at least four accepted impacts that show both modes")
    system = tuple(m.system.frequency_hz.value for m in modes.values() if m.system is not None)
    return _Usable(session, loads, contact, system)


def _common_noise(usable: Sequence[_Usable]) -> tuple[Colour, ...] | None:
    """Return the noise of several sessions of one rig taken together; None for a single one.

    Raises
    ------
    AnalysisError
        The sessions are not of one rig, one is there twice, or their noise differs in size.
    """
    first = usable[0].session
    for other in (one.session for one in usable[1:]):
        if other.rig != first.rig:
            raise AnalysisError(
                f"{_name(other)}: its masses, springs, filter or sampling rate are not those of {_name(first)}; "
                "only sessions of one rig are diagnosed together"
            )
    if len(usable) == 1:
        return None
    shown: dict[bytes, Session] = {}
    for one in usable:
        key = one.shots[0].acceleration.tobytes()
        if key in shown:
            raise AnalysisError(
                f"{_name(one.session)}: holds the impacts of {_name(shown[key])} once more; name it once"
            )
        shown[key] = one.session
    rate = first.rig.sample_rate_hz
    try:
        own = [channel_noise(one.shots, rate) for one in usable]
        both = channel_noise([s for one in usable for s in one.shots], rate)
    except ValueError as error:
        raise AnalysisError(f"{_name(first)} and others: {error}") from None
    for one, noise in zip(usable, own, strict=True):
        for mine, common in zip(noise, both, strict=True):
            if abs(mine.deviation / common.deviation - 1) > NOISE_DIFFERENCE:
                raise AnalysisError(
                    f"{_name(one.session)}: its noise is {mine.deviation / common.deviation:.2f} times that of the "
                    "sessions together; diagnose it by itself"
                )
    return both


def declared_filter(rig: RigDescription) -> StateSpace:
    """Return the recorder's filter as the session declares it; none where it declares none."""
    known = rig.filter_family == "butterworth" and all(map(math.isfinite, (rig.highpass_hz, rig.lowpass_hz)))
    if not known or rig.highpass_order < 1 or rig.lowpass_order < 1:
        return analog_filter(Filter(family="none"))
    return analog_filter(
        Filter(
            family="butterworth",
            highpass_hz=rig.highpass_hz,
            highpass_order=int(rig.highpass_order),
            lowpass_hz=rig.lowpass_hz,
            lowpass_order=int(rig.lowpass_order),
        )
    )


def _load(session: Session, load_set: int) -> float:
    """Load of a load set as the session file gives it, mN."""
    shots = session.accepted(load_set)
    read = [v for s in shots for v in (s.load_before_mn, s.load_after_mn) if math.isfinite(v)]
    return float(np.mean(read)) if read else shots[0].target_load_mn


def diagnose_session(
    session: Session | Sequence[Session],
    known: Sequence[Mechanism],
    progress: Callable[[str], None] = lambda stage: None,
) -> Diagnosis:
    """Find out what physics Eq. 9 leaves out of a session's recordings, or of those of several sessions of one rig.

    Parameters
    ----------
    known
        Mechanisms that may be named.
    progress
        Called with what is being done.

    Raises
    ------
    AnalysisError
        The session cannot carry a diagnosis.
    """
    sessions = [session] if isinstance(session, Session) else list(session)
    # the matrices are small: further threads of the linear algebra would only get in each other's way; trial steps of a
    # fit that lead nowhere may overflow
    with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
        progress("identifying the modes of each impact")
        problem = tester_problem(*sessions)
        contest = _contest(problem, known, progress)
        progress("comparing with the held-out impacts")
        answer = _answer(" + ".join(s.source for s in sessions), contest)
        return with_load_drift(answer, sessions) if any(m.id == LOAD_DRIFT for m in known) else answer


def _contest(problem: Problem, known: Sequence[Mechanism], progress: Callable[[str], None]) -> Contest:
    """Run the contest; with constants of its own for every impact where scatter between impacts explains more."""
    begun = begin_contest(problem, known, progress)
    if begun.p_value >= LEVEL or not scattered(begun.baseline):
        return run_contest(begun, known, progress)
    progress("again, with constants of its own for every impact")
    apart = begin_contest(problem.apart(), known, progress)
    if apart.p_value >= LEVEL:
        return run_contest(apart, known, progress)
    plain = run_contest(begun, known, progress)
    if plain.chosen is not None or (plain.best.terms and not _scatter_is_left(plain)):
        return plain
    again = run_contest(apart, known, progress, contests=BOTH)
    return plain if again.chosen is None else again


def scattered(baseline: Fit) -> bool:
    """Whether the contact's constants differ from impact to impact of a load by more than noise, and by chance.

    That is no missing physics: what differs must neither follow the strength of the tap nor be large.
    """
    apart = fit(baseline.problem.apart(), begin=replace(baseline, constants=_own_constants(baseline)))
    records = baseline.problem.recordings.records
    freed = (len(records) - len(baseline.constants.load)) * baseline.constants.load.shape[1]
    if evidence(baseline.objective - apart.objective, freed) < SCATTER_EVIDENCE:
        return False
    stiffness = np.log(apart.constants.load[:, 0])
    strength = np.array([math.log(float(np.abs(a).max())) for a in apart.amplitudes])
    for group in range(len(baseline.constants.load)):
        at = [i for i, r in enumerate(records) if r.group == group]
        stiffness[at] -= stiffness[at].mean()
        strength[at] -= strength[at].mean()
    if float(stiffness.std()) > MOST_SCATTER:
        return False
    return float(pearsonr(stiffness, strength).pvalue) > LEVEL


def _scatter_is_left(plain: Contest) -> bool:
    """Whether constants of its own for every impact would take up most of what the best explanation leaves."""
    best = plain.best
    amplitudes = best.amplitudes if any(t.nonlinear for t in best.terms) else ()
    begin = replace(best, constants=_own_constants(best))
    apart = fit(best.problem.apart(), best.terms, begin, None, (), SCATTER_STEPS, amplitudes, competing=True)
    return best.objective - apart.objective > MOST_OF_IT * plain.left_over


def _own_constants(fit_: Fit) -> Constants:
    groups = [r.group for r in fit_.problem.recordings.records]
    return replace(fit_.constants, load=fit_.constants.load[groups])


def with_load_drift(found: Diagnosis, sessions: Sequence[Session]) -> Diagnosis:
    """Add to a diagnosis what the calibrations before and after each session say of the load cell.

    Where they can be compared they are a second test, and both share the level.
    """
    drift = load_drift(sessions, LEVEL)
    if drift is None:
        return found
    share = -math.expm1(0.5 * math.log1p(-LEVEL))
    p_value = -math.expm1(2 * math.log1p(-min(found.p_value, drift.p_value, 1 - 1e-15)))
    if found.verdict != "consistent" and found.p_value >= share:
        found = replace(found, verdict="consistent", mechanisms=(), location=None, rms_after=None, next_experiment=None)
    found = replace(found, p_value=p_value)
    if drift.p_value >= share:
        return found
    mechanism = mechanisms()[LOAD_DRIFT]
    value = drift.zero_mv
    named = Named(
        LOAD_DRIFT,
        drift.probability,
        mechanism.component,
        f"{mechanism.statement({q.name: value.value for q in mechanism.parameters})} Its sensitivity changed by "
        f"{100 * drift.sensitivity.value:.2g} % (95 % interval {100 * drift.sensitivity.low:.2g} to "
        f"{100 * drift.sensitivity.high:.2g} %).",
        {q.name: Interval(value.value, value.low, value.high, q.unit) for q in mechanism.parameters},
        (),
    )
    if found.verdict == "unexplained":
        return found  # what is missing from the ring-downs has no name; the drift does not explain it
    location = found.location
    if location is None:
        loads = tuple(1e3 * load for load in found.contest.problem.recordings.loads_n)
        why = f"The calibrations before and after the test differ (p = {drift.p_value:.2g}); the ring-downs do not."
        location = Location(mechanism.component, (), (0.0, 0.0), (0.0, 0.0), loads, why)
    return replace(found, verdict="missing_physics", mechanisms=(*found.mechanisms, named), location=location)


def _answer(source: str, contest: Contest) -> Diagnosis:
    problem, held = contest.problem, contest.held_out
    before = held_out_rms(problem, held, contest.baseline) if held else math.nan
    found = contest.p_value < LEVEL
    verdict = "consistent" if not found else "unexplained" if contest.chosen is None else "missing_physics"
    after, named = None, []
    if contest.chosen is not None:
        after = held_out_rms(problem, held, contest.chosen) if held else None
        for number, step in enumerate(r for r in contest.rounds if r.accepted is not None):
            named.append(_named(contest.chosen, number, step, contest))
    return Diagnosis(
        source,
        verdict,
        contest.p_value,
        tuple(named),
        _location(contest, named) if found else None,
        problem.recordings.noise_rms,
        before,
        after,
        _next_experiment(contest) if found else None,
        contest,
    )


def _named(fit: Fit, number: int, step: Round, contest: Contest) -> Named:
    term, accepted = fit.terms[number], step.accepted
    mechanism = term.mechanism
    entries = [e for e in step.entries if e.fit is not None]
    strength = {e.id: e.evidence + stiffness_evidence(e.score.term.mechanism, e.fit) for e in entries}
    top = max(strength.values())
    weights = {k: math.exp((v - top) / 2 / TEMPERATURE) for k, v in strength.items()}
    total = sum(weights.values()) + weights[mechanism.id] * _odds_of_something_else(fit, step, contest)
    total *= 1 + _odds_of_nothing(contest.p_value)
    rivals = tuple(k for k in weights if k != mechanism.id and weights[k] > 0.02 * weights[mechanism.id])
    alike = _looking_alike(step, mechanism.id, rivals)
    if mechanism.lines is not None and mechanism.strength is not None:
        amplitude, error = tone_amplitude(fit)
        term = replace(term, values={**term.values, mechanism.strength: amplitude})
        known = Interval(amplitude, amplitude - NORMAL_95 * error, amplitude + NORMAL_95 * error, "m/s2")
        parameters = {mechanism.strength: known}
    else:
        parameters = intervals(fit, number)
    return Named(
        mechanism.id,
        min(weights[mechanism.id] / total, 1.0),
        mechanism.component,
        mechanism.statement(term.values),
        parameters,
        alike if accepted is not None else (),
        _fixed(term),
    )


def _odds_of_something_else(fit: Fit, step: Round, contest: Contest) -> float:
    """Return how likely it is that what is not listed is at work, over that the mechanism accepted in a step is.

    The weaker an effect, the more there is that looks like it: of a chi-squared below `LIKENESS` nearly anything does.
    """
    gain = step.before.objective - step.accepted.fit.objective  # type: ignore[union-attr]
    odds = STRONG_LIKENESS + UNLISTED * min(1.0, LIKENESS / max(gain, 1.0)) + math.exp((contest.unnamed - UNNAMED) / 2)
    left = contest.left_over if contest.left_p_value < LEFT_LEVEL else 0.0
    if left > 0:
        explained = contest.baseline.objective - fit.objective
        share = left / (may_be_left(len(fit.terms)) * (explained + left))  # 1 where it would just not be named
        odds = min(odds, 1.0) ** (1 - min(share, 1.0))
    return float(odds)


def _odds_of_nothing(p_value: float) -> float:
    """Return at least how likely it is that nothing is missing, over that something is, after a test gave this p-value.

    Sellke, Bayarri and Berger's bound, both being as likely before.
    """
    return -math.e * p_value * math.log(p_value) if 0 < p_value < 1 / math.e else float(p_value > 0)


def _fixed(term: Term) -> dict[str, float]:
    fitted = {q.name for q in term.mechanism.parameters}
    return {k: float(v) for k, v in term.values.items() if k not in fitted}


def _looking_alike(step: Round, chosen: str, rivals: Sequence[str]) -> tuple[str, ...]:
    """Rivals that these data cannot tell apart: close in evidence, and either alike in signature or never compared."""
    labels, cosines = step.screening.labels, np.abs(step.screening.cosines)
    found = []
    for rival in rivals:
        mine = [i for i, k in enumerate(labels) if k == chosen]
        theirs = [i for i, k in enumerate(labels) if k == rival]
        if not mine or not theirs or cosines[np.ix_(mine, theirs)].max() > LOOK_ALIKE:
            found.append(rival)
    return tuple(found)


def _location(contest: Contest, named: Sequence[Named]) -> Location:
    """Read off the residual of the linear rig where it is more than noise."""
    fit = contest.baseline
    rate = contest.problem.recordings.sample_rate_hz
    bins, windows = excess_by_frequency(fit), excess_by_time(fit)
    frequency = _range(bins.edges, np.any(bins.sure, axis=0), (0.0, rate / 2))
    begin = float(np.mean([r.start_s for r in fit.problem.recordings.records]))
    low, high = _range(windows.edges, np.any(windows.sure, axis=0), (0.0, float(windows.edges[-1])))
    share = _misfit_by_channel(fit, contest.best)
    channels = ("A-B",) if len(share) == 2 and share[1] > 2 * share[0] else ("A", "B")
    misfit = np.zeros(len(contest.problem.recordings.loads_n))
    for record, r, better in zip(fit.problem.recordings.records, fit.residuals, contest.best.residuals, strict=True):
        misfit[record.group] += float(np.vdot(r, r) - np.vdot(better, better))
    loads = 1e3 * np.array(contest.problem.recordings.loads_n)
    chosen = loads if misfit.max() <= 0 else loads[misfit > 0.1 * misfit.max()]
    if named:
        component = named[0].where
    elif channels == ("A-B",):
        component = "sensor chain"
    else:
        by = contest.rounds[0].screening.free.by_component
        component = max(by, key=lambda k: by[k])
    free = "changes of a channel explain" if component == "sensor chain" else "forces of any shape in it explain"
    what = "what is named explains" if named else free
    return Location(
        component,
        channels,
        (1e3 * (begin + low), 1e3 * (begin + high)),
        frequency,
        tuple(sorted({float(v) for v in chosen})),
        f"The residual of Eq. 9 is more than noise from {frequency[0]:.0f} to {frequency[1]:.0f} Hz, and {what} "
        "most of it.",
    )


def _range(edges: Real, sure: NDArray[np.bool_], fallback: tuple[float, float]) -> tuple[float, float]:
    at = np.flatnonzero(sure)
    return (float(edges[at[0]]), float(edges[at[-1] + 1])) if at.size else fallback


def _misfit_by_channel(before: Fit, after: Fit) -> Real:
    """Sum of squares that the better fit takes away in mean and difference of the channels."""
    if len(before.residuals[0]) != 2:
        return np.zeros(1)
    out = np.zeros(2)
    for a, b in zip(before.residuals, after.residuals, strict=True):
        for i, sign in enumerate((1.0, -1.0)):
            out[i] += float(np.sum((a[0] + sign * a[1]) ** 2) - np.sum((b[0] + sign * b[1]) ** 2))
    return out


def _next_experiment(contest: Contest) -> NextExperiment | None:
    """Return the load at which the two best explanations differ most per impact, with a stronger tap."""
    fitted: list[Entry] = [e for e in contest.rounds[0].entries if e.fit is not None] if contest.rounds else []
    if len(fitted) < 2:
        return None
    first, second = fitted[0], fitted[1]
    records = contest.baseline.problem.recordings.records
    groups = len(contest.problem.recordings.loads_n)
    apart, count = np.zeros(groups), np.zeros(groups)
    for i, record in enumerate(records):
        a, b = first.fit.residuals[i], second.fit.residuals[i]  # type: ignore[union-attr]
        apart[record.group] += float(np.sum((a - b) ** 2))
        count[record.group] += 1
    group = int(np.argmax(apart / np.maximum(count, 1)))
    load = contest.problem.recordings.loads_n[group]
    ratio = min(STRONGER_TAP * strongest_tap(contest.baseline, group), MOST_FORCE_RATIO)
    return NextExperiment(
        1e3 * load,
        ratio,
        (first.id, second.id),
        f"At {1e3 * load:.0f} mN the two differ most: by {math.sqrt(apart[group] / count[group]):.1f} standard "
        "deviations an impact at the taps made; a stronger one parts them further.",
    )


def strongest_tap(fit: Fit, group: int) -> float:
    """Return the largest dynamic contact force over the preload among the impacts of a load."""
    from analysis.mismatch.response import response

    place = next(i for i, e in enumerate(fit.arrangement.elements) if e.role == "contact")
    values = fit.constants.at(group)
    to = response(fit.arrangement, values, fit.modes[group].rig, fit.problem.analog)
    t = np.arange(60) / fit.problem.recordings.sample_rate_hz
    peaks = [0.0]
    for record, amplitudes in zip(fit.problem.recordings.records, fit.amplitudes, strict=True):
        if record.group == group:
            d, v = to.motion(amplitudes, place, t)
            peaks.append(float(np.abs(values["kc"] * d + values["cc"] * v).max()) / record.preload_n)
    return max(peaks)
