"""Do the intervals of loads hold what really pressed, whatever is wrong with the gauge and its weights?

Draws sessions of a gauge from formulas of its own: weights by mass in a field of gravity, a calibration up and down
before and after the test, eight loads between them. One thing at a time is wrong. Prints, for each, how many of the
true loads lie inside, the median half-width of the interval, and the true rms error.

usage: gauge_intervals.py [--sessions N] [--first SEED] [--case NAME] [--json OUT.json]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints, ZeroReading

MASSES_G = np.array([0.0, 10, 20, 40, 60, 80, 100])
BEGUN = datetime(2026, 3, 2, 9, 0, tzinfo=UTC)
SENSITIVITY, OFFSET = 0.042, 0.35  # mV/mN, mV
NOISE_MV = 0.003  # of a reading of one second
OWN_ERROR_MN = 0.1  # of each weight
LOADS = 8
LOAD_MINUTES, CALIBRATION_MINUTES = 12.0, 10.0
DECLARED = {"latitude_deg": 52.3, "height_m": 70.0, "weights_g": tuple(MASSES_G), "weight_uncertainty_mn": OWN_ERROR_MN}


@dataclass(frozen=True)
class Case:
    """What is wrong, and what the configuration declares of it."""

    bow_mn: float = 0.0
    loop_mn: float = 0.0  # between the ways up and down
    common: float = 0.0  # relative standard deviation
    anywhere: bool = False  # on Earth
    bump_mn: float = 0.0
    walk_mn: float = 0.0  # in a root hour
    zeros: bool = False  # read after each load
    timed: bool = True  # the file has the times of the calibrations' readings
    declared: dict = field(default_factory=dict)


CASES = {
    "baseline": Case(),
    "bowed by 0.1 %": Case(bow_mn=1.0),
    "bowed by 0.45 %": Case(bow_mn=4.5),
    "hysteresis 0.1 %": Case(loop_mn=1.0),
    "common error 0.1 %": Case(common=1e-3, declared={"common_weight_uncertainty_percent": 0.1}),
    "gravity anywhere on Earth": Case(anywhere=True, declared={"latitude_deg": None, "height_m": None}),
    "thermal bump 1.2 mN, zero read after each load": Case(bump_mn=1.2, zeros=True),
    "thermal bump 1.2 mN, nothing read or declared": Case(bump_mn=1.2),
    "thermal bump 1.2 mN, 1 mN in a root hour declared": Case(
        bump_mn=1.2, declared={"zero_drift_mn_per_root_hour": 1.0}
    ),
    "thermal bump 1.2 mN, limits of 1.2 mN declared": Case(bump_mn=1.2, declared={"zero_limit_mn": 1.2}),
    "thermal bump 1.2 mN, 0.6 mN/K and 1 K declared": Case(
        bump_mn=1.2, declared={"zero_mn_per_k": 0.6, "temperature_uncertainty_k": 1.0}
    ),
    "random walk, zero read after each load": Case(walk_mn=0.6, zeros=True),
    "random walk, its size declared": Case(walk_mn=0.6, declared={"zero_drift_mn_per_root_hour": 0.6}),
    "random walk, nothing read or declared": Case(walk_mn=0.6),
    "random walk, nothing read or declared, readings without times": Case(walk_mn=0.6, timed=False),
}


class Gauge:
    """A gauge as it is, on one day."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self._rng = rng
        self._slope = SENSITIVITY * (1 + 0.02 * rng.standard_normal())
        self._bow = case.bow_mn * rng.choice([-1.0, 1.0])
        self._sine = rng.uniform() < 0.5
        self._loop = case.loop_mn / 2
        self._skew = rng.uniform(0.6, 1.6, 2)
        top = self._skew[0] / self._skew.sum()
        self._peak = top ** self._skew[0] * (1 - top) ** self._skew[1]
        hours = np.linspace(0, 4, 2401)
        self._hours = hours
        walk = np.concatenate([[0.0], np.cumsum(rng.standard_normal(2400))]) * np.sqrt(hours[1])
        self._zero = case.walk_mn * walk
        middle, width = rng.uniform(0.6, 1.3), rng.uniform(0.2, 0.35)
        self._zero = self._zero + case.bump_mn * np.exp(-0.5 * ((hours - middle) / width) ** 2)

    def voltage(self, load_mn: float, hour: float, way: float) -> float:
        """Read the bridge; ``way`` is -1 going up and 1 going down."""
        x = min(max(load_mn / 1000.0, 0.0), 1.0)
        bent = self._bow * (np.sin(np.pi * x) if self._sine else 4 * x * (1 - x))
        loop = way * self._loop * x ** self._skew[0] * (1 - x) ** self._skew[1] / self._peak
        seen = load_mn + bent + loop + np.interp(hour, self._hours, self._zero)
        return OFFSET + self._slope * seen + NOISE_MV * self._rng.standard_normal()


