import numpy as np
import pytest

from analysis.mismatch.recordings.first_look import first_look
from daq.exchange import Recording
from tests.analysis.mismatch.recordings.described_rigs import OMEGA, RATE, SAMPLES, driven


def recording(columns, names, unit="", rate=RATE):
    return Recording(np.array(columns), rate, tuple(names), unit, "made here")


def by_quantity():
    u, x, v = driven()
    return u, {"displacement": x, "velocity": v, "acceleration": 100 * u - OMEGA**2 * x - 0.08 * OMEGA * v}


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_a_driven_rig_without_names_shows_its_input_its_mode_and_what_its_sensor_sees(quantity):
    u, motions = by_quantity()
    y = motions[quantity] + 1e-3 * np.std(motions[quantity]) * np.random.default_rng(1).normal(size=SAMPLES)
    look = first_look(recording([y, u], ["1", "2"]), inputs=["2"])
    assert [c.name for c in look.inputs] == ["2"]
    assert look.sensors[0].quantity == quantity
    assert not look.free
    assert len(look.modes_hz) == 1
    assert look.modes_hz[0] == pytest.approx(12, rel=0.06)


def test_the_least_predictable_of_nameless_channels_is_taken_for_the_input():
    u, motions = by_quantity()
    look = first_look(recording([motions["displacement"], u], ["1", "2"]))
    assert [(c.name, c.told) for c in look.inputs] == [("2", False)]


@pytest.mark.parametrize("name", ["force", "Hammer_1", "u", "input"])
def test_names_tell_an_input(name):
    u, motions = by_quantity()
    look = first_look(recording([u, motions["velocity"]], [name, "speed of the mass"]))
    assert [c.kind for c in look.channels] == ["force", "sensor"]
    assert look.sensors[0].quantity == "velocity"


@pytest.mark.parametrize(
    ("names", "unit", "found"),
    [(("q_kN", "out_mm"), "", ("kN", "mm")), (("q", "out_um"), "", ("", "um")), (("q", "out"), "MM", ("mm", "mm"))],
)
def test_a_unit_is_read_from_the_end_of_a_name_and_in_capitals(names, unit, found):
    u, motions = by_quantity()
    look = first_look(recording([u, motions["displacement"]], names, unit), inputs=[names[0]])
    assert tuple(c.unit for c in look.channels) == found
    assert look.sensors[0].quantity == "displacement"


def test_a_force_in_kilonewtons_is_an_input_whatever_its_name():
    u, motions = by_quantity()
    look = first_look(recording([u, motions["displacement"]], ["q_kN", "out_mm"]))
    assert [c.name for c in look.inputs] == ["q_kN"]


def test_two_modes_of_a_decay_are_seen():
    t = np.arange(6000) / 2000
    y = np.exp(-4 * t) * np.cos(2 * np.pi * 60 * t) + 0.2 * np.exp(-9 * t) * np.sin(2 * np.pi * 210 * t)
    look = first_look(recording([y + 1e-3 * np.random.default_rng(2).normal(size=t.size)], ["acc"], "m/s2", 2000.0))
    assert look.free
    np.testing.assert_allclose(look.modes_hz, [60, 210], rtol=0.01)


def test_noise_has_no_modes():
    y = np.random.default_rng(4).normal(size=(2, 5000))
    assert first_look(recording(y, ["u", "x"])).modes_hz == ()


def test_steps_stuck_samples_and_a_period_are_seen():
    n, period = 4000, 500
    spectrum = np.zeros(period // 2 + 1, complex)
    spectrum[3:40] = np.exp(2j * np.pi * np.random.default_rng(6).random(37))
    u = np.tile(np.fft.irfft(spectrum, period), n // period)
    x = np.round(u / u.max() * 50) * 2e-6
    y = np.clip(u / u.max(), -0.8, 0.8)
    look = first_look(recording([u, x, y], ["force", "encoder", "acc"]))
    assert look.period_s == pytest.approx(period / RATE)
    assert look.channels[1].step == pytest.approx(2e-6)
    assert look.channels[2].clipped == int(np.sum(np.abs(y) == 0.8))
    assert look.channels[0].clipped == look.channels[0].step == 0
