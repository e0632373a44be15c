"""Signals of a machine as they are: an encoder with a quantum, a drive of unknown gain that holds, a closed loop."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants

RATE, SAMPLES, SUBSTEPS = 1000.0, 6000, 40
MASS, DAMPING, GAIN = 2.0, 8.0, 5.0  # kg, N s/m, N/V
QUANTUM = 1e-6  # m
STAGE = """
bodies: {table: 2.0}
slides: [{name: guide, between: [table, ground], damping: unknown}]
inputs: [{channel: u, force_on: table, gain: unknown}]
sensors: [{channel: x, of: table, shows: displacement, unit: m}]
recording: {hold: zero}
"""


def stage(friction: float) -> Recording:
    """Return command and encoder of a stage under proportional and differential control.

    Between the commands it is stepped by a symplectic rule that stops dry friction at zero speed.
    """
    t = np.arange(SAMPLES) / RATE
    wanted = 0.02 * np.sin(5.0 * t) + 0.006 * np.sin(14.5 * t + 1) + 0.002 * np.sin(44.0 * t)
    x = v = before = 0.0
    h, seen = 1 / RATE / SUBSTEPS, np.zeros((2, SAMPLES))
    for i in range(SAMPLES):
        y = round(x / QUANTUM) * QUANTUM
        u = float(np.clip((2000 * (wanted[i] - y) + 60 * ((wanted[i] - y) - before) * RATE) / GAIN, -10, 10))
        before, seen[:, i] = wanted[i] - y, (u, y)
        for _ in range(SUBSTEPS):
            free = v + h * (GAIN * u - DAMPING * v) / MASS
            stopped = max(abs(free) - h * friction / MASS, 0.0)
            new = float(np.copysign(stopped, free))
            x, v = x + h * (v + new) / 2, new
    return Recording(seen, RATE, ("u", "x"), "", "made")


def test_a_stage_in_closed_loop_with_nothing_hidden_is_consistent() -> None:
    found = diagnose_recordings([stage(0.0)], parse_rig(STAGE), variants(catalogue()))
    assert found.answer.verdict == "consistent"


def test_friction_is_found_through_encoder_and_closed_loop() -> None:
    found = diagnose_recordings([stage(1.0)], parse_rig(STAGE), variants(catalogue()))
    assert [m.id for m in found.answer.mechanisms] == ["guide_friction"]
    force = found.answer.mechanisms[0].parameters["friction_force_n"]
    assert force.low < 1.0 < force.high
    assert force.value == pytest.approx(1.0, rel=0.1)


def test_a_held_input_described_as_band_limited_is_told_and_not_named() -> None:
    rig = parse_rig(STAGE.replace("recording: {hold: zero}\n", ""))
    found = diagnose_recordings([stage(0.0)], rig, variants(catalogue())).answer
    assert found.verdict == "unexplained"
    assert "hold: zero" in found.location.why
