"""Scans, figures and published gaps from the command line; explanations in a session's report."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from analysis.contact.inversion import TheoryError
from analysis.results import LoadResult, SessionResults
from analysis.settings import FlatContact
from calibration.estimate import Estimate
from daq.records import RigDescription
from mesotap.answers.explanations import chance, explain, known
from mesotap.commands.theory import published_gap, surface
from tests.mesotap.test_cli import mesotap, refused

RIG = RigDescription(m1_kg=0.107, m2_kg=0.108, k1_n_per_m=538e3, k2_n_per_m=538e3)


def quiet():
    return Console(file=io.StringIO(), width=200)


@pytest.fixture
def scan(tmp_path):
    z = np.convolve(np.random.default_rng(1).standard_normal(2000), np.hanning(21), "same")
    file = tmp_path / "scan.csv"
    file.write_text("x_um,z_nm\n" + "\n".join(f"{0.5 * i},{100 * h:.4f}" for i, h in enumerate(z)))
    return file


def session(stiffness, zeta):
    loads = tuple(
        LoadResult(
            i, P, Estimate(P, 0.2), 8, None, None, None, Estimate(z, 0.01 * z, 7),
            Estimate(k, 0.002 * k, 7), None, None, None, None,
        )
        for i, (P, k, z) in enumerate(zip((265.0, 430.0, 550.0, 790.0, 930.0), stiffness, zeta, strict=True))
    )  # fmt: skip
    return SessionResults("s", "ml", loads, (), None, (Estimate(538e3, 1e3), Estimate(538e3, 1e3)))


def test_surface_of_two_scans(scan, tmp_path):
    answer = json.loads(mesotap("surface", scan, scan, "--json", "-").stdout)
    assert answer["format"] == "mesotap-surface"
    one, both = answer["scans"][0], answer["together"]
    assert both["m0_m2"]["value"] == pytest.approx(2 * one["m0_m2"]["value"])
    assert one["roughness_rq_m"]["low"] < one["roughness_rq_m"]["value"] < one["roughness_rq_m"]["high"]


def test_surface_says_what_is_wrong(tmp_path):
    (tmp_path / "bad.csv").write_text("x_um,z_nm\n1,2\n2,tall\n")
    assert "line 3" in refused("surface", tmp_path / "bad.csv")
    assert "unit" in refused("surface", tmp_path / "bad.csv", "--unit", "ell")


def test_surface_of_a_scan_table(scan):
    console = quiet()
    surface([scan], None, None, 2, None, console)
    assert "R_q, nm" in console.file.getvalue()


@pytest.mark.slow
@pytest.mark.parametrize("which", ["flat", "sphere"])
def test_published_gap_is_written(which, tmp_path):
    console = quiet()
    published_gap(which, tmp_path / "gap.json", tmp_path / "page", console)
    answer = json.loads((tmp_path / "gap.json").read_text())
    assert sum(e["probability"] for e in answer["explanations"]) == pytest.approx(1)
    assert "series compliance" in console.file.getvalue()
    page = (tmp_path / "page" / "report.html").read_text()
    assert "<svg" in page
    assert all(sentence.split(" (")[0].split("%")[0] in page for sentence in answer["sentences"][:1])


def test_published_gap_of_nothing(tmp_path):
    with pytest.raises(TheoryError, match="flat and sphere"):
        published_gap("cube", None, None, quiet())


@pytest.mark.long
def test_figures_of_the_paper(tmp_path):
    mesotap("figures", "-o", tmp_path / "f", "--json", tmp_path / "quoted.json")
    assert {p.stem for p in (tmp_path / "f").glob("*.svg")} == {
        "fig3",
        "fig5",
        "fig6a",
        "fig6b",
        "fig7",
        "fig8",
        "fig9",
    }
    numbers = json.loads((tmp_path / "quoted.json").read_text())["numbers"]
    assert [n["verdict"] for n in numbers if n["quoted"] == 58.9] == ["rounded"]
    assert "58.9" in (tmp_path / "f" / "figures.html").read_text()


@pytest.mark.slow
def test_explanations_of_a_session_find_its_damper():
    k = np.array([4e6, 7e6, 8e6, 9.5e6, 10.3e6])
    explained = explain(session(k, 3.0 / (2 * np.sqrt(k * 0.107 * 0.108 / 0.215))), FlatContact(), RIG)
    assert explained is not None
    assert explained.damping[0].candidate.id == "viscous"
    assert json.dumps(explained.as_json(), allow_nan=False)
    assert any("still misses" in sentence for sentence in explained.sentences)
    assert len(explained.lists) == 4
    assert any("under 4 lists of explanations" in sentence for sentence in explained.sentences)


@pytest.mark.slow
def test_unknown_damping_leaves_stiffness():
    results = session(np.array([4e6, 7e6, 8e6, 9.5e6, 10.3e6]), np.full(5, 0.01))
    loads = (replace(results.loads[0], zeta2=None), *results.loads[1:])
    explained = explain(replace(results, loads=loads), FlatContact(), RIG)
    assert explained is not None
    assert explained.stiffness
    assert explained.damping == ()


def test_three_loads_explain_nothing():
    results = session(np.array([4e6, 7e6, 8e6, 9.5e6, 10.3e6]), np.full(5, 0.01))
    assert explain(replace(results, loads=results.loads[:3]), FlatContact(), RIG) is None


@pytest.mark.slow
def test_words_for_parameters_and_probabilities():
    k = np.array([4e6, 7e6, 8e6, 9.5e6, 10.3e6])
    explained = explain(session(k, np.full(5, 0.01)), FlatContact(), RIG)
    assert explained is not None
    assert "MN/m" in " ".join(known(p) for w in explained.stiffness for p in w.parameters)
    assert chance(explained.stiffness[-1]) == "< 0.1"
