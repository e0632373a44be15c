"""The curve of the gauge through all calibrations of a test: two lines, one curvature, and what is left beside them.

Voltage of reading i of calibration c under a weight that reads L (x = L / L_max):

    V_i = a_c + s_c x + q (x^2 - x) + d_i h psi(x) + error of the weight + misfit of the curve + noise of the reading,

with d_i = +1 when the weight was reached from above and -1 from below, and psi = 4 x (1 - x) a loop closed at its ends.
The loop is fitted so that unequal numbers of both do not bias the curve; its width at a load is read off the
differences at each weight, whatever their shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibration.line import checked
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints

FloatArray = NDArray[np.float64]

_SAME_WEIGHT = 1e-6  # of the largest load: loads no further apart are one weight
FEWEST_FOR_CURVATURE = 4  # weights: with three, a parabola would leave nothing to judge its fit by
MISFIT_QUANTILE = 0.75  # of chi^2, which the residuals of sound gauges stay below: seeds 9001 to 9100 of the benchmark
MOST_BENT = 0.5  # curvature over slope: with it, the slope at one end is half of that in the middle
FEWEST_FOR_A_LOOP = 2  # weights that were reached from both sides
FEWEST_DOF = 3  # from which the scatter of readings is told from that of the weights


@dataclass(frozen=True, slots=True)
class GaugeCurve:
    """What `fit_curve` found. Voltages in mV, x in parts of ``largest_mn``.

    Attributes
    ----------
    largest_mn
        Largest weight, mN.
    offset_mv, slope_mv
        (c,) of each calibration.
    curvature_mv
        q.
    reading_covariance
        (2 c + 1, 2 c + 1) of offsets, slopes and curvature from the scatter of the readings, mV^2.
    weight_gain
        (2 c + 1, w) what a voltage that each weight adds everywhere makes of them.
    weight_std_mn
        (w,) standard uncertainty of each weight by itself, mN.
    reading_std_mv, reading_dof
        Scatter of a reading and its degrees of freedom.
    misfit_mn, misfit_dof
        Standard deviation of the gauge from its curve, beyond what the weights' errors explain, mN.
    loop_load_mn, loop_half_width_mn
        (l,) weights and half of the distance between the curves going up and going down; empty where unknown.
    zero_mv, zero_readings
        (c,) mean voltage without a weight, NaN without such a reading, and the number of readings behind it.
    """

    largest_mn: float
    offset_mv: FloatArray
    slope_mv: FloatArray
    curvature_mv: float
    reading_covariance: FloatArray
    weight_gain: FloatArray
    weight_std_mn: FloatArray
    reading_std_mv: float
    reading_dof: float
    misfit_mn: float
    misfit_dof: float
    loop_load_mn: FloatArray
    loop_half_width_mn: FloatArray
    zero_mv: FloatArray
    zero_readings: NDArray[np.int64]

    def loop_at(self, load_mn: float) -> float:
        """Half of the loop's width at a load, mN; zero outside of the loop."""
        if not self.loop_load_mn.size:
            return 0.0
        return float(np.interp(load_mn, self.loop_load_mn, self.loop_half_width_mn))

    def load_mn(self, voltage_mv: float, offset_mv: float, slope_mv: float) -> tuple[float, float]:
        """Load at a voltage and the slope of the curve there, mN and mV/mN.

        Where a parabola does not reach the voltage, far outside the weights, its tangent at the nearer end does.
        """
        q, voltage = self.curvature_mv, voltage_mv - offset_mv
        x = voltage / slope_mv
        if q != 0.0:
            # s x + q (x^2 - x) = V
            b = slope_mv - q
            inside = b * b + 4 * q * voltage
            if b > 0 and inside > 0:
                x = 2 * voltage / (b + math.sqrt(inside))
            if not (b > 0 and inside > 0 and -0.5 <= x <= 1.5):
                x = 0.0 if voltage < 0 else 1.0
                tangent = slope_mv + q * (2 * x - 1)
                x += (voltage - slope_mv * x) / tangent
                return x * self.largest_mn, tangent / self.largest_mn
        return x * self.largest_mn, (slope_mv + q * (2 * x - 1)) / self.largest_mn


