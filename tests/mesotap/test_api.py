"""The face for programs: what `import mesotap` gives."""

from __future__ import annotations

import doctest
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mesotap
from daq.session_file import write_session
from mesotap import api
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.ring_downs import session_of, with_law


@pytest.fixture(scope="module")
def session() -> mesotap.Session:
    return mesotap.simulate(load_mn=300.0, seed=5)


@pytest.mark.parametrize("module", [mesotap, api])
def test_the_examples_hold(module) -> None:
    failed, tried = doctest.testmod(module)
    assert tried > 1
    assert failed == 0


def test_every_name_can_be_imported_and_is_documented() -> None:
    assert set(api.__all__) | {"__version__"} == set(mesotap.__all__)
    for name in api.__all__:
        assert getattr(mesotap, name).__doc__
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        mesotap.nothing  # noqa: B018


def test_importing_it_imports_nothing_heavy() -> None:
    heavy = "import mesotap, sys; print(sorted({'numpy', 'scipy', 'numba', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


WRAPPING = """
import os, sys
os.environ.pop("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", None)
import colorama, colorama.initialise
wrapped = []
colorama.init = colorama.initialise.init = lambda *more, **settings: wrapped.append(1)
import mesotap
mesotap.simulate(load_mn=500.0, seed=1)
print(len(wrapped))
"""


