"""k_c and zeta_c corrected for a diagnosed effect, and the diagnosis at the end of a session."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from analysis.session import analyse_session
from analysis.settings import AnalysisSettings
from calibration.settings import CalibrationSettings
from daq.records import Session
from mesotap.answers.adoption import AdoptedModel
from mesotap.answers.correction import Correction, correct, show_correction, with_correction
from mesotap.commands import session as commands
from mesotap.configuration.config import Config, ConfigError
from mesotap.operator.people import at_terminal
from rig.settings import Masses, Springs
from tests.analysis.ring_downs import session_of, two_mass, with_law
from tests.analysis.terms import listed

GENTLE = (0.2, 0.3, 0.4, 0.5)
HERTZ = AdoptedModel("found.json", {"hertz_stiffness": {}}, (), {})


@pytest.fixture(scope="module")
def made() -> Session:
    return session_of(with_law("hertz_stiffness"), noise=0.02, ratios=GENTLE)


@pytest.fixture(scope="module")
def correction(made: Session) -> Correction:
    return correct(made, HERTZ)


def test_stiffness_at_zero_amplitude_is_that_of_the_law(correction: Correction) -> None:
    for row in correction.loads:
        true = two_mass(row.corrected.load_n).kc
        assert abs(row.corrected.stiffness.value - true) < 2 * row.corrected.stiffness.half_width
    strongest = correction.loads[-1].plain
    off = abs(strongest.stiffness.value - two_mass(strongest.load_n).kc)
    assert off > 2 * strongest.stiffness.half_width
    assert correction.chi_squared_gain > 1e3


def test_programs_find_the_corrected_values_beside_the_plain_ones(correction: Correction) -> None:
    answer = with_correction({"loads": [{"load_set": 1, "zeta2": None}, {"load_set": 9}]}, correction)
    assert answer["model"]["mechanisms"] == ["hertz_stiffness"]
    at_rest = answer["loads"][0]["corrected"]["at_zero_amplitude"]["contact_stiffness_n_per_m"]
    assert at_rest["low"] < two_mass(0.4).kc < at_rest["high"]
    assert answer["loads"][1]["corrected"] is None


def test_what_a_diagnosis_moved_far_is_told_with_the_corrected_values(correction: Correction) -> None:
    doubted = replace(correction, off={"m2": 15.2, "m1": 3.4})
    said = io.StringIO()
    show_correction(doubted, Console(file=said, width=200))
    (note,) = with_correction({"loads": [], "notes": []}, doubted)["notes"]
    assert "moved m2 by 15 and m1 by 3 declared uncertainties" in note
    assert note in said.getvalue()
    assert with_correction({"loads": [], "notes": []}, correction)["notes"] == []


def test_a_model_that_cannot_be_is_refused(made: Session) -> None:
    with pytest.raises(ConfigError, match=r"bad\.json: unknown mechanism 'magnetism'"):
        correct(made, AdoptedModel("bad.json", {"magnetism": {}}, (), {}))


def ended(session: Session, folder: Path, config: Config) -> str:
    session = replace(session, source=str(folder / session.source))
    Path(session.source).touch()
    results = analyse_session(
        session, AnalysisSettings(), CalibrationSettings(), Masses(), Springs(system_resonance_hz=356.0)
    )
    said = io.StringIO()
    people = at_terminal(Console(file=said, width=200))
    commands._diagnose(session, results, config, folder, people)
    return said.getvalue()


@pytest.mark.slow
def test_a_session_is_diagnosed_at_its_end(tmp_path: Path, monkeypatch) -> None:
    few = {name: (listed(name),) for name in ("hertz_stiffness", "channel_gain")}
    monkeypatch.setattr("mesotap.commands.diagnose.known_mechanisms", lambda folders: few)
    wanted = Config.model_validate({"mesotap": {"diagnose": True}})
    said = ended(session_of(with_law(), ratios=GENTLE), tmp_path, wanted)
    assert json.loads((tmp_path / "diagnosis.json").read_text())["verdict"] == "consistent"
    assert "nothing is left beyond noise" in (tmp_path / "diagnosis.html").read_text()
    assert "diagnosis.html" in said


def test_a_session_that_cannot_be_diagnosed_stays_what_it_is(made: Session, tmp_path: Path) -> None:
    few = Session(made.created, made.rig, made.impacts[:2], source="few.h5")
    said = ended(few, tmp_path, Config.model_validate({"mesotap": {"diagnose": True}}))
    assert re.search(r"no diagnosis: \S+few\.h5: a diagnosis needs at least four accepted impacts", said)
    assert [f.name for f in tmp_path.iterdir()] == ["few.h5"]


def test_it_is_diagnosed_only_where_the_configuration_says_so(made: Session, tmp_path: Path) -> None:
    assert ended(made, tmp_path, Config()) == ""
