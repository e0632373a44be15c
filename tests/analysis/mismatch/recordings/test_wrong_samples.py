"""Samples that are wrong by themselves, against errors put into motions in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal, stats
from scipy.linalg import expm

from analysis.mismatch.answer import Answer
from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.held_out import _as_many_normal
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.outliers import Outlier, by_themselves, put_right_before_thinning
from analysis.mismatch.recordings.recorded import WrongSample, prepare
from analysis.mismatch.recordings.wrong_samples import _taken_out, set_aside, without_wrong_samples
from daq.exchange import Recording
from mesotap.answers.diagnosis_json import diagnosis_json
from mesotap.answers.diagnosis_text import verdict_sentence
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import motion
from tests.analysis.terms import listed

Real = NDArray[np.float64]
RATE, SAMPLES, NOISE = 400.0, 1600, 5e-3
MASSES = np.array([0.7, 0.4])
STIFF = np.array([[5200.0, -2100.0], [-2100.0, 2100.0]])
LOSS = np.array([[1.5, -0.6], [-0.6, 0.6]])
SLOPES = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFF / MASSES[:, None], -LOSS / MASSES[:, None]]])
RIG = parse_rig(
    "bodies: {a: 0.7, b: 0.4}\n"
    "springs:\n  - {between: [a, ground], stiffness: unknown, damping: unknown}\n"
    "  - {between: [a, b], stiffness: unknown, damping: unknown}\n"
    "inputs: [{channel: F, force_on: a, gain: 1}]\n"
    "sensors:\n  - {channel: a, of: a, shows: displacement}\n  - {channel: b, of: b, shows: displacement}\n"
)
KNOWN = [listed("knock"), listed("clipping"), listed("tube_spring_cubic"), listed("contact_creep")]


def driven(noise: Real, knocked: float = 0.0) -> Recording:
    """Return a multisine's response with an impulse (N s) on the second body at 2.1 s, and noise (2, n) in its rms."""
    t, lines = np.arange(SAMPLES) / RATE, np.arange(1, 25, 0.5)
    waves = np.exp(1j * (2 * np.pi * lines[:, None] * t + 2.4 * np.arange(lines.size)[:, None] ** 2))
    push = np.array([0, 0, 1 / MASSES[0], 0])
    answers = np.array([np.linalg.solve(2j * np.pi * f * np.eye(4) - SLOPES, push) for f in lines])
    states = np.real(np.einsum("lk,ln->kn", answers, waves))
    after = np.flatnonzero(t >= 2.1)
    jump = knocked / MASSES[1] * np.eye(4)[3]
    states[:, after] += np.array([expm(SLOPES * (t[i] - 2.1)) @ jump for i in after]).T
    y = states[:2] + NOISE * states[:2].std(axis=1, keepdims=True) * noise
    return Recording(np.vstack([np.real(waves).sum(axis=0), y]), RATE, ("F", "a", "b"), "", "driven.csv")


def normal(seed: int) -> Real:
    return np.random.default_rng(seed).standard_normal((2, SAMPLES))


def fitted(recording: Recording) -> SimulatedFit:
    return linear_fit(problem_of(RIG, [prepare(recording, RIG)]))


def put_right(recording: Recording) -> list[tuple[int, int]]:
    """Return channel and sample of what is put right beneath the linear rig."""
    (found,) = without_wrong_samples(fitted(recording))
    return sorted((w.channel, round(w.time_s * RATE)) for w in found.wrong)


def answer_of(recording: Recording) -> Answer:
    return diagnose_recordings([recording], RIG, KNOWN, learn=False).answer


