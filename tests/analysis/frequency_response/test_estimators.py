"""H1, H2, Hv and coherence against SciPy's, and the receptance of two masses against its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from analysis.frequency_response.estimators import ForceError, excited_up_to, random_error
from analysis.frequency_response.hits import Hit
from analysis.frequency_response.impacts import HitRecord, of_hits, of_recording
from analysis.frequency_response.windows import LEAD_SAMPLES, BandPass, gated
from tests.analysis.frequency_response.hits_of_two import RATE, hits, receptance

KC, CC = 8.0e6, 2.3


def _noisy(rng: np.random.Generator, count: int = 5, n: int = 600) -> list[HitRecord]:
    sections = signal.butter(2, [0.1, 0.2], "bandpass", output="sos")
    records = []
    for number in range(count):
        force = np.zeros(n)
        force[40:52] = (1 + 0.1 * number) * np.sin(np.pi * (np.arange(12) + 0.5) / 12)
        response = signal.sosfilt(sections, force) + 0.01 * rng.standard_normal(n)
        records.append(HitRecord(force + 0.005 * rng.standard_normal(n), response[None], f"hit {number}"))
    return records


def test_estimators_are_those_of_scipy_on_the_same_stretches() -> None:
    records = _noisy(np.random.default_rng(3))
    found = of_hits(records, 1000.0, ["x"], windows=False).response
    hits_at = [int(np.argmax(r.force > 0.1 * r.force.max())) for r in records]
    starts = [at - LEAD_SAMPLES for at in hits_at]
    length = min(r.force.size - start for r, start in zip(records, starts, strict=True))
    f = np.concatenate([r.force[s : s + length] for r, s in zip(records, starts, strict=True)])
    x = np.concatenate([r.response[0, s : s + length] for r, s in zip(records, starts, strict=True)])
    how = {"fs": 1000.0, "window": "boxcar", "nperseg": length, "noverlap": 0, "detrend": False}
    cross, ff, xx = signal.csd(f, x, **how)[1], signal.csd(f, f, **how)[1].real, signal.csd(x, x, **how)[1].real
    assert found.frequency_hz == pytest.approx(signal.csd(f, x, **how)[0][1:])
    assert found.h1[0] == pytest.approx((cross / ff)[1:], rel=1e-9)
    assert found.h2[0] == pytest.approx((xx / cross.conj())[1:], rel=1e-9)
    assert np.abs(found.hv[0]) ** 2 == pytest.approx((xx / ff)[1:], rel=1e-9)
    assert found.coherence[0] == pytest.approx(signal.coherence(f, x, **how)[1][1:], rel=1e-9)


def test_a_lasting_force_gives_what_scipy_gives_with_hann_windows() -> None:
    rng = np.random.default_rng(4)
    force = rng.standard_normal(4000)
    response = signal.sosfilt(signal.butter(2, 0.2, output="sos"), force) + 0.1 * rng.standard_normal(4000)
    found = of_recording(force, response[None], 1000.0, ["x"], "m/s2/N", segment_s=0.5)
    how = {"fs": 1000.0, "window": "hann", "nperseg": 500, "noverlap": 250, "detrend": "constant"}
    assert found.window.startswith("Hann")
    assert found.h1[0] == pytest.approx((signal.csd(force, response, **how)[1] / signal.welch(force, **how)[1])[1:])
    assert found.coherence[0] == pytest.approx(signal.coherence(force, response, **how)[1][1:])
    # root of the power spectral density; SciPy counts the last line once
    assert found.force_spectrum[:-1] ** 2 == pytest.approx(signal.welch(force, **how)[1][1:-1])


def test_h1_is_the_accelerance_of_two_masses() -> None:
    records = hits(np.random.default_rng(1), KC, CC, noise=0.0, force_noise=0.0, seen=(0, 1))
    found = of_hits(records, RATE, ["upper", "lower"]).response
    used = (found.frequency_hz > 60) & (found.frequency_hz < found.force_limit_hz)
    s = 2j * np.pi * found.frequency_hz[used] + found.decay_per_s
    for row in (0, 1):
        closed = s**2 * receptance(s, 0.107, 0.108, KC, CC, seen=row, c=4.0)
        assert np.abs(found.h1[row][used] - closed).max() < 3e-3 * np.abs(closed).max()
        assert np.median(np.abs(found.h1[row][used] / closed - 1)) < 2e-3


def test_the_force_spectrum_is_that_of_a_half_sine() -> None:
    records = hits(np.random.default_rng(2), KC, CC, count=1, noise=0.0, force_noise=0.0)
    found = of_hits(records, RATE, ["lower"]).response
    duration, f = 3e-4, found.frequency_hz
    closed = np.abs(np.cos(np.pi * f * duration) / (1 - (2 * f * duration) ** 2))
    used = f < 4000
    assert found.force_spectrum[used] / found.force_spectrum[0] == pytest.approx(closed[used], abs=0.01)
    at = f[np.argmax(closed < 0.1)]
    assert found.force_limit_hz == pytest.approx(at, rel=0.01)


def test_the_random_error_is_the_scatter_of_h1() -> None:
    """4000 averages of 8 stretches: the coherence of all of them foretells the scatter of each."""
    rng = np.random.default_rng(5)
    force = rng.standard_normal((4000, 8)) + 1j * rng.standard_normal((4000, 8))
    response = 2 * force + 0.6 * (rng.standard_normal((4000, 8)) + 1j * rng.standard_normal((4000, 8)))
    h1 = (force.conj() * response).sum(1) / (np.abs(force) ** 2).sum(1)
    coherence = 4 / (4 + 0.36)
    foretold = float(random_error(np.array(coherence), 8))
    # Eq. 9.90 is of first order: the mean of 1 / |F|^2 over 8 stretches is 8 / 7 of 1 over its mean
    assert np.abs(h1).std() / 2 == pytest.approx(foretold * math.sqrt(8 / 7), rel=0.05)
    assert np.angle(h1).std() == pytest.approx(foretold * math.sqrt(8 / 7), rel=0.05)


def test_one_average_has_no_random_error() -> None:
    found = of_hits(_noisy(np.random.default_rng(3), count=1), 1000.0, ["x"]).response
    assert np.isnan(found.random_error).all()
    assert np.isnan(found.interval()[0]).all()


@pytest.mark.parametrize("order", [1, 2])
def test_a_high_pass_ahead_of_the_recorder_is_taken_out(order: int) -> None:
    """The pulse that an analog high-pass of 10 Hz made is the pulse again."""
    t = np.arange(400) / RATE
    pulse = np.where((t > 0.004) & (t < 0.0043), np.sin(np.pi * (t - 0.004) / 3e-4), 0.0)
    b, a = signal.butter(order, 2 * np.pi * 10, "highpass", analog=True)
    passed = signal.lsim((b, a), pulse, t)[1]
    at = np.flatnonzero(pulse > 0.1)
    back = gated(passed, Hit(int(at[0]), int(at[-1]), 1.0), RATE, BandPass(10.0, order))
    assert np.abs(passed - pulse).max() > 5e-3  # what it had done
    assert back == pytest.approx(pulse, abs=5e-4)


def test_a_spectrum_that_never_falls_excites_to_its_end() -> None:
    f = np.arange(1.0, 11.0)
    assert excited_up_to(f, np.ones(10)) == 10.0
    assert excited_up_to(f, np.zeros(10)) == 0.0
    assert excited_up_to(f, np.r_[np.ones(5), np.full(5, 0.09)]) == 6.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"window": "hamming"}, "is not known"),
        ({"segment_s": 1e-5}, "fewer than 64"),
        ({"segment_s": math.nan}, "fewer than 64"),
    ],
)
def test_what_cannot_be_done_is_said(arguments: dict, said: str) -> None:
    record = _noisy(np.random.default_rng(3), count=1)[0]
    with pytest.raises(ForceError, match=said):
        of_recording(record.force, record.response, 1000.0, ["x"], "m/s2/N", **arguments)


def test_arrays_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ForceError, match="are no"):
        of_recording(np.ones(100), np.ones((1, 99)), 1000.0, ["x"], "m/s2/N")
    with pytest.raises(ForceError, match="not a number"):
        of_recording(np.ones(100), np.full((1, 100), np.nan), 1000.0, ["x"], "m/s2/N")
