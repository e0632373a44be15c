"""The straight line of a dead-weight calibration (Fig. 5), and whether one line serves two calibrations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibration.estimate import LEVEL, Estimate
from daq.records import CalibrationPoints
from rig.errors import MesotapError
from rig.readings import GaugeScale

FloatArray = NDArray[np.float64]
_ROUNDING = 64 * float(np.finfo(np.float64).eps)  # residuals below this share of the voltages are no scatter

_SAME_WEIGHT = 1e-6  # loads that differ by no more than this share (of 1 mN at least) are one weight
MOST_READINGS = 2000  # a weight a second for half an hour; the usual are 14
_IMPLAUSIBLE = 1e9  # no gauge and no weight reaches this, in mV or mN


class CalibrationError(MesotapError, ValueError):
    """These points are no calibration; the text is one sentence for the operator."""


@dataclass(frozen=True, slots=True)
class GaugeFit:
    """Line ``voltage = offset + sensitivity * load`` through the points of one calibration.

    Attributes
    ----------
    sensitivity_mv_per_mn, offset_mv
        The line with its uncertainty.
    normal_inverse
        (2, 2) inverse normal matrix in the order offset, sensitivity; times a variance of the readings (mV^2)
        it is the covariance that they give to the line.
    weight_covariance
        (2, 2) covariance of offset and sensitivity from the uncertain weights; one weight has one error, however
        often it is hung.
    residual_std_mv
        Scatter about the line, mV; zero where ``dof`` is.
    reading_std_mv
        The part of it that the uncertain weights do not explain, mV.
    dof
        Residual degrees of freedom, number of points less two.
    nonlinearity_percent
        Largest distance of the mean voltage at a weight from the line, % of the voltage range of the line.
    curvature_p_value
        Of the test that no quadratic term is needed; None where the points cannot tell.
    curved
        Whether that test rejects at its level.
    time
        When, as the points say.
    """

    sensitivity_mv_per_mn: Estimate
    offset_mv: Estimate
    normal_inverse: FloatArray
    weight_covariance: FloatArray
    residual_std_mv: float
    reading_std_mv: float
    dof: int
    nonlinearity_percent: float
    curvature_p_value: float | None
    curved: bool
    time: str

    @property
    def covariance(self) -> FloatArray:
        """(2, 2) covariance of offset (mV) and sensitivity (mV/mN), readings and weights together."""
        return self.reading_std_mv**2 * self.normal_inverse + self.weight_covariance

    @property
    def scale(self) -> GaugeScale:
        """The line without its uncertainty."""
        return GaugeScale(self.sensitivity_mv_per_mn.value, self.offset_mv.value)


@dataclass(frozen=True, slots=True)
class DriftVerdict:
    """Whether two calibrations differ: ``p_value`` is None where there is no scatter to judge a difference by."""

    drifted: bool
    p_value: float | None
    statement: str


def fit_line(points: CalibrationPoints, weight_uncertainty_mn: float, level: float = 0.01) -> GaugeFit:
    """Fit voltage against load by least squares.

    The errors behind a voltage are that of the reading, independent and of unknown size s_v, and that of the weight,
    of known size u_w, shared by every reading of that weight and absent without a weight. Least squares gives offset
    and sensitivity; s_v^2 is what the residual variance leaves beyond the share that u_w is expected to give it.
    The uncertainty of the line is the sum of both, with degrees of freedom after Welch and Satterthwaite. With two
    points there is no residual, and the uncertainty is that of the weights alone.

    Parameters
    ----------
    points
        (n,) loads, mN, and (n,) voltages, mV.
    weight_uncertainty_mn
        Standard uncertainty of a weight, mN.
    level
        Level of the test for a quadratic term.

    Raises
    ------
    CalibrationError
        Fewer than two different weights, values that are not finite or beyond reason, shapes that do not fit, or a
        voltage that does not rise with the load.

    Examples
    --------
    >>> load = np.array([0.0, 100.0, 200.0, 300.0])
    >>> fitted = fit_line(CalibrationPoints(load, 1.5 + 0.042 * load, "2026-01-01T00:00:00Z"), 0.1)
    >>> round(fitted.sensitivity_mv_per_mn.value, 6)
    0.042
    """
    load, voltage = checked(points)
    largest = float(np.max(np.abs(load)))
    line = _LeastSquares(load / largest, voltage, order=1)
    slope = float(line.coefficients[1]) / largest
    if not slope * float(np.ptp(load)) > _ROUNDING * float(np.max(np.abs(voltage))):
        raise CalibrationError(
            f"the bridge voltage does not rise with the load (fitted sensitivity {slope:.4g} mV/mN); check the wiring "
            "of the gauge and the order of the weights"
        )
    weight_std_mv = slope * weight_uncertainty_mn
    reading_std = line.reading_std(weight_std_mv)
    unit = np.array([1.0, 1.0 / largest])
    normal_inverse = line.normal_inverse * np.outer(unit, unit)
    weight_covariance = line.weight_covariance(weight_std_mv) * np.outer(unit, unit)
    offset, sensitivity = (
        _estimate(value, reading_std**2 * n, weights, line.residual_std**2 * n, line.dof)
        for value, n, weights in zip(
            line.coefficients * unit, np.diag(normal_inverse), np.diag(weight_covariance), strict=True
        )
    )
    if sensitivity.low <= 0:
        raise CalibrationError(
            f"the bridge voltage does not follow the load: the sensitivity is {slope:.4g} mV/mN with a {LEVEL:.0%} "
            f"interval from {sensitivity.low:.4g}; check the gauge and its amplifier"
        )
    p_value = _curvature(load / largest, voltage, weight_std_mv)
    return GaugeFit(
        sensitivity_mv_per_mn=sensitivity,
        offset_mv=offset,
        normal_inverse=normal_inverse,
        weight_covariance=weight_covariance,
        residual_std_mv=line.residual_std,
        reading_std_mv=reading_std,
        dof=line.dof,
        nonlinearity_percent=100 * line.largest_mean_residual() / (slope * float(np.ptp(load))),
        curvature_p_value=p_value,
        curved=p_value is not None and p_value < level,
        time=points.time,
    )


def compare(pre: CalibrationPoints, post: CalibrationPoints, level: float) -> DriftVerdict:
    """Test whether one line serves both calibrations, against a line for each.

    With S_1 and S_2 the sums of squared residuals of one and of two lines through N points in all,
    F = ((S_1 - S_2) / 2) / (S_2 / (N - 4)) follows the F distribution with 2 and N - 4 degrees of freedom when
    nothing drifted. Errors of weights that serve in both calibrations move both lines alike and only widen S_2.

    Points without any scatter are taken at their word: lines that differ beyond rounding have drifted. Without
    residual degrees of freedom there is no verdict (``p_value`` None, not drifted).

    Parameters
    ----------
    pre, post
        The two calibrations.
    level
        Probability of finding a drift where there is none.
    """
    sets = [checked(pre), checked(post)]
    load, voltage = (np.concatenate(both) for both in zip(*sets, strict=True))
    largest = float(np.max(np.abs(load)))
    one = _LeastSquares(load / largest, voltage, order=1)
    two = [_LeastSquares(p / largest, v, order=1) for p, v in sets]
    change = _change_sentence(two, largest)
    dof = len(load) - 4
    if dof < 1:
        return DriftVerdict(False, None, f"{change} Two points each leave no scatter to judge this by.")
    rounding = len(load) * (_ROUNDING * float(np.max(np.abs(voltage)))) ** 2
    separate = sum(fit.sum_of_squares for fit in two)
    reduction = max(one.sum_of_squares - separate, 0.0)
    if reduction <= rounding:
        p_value = 1.0
    elif separate <= rounding:
        p_value = 0.0
    else:
        p_value = float(stats.f.sf(reduction / 2 / (separate / dof), 2, dof))
    drifted = p_value < level
    verdict = "differ" if drifted else "agree"
    shown = f"p = {p_value:.3f}" if p_value >= 0.001 else f"p = {p_value:.0e}" if p_value > 0 else "no scatter at all"
    return DriftVerdict(
        drifted,
        p_value,
        f"The calibrations before and after the test {verdict} (F test, {shown}, level {level:g}). {change}",
    )


def checked(points: CalibrationPoints) -> tuple[FloatArray, FloatArray]:
    """Return loads (n,), mN, and voltages (n,), mV, as float64, or raise `CalibrationError`."""
    try:
        load = np.asarray(points.load_mn, dtype=np.float64)
        voltage = np.asarray(points.voltage_mv, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CalibrationError("the calibration's loads and voltages are not numbers") from error
    if load.ndim != 1 or load.shape != voltage.shape:
        raise CalibrationError(
            f"loads of shape {load.shape} and voltages of shape {voltage.shape} are no calibration: one voltage "
            "belongs to each load"
        )
    if load.size > MOST_READINGS:
        raise CalibrationError(f"the calibration has {load.size} readings, more than {MOST_READINGS}")
    bad = ~(np.isfinite(load) & np.isfinite(voltage))
    if bad.any():
        raise CalibrationError(f"point {int(np.argmax(bad)) + 1} of the calibration is not a finite number")
    if max(float(np.max(np.abs(load), initial=0.0)), float(np.max(np.abs(voltage), initial=0.0))) > _IMPLAUSIBLE:
        raise CalibrationError(f"the calibration has loads or voltages beyond {_IMPLAUSIBLE:g} mN or mV")
    if load.size == 0 or float(np.ptp(load)) <= _SAME_WEIGHT * max(1.0, float(np.max(np.abs(load)))):
        raise CalibrationError("a calibration line needs at least two different weights")
    return load, voltage


def _rounded(x: FloatArray) -> FloatArray:
    """Return scaled loads (n,), those of one weight equal."""
    return np.asarray(np.round(x / _SAME_WEIGHT), dtype=np.float64)


class _LeastSquares:
    """Polynomial through (n,) scaled loads and voltages, with what its covariance is made of."""

    def __init__(self, x: FloatArray, voltage: FloatArray, order: int) -> None:
        design = np.vander(x, order + 1, increasing=True)
        self.coefficients = np.asarray(np.linalg.lstsq(design, voltage, rcond=None)[0], dtype=np.float64)
        self.residuals = voltage - design @ self.coefficients
        self.normal_inverse = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
        self.sum_of_squares = float(self.residuals @ self.residuals)
        self.dof = len(x) - order - 1
        self.residual_std = math.sqrt(self.sum_of_squares / self.dof) if self.dof > 0 else 0.0
        self._design = design
        self._weights, self._which = np.unique(_rounded(x), return_inverse=True)

    def _by_weight(self) -> FloatArray:
        """(n, w) which reading has which weight; a reading without weight has none, and no error of it."""
        return (self._which[:, None] == np.arange(len(self._weights))) * (self._weights != 0.0)

    def reading_std(self, weight_std_mv: float) -> float:
        """Standard deviation of a reading: the residual variance less the share of the weights' errors, mV."""
        if self.dof < 1:
            return 0.0
        by_weight = self._by_weight()
        projected = by_weight - self._design @ (self.normal_inverse @ (self._design.T @ by_weight))
        share = weight_std_mv**2 * float(np.sum(projected**2)) / self.dof
        return math.sqrt(max(self.residual_std**2 - share, 0.0))

    def weight_covariance(self, weight_std_mv: float) -> FloatArray:
        """Covariance of the coefficients from independent errors of the weights, each worth ``weight_std_mv``."""
        gain = self.normal_inverse @ (self._design.T @ self._by_weight())
        return weight_std_mv**2 * (gain @ gain.T)

    def largest_mean_residual(self) -> float:
        """Largest magnitude of the mean residual at a weight, mV."""
        means = np.bincount(self._which, self.residuals) / np.bincount(self._which)
        return float(np.max(np.abs(means)))


