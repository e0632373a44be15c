"""A described rig simulated along a recording, against its exact response."""

from __future__ import annotations

import numpy as np
import pytest

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


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_one_step_between_samples_is_exact_without_laws(hold: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = parse_rig(
        "bodies: {a: 2, b: 0.5}\n"
        "springs:\n"
        "  - {between: [a, ground], stiffness: 800, damping: 4}\n"
        "  - {between: [b, a], stiffness: 900, damping: 0.3}\n"
        "inputs: [{channel: 0, force_on: a}]\n" + sensor("acceleration").replace("mass", "b")
        + f"recording: {{hold: {hold}}}\n"
    )  # fmt: skip
    random = np.random.default_rng(4)
    prepared = prepare(recorded([random.normal(size=800), random.normal(size=800)], RATE, 0.0), rig)
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    one = Simulation(rig, [prepared], constants, 8.0)
    monkeypatch.setattr(Simulation, "_substeps", lambda self, recorded: 7)
    seven = Simulation(rig, [prepared], constants, 8.0)
    assert (one.substeps, seven.substeps) == ([1], [7])
    shown = [s.run(s.begin(), s.own(np.array([0.1, -0.2, 1.0, 3.0])), 0)[0] for s in (one, seven)]
    np.testing.assert_allclose(shown[0], shown[1], rtol=0, atol=1e-9 * np.abs(shown[1]).max())
