import math

import numpy as np
import pytest

from analysis.mismatch.recordings.determined import left_open, left_open_beside, reduced, undetermined, unknown
from analysis.mismatch.recordings.pieces import Piece
from analysis.mismatch.recordings.spectral_model import SpectralModel, Unknowns
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, family, variants
from sim_backend.mechanisms.kinds import AddedBody, Scale

TWO = """
bodies: {a: 1.0, b: unknown}
joints: [{name: foot, between: [a, ground]}, {name: link, between: [a, b]}]
"""


def names(text: str) -> dict[str, tuple[str, ...]]:
    return {u.name: u.with_it for u in undetermined(parse_rig(text))}


@pytest.mark.parametrize(
    ("mass", "gain", "expected"),
    [
        (1.0, 1.0, {}),
        (1.0, "unknown", {"gain of input 1": ("gain of sensor 1",)}),
    ],
)
def test_of_one_driven_body_three_ratios_are_seen(mass, gain, expected):
    text = f"""
bodies: {{body: {mass}}}
joints: [{{between: [body, ground]}}]
inputs: [{{channel: u, force_on: body, gain: unknown}}]
sensors: [{{channel: x, of: body, shows: velocity, gain: {gain}}}]
"""
    assert names(text) == expected


def test_two_bodies_that_ring_in_one_channel_show_four_numbers_of_five():
    found = undetermined(parse_rig(TWO + "sensors: [{channel: x, of: a, shows: acceleration}]"))
    assert [u.name for u in found] == ["mass of b"]
    assert set(found[0].with_it) == {
        "stiffness of foot", "stiffness of link", "damping of foot", "damping of link",
    }  # fmt: skip
    assert "best the mass of b" in found[0].statement


def test_a_force_that_is_known_shows_all_of_them():
    assert names(TWO + "inputs: [{channel: u, force_on: a}]\nsensors: [{channel: x, of: a, shows: acceleration}]") == {}


def test_a_body_that_nothing_shows_is_told():
    found = undetermined(
        parse_rig("""
bodies: {a: 1.0, b: unknown}
joints: [{name: foot, between: [a, ground]}, {name: other, between: [b, ground]}]
inputs: [{channel: u, force_on: a}]
sensors: [{channel: x, of: a, shows: displacement}]
""")
    )
    assert {u.name: u.with_it for u in found} == {"mass of b": (), "stiffness of other": (), "damping of other": ()}
    assert all("no channel shows" in u.statement for u in found)


def test_what_is_said_to_change_together_changes_no_spectrum():
    rig = parse_rig(
        TWO.replace("1.0", "{value: 1.0, uncertainty: 0.1}")
        + "inputs: [{channel: u, force_on: b, gain: unknown}]\n"
        + "sensors: [{channel: x, of: a, shows: acceleration, gain: unknown}]"
    )
    (found,) = undetermined(rig)
    assert (found.name, found.with_it) == ("gain of input 1", ("gain of sensor 1",))
    unknowns = Unknowns(rig, 60.0)
    x = 0.3 * np.random.default_rng(3).standard_normal(len(unknowns.names)) + 1.0
    values = unknowns.constants(x)
    moved = values | {found.name: 3 * values[found.name]}
    moved |= {name: values[name] * 3**power for name, power in zip(found.with_it, found.powers, strict=True)}
    s = 1j * np.geomspace(1.0, 300.0, 50)
    model = SpectralModel(unknowns, [Piece(s, np.zeros((1, 50), complex), np.ones((1, 50), complex), np.ones(1))], 60.0)
    k = len(unknowns.bent)
    other = np.concatenate([x[:k], [moved[p.name] for p in unknowns.gains]])
    none = np.zeros(8)
    np.testing.assert_allclose(model.made(other, none), model.made(x, none), rtol=1e-6)


@pytest.mark.parametrize("stiffness", [1e-3, 1e3, 1e9])
def test_declared_values_of_any_size_determine_the_rest(stiffness):
    text = TWO.replace("name: foot,", f"name: foot, stiffness: {stiffness},")
    assert (
        names(text + "inputs: [{channel: u, force_on: a}]\nsensors: [{channel: x, of: b, shows: acceleration}]") == {}
    )


def test_spectra_of_one_body_are_those_of_the_textbook():
    rig = parse_rig("""
bodies: {body: 2.0}
joints: [{between: [body, ground], stiffness: 800.0, damping: 4.0}]
sensors: [{channel: x, of: body, shows: displacement}]
""")
    assert unknown(rig) == []
    s = 1j * np.array([3.0, 20.0, 50.0])
    piece = Piece(s, np.zeros((1, 3), complex), np.zeros((0, 3), complex), np.ones(1))
    found = SpectralModel(Unknowns(rig, 20.0), [piece], 20.0).made(np.zeros(0), np.array([0.1, 0.5, 0, 0, 0, 0]))
    expected = (2.0 * 0.5 + (2.0 * s + 4.0) * 0.1) / (2 * s**2 + 4 * s + 800.0)
    np.testing.assert_allclose(found[0], expected, rtol=1e-12)


def test_rows_are_reduced_to_one_leading_one_each():
    rows = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 3.0]]) / math.sqrt(2)
    np.testing.assert_allclose(reduced(rows), [[1.0, 2.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)


def test_an_added_body_takes_away_what_one_decay_of_one_channel_determines() -> None:
    rig = parse_rig(
        "bodies: {mass: 1.0}\njoints: [{name: leaf, between: [mass, ground], stiffness: unknown, damping: unknown}]\n"
        "sensors: [{channel: x, of: mass, shows: displacement}]\n"
    )
    (frame,) = family("frame_compliance")
    values = {q.name: v for q, v in zip(frame.parameters, (10.0, 1e5, 20.0), strict=True)}
    on_a_frame = frame.extend(rig.arrangement, values, (0,))
    # two modes have four numbers; five constants make them
    assert left_open(rig) == set()
    assert left_open_beside(rig, on_a_frame) == {"stiffness of leaf", "damping of leaf", *values}
    driven = parse_rig(
        "bodies: {mass: 1.0}\njoints: [{name: leaf, between: [mass, ground], stiffness: unknown, damping: unknown}]\n"
        "inputs: [{channel: u, force_on: mass}]\nsensors: [{channel: x, of: mass, shows: displacement}]\n"
    )
    assert left_open_beside(driven, frame.extend(driven.arrangement, values, (0,))) == set()


SEEN_TWICE = """
bodies: {low: 1.0, high: 0.5}
springs:
  - {name: left, between: [low, ground], stiffness: unknown, damping: 0, alike: tubes}
  - {name: right, between: [low, ground], stiffness: unknown, damping: 0, alike: tubes}
contacts: [{name: touch, between: [high, low], stiffness: unknown, damping: unknown, preload: 0.5}]
sensors:
  - {channel: a, of: low, shows: acceleration}
  - {channel: b, of: low, shows: acceleration}
"""


@pytest.mark.parametrize("added", [m for m in variants(catalogue()) if isinstance(m, AddedBody)], ids=lambda m: m.id)
def test_whatever_is_added_can_be_asked_what_it_leaves_open(added: AddedBody) -> None:
    rig = parse_rig(SEEN_TWICE)
    scale = Scale(1e-3, 0.1, 0.0, 1.0, (10.0, 30.0), 10.0, 1.0, 100.0)
    for place in added.at(rig.arrangement):
        extended = added.extend(rig.arrangement, added.trials(scale)[0], place)
        assert left_open_beside(rig, extended) <= {p.name for p in extended.parameters}