def forces_mn(case: Case, rng: np.random.Generator) -> np.ndarray:
    """What the weights really weigh."""
    latitude = np.degrees(np.arcsin(rng.uniform(-1, 1))) if case.anywhere else 52.3
    # international gravity formula 1980
    s = np.sin(np.radians(latitude)) ** 2
    gravity = 9.780327 * (1 + 0.0053024 * s - 0.0000058 * 4 * s * (1 - s)) - 3.086e-6 * 70.0
    gravity += 3e-4 * rng.standard_normal()
    air, steel = rng.uniform(1.14, 1.26), rng.uniform(7800, 8400)
    own = OWN_ERROR_MN * rng.standard_normal(len(MASSES_G)) * (MASSES_G > 0)
    return MASSES_G * gravity * (1 - air / steel) * (1 + case.common * rng.standard_normal()) + own


def stamp(hour: float) -> str:
    return (BEGUN + timedelta(hours=hour)).isoformat(timespec="milliseconds")


def calibration(
    case: Case, gauge: Gauge, forces: np.ndarray, settings: CalibrationSettings, begins: float
) -> tuple[CalibrationPoints, float]:
    """Hang the weights up and down; return the points and when that was over."""
    order = np.concatenate([np.arange(len(MASSES_G)), np.arange(len(MASSES_G))[::-1]])
    hours = begins + np.arange(len(order)) * CALIBRATION_MINUTES / 60 / len(order)
    way = np.repeat([-1.0, 1.0], len(MASSES_G))
    voltage = [gauge.voltage(forces[i], h, w) for i, h, w in zip(order, hours, way, strict=True)]
    points = CalibrationPoints(
        np.array(settings.loads_mn)[order],
        np.array(voltage),
        stamp(float(np.mean(hours))),
        elapsed_s=3600 * (hours - begins) if case.timed else None,
    )
    return points, float(hours[-1])


def session(case: Case, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors and half-widths of the loads of one session, mN."""
    rng = np.random.default_rng([seed, 20])
    settings = CalibrationSettings.model_validate({**DECLARED, **case.declared})
    gauge, forces = Gauge(case, rng), forces_mn(case, rng)
    pre, hour = calibration(case, gauge, forces, settings, 0.0)
    plan = np.sort(rng.uniform(60, 950, LOADS))
    taps, zeros = [], []
    for load in plan:
        middle = hour + LOAD_MINUTES / 60 * 0.6
        way = rng.choice([-1.0, 1.0])  # the stage went up to the load, or down to it after it had passed
        taps.append((load, middle, gauge.voltage(load, middle, way)))
        hour += LOAD_MINUTES / 60
        if case.zeros:
            zeros.append(ZeroReading(gauge.voltage(0.0, hour, 0.0), stamp(hour)))
    post, _ = calibration(case, gauge, forces, settings, hour + 0.05)
    history = GaugeHistory(pre, post, settings, zeros)
    found = [history.load_at(voltage, stamp(when), NOISE_MV) for _, when, voltage in taps]
    return np.array([e.value - p for e, p in zip(found, plan, strict=True)]), np.array([e.half_width for e in found])


def main() -> None:
    """Run the cases and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--case", choices=CASES, action="append")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.sessions)
    print(f"seeds {seeds[0]} to {seeds[-1]}, {LOADS} loads each")
    print(f"{'':62s} {'inside':>9s} {'half-width':>11s} {'rms error':>10s}")
    rows = {}
    for name in chosen.case or CASES:
        found = [session(CASES[name], seed) for seed in seeds]
        errors, widths = np.array([f[0] for f in found]), np.array([f[1] for f in found])
        inside = np.abs(errors) <= widths
        rows[name] = {
            "inside_percent": 100 * float(inside.mean()),
            "standard_error_percent": 100 * float(np.std(inside.mean(axis=1), ddof=1)) / np.sqrt(len(found)),
            "median_half_width_mn": float(np.median(widths)),
            "rms_error_mn": float(np.sqrt(np.mean(errors**2))),
        }
        row = rows[name]
        print(
            f"{name:62s} {row['inside_percent']:5.1f} +-{row['standard_error_percent']:3.1f} "
            f"{row['median_half_width_mn']:8.2f} mN {row['rms_error_mn']:7.2f} mN"
        )
    if chosen.json:
        chosen.json.write_text(json.dumps({"seeds": [seeds[0], seeds[-1]], "cases": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
