"""Modes of recordings that the tester did not make: how many, how sure, and where the decay begins."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from analysis.modal.clipping import clipped_samples
from analysis.modal.counted_modes import counted_from
from analysis.modal.exponentials import NONE_MISSING
from analysis.modal.identify import identify_ring_down
from analysis.modal.impact_onset import impact_onset
from analysis.modal.later_impact import end_before_an_impact
from analysis.modal.model_order import groups, modes_of
from analysis.modal.modes import sampled_pole
from analysis.modal.realised_modes import half_width_about
from analysis.modal.ring_down_model import Record, Recorded, unresolved

RATE = 10_000.0


def decays(f, zeta, shapes, samples=3000, rate=RATE):
    """Sums of decays in closed form, (c, n)."""
    omega = 2 * np.pi * np.asarray(f)
    zeta = np.asarray(zeta)
    s = (-zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)) / rate
    return (np.atleast_2d(shapes) @ np.exp(np.outer(s, np.arange(samples)))).real


def tapped(f, zeta, pulse_s, before, rng, samples=3000, quantity="acceleration"):
    """Modes set going by a half-sine that begins a fraction of a sample after so many samples, (n,): closed form."""
    t = (np.arange(before + samples) - before - rng.uniform()) / RATE
    w, y = np.pi / pulse_s, np.zeros(t.size)
    until = np.clip(t, 0, pulse_s)
    for own, damping in zip(f, zeta, strict=True):
        omega = 2 * np.pi * own
        s = -damping * omega + 1j * omega * np.sqrt(1 - damping**2)
        acted = (w - np.exp(-s * until) * (s * np.sin(w * until) + w * np.cos(w * until))) / (s * s + w * w)
        displaced = np.exp(s * np.maximum(t, 0)) * acted / s.imag
        mode = (s * s * displaced).imag + np.sin(w * until) if quantity == "acceleration" else displaced.imag
        y += rng.uniform(0.5, 1) * mode / np.abs(mode[before + int(pulse_s * RATE) :]).max()
    return y


def noisy(y, decibel, rng):
    return y + np.abs(y).max() * 10 ** (-decibel / 20) * rng.standard_normal(y.shape)


def identified(y, **options):
    return identify_ring_down(y, RATE, largest_order=0, **options)


def scores(found, f, zeta):
    """Errors over standard errors of frequency and damping, modes in order."""
    return [
        (e.value - true) / e.standard_error
        for m, a, b in zip(found.modes, f, zeta, strict=True)
        for e, true in ((m.frequency_hz, a), (m.damping_ratio, b))
    ]


@pytest.mark.parametrize("decibel", [40, 60])
def test_two_sound_modes_are_settled_by_likelihood_and_their_intervals_hold(decibel):
    rng = np.random.default_rng(decibel)
    off = []
    for _ in range(25):
        f = np.sort(rng.uniform(200, 2000, 2)) * (1, 1.3)
        zeta = np.exp(rng.uniform(np.log(1e-3), np.log(0.05), 2))
        found = identified(noisy(decays(f, zeta, np.exp(2j * np.pi * rng.uniform(size=2))), decibel, rng))
        assert found.method == "ml"
        off += scores(found, f, zeta)
    assert np.mean(np.abs(off) < 1.96) > 0.88
    assert np.abs(off).max() < 5


def test_modes_one_percent_apart_are_found_apart():
    rng = np.random.default_rng(3)
    f, zeta = [600.0, 606.0], [0.003, 0.004]
    off = []
    for _ in range(8):
        shapes = rng.standard_normal((2, 2)) + 1j * rng.standard_normal((2, 2))
        found = identified(noisy(decays(f, zeta, shapes), 40, rng))
        off += scores(found, f, zeta)
    assert np.abs(off).max() < 4.5


def test_heavy_damping_is_found_and_none_is_invented():
    rng = np.random.default_rng(4)
    for zeta in (0.32, 0.4):
        found = identified(noisy(decays([900.0], [zeta], [[1.0], [0.5]]), 40, rng))
        assert np.abs(scores(found, [900.0], [zeta])).max() < 4.5
    assert sum(len(identified(rng.standard_normal((2, 2000))).modes) for _ in range(10)) == 0


def test_an_undamped_mode_hides_no_other_and_never_grows():
    rng = np.random.default_rng(5)
    for zeta1 in (0.0, 1e-4):
        found = identified(noisy(decays([356.0, 1406.0], [zeta1, 0.027], [[1.0, 0.7]]), 40, rng))
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx([356, 1406], rel=1e-3)
        assert all(m.damping_ratio.value >= 0 for m in found.modes)


def test_a_growing_oscillation_is_refused_with_the_reason():
    rng = np.random.default_rng(6)
    y = decays([300.0, 900.0], [0.01, -0.0005], [[1.0, 0.3]])
    found = identified(noisy(y, 40, rng), start=0)
    assert [m.frequency_hz.value for m in found.modes] == pytest.approx([300.0], rel=1e-3)
    assert any("grows" in note for note in found.notes)


def test_era_says_so_and_covers_its_noise():
    rng = np.random.default_rng(7)
    f, zeta = [400.0, 1100.0], [0.01, 0.02]
    off = []
    for _ in range(6):
        y = noisy(decays(f, zeta, [[1.0, 0.8j]], 1500), 50, rng)
        found = identify_ring_down(y, RATE, start=0, largest_order=16, method="era")
        assert found.method == "era"
        off += scores(found, f, zeta)
    assert np.mean(np.abs(off) < 1.96) > 0.8


def test_era_sees_a_record_whose_noise_is_white():
    rng = np.random.default_rng(26)
    for _ in range(3):
        y = tapped([200.0, 700.0], [0.01, 0.02], 0.5e-3, 800, rng)
        y += 0.03 * signal.lfilter([1.0], [1.0, -0.9], rng.standard_normal(y.size))
        era, ml = (identify_ring_down(y, RATE, **o) for o in ({"method": "era", "largest_order": 24}, {}))
        assert [m.frequency_hz.value for m in era.modes] == pytest.approx([200, 700], rel=0.02)
        for own, other in zip(era.modes, ml.modes, strict=True):
            assert abs(own.amplitude[0]) == pytest.approx(abs(other.amplitude[0]), rel=0.1)


def test_era_invents_no_mode_in_noise():
    rng = np.random.default_rng(17)
    for _ in range(12):
        y = noisy(decays([300.0], [0.002], [[1.0]]), 5, rng)
        found = identify_ring_down(y, RATE, start=0, largest_order=24, method="era")
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx([300.0], rel=0.02)


def test_era_finds_a_mode_that_is_over_long_before_the_record():
    rng = np.random.default_rng(18)
    off = []
    for _ in range(6):
        y = noisy(decays([520.0], [0.16], [[1.0], [0.6]]), 20, rng)
        off += scores(identify_ring_down(y, RATE, start=0, largest_order=24, method="era"), [520.0], [0.16])
    assert np.mean(np.abs(off) < 1.96) > 0.7
    assert np.abs(off).max() < 5


def test_modes_that_begin_in_the_noise_are_not_taken_to_begin_with_the_record():
    rng = np.random.default_rng(19)
    off = []
    for _ in range(8):
        y = np.hstack([np.zeros((1, 400)), decays([281.0, 733.0], [0.002, 0.01], [[1.0, 1.0]])])
        y += 0.75 * rng.standard_normal(y.shape)
        assert impact_onset(y - y.mean(), RATE) is None
        found = identified(y)
        assert found.start == pytest.approx(400, abs=60)
        assert any("ms into the record" in note for note in found.notes)
        off += scores(found, [281.0, 733.0], [0.002, 0.01])
    assert np.mean(np.abs(off) < 1.96) > 0.8


def test_modes_that_begin_with_the_record_are_left_there():
    rng = np.random.default_rng(20)
    for _ in range(8):
        y = decays([281.0, 733.0], [0.002, 0.01], [[1.0, 1.0]])
        assert identified(y + 0.9 * rng.standard_normal(y.shape)).start == 0


@pytest.mark.parametrize("before", [0, 6])
def test_an_impact_with_which_a_record_begins_is_no_mode(before):
    rng = np.random.default_rng(21 + before)
    f, zeta = [180.0, 420.0], [0.01, 0.03]
    off, told = [], 0
    for i in range(8):
        y = tapped(f, zeta, rng.uniform(0.4e-3, 3e-3), before, rng, quantity=("acceleration", "displacement")[i % 2])
        found = identified(noisy(y, 30, rng))
        off += scores(found, f, zeta)  # and no other
        told += any("begins with more than its modes" in note for note in found.notes)
    assert np.mean(np.abs(off) < 1.96) > 0.8
    assert np.abs(off).max() < 4
    assert told >= 6


def test_the_decay_begins_after_a_second_hit():
    rng, off = np.random.default_rng(27), []
    f, zeta = [150.0, 600.0], [0.006, 0.01]
    for gap in (40, 90, 160):
        y = tapped(f, zeta, 0.6e-3, 300, rng, samples=4000)
        y[gap:] += 0.7 * y[:-gap]  # the same structure, hit again
        found = identified(noisy(y, 35, rng))
        assert found.start > 300 + gap
        off += scores(found, f, zeta)
    assert np.abs(off).max() < 4


def test_a_deflection_that_is_let_go_is_no_impact_of_its_own():
    rng, off = np.random.default_rng(28), []
    f, zeta = [150.0, 600.0], [0.006, 0.01]
    for held in (60, 250):
        y = np.hstack([np.full((1, held), 2.0), decays(f, zeta, [[1.0, 1.0]], samples=4000)])
        found = identified(noisy(y, 35, rng))
        assert found.start >= held
        off += scores(found, f, zeta)
    assert np.abs(off).max() < 4


def test_a_decay_that_is_nowhere_the_same_is_told():
    k = np.arange(3000)
    y = np.maximum(1 - k / 400, 0) * np.cos(0.3 * k)  # dry friction alone: over after 400 samples
    found = identified(noisy(np.hstack([np.zeros(300), y]), 40, np.random.default_rng(29)))
    assert any(abs(m.frequency_hz.value / (0.3 * RATE / 2 / np.pi) - 1) < 0.03 for m in found.modes)
    assert any("the modes are others from whichever sample" in note for note in found.notes)


@pytest.mark.slow
def test_intervals_hold_after_long_pulses():
    rng, off = np.random.default_rng(22), []
    f, zeta = [90.0, 210.0], [0.05, 0.1]
    for i in range(40):
        y = tapped(f, zeta, rng.uniform(3e-3, 8e-3), 400, rng, quantity=("acceleration", "displacement")[i % 2])
        for mode in identified(noisy(y, 25, rng)).modes:
            j = int(np.argmin(np.abs(np.subtract(f, mode.frequency_hz.value))))
            off += scores(SimpleNamespace(modes=[mode]), f[j : j + 1], zeta[j : j + 1])
    assert len(off) > 150
    assert np.mean(np.abs(off) < 1.96) > 0.9


def test_hum_that_runs_before_the_impact_is_told_and_left_out():
    rng = np.random.default_rng(23)
    y = tapped([200.0, 700.0], [0.01, 0.02], 0.5e-3, 800, rng)
    y += 0.03 * np.sin(2 * np.pi * 50 * np.arange(y.size) / RATE + 1)
    for options in ({}, {"method": "era", "largest_order": 24}):
        found = identify_ring_down(noisy(y, 40, rng), RATE, **{"largest_order": 0, **options})
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx([200, 700], rel=0.01)
        told = any("runs before the impact" in note for note in found.notes)
        assert told or found.method == "era"  # to which noise of its colour has taken the hum off


def test_what_may_be_hum_is_told_where_nothing_was_recorded_before():
    y = decays([50.0, 210.0], [0.0, 0.02], [[0.3, 1.0]])
    found = identified(noisy(y, 40, np.random.default_rng(25)))
    assert len(found.modes) == 2
    assert sum("may be hum" in note for note in found.notes) == 1
    damped = decays([50.0, 210.0], [0.02, 0.02], [[0.3, 1.0]])
    assert not any("may be hum" in note for note in identified(noisy(damped, 40, np.random.default_rng(25))).notes)


def test_coloured_noise_alone_is_told_and_makes_few_modes():
    rng = np.random.default_rng(24)
    found = []
    for _ in range(6):
        white = np.fft.rfft(rng.standard_normal(2000))
        found.append(identified(np.fft.irfft(white / np.sqrt(np.maximum(np.arange(1001), 1.0)))))
    assert sum(len(f.modes) for f in found) <= 10
    assert sum(any("coloured" in note for note in f.notes) for f in found) >= 4


def test_a_burst_of_noise_is_no_ring_down():
    rng = np.random.default_rng(33)
    swell = np.zeros(3000)
    swell[300:800] = np.sin(np.pi * np.arange(500) / 500) ** 2
    for _ in range(2):
        found = identified(swell * rng.standard_normal(3000) + 0.03 * rng.standard_normal(3000))
        assert not found.modes
        assert any("is no ring-down" in note for note in found.notes)


def test_clipped_samples_are_left_out():
    rng = np.random.default_rng(8)
    y = noisy(decays([300.0, 900.0], [0.01, 0.02], [[1.0, 0.8]]), 50, rng)
    clipped = np.clip(y, -0.6 * np.abs(y).max(), 0.6 * np.abs(y).max())
    assert set(clipped_samples(clipped)) == set(np.flatnonzero(np.abs(y[0]) >= 0.6 * np.abs(y).max()))
    assert clipped_samples(y).size == 0
    found = identified(clipped, start=0)
    assert np.abs(scores(found, [300.0, 900.0], [0.01, 0.02])).max() < 4.5
    assert any("clipped" in note for note in found.notes)


def test_a_decay_of_a_few_steps_of_the_converter_has_its_modes_and_no_other():
    rng = np.random.default_rng(32)
    for _ in range(3):
        y = np.hstack([np.zeros((1, 200)), decays([150.0, 600.0], [0.006, 0.02], [[1.0, 0.7]], samples=4000)])
        found = identified(np.round(20 * y + 0.1 * rng.standard_normal(y.shape)) / 20)
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx([150, 600], rel=0.01)


def test_a_rounded_peak_is_not_clipped():
    y = decays([40.0], [0.01], [[1.0]])[:, 30:]
    assert clipped_samples(np.round(12 * y) / 12).size == 0  # a converter of few steps: its peaks are flat
    assert clipped_samples(np.round(100 * np.clip(y, -0.6, 0.6)) / 100).size > 20


def test_what_hardly_oscillates_is_no_mode():
    y = decays([150.0], [0.006], [[1.0]], samples=4000) + 0.5 * np.exp(-2 * np.pi * 8 * np.arange(4000) / RATE)
    found = identified(noisy(y, 35, np.random.default_rng(30)), start=0)
    assert [m.frequency_hz.value for m in found.modes] == pytest.approx([150.0], rel=1e-3)
    assert any("hardly oscillates" in note for note in found.notes)


def test_a_record_of_a_few_periods_is_told():
    rng = np.random.default_rng(31)
    for f in (800.0, 1500.0, 3000.0):
        found = identified(noisy(decays([f], [0.02], [[1.0]], samples=40), 40, rng))
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx([f], rel=0.02)
        assert not any("may be an impact" in note for note in found.notes)


def test_a_mode_that_changes_along_the_decay_is_one_mode():
    k = np.arange(6000)
    amplitude = 1 / (1 + k / 400)  # dry friction and more: no exponential
    y = np.stack([amplitude * np.cos(0.3 * k), 0.5 * amplitude * np.cos(0.3 * k)])
    y += 1e-3 * np.random.default_rng(9).standard_normal(y.shape)
    found = identified(y, start=0)
    near = [m for m in found.modes if abs(m.frequency_hz.value / (0.3 * RATE / 2 / np.pi) - 1) < 0.02]
    assert len(near) == 1


def test_a_decay_without_an_impact_begins_with_the_record():
    y = noisy(decays([600.0, 606.0], [0.001, 0.001], [[1.0, -0.9]]), 30, np.random.default_rng(10))
    assert impact_onset(y, RATE) is None
    assert impact_onset(np.concatenate([np.zeros((1, 200)), y], axis=1), RATE) == pytest.approx(200, abs=12)


def test_what_overlaps_is_a_group():
    z = np.exp(np.array([-0.01 + 0.3j, -0.01 + 0.31j, -0.001 + 0.5j]))
    assert sorted(groups(z, 3000)) == [[0, 1], [2]]
    assert modes_of(Record(np.random.default_rng(1).standard_normal((1, 1500)))).poles.size == 0


@pytest.mark.parametrize(("zeta", "channels"), [(0.01, 1), (0.0005, 1), (0.02, 3)])
def test_what_a_record_could_not_tell_apart_is_said_rightly(zeta, channels):
    rng = np.random.default_rng(5)
    k = np.arange(3000)

    def modes_found(apart):
        pair = [sampled_pole(300 + sign * apart / 2, zeta, 1e4) for sign in (-1, 1)]
        y = 0.5 * sum((z**k).real for z in pair) * np.ones((channels, 1))
        return modes_of(Record(y + 0.02 * rng.normal(size=(channels, k.size))))

    one = modes_found(0.0)
    y = (sampled_pole(300, zeta, 1e4) ** k).real * np.ones((channels, 1))
    record = Record(y + 0.02 * rng.normal(size=(channels, k.size)))
    apart = unresolved(record, modes_of(record))[0] * 1e4 / (2 * np.pi)
    assert one.poles.size == 1
    assert np.mean([modes_found(1.2 * apart).poles.size == 2 for _ in range(8)]) > 0.7
    assert all(modes_found(0.4 * apart).poles.size == 1 for _ in range(8))
    found = identify_ring_down(record.y, 1e4, start=0, largest_order=0)
    assert any("may count as one" in note for note in found.notes)


@pytest.mark.slow
def test_intervals_of_era_hold_in_much_noise():
    rng = np.random.default_rng(31)
    off = []
    for _ in range(12):
        f, zeta = [150.0, 900.0], [0.004, 0.05]
        y = noisy(decays(f, zeta, rng.standard_normal((4, 2))), 8, rng)
        found = identify_ring_down(y, RATE, largest_order=24, method="era")
        if len(found.modes) == 2:
            off += scores(found, f, zeta)
    assert len(off) > 20
    assert np.mean(np.abs(off) < 1.96) > 0.88
    assert np.abs(off).max() < 3.5


def test_half_widths_about_an_estimate_hold_what_is_normal_about_another():
    rng = np.random.default_rng(32)
    for off in (0.0, 0.7, 3.0):
        (half,) = half_width_about(np.array([off]))
        assert np.mean(np.abs(off + rng.standard_normal(100_000)) < half) == pytest.approx(0.95, abs=0.003)


def test_era_says_which_of_two_modes_it_misses_and_its_interval_holds_the_other():
    pair = decays([300.0, 303.0], [0.001, 0.0012], [[1.0, 1.0]], samples=6000)
    found = identify_ring_down(noisy(pair, 15, np.random.default_rng(33)), RATE, largest_order=24, method="era")
    (mode,) = found.modes
    assert abs(mode.frequency_hz.value - 300.0) < 1.96 * mode.frequency_hz.standard_error
    assert any("a further mode around 303" in note for note in found.notes)


@pytest.mark.slow
def test_era_keeps_the_sound_one_of_two_modes_of_which_it_misses_the_other():
    rng, off = np.random.default_rng(35), []
    for _ in range(3):
        shapes = rng.standard_normal((3, 3)) * np.exp(2j * np.pi * rng.uniform(size=3))
        y = decays([221.3, 223.8, 920.0], [0.145, 0.0367, 0.0039], shapes, samples=4000)
        found = identify_ring_down(noisy(y, 40, rng), RATE, largest_order=24, method="era")
        off += [
            min((abs(m.frequency_hz.value - f) / m.frequency_hz.standard_error for m in found.modes), default=np.inf)
            for f in (223.8, 920.0)
        ]
    assert max(off) < 3


def test_a_mode_that_changes_along_its_decay_is_one_for_era_too():
    t = np.arange(4000) / RATE
    y = np.exp(-20 * t) * np.cos(2 * np.pi * (300 * t + 0.02 * np.exp(-40 * t)))
    found = identify_ring_down(noisy(y[None], 50, np.random.default_rng(34)), RATE, largest_order=24, method="era")
    assert [round(mode.frequency_hz.value) for mode in found.modes] == [300]


@pytest.mark.parametrize("at", [0.2, 0.5, 0.8])
def test_a_second_hit_ends_the_decay_before_it(at):
    f, zeta, off = [180.0, 640.0], [0.012, 0.006], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        y = tapped(f, zeta, 1e-3, 150, rng)
        again = int(150 + at * 3000)
        y[again:] += 0.6 * tapped(f, zeta, 1e-3, 0, rng)[: y.size - again]
        found = identified(noisy(y, 40, rng))
        off += scores(found, f, zeta)
        assert any("something sudden" in note or "from there on" in note for note in found.notes)
    assert np.abs(off).max() < 4
    assert np.mean(np.abs(off) < 1.96) > 0.85


def test_a_hit_ends_a_decay_only_if_it_is_heard():
    rng = np.random.default_rng(3)
    y = noisy(tapped([180.0, 640.0], [0.012, 0.006], 1e-3, 150, rng), 40, rng)
    recorded = Recorded(y[None], NONE_MISSING)
    part = counted_from(recorded.until(900), 200, None, 3000)
    assert end_before_an_impact(recorded, part) is None
    y[1200:] += 0.5 * tapped([180.0, 640.0], [0.012, 0.006], 1e-3, 0, rng)[: y.size - 1200]
    assert 1150 <= end_before_an_impact(recorded, part) <= 1200


@pytest.mark.parametrize("slow", ["settles", "drifts"])
def test_what_is_slow_is_no_mode_and_hides_none(slow):
    f, zeta, off = [90.0, 640.0], [0.03, 0.006], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        y = tapped(f, zeta, 1e-3, 400, rng)
        if slow == "settles":  # coupled for alternating signals, from an offset, at 2 Hz
            a = np.exp(-2 * np.pi * 2 / RATE)
            y = signal.lfilter([(1 + a) / 2, -(1 + a) / 2], [1, -a], y + 0.4)
        else:
            y = y + np.linspace(0.1, -0.3, y.size)
        found = identified(noisy(y, 40, rng))
        assert not any("others from whichever" in note for note in found.notes)
        off += scores(found, f, zeta)
    assert np.abs(off).max() < 4
    assert np.mean(np.abs(off) < 1.96) > 0.85


def test_what_a_sensor_that_saturates_adds_is_told():
    f, zeta = [150.0, 640.0], [0.01, 0.008]
    for seed in range(4):
        rng = np.random.default_rng(seed)
        y = decays(f, zeta, [rng.uniform(0.5, 1, 2)])
        found = identified(noisy(y - y**3 / 12, 50, rng), start=0)
        assert all(np.abs(np.array([m.frequency_hz.value for m in found.modes]) / own - 1).min() < 0.01 for own in f)
        assert any("a distortion of the modes at 150" in note for note in found.notes)


def test_a_mode_at_three_times_a_frequency_stays_and_one_of_another_decay_is_not_doubted():
    rng = np.random.default_rng(2)
    for zeta, doubted in (((0.01, 0.004), False), ((0.01, 0.01), True)):  # a string's, and one of many
        found = identified(noisy(decays([150.0, 450.0], zeta, [[1.0, 0.1]]), 60, rng))
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx([150, 450], rel=0.01)
        assert any("distortion" in note for note in found.notes) == doubted


def test_a_background_of_a_narrow_band_that_runs_before_is_no_mode():
    f, zeta = [180.0, 640.0], [0.012, 0.006]
    for seed in range(5):
        rng = np.random.default_rng(seed)
        y = tapped(f, zeta, 1e-3, 800, rng)
        p = np.exp(2 * np.pi * 0.13 * (-0.002 + 1j))
        band = signal.lfilter([1], np.poly([p, p.conjugate()]).real, rng.standard_normal(y.size + 5000))[5000:]
        found = identified(noisy(y, 50, rng) + 0.01 * band / band.std())
        assert [m.frequency_hz.value for m in found.modes] == pytest.approx(f, rel=0.01)


def test_intervals_contain_what_changes_along_the_decay():
    t, own, b = np.arange(3000) / RATE, 0.01 * 2 * np.pi * 300, 0.5
    envelope = 1 / np.sqrt((1 + b) * np.exp(2 * own * t) - b)  # its rate is own (1 + b envelope^2)
    for seed in range(6):
        y = noisy(envelope * np.cos(2 * np.pi * 300 * t + seed), 40, np.random.default_rng(seed))
        found = identified(y, start=0)
        damping = max(found.modes, key=lambda m: abs(m.amplitude[0])).damping_ratio
        assert damping.low < 0.01 < damping.high
        assert any("change along the decay" in note or "width" in note for note in found.notes)


def test_a_broad_oscillation_takes_no_mode_with_it():
    rng = np.random.default_rng(2026)
    for seed in range(6):
        y = decays([150.0, 640.0], [0.01, 0.008], [rng.uniform(0.5, 1, 2)])
        for k in (6, 12):  # a cube leaves what is no sum of a few decays, around both modes and between them
            found = modes_of(Record(noisy(y - y**3 / k, 50, np.random.default_rng(seed))))
            hz = np.abs(np.log(found.poles)) * RATE / (2 * np.pi)
            assert all(np.abs(hz / f - 1).min() < 0.01 for f in (150, 640))


def test_what_falls_later_and_is_louder_is_no_tap():
    f, zeta, off = [180.0, 640.0], [0.012, 0.006], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        y = tapped(f, zeta, 1e-3, 8, rng)
        y[1800:2000] += 6 * rng.standard_normal(200) * np.exp(-np.arange(200) / 60)
        found = identified(noisy(y, 50, rng))
        off += scores(found, f, zeta)
        assert any("something" in note for note in found.notes)
    assert np.abs(off).max() < 4


def test_harmonics_of_a_hum_that_runs_before_are_no_modes():
    f, zeta = [180.0, 640.0], [0.012, 0.006]
    for seed in range(4):
        rng = np.random.default_rng(seed)
        y = tapped(f, zeta, 1e-3, 600, rng)
        t = np.arange(y.size) / RATE
        y += sum(a * np.sin(2 * np.pi * 50 * k * t + rng.uniform(0, 6)) for k, a in ((1, 0.05), (3, 0.004), (5, 0.003)))
        found = identified(noisy(y, 50, rng))
        hum = [m for m in found.modes if f"the mode at {m.frequency_hz.value:.5g} Hz may be hum" in str(found.notes)]
        assert [m.frequency_hz.value for m in found.modes if m not in hum] == pytest.approx(f, rel=0.01)
        assert len(hum) <= 1


def test_a_mode_that_hardly_decays_is_not_doubted_where_it_would_have_been_heard_before():
    rng = np.random.default_rng(4)
    y = np.concatenate([np.zeros((1, 400)), decays([356.5, 1406.0], [1e-5, 0.005], [[1.0, 1.0]])], axis=1)
    found = identified(noisy(y, 50, rng))
    assert [m.frequency_hz.value for m in found.modes] == pytest.approx([356.5, 1406], rel=0.01)
    assert not any("goes on" in note for note in found.notes)
