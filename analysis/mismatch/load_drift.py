"""Whether the load cell drifted during a session: its two calibrations tell, the ring-downs cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from calibration.estimate import Estimate
from calibration.line import CalibrationError, compare, fit_line
from daq.records import Session

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

    @property
    def probability(self) -> float:
        """Of a drift, where either was as likely beforehand: the most that its p-value can say (Sellke's bound)."""
        p = max(self.p_value, 1e-300)
        return 1 / (1 - math.e * p * math.log(p)) if p < 1 / math.e else 0.5


def load_drift(sessions: Sequence[Session], level: float) -> LoadDrift | None:
    """Return the surest drift among sessions; None where no session has two calibrations that can be compared."""
    found = [d for session in sessions if (d := _of(session, level)) is not None]
    if not found:
        return None
    surest = min(found, key=lambda d: d.p_value)
    p = -math.expm1(len(found) * math.log1p(-min(surest.p_value, 1 - 1e-15)))
    return LoadDrift(surest.session, p, surest.zero_mv, surest.sensitivity)


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
