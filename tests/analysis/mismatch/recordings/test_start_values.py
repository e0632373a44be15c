"""Starts from spectra, on recordings by scipy's integrators."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from analysis.mismatch.recordings.pieces import Piece, held
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.spectral_model import SpectralModel, Unknowns
from analysis.mismatch.recordings.start_check import start_check
from analysis.mismatch.recordings.start_values import _centre, start_values, with_first_states
from analysis.session import AnalysisError
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input

RATE, COUNT = 400.0, 3000
M = np.array([1.0, 0.6])
C, K = np.array([[0.9, -0.4], [-0.4, 0.4]]), np.array([[7000.0, -3000.0], [-3000.0, 3000.0]])
TWO = """
bodies: {a: 1.0, b: MASS}
joints: [{name: foot, between: [a, ground]}, {name: link, between: [b, a]}]
INPUT
sensors:
  - {channel: 0, of: b, shows: displacement}
  - {channel: 1, of: a, shows: acceleration}
"""


def two(push, start, u=None):
    """Displacement of b and acceleration of a, with noise; ``push`` (2,) is what a unit of the input does to both."""
    z = motion(lambda s, x, v: (s * push - C @ v - K @ x) / M, start, COUNT, RATE, u)
    forced = np.outer(push, np.zeros(COUNT) if u is None else u)
    shown = np.array([z[1], ((forced - C @ z[2:] - K @ z[:2]) / M[:, None])[0]])
    random = np.random.default_rng(8)
    return shown + 2e-3 * shown.std(axis=1, keepdims=True) * random.normal(size=shown.shape)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 900])
@pytest.mark.parametrize("kind", ["free", "force", "base"])
def test_the_linear_rig_begins_close_whatever_it_was_excited_by_and_wherever_the_recording_begins(kind, late):
    u = None if kind == "free" else noise_input(COUNT, RATE, 2, 60, seed=9)
    push = {"free": np.zeros(2), "force": np.array([0.0, 2.5]), "base": -M}[kind]
    shown = two(push, [0.01, -0.02, 1.0, 0.3] if kind == "free" else [0.0] * 4, u)[:, late:]
    told = {
        "free": "",
        "force": "inputs: [{channel: 2, force_on: b, gain: unknown}]",
        "base": "inputs: [{channel: 2, base_acceleration: true}]",
    }[kind]
    rig = parse_rig(TWO.replace("INPUT", told).replace("MASS", "0.6" if kind == "free" else "unknown"))
    columns = shown if u is None else np.vstack([shown, u[late:]])
    names = tuple(str(i) for i in range(len(columns)))
    ready = prepare(Recording(columns, RATE, names, "", "made here"), rig)
    (values, *_), _ = start_values(rig, [ready])
    assert values["stiffness of foot"] == pytest.approx(4000, rel=0.02)
    assert values["stiffness of link"] == pytest.approx(3000, rel=0.02)
    assert values["damping of foot"] == pytest.approx(0.5, rel=0.3)
    if kind != "free":
        assert values["mass of b"] == pytest.approx(0.6, rel=0.02)
    if kind == "force":
        assert values["gain of input 1"] == pytest.approx(2.5, rel=0.02)
    if late == 0:  # a driven rig is simulated from rest
        assert max(start_check(rig, [ready]).missed.values()) < 0.15


def test_slopes_are_those_of_differences_where_nothing_is_left():
    rig = parse_rig("""
bodies: {a: 1.0, b: unknown}
joints: [{name: foot, between: [a, ground]}, {name: link, between: [b, a]}]
inputs: [{channel: u, force_on: a, gain: unknown}, {channel: w, base_acceleration: true}]
sensors: [{channel: x, of: b, shows: velocity, gain: unknown}]
""")
    random = np.random.default_rng(2)
    s = 4.0 + 1j * np.linspace(5, 120, 60)
    inputs = random.normal(size=(2, 60)) + 1j * random.normal(size=(2, 60))
    unknowns = Unknowns(rig, 60.0)
    x = np.concatenate([0.3 * random.normal(size=len(unknowns.bent)), [1.4, 0.7]])
    # what the model itself makes there is taken for the recording, so that nothing is left
    empty = Piece(s, np.zeros((1, 60), complex), inputs, np.ones(1))
    values = unknowns.constants(x)
    m, k, c = (
        np.diag([1.0, values["mass of b"]]),
        *(
            values[f"{kind} of foot"] * np.diag([1.0, 0.0])
            + values[f"{kind} of link"] * np.array([[1.0, -1.0], [-1.0, 1.0]])
            for kind in ("stiffness", "damping")
        ),
    )
    pushed = values["gain of input 1"] * np.outer(inputs[0], [1.0, 0.0]) - np.outer(inputs[1], np.diag(m))
    moved = np.linalg.solve(s[:, None, None] ** 2 * m + s[:, None, None] * c + k, pushed[:, :, None])[:, 1, 0]
    full = Piece(s, (values["gain of sensor 1"] * s * moved)[None], inputs, empty.level)
    model = SpectralModel(unknowns, [full], 60.0)
    off, slopes = model.evaluated(x)
    assert np.abs(off).max() < 1e-9
    for i, step in enumerate(1e-6 * np.eye(x.size)):
        by_difference = (model.evaluated(x + step)[0] - model.evaluated(x - step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[:, i], by_difference, atol=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("inputs", ["", "inputs: [{channel: u, force_on: a, gain: unknown}]"])
def test_slopes_are_those_of_differences_with_a_beginning_too(inputs):
    rig = parse_rig(f"""
