"""A described rig simulated along a recording, against its exact response."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings import motion
from analysis.mismatch.recordings import simulation as simulation_of
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.simulation import Simulation
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, family
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


@pytest.mark.parametrize("name", ["attached_mass", "frame_compliance"])
def test_a_base_shakes_what_is_added_to_a_rig_as_well(name: str) -> None:
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: 4}]\n"
        "inputs: [{channel: 0, base_acceleration: true}]\n" + sensor("displacement")
    )
    t, omega = np.arange(SAMPLES) / RATE, 15.0
    prepared = prepare(recorded([np.sin(omega * t), np.ones(SAMPLES) + t], RATE, 0.0), rig)
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    mechanism = catalogue()[name][0]
    k, c = 800 + 4j * omega, 150 + 20j * omega  # of the spring, and of what is added, whose mass is 0.3 kg
    term = Term(mechanism, dict(zip((q.name for q in mechanism.parameters), (0.3, 150.0, 20.0), strict=True)), (0,))
    added = {"attached_mass": [[k + c, -c], [-c, c]], "frame_compliance": [[k, -k], [-k, k + c]]}[name]
    response = np.linalg.solve(np.array(added) - omega**2 * np.diag([2.0, 0.3]), [-2.0, -0.3])[0]
    simulation = Simulation(rig, [prepared], constants, 4.0, [term])
    shown, _ = simulation.run(simulation.begin(), simulation.own(np.zeros(2)), 0)
    late = (t > 9) & (t < 11.8)
    np.testing.assert_allclose(
        shown[0, late], np.imag(response * np.exp(1j * omega * t[late])), atol=2e-3 * abs(response)
    )


DECAYS = [
    ("undeclared_filter", "displacement", {"corner_hz": 8.0}, lambda s: 16 * np.pi / (16 * np.pi + s)),
    ("undeclared_filter", "acceleration", {"corner_hz": 50.0}, lambda s: 100 * np.pi / (100 * np.pi + s)),
    ("channel_skew", "velocity", {"delay_of_b_samples": 1.6}, lambda s: np.exp(-1.6 * s / RATE)),
    ("channel_skew", "displacement", {"delay_of_b_samples": -0.3}, lambda s: np.exp(0.3 * s / RATE)),
]


@pytest.mark.parametrize(("name", "shows", "values", "response"), DECAYS)
def test_a_distortion_is_right_from_the_first_sample_of_a_decay(
    name: str, shows: str, values: dict[str, float], response: Callable[[complex], complex]
) -> None:
    # a decay is loudest where it begins: what is wrong there is all that one sees of a distortion
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: 4}]\n" + sensor(shows, 0)
    )
    t, s = np.arange(SAMPLES) / RATE, complex(-1.0, np.sqrt(399.0))  # of 2 s^2 + 4 s + 800 = 0
    prepared = prepare(recorded([np.exp(s * t).real], RATE, 0.0), rig)  # every third sample of it
    assert prepared.every == 3
    t = t * 3
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    simulation = Simulation(rig, [prepared], constants, 3.2, [Term(catalogue()[name][0], values, (0,))])
    shown, at = simulation.run(simulation.begin(), simulation.own(np.array([1.0, s.real])), 0)
    order = {"displacement": 0, "velocity": 1, "acceleration": 2}[shows]
    expected = (s**order * response(s) * np.exp(s * t[: at.stop - at.start])).real
    np.testing.assert_allclose(shown[0], expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("after", [100, 100.3, 1020.75])  # samples
@pytest.mark.parametrize("shows", ["displacement", "acceleration"])
def test_a_second_impact_is_the_response_to_one_from_when_it_falls(shows: str, after: float) -> None:
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: 4}]\n" + sensor(shows, 0)
    )
    t, s = np.arange(SAMPLES) / RATE, complex(-1.0, np.sqrt(399.0))  # of 2 s^2 + 4 s + 800 = 0
    prepared = replace(prepare(recorded([np.exp(s * t).real], RATE, 0.0), rig), rate_hz=RATE)
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    simulation = Simulation(rig, [prepared], constants, 3.2, [Term(catalogue()["double_hit"][0], {}, (0,))])
    own = replace(simulation.own(np.array([1.0, s.real])), impact=np.array([after / RATE, 0.7]))
    shown, at = simulation.run(simulation.begin(), own, 0)
    t = t[: at.stop - at.start]
    late = np.maximum(t - after / RATE, 0.0)
    order = {"displacement": 0, "acceleration": 2}[shows]
    once = (s**order * np.exp(s * t)).real
    again = 0.7 * (s**order * np.exp(s * late)).imag / s.imag * (late > 0)
    clear = np.abs(t * RATE - after) > 0.5  # while the pulse lasts, it is one
    np.testing.assert_allclose(shown[0, clear], (once + again)[clear], atol=1e-3 * np.abs(once).max())


def test_a_distortion_of_a_simulation_that_runs_away_is_lost_and_no_error() -> None:
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: 4}]\n"
        "inputs: [{channel: 0, force_on: mass}]\n" + sensor("displacement")
    )
    prepared = prepare(recorded([np.ones(SAMPLES), np.arange(SAMPLES)], RATE, 0.0), rig)
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    terms = [
        Term(catalogue()["tube_spring_cubic"][0], {"cubic_stiffness_n_per_m3": -1e25}, (0,)),
        Term(catalogue()["undeclared_filter"][0], {"corner_hz": 50.0}, (0,)),
    ]
    simulation = Simulation(rig, [prepared], constants, 3.2, terms)
    shown, _ = simulation.run(simulation.begin(), simulation.own(np.array([1.0, 0.0])), 0)
    assert not np.all(np.isfinite(shown))


def test_a_damping_that_ended_at_its_bound_is_still_a_parameter_that_tells() -> None:
    # friction takes the place of the damping, which a fit then leaves at a rounding of none
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: unknown}]\n"
        "inputs: [{channel: 0, force_on: mass}]\n" + sensor("velocity")
    )
    t = np.arange(SAMPLES) / RATE
    prepared = prepare(recorded([np.sin(15 * t), np.ones(SAMPLES) + t], RATE, 0.0), rig)
    found = []
    for damping in (0.0, 1e-130, 1e-3):
        constants = {p.name: p.value for p in rig.arrangement.parameters} | {"damping of spring": damping}
        simulation = Simulation(rig, [prepared], constants, 3.2)
        (k,) = (i for i, p in enumerate(simulation.parameters) if p.name == "damping of spring")
        x, own = simulation.begin(), simulation.own(np.zeros(2))
        p = simulation.parameters[k]
        moved = np.where(np.arange(x.size) == k, p.inward(damping + 1e-3), x)
        found.append(simulation.run(moved, own, 0)[0] - simulation.run(x, own, 0)[0])
        # a step of the differences moves the channel by far more than numbers are rounded
        nudged = np.where(np.arange(x.size) == k, x + 1e-6 * max(1.0, abs(x[k])), x)
        assert np.abs(simulation.run(nudged, own, 0)[0] - simulation.run(x, own, 0)[0]).max() > 1e-12
    for one in found[1:]:
        np.testing.assert_allclose(one, found[0], rtol=0, atol=1e-2 * np.abs(found[0]).max())


def test_another_hold_takes_its_own_inputs_between_samples() -> None:
    """A fit of inputs that are held otherwise begins with a fit of the same recording."""
    u = np.random.default_rng(1).standard_normal(500)
    springs = "bodies: {m: 1}\nsprings: [{between: [m, ground], stiffness: 900, damping: 2}]\n"
    channels = "inputs: [{channel: 0, force_on: m}]\nsensors: [{channel: 1, of: m, shows: displacement}]\n"
    shown = {}
    for hold, other in (("zero", "first"), ("first", "zero")):
        rig, like = (parse_rig(f"{springs}{channels}recording: {{hold: {h}}}\n") for h in (hold, other))
        prepared = [prepare(recorded([u, u], 100.0, 0.0), rig)]
        before = Simulation(like, prepared, {}, 5.0)
        for name, alike in (("alone", None), ("after", before)):
            one = Simulation(rig, prepared, {}, 5.0, (), alike)
            shown[hold, name], _ = one.run(one.begin(), one.own(np.zeros(2)), 0)
        np.testing.assert_array_equal(shown[hold, "after"], shown[hold, "alone"])
    assert not np.allclose(shown["zero", "alone"], shown["first", "alone"])


@pytest.mark.parametrize(("threads", "together"), [(False, 10**9), (True, 10**9), (False, 1), (False, 5000)])
def test_several_places_at_once_show_what_each_shows_alone(
    threads: bool, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = parse_rig(
        "bodies: {a: 2, b: 0.5}\n"
        "springs:\n"
        "  - {name: lower, between: [a, ground], stiffness: unknown, damping: unknown}\n"
        "  - {name: upper, between: [b, a], stiffness: 900, damping: 0.3}\n"
        "inputs: [{channel: 0, force_on: a, gain: unknown, offset: unknown}]\n"
        + sensor("acceleration").replace("mass", "b")
    )
    random = np.random.default_rng(8)
    prepared = prepare(recorded([random.normal(size=800), random.normal(size=800)], RATE, 0.0), rig)
    known = {p.name: p.value if np.isfinite(p.value) else 1.0 for p in rig.arrangement.parameters}
    (cubic,) = family("tube_spring_cubic")
    term = Term(cubic, dict.fromkeys((q.name for q in cubic.parameters), 1e4), (0,))
    simulation = Simulation(rig, [prepared], known, 8.0, (term,))
    begin, own = simulation.begin(), simulation.own(np.array([0.1, -0.2, 1.0, 3.0]))
    # every parameter, an offset among them, is another; one place has no rig at all
    places = [(begin + 0.1 * i * random.normal(size=begin.size), own) for i in range(5)]
    places.append((np.full(begin.size, np.nan), own))
    monkeypatch.setattr(motion, "SIDE_BY_SIDE", 0 if threads else 10**9)
    monkeypatch.setattr(simulation_of, "TOGETHER", together)
    shown, at = simulation.runs(places, 0)
    alone = [simulation.run(*place, 0) for place in places]
    assert all(at == own_at for _, own_at in alone)
    np.testing.assert_array_equal(shown, [one for one, _ in alone])
    assert np.all(np.isfinite(shown[:5]))
    assert np.all(np.isnan(shown[5]))
    assert np.ptp(shown[:5], axis=0).max() > 0


def test_what_is_remembered_goes_on_with_the_mechanism_that_remembers_it() -> None:
    """Terms come and go in a selection: a force carried into a recording is no other spring's, and no channel's."""
    rig = parse_rig(
        "bodies: {a: 2, b: 0.5}\nsprings:\n"
        "  - {name: lower, between: [a, ground], stiffness: 900}\n  - {name: upper, between: [b, a], stiffness: 700}\n"
        "inputs: [{channel: 0, force_on: a}]\n" + sensor("displacement").replace("mass", "b")
    )
    rows = np.random.default_rng(8).normal(size=(2, 400))
    prepared = prepare(recorded(list(rows), RATE, 0.0), rig)
    (relaxation,), (low_pass, *_) = family("relaxation"), family("undeclared_filter")
    lower, upper = (
        Term(relaxation, {"relaxing_stiffness_n_per_m": 90.0, "relaxation_time_s": 0.1}, (e,)) for e in (0, 1)
    )
    channel = Term(low_pass, {"corner_hz": 20.0}, (0,))
    first = Simulation(rig, [prepared], {}, 8.0, (channel, lower, upper))
    state = np.array([0.1, -0.2, 1.0, 3.0])
    own = replace(first.own(state), memory=np.array([0.5, 7.0, 11.0]))
    for terms, expected in (
        ((upper,), [11.0]),
        ((upper, channel), [11.0, 0.5]),
        ((lower, upper, channel), [7.0, 11.0, 0.5]),
        ((), []),
    ):
        other = Simulation(rig, [prepared], {}, 8.0, terms)
        (found,) = motion.continued(other, [state], first, [own])
        assert found.memory.tolist() == expected
        np.testing.assert_array_equal(found.state, state)
    again = Simulation(rig, [prepared], {}, 8.0, (lower,))
    (fresh,) = motion.continued(again, [state], Simulation(rig, [prepared], {}, 8.0), [own])
    assert fresh.memory.tolist() == [0.0]
