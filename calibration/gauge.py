"""The load behind a bridge voltage at any time of a test, from the calibrations before and after it (Sec. 3.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from calibration.budget import Budget, Contribution
from calibration.curve import fit_curve
from calibration.estimate import Estimate
from calibration.line import CalibrationError, DriftVerdict, GaugeFit, compare, fit_line
from calibration.settings import CalibrationSettings
from calibration.wander import Timeline, Wander
from calibration.weights import Gravity
from calibration.within import WithinCalibrations
from daq.records import CalibrationPoints, ZeroReading
from rig.readings import GaugeScale

__all__ = ["CalibrationError", "DriftVerdict", "GaugeFit", "GaugeHistory", "GaugeResult", "compare", "fit_line"]

MIDWAY = 0.5
UNSEEN_DRIFT = (
    "The gauge was not read without load between them: a drift of the zero that came and went is not in the intervals "
    "of the loads (calibration.zero_every_loads reads it, calibration.zero_limit_mn declares how large it can be)."
)
LONGEST_TEST_H = 48.0  # from the only calibration of a test; a time beyond it is a clock set wrong
BEYOND = 1.0  # a time farther from the calibrations than they are from each other is a clock set wrong


@dataclass(frozen=True, slots=True)
class GaugeResult:
    """The gauge over a whole test: the line midway between the calibrations, and whether they agree.

    ``drift_p_value`` is None where drift could not be tested. ``hysteresis_percent`` is half of the largest distance
    between the way up and the way down, % of the range; ``misfit_mn`` what the gauge departs from its curve beyond the
    errors of weights and readings; ``zero_readings`` counts the readings without load between the calibrations.
    """

    sensitivity_mv_per_mn: Estimate
    offset_mv: Estimate
    nonlinearity_percent: float
    drifted: bool
    drift_p_value: float | None
    statement: str
    hysteresis_percent: float = 0.0
    misfit_mn: float = 0.0
    gravity: Gravity | None = None
    zero_readings: int = 0


class GaugeHistory:
    """The gauge between the calibration before a test and the one after it.

    The curve of both calibrations (`calibration.curve`) shares one curvature; offset and sensitivity wander
    (`calibration.random_walk`), seen at the calibrations and, for the offset, wherever the gauge was read without a
    load. A drift that begins and ends between two such readings leaves no trace: what is declared of the gauge's
    stability has to cover it.

    With one calibration only, that one holds throughout, with a note; with neither, every answer is None.
    A calibration that cannot be used counts as absent, with a note that says why.

    Parameters
    ----------
    pre, post
        Calibrations before and after the test, or None.
    settings
        What is declared of weights, gravity and drift, and the level of the drift test.
    zeros
        Readings without load between them.

    Attributes
    ----------
    pre_fit, post_fit
        `GaugeFit` of each usable calibration, or None.
    verdict
        `DriftVerdict` of the two, or None unless both are usable.
    notes
        Sentences about what limits the answers at any time.
    """

    def __init__(
        self,
        pre: CalibrationPoints | None,
        post: CalibrationPoints | None,
        settings: CalibrationSettings,
        zeros: Sequence[ZeroReading] = (),
    ) -> None:
        notes: list[str] = []
        self.pre_fit = _usable(pre, "before", settings, notes)
        self.post_fit = _usable(post, "after", settings, notes)
        self.verdict: DriftVerdict | None = None
        self._settings = settings
        if pre is not None and post is not None and self.pre_fit is not None and self.post_fit is not None:
            self.verdict = compare(pre, post, settings.drift_test_level)
        elif self.pre_fit is not None or self.post_fit is not None:
            which = "before" if self.pre_fit is not None else "after"
            notes.append(
                f"only the calibration {which} the test is there: of drift, loads allow only for what is declared"
            )
        else:
            notes.append(
                "there is no calibration to tell loads from voltages: those of the file, if any, count on a "
                f"sensitivity of the gauge that is right to within {settings.uncalibrated_sensitivity_percent:g} % "
                "(calibration.uncalibrated_sensitivity_percent)"
            )
        self.notes = tuple(notes)
        used = [p for p, fit in ((pre, self.pre_fit), (post, self.post_fit)) if p is not None and fit is not None]
        self._quantum = max([settings.resolution_mv, *(p.quantum_mv for p in used)])
        self._wander = _wander(used, self._hours(used), zeros, settings) if used else None

    def of_written_load(self, load_mn: float, reading: Contribution) -> Budget:
        """Budget of a load that the file itself gives: what was read, and the gauge's sensitivity if never calibrated.

        Parameters
        ----------
        load_mn
            The load.
        reading
            What its readings tell of its uncertainty.
        """
        limits = self._settings.uncalibrated_sensitivity_percent / 100
        sensitivity = Contribution(
            "sensitivity of the gauge as configured, never calibrated",
            math.nan,
            "1",
            limits / math.sqrt(3),
            load_mn,
            distribution="rectangular",
        )
        return Budget("load_mn", "mN", load_mn, (reading, *([sensitivity] if self._wander is None else [])))

    @property
    def reading_std_mv(self) -> float:
        """Standard deviation of a reading by the scatter of the calibrations, mV; 0 where there is none."""
        return 0.0 if self._wander is None else self._wander.curve.reading_std_mv

    def _hours(self, used: Sequence[CalibrationPoints]) -> Timeline:
        """Times of the calibrations in hours; an hour apart where they cannot be told apart."""
        seconds = [_seconds(points.time) for points in used]
        if len(used) == 1:
            return Timeline(seconds[0], (0.0,))
        start, end = seconds
        if start is None or end is None or not end > start:
            return Timeline(None, (0.0, 1.0))
        return Timeline(start, (0.0, (end - start) / 3600))

    def fraction_at(self, time: str) -> tuple[float, str]:
        """Where a time lies between the calibrations: 0 before, 1 after; and a note, empty if there is none to make.

        ``time`` is ISO 8601 UTC. A time that cannot be read, of the impact or of a calibration, counts as midway;
        so does one that is farther from the calibrations than they are from each other.
        """
        if self.pre_fit is None:
            return 1.0, ""
        if self.post_fit is None:
            return 0.0, ""
        start, end = _seconds(self.pre_fit.time), _seconds(self.post_fit.time)
        if start is None or end is None or not end > start:
            return MIDWAY, "the times of the calibrations cannot be told apart: the load is by their mean"
        now = _seconds(time)
        if now is None:
            return MIDWAY, f"the time {time!r} is not an ISO 8601 time: the load is by the mean of the calibrations"
        fraction = (now - start) / (end - start)
        if abs(fraction - MIDWAY) > BEYOND + MIDWAY:
            return MIDWAY, f"the time {time} is far from both calibrations: the load is by their mean"
        if not 0.0 <= fraction <= 1.0:
            side = "before the first" if fraction < 0 else "after the last"
            return fraction, f"the time {time} is {side} calibration: the nearest one holds"
        return fraction, ""

    def _hour(self, time: str) -> float:
        """Hours since the first calibration; a time that nothing is known of is that of the only calibration."""
        if self._wander is None:
            return 0.0
        timeline = self._wander.timeline
        if len(timeline.hours) == 2:
            return self.fraction_at(time)[0] * timeline.hours[1]
        start, now = timeline.start_s, _seconds(time)
        hour = 0.0 if start is None or now is None else (now - start) / 3600
        return hour if abs(hour) <= LONGEST_TEST_H else 0.0

    def scale_at(self, time: str) -> GaugeScale | None:
        """Return the straight line in force at a time: the curve's least-squares line over the range of the weights."""
        if self._wander is None:
            return None
        offset, slope = self._wander.line(self._hour(time))
        return GaugeScale(sensitivity_mv_per_mn=slope, offset_mv=offset)

    def load_at(self, voltage_mv: float, time: str, voltage_uncertainty_mv: float = 0.0) -> Estimate | None:
        """Load behind a bridge voltage, mN, with everything in its `budget_at`.

        ``voltage_uncertainty_mv`` is the standard uncertainty of the reading. None without a calibration or where the
        voltage is not finite.
        """
        budget = self.budget_at(voltage_mv, time, voltage_uncertainty_mv)
        return None if budget is None else budget.estimate()

    def budget_at(
        self, voltage_mv: float, time: str, voltage_uncertainty_mv: float = 0.0, voltage_dof: float = math.inf
    ) -> Budget | None:
        """Return the load behind a bridge voltage with every source of its uncertainty, mN."""
        if self._wander is None or not math.isfinite(voltage_mv):
            return None
        reading = Contribution(
            "bridge voltage during the taps", voltage_mv, "mV", voltage_uncertainty_mv, 1.0, voltage_dof
        )
        return self._wander.budget(voltage_mv, self._hour(time), reading, self._quantum)

    def result(self) -> GaugeResult | None:
        """Return the gauge over the whole test, or None without a calibration."""
        if self._wander is None:
            return None
        fits = [fit for fit in (self.pre_fit, self.post_fit) if fit is not None]
        hours = self._wander.timeline.hours
        midway = MIDWAY * (hours[0] + hours[-1])
        return GaugeResult(
            sensitivity_mv_per_mn=self._wander.sensitivity(midway),
            offset_mv=self._wander.offset(midway),
            nonlinearity_percent=max(fit.nonlinearity_percent for fit in fits),
            drifted=self.verdict is not None and self.verdict.drifted,
            drift_p_value=None if self.verdict is None else self.verdict.p_value,
            statement=self._statement(),
            hysteresis_percent=self._wander.hysteresis_percent(),
            misfit_mn=self._wander.curve.misfit_mn,
            gravity=self._settings.gravity,
            zero_readings=self._wander.zeros_used,
        )

    def _statement(self) -> str:
        sentence = self.verdict.statement if self.verdict is not None else ""
        for fit, which in ((self.pre_fit, "before"), (self.post_fit, "after")):
            if fit is not None and fit.curved:
                sentence += (
                    f" The calibration {which} the test is curved (p = {fit.curvature_p_value:.1g}), "
                    f"by up to {fit.nonlinearity_percent:.2f} % of its range."
                )
        unseen = self._wander is not None and not self._wander.zeros_used
        if self.verdict is not None and unseen and not self._settings.zero_declared:
            sentence += f" {UNSEEN_DRIFT}"
        return " ".join([sentence.strip(), *(note[0].upper() + note[1:] + "." for note in self.notes)]).strip()


def _wander(
    used: Sequence[CalibrationPoints], timeline: Timeline, zeros: Sequence[ZeroReading], settings: CalibrationSettings
) -> Wander:
    return Wander(fit_curve(used, settings), timeline, zeros, settings, WithinCalibrations(used))


def _usable(
    points: CalibrationPoints | None, which: str, settings: CalibrationSettings, notes: list[str]
) -> GaugeFit | None:
    if points is None:
        return None
    try:
        return fit_line(points, settings.typical_weight_error_mn(points.load_mn), settings.drift_test_level)
    except CalibrationError as error:
        notes.append(f"the calibration {which} the test cannot be used: {error}")
        return None


def _seconds(time: str) -> float | None:
    """Seconds since the epoch of an ISO 8601 time, UTC unless it says otherwise; None if it cannot be read."""
    try:
        moment = datetime.fromisoformat(time)
        return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()
    except (TypeError, ValueError, OverflowError):
        return None