bodies: {{a: 1.0, b: unknown}}
joints: [{{name: foot, between: [a, ground]}}, {{name: link, between: [b, a]}}]
{inputs}
sensors:
  - {{channel: x, of: b, shows: velocity, gain: unknown}}
  - {{channel: y, of: a, shows: acceleration}}
""")
    random = np.random.default_rng(5)
    s = 4.0 + 1j * np.linspace(5, 120, 60)
    u = random.normal(size=(len(rig.drives), 60)) + 1j * random.normal(size=(len(rig.drives), 60))
    unknowns = Unknowns(rig, 60.0)
    x = np.concatenate([0.3 * random.normal(size=len(unknowns.bent)), 0.7 + random.random(len(unknowns.gains))])
    piece = Piece(s, np.zeros((2, 60), complex), u, np.array([1.0, 30.0]))
    outputs = SpectralModel(unknowns, [piece], 60.0).made(x, random.normal(size=4 + 2 * 4))
    model = SpectralModel(unknowns, [Piece(s, outputs, u, piece.level)], 60.0)
    off, slopes = model.evaluated(x)
    assert np.abs(off).max() < 1e-9
    for i, step in enumerate(1e-6 * np.eye(x.size)):
        by_difference = (model.evaluated(x + step)[0] - model.evaluated(x - step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[:, i], by_difference, atol=1e-6 * np.abs(slopes).max())


def test_a_held_input_has_the_spectrum_of_its_steps():
    sh = 1j * np.array([0.1, 1.0, 2.0])
    np.testing.assert_allclose(held(sh, "zero"), np.sinc(sh.imag / 2 / np.pi) * np.exp(-sh / 2), rtol=1e-12)
    np.testing.assert_allclose(held(sh, "first"), np.sinc(sh.imag / 2 / np.pi) ** 2, rtol=1e-12)


def test_the_mean_frequency_of_a_sine_is_its_own():
    t = np.arange(2000) / 500
    rig = parse_rig(
        "{bodies: {a: 1}, joints: [{between: [a, ground]}], sensors: [{channel: 0, of: a, shows: velocity}]}"
    )
    ready = prepare(Recording(np.sin(2 * np.pi * 25 * t)[None], 500.0, ("x",), "", "made here"), rig)
    assert _centre([ready]) == pytest.approx(2 * np.pi * 25, rel=0.02)


@pytest.mark.long
def test_a_wrong_constant_is_what_should_be_unknown():
    u = noise_input(COUNT, RATE, 2, 60, seed=9)
    shown = two(np.array([0.0, 2.5]), [0.0] * 4, u)
    text = TWO.replace("INPUT", "inputs: [{channel: 2, force_on: b, gain: 0.05}]").replace("MASS", "0.6")
    rig = parse_rig(text)
    ready = prepare(Recording(np.vstack([shown, u]), RATE, ("p", "q", "u"), "", "made here"), rig)
    found = start_check(rig, [ready])
    assert found.poor
    assert next(iter(found.freed)) == "gain of input 1"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_four_slow_bodies_seen_by_one_sensor_begin_where_they_are(seed):
    # most of what the sensor shows is far above the modes, which alone would tell a start much too stiff
    mass = np.array([1.0, 1.5, 1.2, 2.1])
    links = [(328.0, 1.4, [1, 0, 0, 0]), (122.0, 0.1, [1, -1, 0, 0]), (180.0, 1.7, [0, 1, -1, 0])]
    links += [(226.0, 0.7, [1, 0, 0, -1]), (199.0, 1.8, [0, 0, 0, 1])]
    k, c = (sum(link[i] * np.outer(link[2], link[2]) for link in links) for i in (0, 1))
    u = noise_input(3000, 120.0, 0.2, 20, seed)
    push = np.array([1.0, 0, 0, 0])
    z = motion(lambda s, x, v: (s * push - c @ v - k @ x) / mass, [0.0] * 8, 3000, 120.0, u)
    shown = z[4] + 3e-3 * z[4].std() * np.random.default_rng(seed).normal(size=3000)
    rig = parse_rig("""
