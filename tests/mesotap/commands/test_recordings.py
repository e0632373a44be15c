"""Real recordings and sessions made by other programs; skipped where they are not at hand."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from analysis.session import analyse_session
from daq.exchange import import_recording
from daq.session_file import read_session
from mesotap.commands.files import modes_of
from mesotap.configuration.config import Config

pytestmark = pytest.mark.data
CONFIG = Config()


@pytest.fixture(scope="module")
def data() -> Path:
    folder = Path(os.environ.get("MESOTAP_DATA") or Path(__file__).parents[3] / ".." / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set MESOTAP_DATA to the folder that holds them")
    return folder


@pytest.mark.parametrize(
    "method", [pytest.param("ml", marks=pytest.mark.slow), pytest.param("era", marks=pytest.mark.slow)]
)
def test_modes_of_the_bolted_beam(data, method):
    recording = import_recording(data / "brake-reuss-beam" / "HammerImpact.mat")
    assert recording.rate_hz == pytest.approx(12800.0)
    found = modes_of(recording, method)
    # frequency, Hz, and the range of damping ratios read elsewhere (mode 1 falls along the decay)
    for f, low, high in ((80.4, 0.0014, 0.0025), (297.7, 0.0008, 0.0015), (1526.8, 0.0010, 0.0014)):
        near = [m for m in found.modes if abs(m.frequency_hz.value / f - 1) < 2e-3]
        assert len(near) == 1, f
        damping = near[0].damping_ratio
        if method == "ml":
            assert low < damping.value < high
        else:  # ERA does not weigh by the noise: 5 to 15 % of damping here, and its interval reaches into the range
            assert damping.low < high
            assert low < damping.high
            assert damping.standard_error < 0.15 * damping.value


def true_modes(truth, load_set):
    """Poles of Eq. 9 with the true parameters, from its state matrix."""
    m1, m2 = 0.107, 0.108
    k1, k2, kc, cc = truth["K1"], truth["K2"], truth["kc"][load_set], truth["cc"][load_set]
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:] = [[-(k1 + kc) / m1, kc / m1, -cc / m1, cc / m1], [kc / m2, -(k2 + kc) / m2, cc / m2, -cc / m2]]
    s = np.linalg.eigvals(a)
    s = s[s.imag > 0]
    return s[np.argsort(np.abs(s))]


@pytest.mark.slow
def test_sessions_with_nothing_concealed_are_recovered(data):
    truths = json.loads((data / "concealed-practice" / "truth.json").read_text())
    inside = []
    for name in [n for n, t in truths.items() if not t["kinds"]]:
        session = read_session(data / "concealed-practice" / f"{name}.h5")
        results = analyse_session(session, CONFIG.analysis, CONFIG.calibration, CONFIG.rig.masses, CONFIG.rig.springs)
        for load in results.loads:
            contact = true_modes(truths[name], load.load_set)[1]
            expected = {
                "f2_hz": abs(contact) / 2 / math.pi,
                "zeta2": -contact.real / abs(contact),
                "contact_stiffness_n_per_m": truths[name]["kc"][load.load_set],
                "contact_damping_n_s_per_m": truths[name]["cc"][load.load_set],
            }
            for key, true in expected.items():
                estimate = getattr(load, key)
                inside.append(estimate.low <= true <= estimate.high)
                assert estimate.value == pytest.approx(true, rel=0.03)
    assert len(inside) >= 96
    assert np.mean(inside) > 0.88


@pytest.mark.slow
def test_the_contact_mode_is_found_whatever_is_concealed(data):
    truths = json.loads((data / "concealed-practice" / "truth.json").read_text())
    for name in sorted(truths)[::4]:
        session = read_session(data / "concealed-practice" / f"{name}.h5")
        results = analyse_session(session, CONFIG.analysis, CONFIG.calibration, CONFIG.rig.masses, CONFIG.rig.springs)
        for load in results.loads:
            expected = abs(true_modes(truths[name], load.load_set)[1]) / 2 / math.pi
            assert load.f2_hz.value == pytest.approx(expected, rel=0.03), (name, load.load_set)
