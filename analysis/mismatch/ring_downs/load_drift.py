"""Whether the load cell drifted during a session: its two calibrations tell, the ring-downs cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.mismatch.answer import Answer, Interval, Location, Named
from analysis.mismatch.chi_squared import odds_of_nothing, p_of
from calibration.estimate import Estimate
from calibration.line import CalibrationError, compare, fit_line
from daq.records import Session
from sim_backend.mechanisms.kinds import ChannelDistortion, Mechanism

WEIGHTS_EXACT = 0.0  # the same weights hang in both calibrations: their errors do not part them


@dataclass(frozen=True, slots=True)
class LoadDrift:
    """Change of the gauge from the calibration before a session to the one after it.

    Attributes
    ----------
    p_value
        That nothing changed, all sessions tried counted.
    zero_mv
        Change of the zero, mV.
    sensitivity
        Relative change of the sensitivity.
    """

    session: str
    p_value: float
    zero_mv: Estimate
    sensitivity: Estimate


def load_drift(sessions: Sequence[Session], level: float) -> LoadDrift | None:
    """Return the surest drift among sessions; None where no session has two calibrations that can be compared."""
    found = [d for session in sessions if (d := _of(session, level)) is not None]
    if not found:
        return None
    surest = min(found, key=lambda d: d.p_value)
    return replace(surest, p_value=p_of(surest.p_value, len(found)))


def with_load_drift(answer: Answer, sessions: Sequence[Session], known: Sequence[Mechanism], level: float) -> Answer:
    """Add to an answer what the calibrations before and after each session say of the load cell.

    Where they can be compared they are a second test, and both share the level.
    """
    mechanism = next((m for m in known if isinstance(m, ChannelDistortion) and m.of == "load cell"), None)
    drift = None if mechanism is None else load_drift(sessions, level)
    if drift is None or mechanism is None:
        return answer
    share, p_value = p_of(level, 0.5), p_of(min(answer.p_value, drift.p_value), 2)
    if answer.verdict != "consistent" and answer.p_value >= share:
        fit = replace(answer.fit, heldout_rms_after=None)
        answer = replace(
            answer, verdict="consistent", mechanisms=(), location=None, fit=fit, next_experiment=None, fitted=None
        )
    answer = replace(answer, p_value=p_value)
    if drift.p_value >= share or answer.verdict == "unexplained":
        return answer  # what is missing from the ring-downs may have no name; the drift does not explain it
    location = answer.location
    if location is None:
        why = f"The calibrations before and after the test differ (p = {drift.p_value:.2g}); the ring-downs do not."
        location = Location(mechanism.component, None, (), (0.0, 0.0), (0.0, 0.0), tuple(answer.loads_n), why)
    named = _named(drift, mechanism)
    complete = answer.complete_probability * named.probability
    return replace(
        answer, verdict="missing_physics", mechanisms=(*answer.mechanisms, named), location=location,
        complete_probability=complete,
    )  # fmt: skip


def _named(drift: LoadDrift, mechanism: Mechanism) -> Named:
    value = drift.zero_mv
    said = mechanism.statement({q.name: value.value for q in mechanism.parameters}, mechanism.component)
    return Named(
        mechanism.id,
        1 / (1 + odds_of_nothing(drift.p_value)),  # where either was as likely beforehand
        mechanism.component,
        f"{said} Its sensitivity changed by {100 * drift.sensitivity.value:.2g} % (95 % interval "
        f"{100 * drift.sensitivity.low:.2g} to {100 * drift.sensitivity.high:.2g} %).",
        {q.name: Interval(value.value, value.low, value.high, q.unit) for q in mechanism.parameters},
        (),
    )


def _of(session: Session, level: float) -> LoadDrift | None:
    if session.pre is None or session.post is None:
        return None
    try:
        p = compare(session.pre, session.post, level).p_value
        before, after = (fit_line(points, WEIGHTS_EXACT, level) for points in (session.pre, session.post))
    except CalibrationError:
        return None
    if p is None:
        return None
    zero = _difference(before.offset_mv, after.offset_mv, 1.0)
    slope = before.sensitivity_mv_per_mn
    return LoadDrift(session.source, p, zero, _difference(slope, after.sensitivity_mv_per_mn, 1 / slope.value))


def _difference(before: Estimate, after: Estimate, scale: float) -> Estimate:
    error = math.hypot(before.standard_error, after.standard_error)
    return Estimate(scale * (after.value - before.value), abs(scale) * error, before.dof + after.dof)