@dataclass(frozen=True, slots=True)
class HungWeights:
    """All readings (n,) of one or two calibrations, and which weight (of w) was hung in each.

    Attributes
    ----------
    x
        Load over the largest, ``largest_mn``; ``voltage`` in mV.
    own
        (n, calibrations) one where a reading belongs to a calibration.
    weights, place, hung
        (w,) different loads in steps of ``_SAME_WEIGHT``; (n,) number of each reading's; (n, w) the same as ones.
    direction
        -1 where the weight was reached from below, +1 from above.
    both
        (w,) which weights were reached from both sides.
    """

    x: FloatArray
    voltage: FloatArray
    own: FloatArray
    weights: FloatArray
    place: NDArray[np.intp]
    hung: FloatArray
    direction: FloatArray
    both: NDArray[np.bool_]
    largest_mn: float

    @classmethod
    def of(cls, calibrations: Sequence[CalibrationPoints]) -> HungWeights:
        """Return them for calibrations each of which passes `calibration.line.checked`."""
        parts = [checked(points) for points in calibrations]
        load = np.concatenate([part[0] for part in parts])
        voltage = np.concatenate([part[1] for part in parts])
        own = np.eye(len(parts))[np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])]
        direction = np.concatenate([_directions(part[0]) for part in parts])
        largest = float(np.max(np.abs(load)))
        x = load / largest
        weights, place = np.unique(np.round(x / _SAME_WEIGHT), return_inverse=True)
        both = _reached_both_ways(place, direction, len(weights))
        return cls(x, voltage, own, weights, place, np.eye(len(weights))[place], direction, both, largest)


def fit_curve(calibrations: Sequence[CalibrationPoints], settings: CalibrationSettings) -> GaugeCurve:
    """Fit the curve of the gauge to one or two calibrations, each of which passes `calibration.line.fit_line`.

    Scatter of the readings comes from weights that were hung more than once; what the means of the weights leave
    beyond that and beyond the weights' own uncertainty is misfit of the curve.
    """
    r = HungWeights.of(calibrations)
    c, x, voltage, direction, both = r.own.shape[1], r.x, r.voltage, r.direction, r.both
    largest, weights, hung = r.largest_mn, r.weights, r.hung
    design, gain, beta, curved = _monotonic(x, voltage, r.own, direction, len(weights), int(both.sum()))
    slope = float(np.mean(beta[c : 2 * c])) / largest
    weight_std = settings.weight_errors_mn(weights * _SAME_WEIGHT * largest)
    weight_std_mv = np.asarray(slope * weight_std, dtype=np.float64)
    scatter = _reading_scatter(voltage, hung, design, direction, both, c, weight_std_mv)
    misfit, misfit_dof = _misfit(voltage, hung, design, gain, scatter[0], weight_std_mv, curved)
    keep = 2 * c + (1 if curved else 0)
    full = np.zeros((2 * c + 1, len(x)))
    full[:keep] = gain[:keep]
    loop = _loop(voltage - design[:, :keep] @ beta[:keep], r.place, direction, both, scatter[0])
    empty = [(r.own[:, i] == 1.0) & (x == 0.0) for i in range(c)]
    return GaugeCurve(
        largest_mn=largest,
        offset_mv=beta[:c],
        slope_mv=beta[c : 2 * c],
        curvature_mv=float(beta[2 * c]) if curved else 0.0,
        reading_covariance=scatter[0] ** 2 * full @ full.T,
        weight_gain=full @ hung,
        weight_std_mn=weight_std,
        reading_std_mv=scatter[0],
        reading_dof=scatter[1],
        misfit_mn=misfit / slope,
        misfit_dof=misfit_dof,
        loop_load_mn=weights[both] * _SAME_WEIGHT * largest,
        loop_half_width_mn=loop / slope,
        zero_mv=np.array([float(np.mean(voltage[e])) if e.any() else math.nan for e in empty]),
        zero_readings=np.array([int(e.sum()) for e in empty]),
    )


