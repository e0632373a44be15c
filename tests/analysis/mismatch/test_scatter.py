"""A contact that is not quite the same at every impact: no missing physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch import diagnosis
from analysis.mismatch.colour import noise_colour
from analysis.mismatch.contest import LEVEL, begin_contest
from sim_backend.contact_laws import ContactLaw
from sim_backend.mechanisms.mechanism import mechanisms
from tests.analysis.ring_downs import exact, session_of

KNOWN = [mechanisms()[name] for name in ("hertz_stiffness", "contact_creep", "tube_spring_damping")]


def test_scatter_between_impacts_is_no_missing_physics() -> None:
    rng = np.random.default_rng(5)

    def record(rig, load_n, pulse) -> np.ndarray:
        own = replace(rig, kc=rig.kc * (1 + 1e-3 * rng.standard_normal()))
        found = exact(own, load_n, pulse, ContactLaw("linear", load_n))
        return np.stack([found.acceleration, found.acceleration])

    session = session_of(record, ratios=(0.3, 0.3, 0.3, 0.3, 0.3, 0.3))
    problem = diagnosis.tester_problem(session)
    assert begin_contest(problem, KNOWN).p_value < LEVEL
    assert diagnosis.diagnose_session(session, KNOWN).verdict == "consistent"


def test_noise_below_the_recorders_step_is_told() -> None:
    rng = np.random.default_rng(1)
    step = 1e-3
    quiet = [np.round(0.1 * step * rng.standard_normal((2, 240)) / step) * step for _ in range(8)]
    with pytest.raises(ValueError, match=r"smaller than the recorder's step of 0\.001"):
        noise_colour(quiet, [q[0] - q[1] for q in quiet], 25e3, step)