bodies: {a: 1.0, b: 1.5, c: 1.2, d: 2.1}
joints:
  - {name: one, between: [a, ground]}
  - {name: two, between: [b, a]}
  - {name: three, between: [c, b]}
  - {name: four, between: [d, a]}
  - {name: five, between: [d, ground]}
inputs: [{channel: 1, force_on: a}]
sensors: [{channel: 0, of: a, shows: velocity}]
""")
    ready = prepare(Recording(np.array([shown, u]), 120.0, ("0", "1"), "", "made here"), rig)
    (values, *_), _ = start_values(rig, [ready])
    for name, (stiffness, _, _) in zip(("one", "two", "three", "four", "five"), links, strict=True):
        assert values[f"stiffness of {name}"] == pytest.approx(stiffness, rel=0.1)


def test_steps_under_which_a_rig_mostly_rests_say_how_fast_it_moves():
    """A chain of four bodies under steps, seen by the last of them: exact from sample to sample."""
    rate, mass = 2000.0, np.array([0.05, 0.06, 0.05, 0.1])
    stiffness, damping = np.array([4e3, 1.5e4, 1.4e4, 1.7e4]), np.array([2.0, 8.0, 10.0, 18.0])
    rows = np.eye(4) - np.eye(4, k=-1)
    k, c = (rows.T @ np.diag(of) @ rows / mass[:, None] for of in (stiffness, damping))
    a = np.block([[np.zeros((4, 4)), np.eye(4)], [-k, -c]])
    push = np.concatenate([np.zeros(4), np.array([0.0, 1.0, 0.0, 0.0]) / mass])[:, None]
    forward, given, *_ = cont2discrete((a, push, np.eye(8), np.zeros((8, 1))), 1 / rate)
    random = np.random.default_rng(3)
    u, state, shown = np.repeat(random.normal(size=8), 600), np.zeros(8), []
    for force in u:
        shown.append(state[3])
        state = forward @ state + given[:, 0] * force
    y = np.array(shown)
    y += 2e-4 * y.std() * random.normal(size=y.size)
    rig = parse_rig(
        f"bodies: {{a: {mass[0]}, b: {mass[1]}, c: {mass[2]}, d: {mass[3]}}}\n"
        "springs:\n"
        "  - {name: one, between: [a, ground], stiffness: unknown, damping: unknown}\n"
        "  - {name: two, between: [b, a], stiffness: unknown, damping: unknown}\n"
        "  - {name: three, between: [c, b], stiffness: unknown, damping: unknown}\n"
        "  - {name: four, between: [d, c], stiffness: unknown, damping: unknown}\n"
        "inputs: [{channel: 0, force_on: b}]\nrecording: {hold: zero}\n"
        "sensors: [{channel: 1, of: d, shows: displacement}]\n"
    )
    ready = prepare(Recording(np.array([u, y]), rate, ("u", "y"), "", "made here"), rig)
    modes = np.sqrt(np.linalg.eigvals(k).real)
    assert modes.min() < _centre([ready]) < modes.max()
    (values, *_), _ = start_values(rig, [ready])
    found = [values[f"stiffness of {name}"] for name in ("one", "two", "three", "four")]
    np.testing.assert_allclose(found, stiffness, rtol=0.05)


def test_a_start_that_runs_away_is_left_out_and_only_where_all_do_the_rig_is_refused() -> None:
    rig = parse_rig(TWO.replace("MASS", "0.6").replace("INPUT", ""))
    prepared = prepare(Recording(two(np.zeros(2), [1e-3, 2e-3, 0.0, 0.0]), RATE, ("b", "a"), "", "decay.csv"), rig)
    good = {p.name: p.value for p in rig.arrangement.parameters}
    for element, k, c in zip(rig.arrangement.elements, (4000.0, 3000.0), (0.5, 0.4), strict=True):
        good |= {str(element.stiffness): k, str(element.damping): c}
    away = good | {str(rig.arrangement.elements[1].damping): 5e14}  # seen in a rig of three stiffnesses and one sensor
    ((values, states),) = with_first_states(rig, [prepared], [away, good], 20.0)
    assert values == good
    assert np.all(np.isfinite(states[0]))
    with pytest.raises(AnalysisError, match=r"decay\.csv: the rig .* runs away from any start"):
        with_first_states(rig, [prepared], [away, away], 20.0)
