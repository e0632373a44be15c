"""Slopes of a simulated recording beside a force that jumps, against those of far finer steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings import simulation as simulated
from analysis.mismatch.recordings.model import Point, SimulationModel
from analysis.mismatch.recordings.recorded import FIT, prepare
from analysis.mismatch.recordings.simulation import Simulation
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from tests.analysis.terms import listed

RIG = """
bodies: {frame: 1.3, arm: 0.9}
springs: [{between: [frame, ground], stiffness: unknown, damping: unknown}]
joints: [{name: joint, between: [arm, frame], stiffness: unknown, damping: unknown}]
slides: [{name: guide, between: [arm, ground], damping: unknown}]
inputs: [{channel: 0, force_on: frame, offset: 0}]
sensors:
  - {channel: 1, of: frame, shows: velocity, offset: 0}
  - {channel: 2, of: arm, shows: velocity, offset: 0}
recording: {hold: first}
"""
CONSTANTS = {
    "stiffness of spring": 9000.0, "damping of spring": 4.0, "stiffness of joint": 5200.0, "damping of joint": 2.0,
    "damping of guide": 0.3,
}  # fmt: skip
RATE, SAMPLES = 2000.0, 2000


def slopes() -> Real:
    """Return what each parameter changes, (numbers, parameters)."""
    random, t = np.random.default_rng(11), np.arange(SAMPLES) / RATE
    lines = np.arange(1.5, 20.0, 0.5)
    force = np.cos(2 * np.pi * np.outer(t, lines) + random.uniform(0, 6.28, lines.size)).sum(axis=1)
    data = np.array([14 * force / force.std(), random.normal(size=SAMPLES), random.normal(size=SAMPLES)])
    rig = parse_rig(RIG)
    prepared = prepare(Recording(data, RATE, ("force", "v1", "v2"), "", "simulated"), rig)
    constants = {p.name: p.value for p in rig.arrangement.parameters} | CONSTANTS
    term = Term(listed("guide_friction"), {"friction_force_n": 2.2, "rounding": 3e-4}, (2,))
    simulation = Simulation(rig, [prepared], constants, 14.0, [term])
    own = simulation.own(np.zeros(4))
    model = SimulationModel(simulation, [own], (FIT,), 1.0)
    (tangent,) = model.linearise(model.evaluate(Point(simulation.begin(), (own,))), exact=True).tangents
    return np.asarray(tangent.common + tangent.q @ tangent.cross, np.float64)


def test_slopes_beside_dry_friction_are_those_of_far_finer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated, "WITH_JUMPS", 3)  # between six steps a sample there is little to tell apart
    found = slopes()
    with monkeypatch.context() as alone:
        alone.setattr(Simulation, "near", lambda self, *_: self)
        without = slopes()
    monkeypatch.setattr(simulated, "TOLERANCE", math.inf)
    monkeypatch.setattr(Simulation, "_substeps", lambda self, recorded: 192)
    fine = slopes()
    off, off_alone = (np.linalg.norm(one - fine, axis=0) / np.linalg.norm(fine, axis=0) for one in (found, without))
    assert np.all(off < 1e-3)
    assert off_alone.max() > 0.01  # of differences between motions that are divided each by its own errors