def _estimate(value: float, reading: float, weights: float, raw: float, dof: int) -> Estimate:
    """Value with variance ``reading + weights``; only the raw residual variance ``raw`` behind it is uncertain."""
    variance = reading + weights
    effective = dof * (variance / raw) ** 2 if raw > 0 else math.inf
    return Estimate(float(value), math.sqrt(variance), max(effective, 1.0))


def _curvature(x: FloatArray, voltage: FloatArray, weight_std_mv: float) -> float | None:
    """Two-sided p value of a quadratic term; None with fewer than three weights or no degree of freedom left."""
    if len(np.unique(_rounded(x))) < 3 or len(x) < 4:
        return None
    parabola = _LeastSquares(x, voltage, order=2)
    n = float(parabola.normal_inverse[2, 2])
    quadratic = _estimate(
        float(parabola.coefficients[2]),
        parabola.reading_std(weight_std_mv) ** 2 * n,
        float(parabola.weight_covariance(weight_std_mv)[2, 2]),
        parabola.residual_std**2 * n,
        parabola.dof,
    )
    if abs(quadratic.value) <= _ROUNDING * float(np.max(np.abs(voltage))):
        return 1.0
    if quadratic.standard_error == 0.0:
        return 0.0
    return float(2 * stats.t.sf(abs(quadratic.value) / quadratic.standard_error, quadratic.dof))


def _change_sentence(fits: list[_LeastSquares], largest: float) -> str:
    """What changed from the first line to the second, in numbers."""
    (offset_0, slope_0), (offset_1, slope_1) = (fit.coefficients for fit in fits)
    apparent = ((offset_1 - offset_0) + (slope_1 - slope_0)) / slope_0 * largest if slope_0 else math.nan
    percent = 100 * (slope_1 / slope_0 - 1) if slope_0 else math.nan
    return (
        f"From before to after, the sensitivity went from {slope_0 / largest:#.5g} to {slope_1 / largest:#.5g} mV/mN "
        f"({percent:+z.2f} %) and the zero from {offset_0:#.4g} to {offset_1:#.4g} mV, "
        f"which shifts a load of {largest:.4g} mN by {apparent:+z.2f} mN."
    )
