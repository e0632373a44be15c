"""A described rig simulated along a recording, against its exact response."""

from __future__ import annotations

import numpy as np

from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.simulation import Simulation
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import RATE, SAMPLES, recorded, sensor


def test_simulation_of_a_linear_rig_is_its_exact_response() -> None:
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: 4}]\n"
        "inputs: [{channel: 0, force_on: mass}]\n" + sensor("displacement")
    )
    t = np.arange(SAMPLES) / RATE
    omega = 15.0
    prepared = prepare(recorded([np.sin(omega * t), np.ones(SAMPLES) + t], RATE, 0.0), rig)
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    simulation = Simulation(rig, [prepared], constants, 3.2)
    shown, _ = simulation.run(simulation.begin(), simulation.own(np.zeros(2)), 0)
    response = 1 / (800 - 2 * omega**2 + 1j * omega * 4)
    late = (t > 8) & (t < 11.8)  # the transient falls by e for each second; the input's end rings
    np.testing.assert_allclose(
        shown[0, late], np.imag(response * np.exp(1j * omega * t[late])), atol=5e-4 * abs(response)
    )