@pytest.mark.parametrize(
    ("channel", "sample", "size"), [(0, 333, 40.0), (1, 860, -12.0), (1, 1500, 300.0), (0, 4, 25.0), (1, 1599, 25.0)]
)
def test_a_sound_rig_with_one_wrong_sample_is_consistent_and_the_sample_told(
    channel: int, sample: int, size: float
) -> None:
    noise = normal(1)
    noise[channel, sample] += size
    answer = answer_of(driven(noise))
    assert answer.verdict == "consistent"
    (said,) = answer.set_aside
    assert said.name == f"driven.csv, channel {'ab'[channel]}"
    assert f"at {sample / RATE:.6g} s" in said.statement
    assert float(said.statement.split("(")[1].split()[0]) == pytest.approx(abs(size), rel=0.2)
    assert "cannot be the rig's own motion" in verdict_sentence(answer)
    assert diagnosis_json(answer, 1.0)["set_aside"][0]["segment"] == said.name


def test_what_is_put_right_is_as_far_off_as_it_was_put_and_the_rest_stays() -> None:
    noise = normal(2)
    wrong = noise.copy()
    where = [(0, 100), (0, 701), (1, 702 + 40), (1, 1333)]
    for number, (channel, sample) in enumerate(where):
        wrong[channel, sample] += 15 + 10 * number
    recording, sound = driven(wrong), driven(noise)
    (found,) = without_wrong_samples(fitted(recording))
    assert sorted((w.channel, round(w.time_s * RATE)) for w in found.wrong) == where
    off = (found.outputs - sound.data[1:]) / (NOISE * sound.data[1:].std(axis=1, keepdims=True))
    assert np.all(np.abs(off[tuple(np.transpose(where))]) < 4)  # as the noise that stood there, and that is lost
    off[tuple(np.transpose(where))] = 0.0
    assert np.all(off == 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_heavy_tails_are_no_missing_physics(seed: int) -> None:
    noise = np.random.default_rng(seed).standard_t(3, (2, SAMPLES)) / np.sqrt(3)
    recording = driven(noise)
    told = put_right(recording)
    assert 10 < len(told) < 80  # of 3,200 about 1.1 % lie beyond five times the noise's own width
    assert answer_of(recording).verdict == "consistent"


def test_of_normal_noise_nothing_is_wrong() -> None:
    assert sum(len(put_right(driven(normal(seed)))) for seed in range(20, 32)) <= 1


def test_what_a_rig_does_is_not_put_right() -> None:
    beside, both, clipped = normal(3), normal(3), driven(normal(3))
    beside[1, 800:803] += [20.0, 25.0, 15.0]  # lasts
    both[:, 800] += 30.0  # in both channels
    assert put_right(driven(beside)) == []
    assert put_right(driven(both)) == []
    assert put_right(driven(normal(3), knocked=0.004)) == []
    top = clipped.data[2].max()
    cut = np.vstack([clipped.data[:2], np.minimum(clipped.data[2], 0.97 * top)])
    assert put_right(replace(clipped, data=cut)) == []  # where the motion is largest


def test_a_spring_that_hardens_is_no_noise_with_wrong_samples() -> None:
    spring = parse_rig("bodies: {m: 1}\nsprings: [{between: [m, ground], damping: unknown}]\n"
                       "sensors: [{channel: x, of: m, shows: acceleration}]\n")  # fmt: skip
    omega = 2 * np.pi * 12
    states = motion(lambda u, x, v: -2.0 * v - omega**2 * x - 4e9 * x**3, [1e-3, 0.0], 1600, 400.0)
    shown = -2.0 * states[1] - omega**2 * states[0] - 4e9 * states[0] ** 3
    recording = Recording((shown + 1e-3 * normal(4)[0])[None], 400.0, ("x",), "", "hardening")
    (found,) = without_wrong_samples(linear_fit(problem_of(spring, [prepare(recording, spring)])))
    assert found.wrong == ()


def test_in_slow_noise_a_wrong_sample_is_found_by_what_its_neighbours_lead_to_expect() -> None:
    """Of first-order noise the mean of both neighbours, times 2 a / (1 + a^2), is the best guess, off by its rms."""
    rng, a, found = np.random.default_rng(5), 0.9, []
    for _ in range(30):
        row = signal.lfilter([1.0], [1.0, -a], rng.standard_normal(2000))
        guess = a / (1 + a**2) * (row[899] + row[901])
        row[900] += 12.0
        wrong = row.copy()
        (one,) = _taken_out(row, np.ones(2000, np.bool_), 0, 1e-6, prepare(driven(normal(1)), RIG))
        assert one.sample == 900
        assert wrong[900] - row[900] == pytest.approx(12.0, abs=4.0)
        found.append(row[900] - guess)
    assert np.sqrt(np.mean(np.square(found))) < 0.15 / np.sqrt(1 + a**2)  # its weights are estimated


@pytest.mark.parametrize("sample", [0, 4, 15, 40, 1985, 1999])
def test_where_a_recording_begins_and_ends_a_wrong_sample_is_found_but_where_a_decay_begins(sample: int) -> None:
    row = signal.lfilter([1.0], [1.0, -0.5], np.random.default_rng(9).standard_normal(2100))[100:]
    row[sample] += 25.0
    forced, free = (replace(prepare(driven(normal(1)), RIG), inputs=np.zeros((count, SAMPLES))) for count in (1, 0))
    (one,) = _taken_out(row.copy(), np.ones(2000, np.bool_), 0, 1e-6, forced)
    assert one.sample == sample
    assert one.size == pytest.approx(25.0, abs=4.0)
    assert len(_taken_out(row.copy(), np.ones(2000, np.bool_), 0, 1e-6, free)) == (sample > 34)


def test_wrong_samples_may_come_whenever_but_not_where_motion_is_large() -> None:
    shown = driven(normal(6)).data[1:]
    anywhere = [Outlier(0, sample, 1.0, 20.0) for sample in (210, 480, 777, 1020, 1290, 1500)]
    assert by_themselves(anywhere, shown, 0.01)
    largest = np.argsort(-np.abs(shown[0] - shown[0].mean()))[:6]
    assert not by_themselves([replace(w, sample=int(s)) for w, s in zip(anywhere, largest, strict=True)], shown, 0.01)


def test_what_an_impact_shows_as_it_strikes_is_not_told_as_a_wrong_sample() -> None:
    found = fitted(driven(normal(12)))
    wrong = tuple(WrongSample(0, time_s, 20.0) for time_s in (1.0, 2.5))
    recorded = replace(found.problem.recordings[0], wrong=wrong, source="folder/driven.csv")
    found = replace(found, problem=replace(found.problem, recordings=(recorded,)))
    assert "2 samples are off" in set_aside(found)[0].statement
    assert set_aside(found)[0].name == "folder/driven.csv, channel a"
    assert set_aside(found)[0].statement.startswith("driven.csv, channel a: ")
    assert "blow" not in set_aside(found)[0].statement
    struck = replace(found, own=(replace(found.own[0], impact=np.array([2.4990, 1.0])),))
    assert "one sample is off and the next one right again, at 1 s" in set_aside(struck)[0].statement


@pytest.mark.slow
def test_a_wrong_sample_at_a_peak_is_put_right_where_no_mechanism_explains_it() -> None:
    noise = normal(13)
    noise[0, int(np.argmax(np.abs(driven(0 * noise).data[1])))] += 30.0
    answer = answer_of(driven(noise))
    assert answer.verdict == "consistent"
    assert "one sample is off" in answer.set_aside[0].statement


@pytest.mark.parametrize(("factor", "size"), [(2, 300.0), (4, 12.0), (15, 40.0)])
def test_before_a_decay_is_thinned_out_a_wrong_sample_is_put_right(factor: int, size: float) -> None:
    t = np.arange(6000) / 500
    sound = 2e-3 * np.exp(-t) * np.cos(40 * t) + 2e-6 * np.random.default_rng(10).standard_normal(t.size)
    wrong = sound.copy()
    wrong[2200] += 2e-6 * size
    right, found = put_right_before_thinning(wrong[None], factor, slice(400, 6000), 0.01)
    (one,) = found
    assert one.sample == 2200
    assert one.over_noise == pytest.approx(size, rel=0.25)
    assert np.flatnonzero(right[0] != sound).tolist() == [2200]
    assert abs(right[0, 2200] - sound[2200]) < 4 * 2e-6
    same, nothing = put_right_before_thinning(sound[None], factor, slice(400, 6000), 0.01)
    assert nothing == []
    assert np.all(same == sound)


@pytest.mark.parametrize("size", [0.0, 12.0, 300.0])
def test_a_wrong_sample_does_not_change_by_what_a_decay_is_thinned_out(size: float) -> None:
    mass = parse_rig("bodies: {m: 1}\nsprings: [{between: [m, ground], damping: unknown}]\n"
                     "sensors: [{channel: x, of: m, shows: displacement}]\n")  # fmt: skip
    t = np.arange(6000) / 500
    sound = 2e-3 * np.exp(-t) * np.cos(63.2 * t) + 1e-5 * np.random.default_rng(10).standard_normal(t.size)
    wrong = sound.copy()
    wrong[2200] += 1e-5 * size
    one, other = (prepare(Recording(row[None], 500.0, ("x",), "", "decay"), mass) for row in (sound, wrong))
    assert one.every == other.every
    assert one.start_s == other.start_s
    assert np.abs(one.outputs - other.outputs).max() < 12.1 * 1e-5  # those of 12 are left for a model to find


@pytest.mark.parametrize("second", [0.02, 0.3])
def test_before_a_decay_is_thinned_out_a_second_impact_stays(second: float) -> None:
    t = np.arange(20_400) / 6000
    late = np.maximum(t - 2.40011, 0.0)
    speed = np.exp(-t) * np.cos(92.4 * t) + second * (late > 0) * np.exp(-late) * np.cos(92.4 * late)
    rows = (speed + 1e-3 * np.random.default_rng(11).standard_normal(t.size))[None]
    right, found = put_right_before_thinning(rows, 6, slice(400, t.size), 0.01)
    assert found == []
    assert right is rows


@pytest.mark.parametrize("degrees", [9, 12, 30])
def test_power_of_noise_with_tails_scatters_as_that_of_fewer_normal_samples(degrees: int) -> None:
    kurtosis = 3 + 6 / (degrees - 4)
    noise = stats.t(degrees).rvs(400_000, random_state=np.random.default_rng(7))
    assert _as_many_normal(noise) == pytest.approx(2 / (kurtosis - 1), rel=0.07)
    assert _as_many_normal(np.sign(noise)) == 1.0


@pytest.mark.slow
def test_beneath_a_law_a_wrong_sample_is_put_right_too() -> None:
    spring = parse_rig("bodies: {m: 1}\nsprings: [{between: [m, ground], damping: unknown}]\n"
                       "sensors: [{channel: x, of: m, shows: displacement, unit: mm}]\n")  # fmt: skip
    omega, hardening = 2 * np.pi * 12, 1.5e9
    states = motion(lambda u, x, v: -1.2 * v - omega**2 * x - hardening * x**3, [1e-3, 0.0], 1600, 120.0)
    noise = np.random.default_rng(8).standard_normal(1600)
    noise[555] += 60.0
    recording = Recording((states[0] + 2e-6 * noise)[None], 120.0, ("x",), "", "hardening")
    known = [listed("tube_spring_cubic"), listed("double_hit"), listed("guide_friction")]
    answer = diagnose_recordings([recording], spring, known, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["tube_spring_cubic"]
    cubic = next(iter(answer.mechanisms[0].parameters.values()))
    assert cubic.low < hardening < cubic.high
    assert answer.remainder.p_value > 0.01
    assert len(answer.set_aside) == 1
    assert answer.location is not None
    assert "what is named explains all of it beyond noise" in answer.location.why
    assert answer.fitted is not None
    assert answer.fitted.constants["offset of sensor 1"].unit == "mm"