def test_standard_output_is_left_as_it_is() -> None:
    pytest.importorskip("colorama")  # with it numba wraps sys.stdout for each message that it marks
    done = subprocess.run([sys.executable, "-c", WRAPPING], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"


@pytest.mark.parametrize("kind", [str, Path])
def test_a_path_is_a_text_or_a_path(kind, session: mesotap.Session, tmp_path: Path) -> None:
    file = tmp_path / "one.h5"
    write_session(file, session)
    assert np.array_equal(mesotap.read_session(kind(file)).impacts[0].acceleration, session.impacts[0].acceleration)


def test_a_recording_of_another_program_is_no_session(tmp_path: Path) -> None:
    file = tmp_path / "decay.csv"
    t = np.arange(500) / 1e3
    np.savetxt(file, np.stack([t, np.exp(-5 * t) * np.sin(300 * t)], axis=1), delimiter=",", header="t [s],a [m/s2]")
    with pytest.raises(mesotap.MesotapError, match="no session"):
        mesotap.read_session(file)


def test_the_modes_of_a_session_are_those_of_what_was_simulated(session: mesotap.Session) -> None:
    (load,) = mesotap.identify(session).loads
    rig = session.rig
    k_c = mesotap.contact_stiffness(
        load.f2_hz.value,
        load.zeta2.value,
        m1_kg=rig.m1_kg,
        m2_kg=rig.m2_kg,
        k1_n_per_m=rig.k1_n_per_m,
        k2_n_per_m=rig.k2_n_per_m,
    )
    # springs of the session are measured by its system mode, those of the header declared: parts in a thousand
    assert float(k_c) == pytest.approx(load.contact_stiffness_n_per_m.value, rel=3e-3)


def test_samples_need_their_rate_and_a_session_has_its_own(session: mesotap.Session) -> None:
    with pytest.raises(TypeError, match="sample_rate_hz"):
        mesotap.identify(np.zeros(100))
    with pytest.raises(TypeError, match="knows its own"):
        mesotap.identify(session, 25e3)


def test_the_table_and_the_array_hold_the_records(session: mesotap.Session) -> None:
    table, array = session.to_pandas(), session.to_xarray()
    (impact,) = session.impacts
    assert table.loc[0, "peak_m_s2"] == np.abs(impact.acceleration).max()
    assert np.array_equal(array.acceleration.sel(channel="B").values[0], impact.acceleration[1])
    assert array.time_s.values[0, impact.pretrigger] == 0.0


def test_a_diagnosis_takes_what_is_in_memory() -> None:
    few = ("quadratic_damping", "tube_spring_cubic")
    answer = mesotap.diagnose(session_of(with_law()), without=[name for name in catalogue() if name not in few])
    assert answer.verdict == "consistent"
    assert {limit.id for limit in answer.upper_limits} == set(few)
    with pytest.raises(TypeError, match="name a session"):
        mesotap.diagnose()


def test_what_a_person_can_mend_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(mesotap.MesotapError, match=r"nowhere\.h5"):
        mesotap.read_session(tmp_path / "nowhere.h5")
    with pytest.raises(mesotap.MesotapError, match="not above the system resonance"):
        mesotap.contact_stiffness(300.0, m1_kg=0.107, m2_kg=0.108, k1_n_per_m=5.379e5, k2_n_per_m=5.379e5)


DECAY = np.exp(-20 * np.arange(2000) / 1e4) * np.sin(2 * np.pi * 300 * np.arange(2000) / 1e4)
RIG = {"m1_kg": 0.107, "m2_kg": 0.108, "k1_n_per_m": 5.379e5, "k2_n_per_m": 5.379e5}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: mesotap.theory(500, "bogus"), "there is no contact 'bogus'; give 'paper-flat' or 'paper-sphere'"),
        (lambda: mesotap.theory(np.nan), "a load is not finite"),
        (lambda: mesotap.theory(-5), "carry no negative load"),
        (lambda: mesotap.theory("x"), "no array of numbers"),
        (lambda: mesotap.identify(np.where(np.arange(2000) == 17, np.nan, DECAY), 1e4), "sample 17 of channel 0, nan"),
        (lambda: mesotap.identify(np.where(np.arange(2000) > 1990, np.inf, [DECAY] * 2), 1e4), "18 of 4000 samples"),
        (lambda: mesotap.identify(np.zeros((2, 3, 500)), 1e4), r"shape \(2, 3, 500\) are no free decay"),
        (lambda: mesotap.identify([], 1e4), "are no free decay"),
        (lambda: mesotap.identify(["a"], 1e4), "no array of numbers"),
        (lambda: mesotap.identify(DECAY, -1.0), "a sampling rate of -1.0 Hz"),
        (lambda: mesotap.identify(DECAY, np.nan), "a sampling rate of nan Hz"),
        (lambda: mesotap.identify(DECAY, 1e4, method="bogus"), "there is no method 'bogus'"),
        (lambda: mesotap.simulate(-5), r"load_mn is -5; it lies above 0 and up to 1100 mN"),
        (lambda: mesotap.simulate(1e9), r"load_mn is 1e\+09; it lies above 0"),
        (lambda: mesotap.simulate(1099.9), "load_mn=1099.9 cannot be set on this rig: "),
        (lambda: mesotap.simulate(seed=-1), "seed is -1"),
    ],
)
def test_what_is_wrong_is_said_and_names_no_option_of_the_command_line(wrong, said: str) -> None:
    with pytest.raises(mesotap.MesotapError, match=said) as told:
        wrong()
    assert "--" not in str(told.value)


def test_of_single_values_there_are_floats() -> None:
    one, several = mesotap.theory(500.0), mesotap.theory([500.0])
    assert {name: type(k) for name, k in one.items()} == dict.fromkeys(several, float)
    assert one == {name: k[0] for name, k in several.items()}
    assert type(mesotap.contact_stiffness(1409.0, **RIG)) is float
    assert mesotap.contact_stiffness([1409.0, 1500.0], [[0.01], [0.02]], **RIG).shape == (2, 2)


def test_a_simulated_tap_may_be_rejected_and_then_has_no_estimates() -> None:
    tapped = mesotap.simulate(500, seed=3)
    assert (tapped.impacts[0].accepted, "tap more gently" in tapped.impacts[0].reject_reason) == (False, True)
    load = mesotap.identify(tapped).loads[0]
    assert (load.f2_hz, "no accepted impact at this load" in load.notes) == (None, True)
    assert "may be rejected" in str(mesotap.simulate.__doc__)
