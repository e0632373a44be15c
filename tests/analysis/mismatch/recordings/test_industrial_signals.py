"""Signals as they are: an encoder's quantum, a held drive, a closed loop, clipping once, sticking at last."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from analysis.mismatch.diagnosis import diagnose_recordings
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.mechanisms.kinds import ChannelDistortion
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input

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


@pytest.mark.slow
def test_a_stage_in_closed_loop_with_nothing_hidden_is_consistent() -> None:
    found = diagnose_recordings([stage(0.0)], parse_rig(STAGE), variants(catalogue()))
    assert found.answer.verdict == "consistent"


@pytest.mark.long
def test_friction_is_found_through_encoder_and_closed_loop() -> None:
    found = diagnose_recordings([stage(1.0)], parse_rig(STAGE), variants(catalogue()))
    assert [m.id for m in found.answer.mechanisms] == ["guide_friction"]
    force = found.answer.mechanisms[0].parameters["friction_force_n"]
    assert force.low < 1.0 < force.high
    assert force.value == pytest.approx(1.0, rel=0.1)


@pytest.mark.slow
def test_a_held_input_described_as_band_limited_is_told_and_not_named() -> None:
    rig = parse_rig(STAGE.replace("recording: {hold: zero}\n", ""))
    found = diagnose_recordings([stage(0.0)], rig, variants(catalogue())).answer
    assert found.verdict == "unexplained"
    assert "hold: zero" in found.location.why
    assert found.rivals
    for rival in found.rivals:  # none is certain, nor needless because nothing were missing
        assert rival.probability < 0.5
        assert rival.why.endswith("once the rig file says 'recording: {hold: zero}'.")
        assert "nothing is missing" not in rival.why


@pytest.mark.slow
def test_clipping_that_happens_once_in_a_sweep_about_an_offset_is_named() -> None:
    rate, samples, omega = 400.0, 4000, 2 * np.pi * 20.0
    t = np.arange(samples) / rate
    u = np.sin(2 * np.pi * (8.0 + 1.5 * t) * t)  # 8 to 38 Hz: through the resonance in a few of the blocks
    x = motion(lambda s, x, v: 100 * s - omega**2 * x - 0.03 * omega * v, [0.0, 0.0], samples, rate, u)[0]
    peak, offset = np.abs(x).max(), 0.02 * np.abs(x).max()
    shown = np.clip(x, -0.97 * peak, 0.97 * peak) + offset
    shown += 5e-4 * peak * np.random.default_rng(7).normal(size=samples)
    rig = parse_rig(
        "bodies: {mass: 1}\nsprings: [{between: [mass, ground], damping: unknown}]\n"
        "inputs: [{channel: u, force_on: mass, gain: unknown}]\n"
        "sensors: [{channel: x, of: mass, shows: displacement, offset: unknown}]\n"
    )
    found = diagnose_recordings(
        [Recording(np.array([u, shown]), rate, ("u", "x"), "", "made")], rig, variants(catalogue())
    )
    assert [m.id for m in found.answer.mechanisms] == ["clipping"]


@pytest.mark.long
def test_friction_that_stops_a_decay_is_followed_to_where_it_sticks() -> None:
    rate, samples, sub, mass, stiffness, damping, friction = 200.0, 4000, 50, 1.0, 3000.0, 1.0, 2e-3
    x, v, h = 1e-3, 0.0, 1 / 200.0 / 50
    shown = np.zeros(samples)
    for i in range(samples):
        shown[i] = x
        for _ in range(sub):  # a symplectic rule that stops dry friction at zero speed
            free = v - h * (stiffness * x + damping * v) / mass
            v = float(np.copysign(max(abs(free) - h * friction / mass, 0.0), free))
            x += h * v
    shown += 5e-8 * np.random.default_rng(3).normal(size=samples)
    rig = parse_rig(
        "bodies: {mass: 1}\njoints: [{between: [mass, ground]}]\n"
        "sensors: [{channel: x, of: mass, shows: displacement, offset: unknown}]\n"
    )
    found = diagnose_recordings([Recording(shown[None], rate, ("x",), "", "made")], rig, variants(catalogue()))
    assert [m.id for m in found.answer.mechanisms] == ["guide_friction"]
    force = found.answer.mechanisms[0].parameters["friction_force_n"]
    assert force.value == pytest.approx(friction, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_of_a_force_cell_is_no_filter_of_the_accelerometer(seed: int) -> None:
    random = np.random.default_rng(seed)
    rate, samples, mass, stiffness, damping = 2000.0, 4000, 0.5, 31.6e3, 2.5
    pieces = 20
    fine = np.arange((samples - 1) * pieces + 1) / rate / pieces
    push = np.zeros(fine.size)
    for tap in range(5):
        begun, peak = 0.05 + 0.38 * tap + random.uniform(0, 0.04), random.uniform(30, 60)
        at = (fine > begun) & (fine < begun + 8e-3)
        push[at] += peak * np.sin(np.pi * (fine[at] - begun) / 8e-3) ** 2
    state = signal.lti([1 / mass, 0, 0], [1, damping / mass, stiffness / mass])
    shown = signal.lsim(state, push, fine)[1][::pieces]
    force = push[::pieces] + 2e-3 * push.max() * random.normal(size=samples)
    shown = shown + 3e-3 * shown.std() * random.normal(size=samples)
    rig = parse_rig("""
bodies: {block: 0.5}
springs: [{between: [block, ground], damping: unknown}]
inputs: [{channel: 0, force_on: block}]
sensors: [{channel: 1, of: block, shows: acceleration}]
""")
    found = diagnose_recordings(
        [Recording(np.array([force, shown]), rate, ("0", "1"), "", "made")], rig, variants(catalogue())
    ).answer
    assert found.verdict == "consistent"


@pytest.mark.slow
def test_an_amplifier_that_clips_the_louder_of_two_recordings_is_named() -> None:
    rig = parse_rig("""
bodies: {mass: 1}
springs: [{between: [mass, ground], damping: unknown}]
inputs: [{channel: 0, force_on: mass, gain: unknown}]
sensors: [{channel: 1, of: mass, shows: velocity}]
""")
    omega, rate, samples = 2 * np.pi * 12, 200.0, 2000
    shown = []
    for seed, loud in ((1, 1.0), (2, 0.5)):
        u = noise_input(samples, rate, 2, 25, seed)
        y = motion(lambda s, x, v: 100 * s - omega**2 * x - 3 * v, [0.0, 0.0], samples, rate, loud * u)[1]
        shown.append((loud * u, y + 0.02 * y.std() * np.random.default_rng(seed).normal(size=samples)))
    level = 0.85 * np.abs(shown[0][1]).max()
    known = [m for m in variants(catalogue()) if isinstance(m, ChannelDistortion) or m.id == "tube_spring_cubic"]
    assert np.abs(shown[1][1]).max() < level
    recordings = [Recording(np.array([u, np.clip(y, -level, level)]), rate, ("0", "1"), "", "made") for u, y in shown]
    found = diagnose_recordings(recordings, rig, known).answer
    assert [m.id for m in found.mechanisms] == ["clipping"]
    assert found.mechanisms[0].parameters["clip_at_fraction_of_peak"].value == pytest.approx(1.0, abs=0.01)
