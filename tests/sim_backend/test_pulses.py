import numpy as np
import pytest
from scipy.integrate import quad

from sim_backend.pulses import SHAPES, half_sine, haversine, sampled, triangle

T = 3e-4


@pytest.mark.parametrize("shape", SHAPES)
def test_peaks_in_the_middle_and_vanishes_outside(shape):
    pulse = SHAPES[shape](2.0, T)
    assert pulse(T / 2) == pytest.approx(2.0)
    assert pulse([-1e-9, T, 2 * T]) == pytest.approx([0, 0, 0])
    assert pulse.duration_s == T


@pytest.mark.parametrize(("shape", "mean"), [("half_sine", 2 / np.pi), ("haversine", 0.5), ("triangle", 0.5)])
def test_impulse_is_the_textbook_mean_times_the_duration(shape, mean):
    assert SHAPES[shape](3.0, T).impulse_ns() == pytest.approx(3.0 * mean * T)


def test_knots_are_where_the_force_is_not_smooth():
    assert half_sine(1, T).knots == pytest.approx([0, T])
    assert haversine(1, T).knots == pytest.approx([0, T])
    assert triangle(1, T).knots == pytest.approx([0, T / 2, T])


def test_second_impact_adds_to_the_first():
    pulse = half_sine(1.0, T).followed_by(haversine(0.5, T), T / 2)
    assert pulse(0.75 * T) == pytest.approx(np.sin(0.75 * np.pi) + 0.25)
    assert pulse.duration_s == pytest.approx(1.5 * T)
    assert pulse.impulse_ns() == pytest.approx(quad(pulse, 0, 1.5 * T, points=[T / 2, T])[0], rel=1e-6)


def test_sampled_force_is_straight_between_points():
    pulse = sampled([0, 1e-4, 3e-4], [0, 4, 0])
    assert pulse([5e-5, 2e-4]) == pytest.approx([2, 2])


def test_scaled_keeps_the_shape():
    assert haversine(1, T).scaled(3)(0.3 * T) == pytest.approx(3 * haversine(1, T)(0.3 * T))


@pytest.mark.parametrize(("t", "f"), [([0, 0], [0, 1]), ([0], [1]), ([0, 1, 2], [0, 1]), ([-1, 1], [0, 1])])
def test_bad_tables_are_refused(t, f):
    with pytest.raises(ValueError, match="sampled pulse"):
        sampled(t, f)
