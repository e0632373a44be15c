"""The load behind a bridge voltage at any time of a test, from the calibrations before and after it (Sec. 3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.line import CalibrationError, DriftVerdict, GaugeFit, compare, fit_line
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints
from rig.readings import GaugeScale

__all__ = ["CalibrationError", "DriftVerdict", "GaugeFit", "GaugeHistory", "GaugeResult", "compare", "fit_line"]

MIDWAY = 0.5
BEYOND = 1.0  # a time farther from the calibrations than they are from each other is a clock set wrong


@dataclass(frozen=True, slots=True)
class GaugeResult:
    """The gauge over a whole test: the line midway between the calibrations, and whether they agree.

    ``drift_p_value`` is None where drift could not be tested.
    """

    sensitivity_mv_per_mn: Estimate
    offset_mv: Estimate
    nonlinearity_percent: float
    drifted: bool
    drift_p_value: float | None
    statement: str


class GaugeHistory:
    """The gauge between the calibration before a test and the one after it.

    Sensitivity and offset are interpolated linearly in time. With tau from 0 (before) to 1 (after), a quantity that
    the two calibrations disagree about by d has, when they drifted apart, the additional variance d^2 tau (1 - tau):
    that of a random walk pinned at both calibrations whose one known increment d stands for its size, and also that
    of a single jump by d at an unknown time between them. Steady drift and a jump are covered as stated; a free random
    walk less well, as its size is known from one increment alone. Before the first and after the last calibration
    the nearest one holds, with variance d^2 times the time beyond it as a share of the time between them.

    With one calibration only, that one holds throughout, with a note; with neither, every answer is None.
    A calibration that cannot be used counts as absent, with a note that says why.

    Parameters
    ----------
    pre, post
        Calibrations before and after the test, or None.
    settings
        Uncertainty of the weights and level of the drift test.

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
        self, pre: CalibrationPoints | None, post: CalibrationPoints | None, settings: CalibrationSettings
    ) -> None:
        notes: list[str] = []
        self.pre_fit = _usable(pre, "before", settings, notes)
        self.post_fit = _usable(post, "after", settings, notes)
        self.verdict: DriftVerdict | None = None
        if pre is not None and post is not None and self.pre_fit is not None and self.post_fit is not None:
            self.verdict = compare(pre, post, settings.drift_test_level)
        elif self.pre_fit is not None or self.post_fit is not None:
            which = "before" if self.pre_fit is not None else "after"
            notes.append(f"only the calibration {which} the test is there: loads do not allow for drift of the gauge")
        else:
            notes.append("there is no calibration to tell loads from voltages")
        self.notes = tuple(notes)

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

    def scale_at(self, time: str) -> GaugeScale | None:
        """Return the line in force at a time."""
        fraction, _ = self.fraction_at(time)
        line = self._line(fraction)
        return None if line is None else GaugeScale(sensitivity_mv_per_mn=float(line[1]), offset_mv=float(line[0]))

    def load_at(self, voltage_mv: float, time: str, voltage_uncertainty_mv: float = 0.0) -> Estimate | None:
        """Load behind a bridge voltage, mN.

        The standard error combines the reading (``voltage_uncertainty_mv``, standard, mV), the fits, the weights and
        the drift as the class describes. None without a calibration or where the voltage is not finite.
        """
        fraction, _ = self.fraction_at(time)
        line = self._line(fraction)
        if line is None or not math.isfinite(voltage_mv):
            return None
        offset, slope = line
        load = (voltage_mv - offset) / slope
        # dP = -(d offset + P d slope) / slope
        gradient = np.array([-1.0, -load]) / slope
        return self._spread(float(load), gradient, fraction, (voltage_uncertainty_mv / slope) ** 2)

    def result(self) -> GaugeResult | None:
        """Return the gauge over the whole test, or None without a calibration."""
        line = self._line(MIDWAY)
        if line is None:
            return None
        fits = [fit for fit in (self.pre_fit, self.post_fit) if fit is not None]
        return GaugeResult(
            sensitivity_mv_per_mn=self._spread(float(line[1]), np.array([0.0, 1.0]), MIDWAY),
            offset_mv=self._spread(float(line[0]), np.array([1.0, 0.0]), MIDWAY),
            nonlinearity_percent=max(fit.nonlinearity_percent for fit in fits),
            drifted=self.verdict is not None and self.verdict.drifted,
            drift_p_value=None if self.verdict is None else self.verdict.p_value,
            statement=self._statement(),
        )

    def _line(self, fraction: float) -> NDArray[np.float64] | None:
        """(2,) offset and sensitivity."""
        parts = self._shares(fraction)
        if not parts:
            return None
        total = np.zeros(2)
        for share, fit in parts:
            total += share * np.array([fit.offset_mv.value, fit.sensitivity_mv_per_mn.value])
        return total

    def _shares(self, fraction: float) -> list[tuple[float, GaugeFit]]:
        if self.pre_fit is not None and self.post_fit is not None:
            inside = min(max(fraction, 0.0), 1.0)
            return [(1.0 - inside, self.pre_fit), (inside, self.post_fit)]
        return [(1.0, fit) for fit in (self.pre_fit, self.post_fit) if fit is not None]

    def _spread(self, value: float, gradient: NDArray[np.float64], fraction: float, known: float = 0.0) -> Estimate:
        """Estimate of a quantity whose derivatives by offset and sensitivity are ``gradient`` (2,)."""
        variance = known
        uncertain = 0.0
        weight_std = 0.0
        for share, fit in self._shares(fraction):
            by_reading = share**2 * float(gradient @ fit.normal_inverse @ gradient)
            variance += fit.reading_std_mv**2 * by_reading
            if fit.dof > 0:
                uncertain += (fit.residual_std_mv**2 * by_reading) ** 2 / fit.dof
            # The same weights hang in both calibrations: their errors add up rather than average out.
            weight_std += share * math.sqrt(max(float(gradient @ fit.weight_covariance @ gradient), 0.0))
        variance += weight_std**2
        if self.verdict is not None and self.verdict.drifted and self.pre_fit is not None and self.post_fit is not None:
            difference = np.array(
                [
                    self.post_fit.offset_mv.value - self.pre_fit.offset_mv.value,
                    self.post_fit.sensitivity_mv_per_mn.value - self.pre_fit.sensitivity_mv_per_mn.value,
                ]
            )
            inside = min(max(fraction, 0.0), 1.0)
            variance += float(gradient @ difference) ** 2 * (inside * (1.0 - inside) + abs(fraction - inside))
        dof = variance**2 / uncertain if uncertain > 0 else math.inf
        return Estimate(value, math.sqrt(variance), max(dof, 1.0))

    def _statement(self) -> str:
        sentence = self.verdict.statement if self.verdict is not None else ""
        for fit, which in ((self.pre_fit, "before"), (self.post_fit, "after")):
            if fit is not None and fit.curved:
                sentence += (
                    f" The calibration {which} the test is curved (p = {fit.curvature_p_value:.1g}), "
                    f"by up to {fit.nonlinearity_percent:.2f} % of its range."
                )
        return " ".join([sentence.strip(), *(note[0].upper() + note[1:] + "." for note in self.notes)]).strip()


def _usable(
    points: CalibrationPoints | None, which: str, settings: CalibrationSettings, notes: list[str]
) -> GaugeFit | None:
    if points is None:
        return None
    try:
        return fit_line(points, settings.weight_uncertainty_mn, settings.drift_test_level)
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
