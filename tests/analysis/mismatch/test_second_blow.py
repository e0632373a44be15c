"""When a tap struck, and what a second blow adds: against closed forms of one mode under half a sine."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.mismatch.baseline import Sensitivity
from analysis.mismatch.linear import LinearRig
from analysis.mismatch.model import BEYOND, Model, Variant, rung, struck_again
from analysis.mismatch.problem import Term
from analysis.mismatch.records import Record
from sim_backend.mechanisms.mechanism import mechanisms
from sim_backend.modal_march import MEMORY, SLOTS, march, no_law, step_weights

RATE = 25e3
PULSE_S = 0.31e-3
POLE = -400.0 + 2j * np.pi * 2900.0
DRIVE = 0.7 - 0.2j


def response(t: np.ndarray) -> np.ndarray:
    """Twice the real part of a mode under half a sine from 0 to PULSE_S, from rest."""
    w = np.pi / PULSE_S
    inside = np.clip(t, 0.0, PULSE_S)
    driven = (w * np.exp(POLE * inside) - w * np.cos(w * inside) - POLE * np.sin(w * inside)) / (POLE**2 + w**2)
    return 2 * (DRIVE * driven * np.exp(POLE * np.maximum(t - PULSE_S, 0.0))).real * (t > 0)


def ended() -> complex:
    """Amplitude of the mode at the end of the pulse."""
    w = np.pi / PULSE_S
    return DRIVE * w * (np.exp(POLE * PULSE_S) + 1) / (POLE**2 + w**2)


@pytest.mark.parametrize("delay", [60.0, 61.37, 75.5])
def test_a_second_blow_is_the_first_one_again_while_it_acts_and_after(delay: float) -> None:
    start, n = 13, 400
    t = np.arange(n) / RATE
    pulse = response((np.arange(-5, start)) / RATE)[None]
    start_s = start / RATE
    record = Record("", response(start_s + t)[None], np.zeros((1, n)), start_s, 0, 0.1, 0, 0, pulse)
    record = replace(record, second=delay - record.since_tap_s * RATE)
    rig = SimpleNamespace(poles=np.array([POLE]), weight=np.array([2.0]), filtered=np.array([[1.0 + 0j]]))
    amplitude = np.array([ended() * np.exp(POLE * (start_s - PULSE_S))])
    found = struck_again(SimpleNamespace(rig=rig), amplitude, record, RATE)[0]  # type: ignore[arg-type]
    expected = response(start_s + t - delay / RATE)
    rings = start_s + t - delay / RATE >= start_s
    assert np.allclose(found[rings], expected[rings], rtol=0, atol=1e-12 * np.abs(expected).max())
    assert np.abs(found - expected).max() < 0.03 * np.abs(expected).max()  # the pulse has a corner at either end


@pytest.mark.parametrize("struck_s", [-0.2e-3, 0.05e-3, 0.1e-3, 0.45e-3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_phase_of_the_lowest_mode_tells_when_the_tap_struck(struck_s: float, sign: float) -> None:
    slow = -8.0 + 2j * np.pi * 330.0
    one = np.ones((1, 1), np.complex128)
    rig = LinearRig(np.array([slow]), one, one, np.array([DRIVE]), one, one, one, np.ones((1, 1)), np.array([2.0]))
    none = np.zeros((0, 1), np.complex128)
    record = Record("", np.zeros((1, 1)), np.zeros((1, 1)), 0.9e-3, 0, 0.1, 0)
    amplitude = np.array([sign * 3.1 * DRIVE * np.exp(slow * (record.start_s - struck_s))])
    found = Sensitivity(rig, none, none[:, None], none).since_tap(amplitude, record)
    assert record.start_s - found == pytest.approx(struck_s, abs=1e-12)


def test_a_tap_is_not_looked_for_far_from_the_trigger() -> None:
    slow = 2j * np.pi * 330.0
    one = np.ones((1, 1), np.complex128)
    rig = LinearRig(np.array([slow]), one, one, np.array([1.0 + 0j]), one, one, one, np.ones((1, 1)), np.array([2.0]))
    none = np.zeros((0, 1), np.complex128)
    record = Record("", np.zeros((1, 1)), np.zeros((1, 1)), 0.9e-3, 0, 0.1, 0)
    amplitude = np.array([np.exp(slow * (record.start_s - 0.8e-3))])
    assert record.start_s - Sensitivity(rig, none, none[:, None], none).since_tap(amplitude, record) == pytest.approx(
        0.5e-3
    )


def test_a_law_feels_a_second_blow_as_if_the_rig_had_been_struck_anew() -> None:
    h, steps, at = 1 / RATE / 4, 900, 317
    poles = np.array([POLE, -8.0 + 2j * np.pi * 330.0])
    seen = np.array([[0.3 - 2.0j, 0.1 - 0.7j]]) * 1e-4
    begun, blow = np.array([1.0 + 0.2j, -0.4j]), np.array([0.3j, 0.2 + 0.1j])
    creep = mechanisms()["contact_creep"].law  # its force is proportional to the deformation: motions add up
    row = np.array([1.0, 2e6, 10.0, h, 0.2, 5e-3])

    def forces(start: np.ndarray, t0: float, count: int, struck: int) -> np.ndarray:
        return march(
            (creep, *[no_law] * (SLOTS - 1)), np.array([0, -1, -1, -1]), np.tile(row, (1, SLOTS, 1)), seen[None],
            (seen * poles)[None], (1e-3 * np.conj(seen))[None], step_weights(poles, h)[None], start[None],
            np.array([2.0, 2.0]), np.array([t0]), h, count, np.zeros((SLOTS, MEMORY)), np.array([struck]), blow[None],
        )[0, 0]  # fmt: skip

    both = forces(begun, 0.0, steps, at)
    apart = forces(begun, 0.0, steps, -1)
    apart[at:] += forces(blow, at * h, steps - at, -1)
    assert np.abs(both - apart).max() < 1e-3 * np.abs(apart[at:]).max()
    assert np.abs(both - forces(begun, 0.0, steps, -1)).max() > 0.05 * np.abs(both).max()


@pytest.mark.parametrize("delay", [-1.6, -0.587, 0.3, 2.4])
def test_a_delayed_channel_is_right_to_the_ends_of_the_record(delay: float) -> None:
    n, poles = 300, np.array([POLE, -8.0 + 2j * np.pi * 330.0])
    amplitudes = np.array([1.0 - 0.3j, 0.5j])
    rig = SimpleNamespace(poles=poles, weight=np.array([2.0, 2.0]), filtered=np.array([[1.0, 0.2], [0.9, -0.4j]]))
    to = SimpleNamespace(rig=rig)
    record = Record("", np.zeros((2, n)), np.zeros((2, n)), 0.0, 0, 0.1, 0)
    term = Term(mechanisms()["channel_skew"], {"delay_of_b_samples": delay})
    added = np.zeros((2, n))
    model = SimpleNamespace(rate=RATE, _seen=lambda term, record, clean: dict(term.values))
    Model._struck_and_distorted(model, added, record, Variant((term,), amplitudes, {}, to))  # type: ignore[arg-type]
    earlier = rung(to, amplitudes * np.exp(-delay / RATE * poles), 1 / RATE, n)  # type: ignore[arg-type]
    expected = (earlier - rung(to, amplitudes, 1 / RATE, n))[1]  # type: ignore[arg-type]
    assert abs(delay) < BEYOND
    assert np.abs(added[1] - expected).max() < 1e-4 * np.abs(expected).max()
    assert not added[0].any()
