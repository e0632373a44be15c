"""Offset and sensitivity of the gauge at any time of a test, and the budget of a load behind a voltage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from calibration.budget import Budget, Contribution
from calibration.curve import GaugeCurve
from calibration.estimate import Estimate
from calibration.random_walk import DECLARED_DOF, RandomWalk
from calibration.settings import CalibrationSettings
from calibration.weights import buoyancy_half_width
from calibration.within import WithinCalibrations
from daq.records import ZeroReading

FloatArray = NDArray[np.float64]
ASSUMED_ZERO_DRIFT = 0.1  # mN in a root hour, the order of a gauge of which nothing is declared: 0.01 % of 1 N
ASSUMED_SENSITIVITY_DRIFT = 0.005  # % in a root hour
LONGEST_SINCE_H = 48.0  # of a zero reading since the only calibration
LEAST_SQUARES_SHARE = 1 / 6  # x^2 - x has the least-squares line -1/6 over 0 to 1


@dataclass(frozen=True, slots=True)
class Timeline:
    """Times of the calibrations: ``hours`` since the first, whose moment is ``start_s`` (None: unknown)."""

    start_s: float | None
    hours: tuple[float, ...]


class Wander:
    """The curve of the gauge with offset and sensitivity that wander between calibrations and zero readings.

    Parameters
    ----------
    curve
        Through all calibrations.
    timeline
        When they were made.
    zeros
        Readings without load; those whose time cannot be read, or lies outside of the calibrations, are left out.
    settings
        What is declared of weights, gravity, temperature and drift.
    within
        What the readings of the calibrations tell of the drift of the zero.
    """

    def __init__(
        self,
        curve: GaugeCurve,
        timeline: Timeline,
        zeros: Sequence[ZeroReading],
        settings: CalibrationSettings,
        within: WithinCalibrations | None = None,
    ) -> None:
        self.curve, self.timeline, self._settings = curve, timeline, settings
        c = len(timeline.hours)
        slope = float(np.mean(curve.slope_mv)) / curve.largest_mn
        variance = np.diag(curve.reading_covariance)
        # a zero reading counts from where the calibrations' own put the offset of the curve
        above = curve.offset_mv - curve.zero_mv
        self._with_zero = np.isfinite(above)
        level = float(np.mean(above[self._with_zero])) if self._with_zero.any() else 0.0
        used = self._between(zeros) if c == 2 or timeline.start_s is not None else []
        self.zeros_used = len(used)
        noise = curve.reading_std_mv**2
        self._offset = RandomWalk(
            [*timeline.hours, *(hour for hour, _ in used)],
            [*curve.offset_mv, *(voltage + level for _, voltage in used)],
            [*variance[:c], *(noise for _ in used)],
            *_prior(settings.zero_drift_mn_per_root_hour, ASSUMED_ZERO_DRIFT, slope),
            within.log_likelihood if within is not None and within.contrasts else None,
        )
        self._slope = RandomWalk(
            timeline.hours,
            curve.slope_mv,
            variance[c : 2 * c],
            *_prior(
                settings.sensitivity_drift_percent_per_root_hour,
                ASSUMED_SENSITIVITY_DRIFT,
                slope * curve.largest_mn / 100,
            ),
        )
        self._observed = np.array([*curve.offset_mv, *(voltage + level for _, voltage in used)])

    def _between(self, zeros: Sequence[ZeroReading]) -> list[tuple[float, float]]:
        """Hour and voltage of the zero readings that can be used."""
        if self.timeline.start_s is None:
            return []
        found = []
        for zero in zeros:
            try:
                moment = datetime.fromisoformat(zero.time)
            except (TypeError, ValueError):
                continue
            moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
            hour = (moment.timestamp() - self.timeline.start_s) / 3600
            if math.isfinite(zero.voltage_mv) and 0.0 <= hour <= max(*self.timeline.hours, LONGEST_SINCE_H):
                found.append((hour, zero.voltage_mv))
        last = self.timeline.hours[-1]
        return [f for f in found if len(self.timeline.hours) == 1 or f[0] <= last]

    def budget(self, voltage_mv: float, hour: float, reading: Contribution, quantum_mv: float) -> Budget:
        """Load behind a voltage with every source of its uncertainty, mN; ``reading`` is that of the voltage, in mV."""
        curve = self.curve
        picked, by_zero = self._picked(hour)
        offset = float(self._offset.weights(hour) @ self._observed)
        slope_full = float(self._slope.weights(hour) @ curve.slope_mv)
        load, slope = curve.load_mn(voltage_mv, offset, slope_full)
        x = load / curve.largest_mn
        # dV = da + x ds + (x^2 - x) dq, and dP = -dV / slope
        by_parameter = np.concatenate([picked[0], x * picked[1], [x**2 - x]])
        gain = by_parameter @ curve.weight_gain / slope
        weight = gain * curve.weight_std_mn * (slope_full / curve.largest_mn)
        scatter = math.sqrt(max(float(by_parameter @ curve.reading_covariance @ by_parameter), 0.0) + by_zero) / slope
        # the curve misses the load itself as well as each weight
        misfit = curve.misfit_mn * math.sqrt(1 + float(np.sum(gain**2)) * (slope_full / curve.largest_mn) ** 2)
        return Budget(
            "load",
            "mN",
            load,
            tuple(
                part
                for part in (
                    Contribution(
                        reading.source, reading.value, "mV", reading.standard_uncertainty, 1 / slope, reading.dof
                    ),
                    Contribution(
                        "resolution of the amplifier",
                        math.nan,
                        "mV",
                        quantum_mv / math.sqrt(12),
                        1 / slope,
                        distribution="rectangular",
                    ),
                    Contribution(
                        "scatter of the calibration's readings", math.nan, "mN", scatter, 1.0, curve.reading_dof, "t"
                    ),
                    Contribution("weights, each by itself", math.nan, "mN", float(np.linalg.norm(weight)), 1.0),
                    Contribution("misfit of the curve", math.nan, "mN", misfit, 1.0, curve.misfit_dof, "t"),
                    Contribution("hysteresis", math.nan, "mN", curve.loop_at(load), 1.0, distribution="two-point"),
                    *self._of_the_weights(load),
                    *self._of_the_drift(hour, x, slope),
                    *self._of_the_temperature(load),
                    Contribution(
                        "zero between its readings, limits declared",
                        math.nan,
                        "mN",
                        self._settings.zero_limit_mn / math.sqrt(3),
                        1.0,
                        distribution="rectangular",
                    ),
                )
                if part.standard_uncertainty > 0 or part.source == reading.source
            ),
        )

    def _picked(self, hour: float) -> tuple[tuple[FloatArray, FloatArray], float]:
        """Share of each calibration's offset and slope at a time, and the variance that zero readings add, mV^2."""
        c = len(self.timeline.hours)
        by_offset, by_slope = self._offset.weights(hour), self._slope.weights(hour)
        offsets = by_offset[:c].copy()
        by_zero = float(by_offset[c:].sum())
        noise = self.curve.reading_std_mv**2
        added = noise * float(np.sum(by_offset[c:] ** 2))
        if by_zero and self._with_zero.any():
            share = by_zero / int(self._with_zero.sum())
            offsets += share * self._with_zero
            added += noise * share**2 * float(np.sum(1 / self.curve.zero_readings[self._with_zero]))
        return (offsets, by_slope), added

    def _of_the_weights(self, load: float) -> list[Contribution]:
        """What all weights have in common, and so every load in proportion."""
        settings = self._settings
        gravity = settings.gravity
        return [
            Contribution(
                "weights, in common",
                math.nan,
                "1",
                settings.common_weight_uncertainty_percent / 100,
                load,
            ),
            Contribution(
                f"local gravity ({gravity.source})",
                gravity.value,
                "m/s2",
                gravity.standard_uncertainty,
                load / gravity.value,
                distribution=gravity.distribution,
            ),
            Contribution(
                "buoyancy of the air",
                math.nan,
                "1",
                buoyancy_half_width(settings.weights_g is not None) / math.sqrt(3),
                load,
                distribution="rectangular",
            ),
        ]

    def _of_the_drift(self, hour: float, x: float, slope: float) -> list[Contribution]:
        return [
            Contribution(
                "drift of the zero",
                math.nan,
                "mV",
                math.sqrt(self._offset.variance(hour)),
                1 / slope,
                self._offset.dof,
                "t",
            ),
            Contribution(
                "drift of the sensitivity",
                math.nan,
                "mV",
                math.sqrt(self._slope.variance(hour)),
                x / slope,
                self._slope.dof,
                "t",
            ),
        ]

    def _of_the_temperature(self, load: float) -> list[Contribution]:
        settings = self._settings
        return [
            Contribution(
                f"temperature against the calibrations, {of}",
                math.nan,
                "K",
                settings.temperature_uncertainty_k,
                per_k,
            )
            for of, per_k in (
                ("sensitivity", load * settings.sensitivity_percent_per_k / 100),
                ("zero", settings.zero_mn_per_k),
            )
        ]

    def line(self, hour: float) -> tuple[float, float]:
        """Offset, mV, and sensitivity, mV/mN, of the least-squares line of the curve at a time."""
        offset = float(self._offset.weights(hour) @ self._observed)
        slope = float(self._slope.weights(hour) @ self.curve.slope_mv)
        return offset - LEAST_SQUARES_SHARE * self.curve.curvature_mv, slope / self.curve.largest_mn

    def sensitivity(self, hour: float) -> Estimate:
        """Sensitivity of that line, mV/mN, with the uncertainty of the weights' force."""
        curve, c = self.curve, len(self.timeline.hours)
        picked = np.zeros(2 * c + 1)
        picked[c : 2 * c] = self._slope.weights(hour)
        _, slope = self.line(hour)
        in_common = sum(p.uncertainty**2 for p in self._of_the_weights(slope))
        drift = self._slope.variance(hour) / curve.largest_mn**2
        return self._linear(slope, picked / curve.largest_mn, in_common, drift)

    def offset(self, hour: float) -> Estimate:
        """Offset of that line, mV."""
        c = len(self.timeline.hours)
        (offsets, _), by_zero = self._picked(hour)
        picked = np.concatenate([offsets, np.zeros(c), [-LEAST_SQUARES_SHARE]])
        return self._linear(self.line(hour)[0], picked, by_zero, self._offset.variance(hour))

    def _linear(self, value: float, picked: FloatArray, more: float, drift: float) -> Estimate:
        """Estimate of a combination of the curve's parameters."""
        curve = self.curve
        per_weight = picked @ curve.weight_gain * float(np.mean(curve.slope_mv)) / curve.largest_mn
        scatter = max(float(picked @ curve.reading_covariance @ picked), 0.0)
        misfit = curve.misfit_mn**2 * float(np.sum(per_weight**2))
        parts = [
            Contribution("", math.nan, "", math.sqrt(scatter), 1.0, curve.reading_dof),
            Contribution("", math.nan, "", math.sqrt(misfit), 1.0, curve.misfit_dof),
            Contribution("", math.nan, "", float(np.linalg.norm(per_weight * curve.weight_std_mn)), 1.0),
            Contribution("", math.nan, "", math.sqrt(more), 1.0),
            Contribution("", math.nan, "", math.sqrt(drift), 1.0, self._offset.dof),
        ]
        return Budget("", "", value, tuple(parts)).estimate()

    def hysteresis_percent(self) -> float:
        """Half of the loop's largest width, % of the range of the weights."""
        return 100 * float(np.max(self.curve.loop_half_width_mn, initial=0.0)) / self.curve.largest_mn


def _prior(declared: float | None, assumed: float, unit: float) -> tuple[float, float | None]:
    """Rate of a drift, in the unit of what drifts, and its degrees of freedom, if it is known at all."""
    return (assumed * unit, None) if declared is None else (declared * unit, DECLARED_DOF)
