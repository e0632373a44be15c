"""A preloaded contact whose bodies the rig file names in the other order than sensors count; by SciPy's integrator."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.otherwise import _alike_both_ways
from daq.exchange import Recording
from mesotap.answers.diagnosis_text import verdict_sentence
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, family, variants
from sim_backend.mechanisms.kinds import AtRest, ForceLaw, Scale
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input

RATE, SAMPLES = 2000.0, 4000
MASS, PRELOAD, PRESSED, DAMPING = 0.4, 20.0, 1e-4, 14.0  # kg, N, m under the preload, N s/m


def described(between: str) -> str:
    return (
        f"bodies: {{ball: {MASS}}}\n"
        f"contacts: [{{name: pair, between: {between}, preload: {PRELOAD}, stiffness: unknown, damping: unknown}}]\n"
        "inputs: [{channel: u, force_on: ball}]\nsensors: [{channel: x, of: ball, shows: displacement, unit: m}]\n"
    )


def pressed(loud: float) -> Recording:
    """Return the motion of a ball, away from what it is pressed against, under a Hertzian contact."""
    u = loud * noise_input(SAMPLES, RATE, 2, 200, seed=3)
    u *= np.clip(np.arange(SAMPLES) / 100, 0, 1)

    def rest(force: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        contact = PRELOAD * (np.maximum(1 - x / PRESSED, 0) ** 1.5 - 1)
        return np.asarray((force + contact - DAMPING * v) / MASS)

    x = motion(rest, [0.0, 0.0], SAMPLES, RATE, u)[0]
    x = x + 1e-3 * x.std() * np.random.default_rng(4).normal(size=SAMPLES)
    return Recording(np.stack([u, x]), RATE, ("u", "x"), "", "pressed")


@pytest.mark.slow
@pytest.mark.parametrize("loud", [0.3, 2.0])  # N rms: of 0.3 N a quadratic and a cubic spring leave nothing either
def test_the_answer_says_that_the_bodies_of_a_contact_are_named_in_the_other_order(loud: float) -> None:
    answer = diagnose_recordings([pressed(loud)], parse_rig(described("[ball, ground]")), variants(catalogue())).answer
    assert answer.verdict == "unexplained"
    assert answer.location is not None
    assert answer.location.element == "pair"
    assert "names the bodies of the pair in the other order: it is hertz stiffness there" in answer.location.why
    assert answer.next_experiment is None
    assert "the bodies of the pair in the other order" in verdict_sentence(answer)


@pytest.mark.slow
def test_named_in_the_right_order_it_is_hertz() -> None:
    answer = diagnose_recordings([pressed(2.0)], parse_rig(described("[ground, ball]")), variants(catalogue())).answer
    assert [m.id for m in answer.mechanisms] == ["hertz_stiffness"]
    assert answer.remainder.p_value > 0.01


@pytest.mark.parametrize(
    ("name", "alike"), [("quadratic_damping", True), ("hertz_stiffness", False), ("contact_loss", False)]
)
def test_a_law_that_is_alike_both_ways_does_not_hang_by_the_order_of_the_bodies(name: str, alike: bool) -> None:
    """Drag in a contact, which slow noise hid, was told to need the bodies in the other order."""
    law = next(m for m in family(name) if isinstance(m, ForceLaw) and m.preloaded)
    scale = Scale(deformation=1e-5, rate=1e-2, static=PRESSED, force=2.0, frequency_hz=(50.0, 100.0))
    term = Term(law, law.trials(scale)[0], (0,))
    assert _alike_both_ways(term, AtRest(PRELOAD, 1.5 * PRELOAD / PRESSED, DAMPING)) is alike
