"""What is concealed in a rig of two modes is named, from a CSV file by scipy's own integrator."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import resample
from typer.testing import CliRunner

from mesotap.cli import app
from tests.analysis.mismatch.recordings.described_rigs import noise_input

Real = NDArray[np.float64]
Extra = Callable[[float, float], tuple[float, float]]
"""Displacement of the table (m) and force of the neck (N) to the extra forces of foot and neck (N)."""

pytestmark = pytest.mark.long
SAMPLES, RATE_HZ, NOISE = 2400, 400.0, 3e-3
TIMES = np.arange(SAMPLES) / RATE_HZ
TABLE_KG, HEAD_KG = 1.0, 0.5
FOOT, NECK = (6000.0, 4.0), (9000.0, 5.0)  # N/m, N s/m: modes at 10 and 27 Hz
PART_KG, MOUNT_HZ, MOUNT_RATIO = 0.02, 60.0, 0.02
STOP, GAP_M = 6000.0, 3e-3
PRELOAD_N = 45.0  # half of what the neck carries at most
SKEW_SAMPLES, HUM = 0.4, 0.6
RIG = """
name: tower
bodies: {table: 1, head: 0.5}
springs: [{name: foot, between: [table, ground], damping: unknown}]
joints: [{name: neck, between: [table, head]}]
inputs: [{channel: force, force_on: table}]
sensors:
  - {channel: a, of: table, shows: acceleration, unit: m/s2}
  - {channel: b, of: head, shows: acceleration, unit: m/s2}
"""


def nothing(x: float, neck: float) -> tuple[float, float]:
    return 0.0, 0.0


def stopped(x: float, neck: float) -> tuple[float, float]:
    return STOP * max(x - GAP_M, 0.0), 0.0


def parted(x: float, neck: float) -> tuple[float, float]:
    return 0.0, max(neck, -PRELOAD_N) - neck


def recorded(
    extra: Extra = nothing, part_kg: float = 0.0, late: float = 0.0, highest_hz: float = 60.0
) -> tuple[Real, Real]:
    """Return the force (n,), N, and accelerations (2, n), m/s2, the second ``late`` samples behind."""
    force = 20 * noise_input(SAMPLES, RATE_HZ, 3, highest_hz, seed=3)
    fine = 16  # a band-limited force is known between its samples too
    drive = CubicSpline(np.arange(fine * SAMPLES) / fine / RATE_HZ, resample(force, fine * SAMPLES))
    mount = (2 * np.pi * MOUNT_HZ) ** 2 * part_kg, 2 * MOUNT_RATIO * 2 * np.pi * MOUNT_HZ * part_kg

    def accelerations(t: float, z: Real) -> Real:
        x, v = z[:3], z[3:]
        foot, neck, held = (
            k * (x[i] - lower) + c * (v[i] - lower_v)
            for (k, c), i, lower, lower_v in ((FOOT, 0, 0.0, 0.0), (NECK, 0, x[1], v[1]), (mount, 2, x[1], v[1]))
        )
        of_foot, of_neck = extra(float(x[0]), float(neck))
        foot, neck = foot + of_foot, neck + of_neck
        part = -held / part_kg if part_kg else 0.0
        return np.array([(drive(t) - foot - neck) / TABLE_KG, (neck + held) / HEAD_KG, part])

    def slope(t: float, z: Real) -> Real:
        return np.concatenate([z[3:], accelerations(t, z)])

    run = solve_ivp(
        slope, (0, TIMES[-1]), np.zeros(6), "DOP853", rtol=1e-9, atol=1e-12, max_step=1 / RATE_HZ, dense_output=True
    )

    def seen(times: Real, body: int) -> Real:
        return np.array([accelerations(t, run.sol(t))[body] for t in times])

    return force, np.stack([seen(TIMES, 0), seen(np.maximum(TIMES - late / RATE_HZ, 0.0), 1)])


def diagnosed(folder: Path, force: Real, shown: Real, rig: str = RIG) -> dict[str, Any]:
    noise = np.random.default_rng(1).normal(size=shown.shape)
    table = np.column_stack([TIMES, force, *(shown + NOISE * shown.std(axis=1, keepdims=True) * noise)])
    np.savetxt(folder / "tower.csv", table, delimiter=",", header="time [s],force,a,b", comments="")
    (folder / "tower.yaml").write_text(rig)
    arguments = [folder / "tower.csv", "--rig", folder / "tower.yaml", "--json", folder / "answer.json"]
    result = CliRunner().invoke(app, ["diagnose", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    answer: dict[str, Any] = json.loads((folder / "answer.json").read_text())
    return answer


def only(answer: dict[str, Any], name: str) -> dict[str, Any]:
    """Return what is said of the one mechanism that is named."""
    assert [m["id"] for m in answer["mechanisms"]] == [name]
    found: dict[str, Any] = answer["mechanisms"][0]["parameters"]
    return found


def test_a_channel_that_is_late(tmp_path: Path) -> None:
    delay = only(diagnosed(tmp_path, *recorded(late=SKEW_SAMPLES)), "channel_skew")["delay_of_b_samples"]
    assert delay["low"] < SKEW_SAMPLES < delay["high"]


def test_a_channel_that_is_clipped(tmp_path: Path) -> None:
    force, shown = recorded()
    highest = 0.7 * float(np.abs(shown[0]).max())
    shown[0] = np.clip(shown[0], -highest, highest)
    level = only(diagnosed(tmp_path, force, shown), "clipping")["clip_at_fraction_of_peak"]
    peak = np.abs(np.loadtxt(tmp_path / "tower.csv", delimiter=",", skiprows=1)[:, 2]).max()
    assert level["value"] == pytest.approx(highest / peak, rel=1e-3)


def test_a_spring_that_meets_a_stop(tmp_path: Path) -> None:
    stop = only(diagnosed(tmp_path, *recorded(stopped)), "end_stop")
    assert stop["stop_stiffness_n_per_m"]["value"] == pytest.approx(STOP, rel=2e-3)
    assert stop["gap_m"]["value"] == pytest.approx(GAP_M, rel=2e-3)


def test_a_contact_that_parts_under_its_declared_preload(tmp_path: Path) -> None:
    rig = RIG.replace("joints: [{name: neck, ", f"contacts: [{{name: neck, preload: {PRELOAD_N}, ")
    answer = diagnosed(tmp_path, *recorded(parted), rig)
    assert only(answer, "contact_loss") == {}
    assert answer["mechanisms"][0]["element"] == "neck"


def test_a_rig_that_conceals_nothing(tmp_path: Path) -> None:
    answer = diagnosed(tmp_path, *recorded(highest_hz=35.0))
    assert (answer["verdict"], answer["mechanisms"]) == ("consistent", [])


def test_a_part_that_rides_on_the_head(tmp_path: Path) -> None:
    part = only(diagnosed(tmp_path, *recorded(part_kg=PART_KG)), "attached_mass")
    assert part["attached_mass_kg"]["value"] == pytest.approx(PART_KG, rel=0.02)
    assert part["mount_frequency_hz"]["value"] == pytest.approx(MOUNT_HZ, rel=2e-3)


def test_mains_that_hum(tmp_path: Path) -> None:
    force, shown = recorded()
    hum = np.sin(2 * np.pi * 50 * TIMES + np.array([[0.3], [1.3]])) * np.array([[HUM], [0.4]])
    amplitude = only(diagnosed(tmp_path, force, shown + hum), "mains_hum")["amplitude_m_s2"]
    assert amplitude["low"] < HUM < amplitude["high"]
