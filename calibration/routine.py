"""Calibrating the strain gauge with dead weights, before or after a test (Sec. 3.2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from calibration.line import CalibrationError, checked, fit_line
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints
from rig.errors import RigError, StaleReading
from rig.interface import Rig
from rig.readings import LoadReading
from rig.settling import let_settle

_ATTEMPTS = 3  # readings of a gauge that seems frozen before it is believed
_SETTLING_READING_S = 0.1  # readings while the amplifier's filter follows the weight
_NO_SCATTER = 1e-9  # scatter below this share of the voltage range is none: the readings are copies of each other


def calibrate(
    rig: Rig,
    settings: CalibrationSettings,
    operator_say: Callable[[str], None],
    on_progress: Callable[[int, int], None] | None = None,
    on_reading: Callable[[float, LoadReading], None] | None = None,
) -> CalibrationPoints:
    """Hang each weight ``repeats`` times, upwards and downwards in turn, and record the voltages.

    Going down as well as up shows hysteresis as scatter about the line instead of hiding it in the sensitivity.
    Whatever happens, the weights are off the gauge afterwards.

    Parameters
    ----------
    rig
        An open rig, its surfaces apart.
    settings
        Weights, repeats and averaging time.
    operator_say
        Told in sentences what goes on.
    on_progress
        Called with the number of readings done and to do.
    on_reading
        Called with each weight, mN, and what the gauge read under it.

    Returns
    -------
    CalibrationPoints
        In the order of recording; the time is halfway through.

    Raises
    ------
    StaleReading
        The gauge is frozen or does not read a number.
    RigError
        What the parts raise.

    Examples
    --------
    >>> points = calibrate(rig, settings, print)  # doctest: +SKIP
    >>> fit_line(points, settings.weight_uncertainty_mn).sensitivity_mv_per_mn  # doctest: +SKIP
    """
    sequence = list(_sequence(settings))
    readings: list[LoadReading] = []
    times: list[str] = []
    operator_say(
        f"Calibrating the strain gauge with {len(set(settings.loads_mn))} weights up to "
        f"{max(settings.loads_mn):g} mN, {len(sequence)} readings of {settings.averaging_s:g} s."
    )
    begun = rig.clock.utc()
    with _weights_removed(rig, operator_say):
        for done, load in enumerate(sequence):
            rig.weights.place(load)
            readings.append(_living_reading(rig, load, settings.averaging_s))
            times.append(rig.clock.utc())
            if on_reading is not None:
                on_reading(load, readings[-1])
            if on_progress is not None:
                on_progress(done + 1, len(sequence))
        ended = rig.clock.utc()
    voltages, quantum = np.array([r.voltage_mv for r in readings]), max(r.quantum_mv for r in readings)
    return CalibrationPoints(
        np.array(sequence, dtype=np.float64), voltages, _midway(begun, ended), quantum, _elapsed(times)
    )


def read_empty(rig: Rig, settings: CalibrationSettings) -> LoadReading:
    """Read the gauge while the surfaces are apart and no weight hangs on it.

    Raises
    ------
    StaleReading
        The gauge is frozen or does not read a number.
    """
    return _living_reading(rig, 0.0, settings.averaging_s)


def check_points(points: CalibrationPoints, settings: CalibrationSettings, declared_sensitivity: float) -> list[str]:
    """Complaints about a calibration, a sentence each; empty if it is fit to be used.

    ``declared_sensitivity`` is what the configuration expects of the gauge, mV/mN.
    """
    try:
        load, voltage = checked(points)
        if np.ptp(voltage) == 0.0:
            return [
                f"the gauge reads {voltage[0]:.4g} mV under every weight: it is frozen or not connected; "
                "check the amplifier and its cable"
            ]
        fit = fit_line(points, settings.typical_weight_error_mn(points.load_mn), settings.drift_test_level)
    except CalibrationError as error:
        return [str(error)]
    complaints = []
    sensitivity = fit.sensitivity_mv_per_mn.value
    deviation = 100 * (sensitivity / declared_sensitivity - 1)
    if abs(deviation) > settings.largest_sensitivity_deviation_percent:
        complaints.append(
            f"the sensitivity is {sensitivity:.4g} mV/mN, {abs(deviation):.1f} % "
            f"{'above' if deviation > 0 else 'below'} the {declared_sensitivity:.4g} mV/mN of the configuration (at "
            f"most {settings.largest_sensitivity_deviation_percent:g} % are allowed): check the weights, the gain of "
            "the amplifier and gauge_sensitivity_mv_per_mn"
        )
    if fit.nonlinearity_percent > settings.largest_nonlinearity_percent:
        complaints.append(
            f"the calibration departs from a line by {fit.nonlinearity_percent:.2f} % of its range (at most "
            f"{settings.largest_nonlinearity_percent:g} % are allowed): check that each weight is "
            "the one that was asked for, and that it hangs freely"
        )
    span = sensitivity * float(np.ptp(load))
    copies = fit.dof > 0 and (fit.residual_std_mv <= _NO_SCATTER * span or _repeats_are_copies(load, voltage))
    if copies and not points.quantum_mv:  # what the amplifier rounds may well be the same twice
        complaints.append("repeated readings have no noise at all: the gauge is frozen or the readings are not its own")
    return complaints


def _sequence(settings: CalibrationSettings) -> Iterator[float]:
    upwards = sorted(settings.loads_mn)
    for repeat in range(settings.repeats):
        yield from upwards if repeat % 2 == 0 else reversed(upwards)


def _living_reading(rig: Rig, load_mn: float, duration_s: float) -> LoadReading:
    gauge = rig.load_cell
    let_settle(rig.clock, gauge.settling_s, lambda: gauge.read(_SETTLING_READING_S), heed=gauge.idle)
    for _ in range(_ATTEMPTS):
        reading = rig.load_cell.read(duration_s)
        frozen = reading.samples > 1 and reading.spread_mv == 0.0 and not reading.quantum_mv
        if math.isfinite(reading.voltage_mv) and not frozen:
            return reading
    state = "its samples are all the same" if math.isfinite(reading.voltage_mv) else "it does not read a number"
    raise StaleReading(
        f"the strain gauge is dead under {load_mn:g} mN: {state} in {_ATTEMPTS} readings of {duration_s:g} s; "
        "check the bridge supply and the amplifier"
    )


@contextmanager
def _weights_removed(rig: Rig, operator_say: Callable[[str], None]) -> Iterator[None]:
    """Take the weights off on leaving; a failure to do so never hides what went wrong before."""
    try:
        yield
    except BaseException:
        try:
            rig.weights.place(0.0)
        except RigError as error:
            operator_say(f"The weights may still hang on the gauge: {error}")
        raise
    rig.weights.place(0.0)


def _midway(begun: str, ended: str) -> str:
    """ISO 8601 UTC time halfway between two; the first if either cannot be read."""
    try:
        start, end = datetime.fromisoformat(begun), datetime.fromisoformat(ended)
        middle = (start + (end - start) / 2).astimezone(UTC)
    except (TypeError, ValueError):
        return begun
    return middle.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _elapsed(times: Sequence[str]) -> NDArray[np.float64] | None:
    """Seconds from the first of ISO 8601 times to each; None if one cannot be read or the clock was set back."""
    try:
        moments = [datetime.fromisoformat(time) for time in times]
        elapsed = np.array([round((moment - moments[0]).total_seconds(), 3) for moment in moments])
    except (TypeError, ValueError):
        return None
    return elapsed if bool(np.all(np.diff(elapsed) >= 0)) else None


def _repeats_are_copies(load: NDArray[np.float64], voltage: NDArray[np.float64]) -> bool:
    """Whether weights were hung repeatedly and every one gave one and the same voltage each time."""
    weights, counts = np.unique(load, return_counts=True)
    repeated = weights[counts > 1]
    return len(repeated) > 0 and all(np.ptp(voltage[load == weight]) == 0.0 for weight in repeated)
