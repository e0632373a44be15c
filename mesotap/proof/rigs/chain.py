"""Effects in a sensor, the recorder or the exciter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from mesotap.proof.rigs.draw import Wants
from mesotap.proof.rigs.effects import Effect, Hidden, Rng, with_recorder
from mesotap.proof.rigs.trial import Altered, Trial, recorded

Array = NDArray[np.float64]
FINER = 4


def _peak(trial: Trial, sensor: int) -> float:
    """Largest value of a channel of the linear rig, without its offset."""
    channels = recorded(trial, Altered(trial.rig.plant(trial.rig.true_values())))
    return max(float(np.max(np.abs(c[:, sensor] - trial.rig.sensors[sensor].offset.true))) for c in channels)


def _in_sensor(
    name: str, trial: Trial, sensor: int, distort: Callable[[Array, int, float], Array], **more: float
) -> Hidden:
    """Return an effect on one channel, without its offset; ``distort`` gets it ``pieces`` times a sample."""
    offset = trial.rig.sensors[sensor].offset.true

    def add(altered: Altered, s: float) -> Altered:
        def recorder(fine: Array, pieces: int, record: int) -> Array:
            out = fine.copy()
            out[:, sensor] = distort(fine[:, sensor] - offset, pieces, s) + offset
            return out

        return with_recorder(altered, recorder)

    return Hidden(name, (trial.rig.sensors[sensor].channel,), "sensor", add, **more)  # type: ignore[arg-type]


def _any(trial: Trial, rng: Rng) -> int:
    return int(rng.integers(len(trial.rig.sensors)))


def _gain(trial: Trial, rng: Rng) -> Hidden:
    sign = float(rng.choice([-1.0, 1.0]))
    return _in_sensor("channel_gain", trial, _any(trial, rng), lambda x, pieces, s: (1 + sign * s) * x, most=0.3)


def _skew(trial: Trial, rng: Rng) -> Hidden:
    """One channel is sampled later, by a share of a sample or a few."""

    def later(x: Array, pieces: int, s: float) -> Array:
        k = np.arange(x.size, dtype=np.float64)
        return np.asarray(CubicSpline(k, x)(k + s * pieces))

    return _in_sensor("channel_skew", trial, _any(trial, rng), later, most=4.0)


def _clipping(trial: Trial, rng: Rng) -> Hidden:
    sensor = _any(trial, rng)
    peak = _peak(trial, sensor)
    return _in_sensor(
        "clipping", trial, sensor, lambda x, pieces, s: np.clip(x, -peak / (1 + s), peak / (1 + s)), start=0.05
    )


def _curvature(trial: Trial, rng: Rng) -> Hidden:
    sensor = _any(trial, rng)
    peak = _peak(trial, sensor)
    squared, cubed = (float(x) for x in rng.uniform(-1, 1, 2))

    def bent(x: Array, pieces: int, s: float) -> Array:
        return np.asarray(x + s * (squared * x**2 / peak + cubed * x**3 / peak**2))

    return _in_sensor("sensor_curvature", trial, sensor, bent, most=0.3)


def _filter(trial: Trial, rng: Rng) -> Hidden:
    """Low-pass of the first order; the strength is the highest mode's frequency over its corner."""
    rate = trial.rig.rate
    highest = float(trial.rig.plant(trial.rig.true_values()).modes_hz()[-1])

    def passed(x: Array, pieces: int, s: float) -> Array:
        # exact for straight lines between points of a spline that are so close that it is as good as straight there
        finer = CubicSpline(np.arange(x.size), x)(np.arange((x.size - 1) * FINER + 1) / FINER)
        step = 2 * np.pi * highest / s / (rate * pieces * FINER)
        kept = np.exp(-step)
        mean = -np.expm1(-step) / step
        out = lfilter([1 - mean, mean - kept], [1.0, -kept], finer - finer[0]) + finer[0]
        return np.asarray(out[::FINER])

    hidden = _in_sensor("undeclared_filter", trial, _any(trial, rng), passed, start=0.01, most=3.0)
    return replace(hidden, parameters=lambda s: {"corner_hz": highest / s})


def _hum(trial: Trial, rng: Rng) -> Hidden:
    rig = trial.rig
    line = float(rng.choice([50.0, 60.0]))
    count = len(rig.sensors)
    level = float(np.median([_peak(trial, i) for i in range(count)]))
    sizes = np.append(1.0, rng.uniform(0.0, 0.5, 2))
    sizes[line * np.arange(1, 4) > 0.45 * rig.rate] = 0.0
    phases = rng.uniform(0, 2 * np.pi, (len(trial.records), 3, count))

    def add(altered: Altered, s: float) -> Altered:
        def recorder(fine: Array, pieces: int, record: int) -> Array:
            t = np.arange(len(fine))[:, None] / (rig.rate * pieces)
            tones = [size * np.sin(2 * np.pi * line * (k + 1) * t + phases[record, k]) for k, size in enumerate(sizes)]
            return np.asarray(fine + s * level * sum(tones))

        return with_recorder(altered, recorder)

    places = ("sensor chain", *(sensor.channel for sensor in rig.sensors))
    return Hidden("mains_hum", places, "sensor", add, lambda s: {"amplitude_m_s2": s * level}, start=1e-3)


def _exciter(trial: Trial, rng: Rng) -> Hidden | None:
    rig = trial.rig
    if rig.input is None:
        return None
    peak = max(float(np.max(np.abs(r.size * r.drive.samples()))) for r in trial.records)
    squared, cubed = rng.uniform(-1, 1, 2).tolist()

    def add(altered: Altered, s: float) -> Altered:
        before = altered.force
        return replace(
            altered,
            force=lambda u: before(u) + s * (squared * before(u) ** 2 / peak + cubed * before(u) ** 3 / peak**2),
        )

    return Hidden("input_curvature", (rig.input.channel,), "input", add, most=0.3)


CHAIN = (
    Effect("channel_gain", Wants(sensors=2), _gain),
    Effect("channel_skew", Wants(sensors=2), _skew),
    Effect("clipping", Wants(), _clipping),
    Effect("sensor_curvature", Wants(), _curvature),
    Effect("input_curvature", Wants(excited="forced"), _exciter),
    Effect("mains_hum", Wants(fastest=400.0, shows=2), _hum),
    Effect("undeclared_filter", Wants(sensors=2), _filter),
)