def _monotonic(
    x: FloatArray, voltage: FloatArray, hung_in: FloatArray, direction: FloatArray, weights: int, both: int
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Design, its pseudo-inverse, the parameters, and whether a curvature is among them.

    What would make the voltage fall anywhere with the load, or bend more than a gauge can, is left out: it is misfit.
    """
    c = hung_in.shape[1]
    lines = np.hstack([hung_in, hung_in * x[:, None]])
    bend = [(x**2 - x)[:, None]] if weights >= FEWEST_FOR_CURVATURE else []
    loop = [(direction * 4 * x * (1 - x))[:, None]] if both >= FEWEST_FOR_A_LOOP else []
    for extra, curved in ((bend + loop, bool(bend)), (loop, False), ([], False)):
        design = np.hstack([lines, *extra])
        gain = np.asarray(np.linalg.pinv(design), dtype=np.float64)
        beta = np.asarray(gain @ voltage, dtype=np.float64)
        least = float(np.min(beta[c : 2 * c]))
        if least > 0 and not (curved and abs(beta[2 * c]) > MOST_BENT * least):
            break
    return design, gain, beta, curved


def _directions(load: FloatArray) -> FloatArray:
    """(n,) -1 where a weight was reached from below, +1 from above: the gauge is empty before the first."""
    steps = np.sign(np.diff(load, prepend=0.0))
    for i in range(1, len(steps)):
        if steps[i] == 0.0:
            # the largest weight hung again begins the way down, an empty gauge read again the way up
            rest = np.sign(np.diff(load[i:]))
            turn = rest[rest != 0.0]
            steps[i] = turn[0] if turn.size else steps[i - 1]
    return np.where(steps < 0, 1.0, -1.0)


def _reached_both_ways(place: NDArray[np.intp], direction: FloatArray, count: int) -> NDArray[np.bool_]:
    """(w,) which of the weights were reached from below as well as from above."""
    up, down = (np.bincount(place[direction == d], minlength=count) for d in (-1.0, 1.0))
    return (up > 0) & (down > 0)


def _residual(voltage: FloatArray, design: FloatArray) -> tuple[float, int]:
    """Sum of squares that a design leaves, and its degrees of freedom."""
    left, _, rank, _ = np.linalg.lstsq(design, voltage, rcond=None)
    return float(np.sum((voltage - design @ left) ** 2)), len(voltage) - int(rank)


def _reading_scatter(
    voltage: FloatArray,
    hung: FloatArray,
    design: FloatArray,
    direction: FloatArray,
    both: NDArray[np.bool_],
    calibrations: int,
    weight_std_mv: FloatArray,
) -> tuple[float, float]:
    """Standard deviation of a reading and its degrees of freedom.

    Each weight may be off the curve, and off by another amount on the way down, by amounts that repeat.
    """
    lines = design[:, : 2 * calibrations]
    loops = hung[:, both] * direction[:, None]
    for extra in ([hung, loops], [hung, design[:, 2 * calibrations :]], [hung]):
        squares, dof = _residual(voltage, np.hstack([lines, *extra]))
        if dof >= FEWEST_DOF:
            return math.sqrt(squares / dof), float(dof)
    squares, dof = _residual(voltage, design)
    if dof < 1:
        return 0.0, math.inf
    # nothing was repeated: what the weights' errors are expected to leave is not scatter
    maker = np.eye(len(voltage)) - design @ np.linalg.pinv(design)
    expected = float(np.sum((maker @ (hung * weight_std_mv)) ** 2))
    return math.sqrt(max(squares - expected, 0.0) / dof), float(dof)


def _misfit(
    voltage: FloatArray,
    hung: FloatArray,
    design: FloatArray,
    gain: FloatArray,
    reading_std: float,
    weight_std_mv: FloatArray,
    curved: bool,
) -> tuple[float, float]:
    """Standard deviation from the curve beyond reading and weights, mV, and its degrees of freedom."""
    count = hung.sum(axis=0)
    mean = (hung / count).T
    left = mean @ (np.eye(len(voltage)) - design @ gain)
    dof = hung.shape[1] - (3 if curved else 2)
    if dof < 1 or len(voltage) <= design.shape[1]:
        return 0.0, math.inf
    expected = reading_std**2 * float(np.sum(left**2)) + float(np.sum((left @ (hung * weight_std_mv)) ** 2))
    per_unit = float(np.sum((left @ hung) ** 2))
    expected *= float(stats.chi2.ppf(MISFIT_QUANTILE, dof)) / dof
    excess = max(float(np.sum((left @ voltage) ** 2)) - expected, 0.0) / per_unit if per_unit > 0 else 0.0
    return math.sqrt(excess), float(dof)


def _loop(
    residual: FloatArray, place: NDArray[np.intp], direction: FloatArray, both: NDArray[np.bool_], reading_std: float
) -> FloatArray:
    """(l,) half of the loop's width at each weight reached both ways, mV, less what scatter alone would show."""
    widths = []
    for weight in np.flatnonzero(both):
        up, down = (residual[(place == weight) & (direction == d)] for d in (-1.0, 1.0))
        half = (float(np.mean(down)) - float(np.mean(up))) / 2
        noise = reading_std**2 * (1 / len(up) + 1 / len(down)) / 4
        widths.append(math.sqrt(max(half**2 - noise, 0.0)))
    return np.array(widths)
