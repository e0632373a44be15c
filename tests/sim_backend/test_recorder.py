from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from rig.settings import Filter
from sim_backend.recorder import Converter, Noise, analog_filter
from sim_backend.settings import SimulatedNoise


@pytest.mark.parametrize("highpass_order", [1, 2, 3])
@pytest.mark.parametrize("lowpass_order", [1, 4, 5, 8])
def test_response_is_that_of_scipys_butterworth(highpass_order, lowpass_order):
    system = analog_filter(Filter(highpass_order=highpass_order, lowpass_order=lowpass_order))
    f = np.geomspace(1, 12000, 50)
    s = 2j * np.pi * f
    ours = np.array([(system.c @ np.linalg.solve(x * np.eye(len(system.b)) - system.a, system.b))[0] for x in s])
    high = signal.butter(highpass_order, 2 * np.pi * 10, "high", analog=True, output="zpk")
    low = signal.butter(lowpass_order, 2 * np.pi * 10000, "low", analog=True, output="zpk")
    theirs = signal.freqs_zpk(*high, 2 * np.pi * f)[1] * signal.freqs_zpk(*low, 2 * np.pi * f)[1]
    assert ours + system.d[0] == pytest.approx(theirs, rel=1e-9, abs=1e-12)


def test_no_filter_is_the_identity():
    system = analog_filter(Filter(family="none"))
    assert len(system.b) == 0
    assert system.d == [1.0]


def test_converter_rounds_to_codes_and_clips():
    convert = Converter(8.0, 4)  # codes -8 to 7, a unit each
    assert convert(np.array([0.4, 0.6, -3.2, 99.0, -99.0])) == pytest.approx([0, 1, -3, 7, -8])


def test_noise_has_the_rms_and_the_share_of_colour_asked_for():
    settings = SimulatedNoise(rms_m_s2=0.01, coloured_share=0.4, corner_hz=500.0)
    noise = Noise(settings, 2, 25000.0, np.random.default_rng(0))
    x = np.hstack([noise.draw(256) for _ in range(2000)])
    assert np.std(x, axis=1) == pytest.approx([0.01, 0.01], rel=0.01)
    for lag in (1, 3, 10):
        correlation = np.mean(x[:, lag:] * x[:, :-lag]) / np.mean(x**2)
        assert correlation == pytest.approx(0.4 * np.exp(-2 * np.pi * 500 / 25000 * lag), abs=0.01)
    assert abs(np.mean(x[0] * x[1])) < 0.01 * np.mean(x[0] ** 2)


def test_noise_has_no_seam_between_blocks():
    settings = SimulatedNoise(rms_m_s2=1.0, coloured_share=1.0, corner_hz=10.0)
    noise = Noise(settings, 1, 25000.0, np.random.default_rng(1))
    blocks = [noise.draw(64) for _ in range(500)]
    steps = np.array([b[0, 0] - a[0, -1] for a, b in pairwise(blocks)])
    assert np.std(steps) == pytest.approx(np.sqrt(2 * (1 - np.exp(-2 * np.pi * 10 / 25000))), rel=0.1)


def test_noise_begins_in_its_stationary_state():
    settings = SimulatedNoise(rms_m_s2=1.0, coloured_share=1.0, corner_hz=1.0)
    rng = np.random.default_rng(2)
    first = [Noise(settings, 1, 25000.0, rng).draw(1)[0, 0] for _ in range(4000)]
    assert np.std(first) == pytest.approx(1.0, rel=0.05)
