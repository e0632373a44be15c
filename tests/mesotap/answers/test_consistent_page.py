"""The page of a session in which nothing is missing: every number on it is one of the answer's or the session's."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from html.parser import HTMLParser
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from daq.records import Session
from daq.session_file import read_session
from mesotap.report import figures
from sim_backend.mechanisms.catalogue import catalogue
from tests.mesotap.test_cli import mesotap, refused

pytestmark = pytest.mark.slow
LOADS_MN = (150.0, 400.0)
IMPACTS = 4
DOI = "10.1115/1.1857920"
SUPERSCRIPT = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
ADVERBS = re.compile(r"\b(far|much|hardly|barely|clearly|greatly|vastly) (less|more|better|worse|smaller|larger)\b")
NUMBER = re.compile(r"(?<![\w.])[−-]?\d+(?:\.\d+)?(?: × 10[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)?")


@dataclass
class Page(HTMLParser):
    """Texts of a page outside its figures, and its tables as rows of cells."""

    texts: list[str] = field(default_factory=list)
    tables: list[list[list[str]]] = field(default_factory=list)
    figures: int = 0
    _skipped: int = 0
    _in_cell: bool = False

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._skipped += tag in ("svg", "style", "script")
        self.figures += tag == "figure"
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th") and not self._skipped:
            self.tables[-1][-1].append("")
            self._in_cell = True

    def handle_endtag(self, tag: str) -> None:
        self._skipped -= tag in ("svg", "style", "script")

        self._in_cell &= tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._skipped:
            return
        self.texts.append(data)
        if self._in_cell:
            self.tables[-1][-1][-1] += data

    def table(self, *headings: str) -> list[list[str]]:
        """Rows of the one table with these words in its head."""
        (found,) = (t for t in self.tables if all(any(h in cell for cell in t[0]) for h in headings))
        return found


@dataclass
class Consistent:
    folder: Path
    page: Page
    answer: dict
    session: Session
    results: dict
    truth: list[dict]


def value_of(text: str) -> float:
    mantissa, _, power = text.replace("−", "-").partition(" × 10")
    return float(mantissa) * 10 ** int(power.translate(SUPERSCRIPT) or 0)


def is_rounded(text: str, value: float) -> bool:
    """Whether a text is a number rounded to the digits it shows."""
    mantissa, _, power = text.replace("−", "-").partition(" × 10")
    whole, _, fraction = mantissa.partition(".")
    shown = len(fraction) if fraction else len(whole.rstrip("0")) - len(whole)
    decimals = shown - int(power.translate(SUPERSCRIPT) or 0)
    return abs(value_of(text) - value) <= 0.51 * 10.0**-decimals  # also where a half is rounded either way


@pytest.fixture(scope="module")
def consistent(tmp_path_factory: pytest.TempPathFactory) -> Consistent:
    folder = tmp_path_factory.mktemp("consistent")
    changes = (
        f"mesotap.load_plan_mn=[{', '.join(str(load) for load in LOADS_MN)}]",
        f"mesotap.impacts_per_load={IMPACTS}",
        "mesotap.dwell_s=0",
    )
    arguments = [part for change in changes for part in ("--set", change)]
    mesotap("run", "--simulate", "--seed", 3, "--output", folder / "session", *arguments)
    mesotap("diagnose", folder / "session", "--report", folder / "page", "--json", folder / "answer.json")
    page = Page()
    page.feed((folder / "page" / "diagnosis.html").read_text(encoding="utf-8"))
    session = read_session(folder / "session" / "session.h5")
    loaded = [json.loads(line) for line in (folder / "session" / "journal.jsonl").read_text().splitlines()]
    truth = [entry["truth"] for entry in loaded if entry.get("truth")]
    answer, results = (
        json.loads(path.read_text()) for path in (folder / "answer.json", folder / "session" / "results.json")
    )
    return Consistent(folder, page, answer, session, results, truth)


def test_nothing_is_missing_and_the_page_says_of_how_much(consistent: Consistent) -> None:
    said = " ".join(consistent.page.texts)
    assert consistent.answer["verdict"] == "consistent"
    accepted = sum(impact.accepted for impact in consistent.session.impacts)
    low, high = (f"{entry['load_mn']['value']:.0f}" for entry in consistent.results["loads"])
    assert f"explains {accepted} impacts at {len(LOADS_MN)} loads from {low} to {high} mN" in " ".join(said.split())
    fit = consistent.answer["fit"]
    assert 0 < fit["heldout_segments"] < accepted
    assert f"{fit['heldout_segments']} segments took no part" in said
    samples = sum(i.acceleration[0].size for i in consistent.session.impacts if i.accepted) / accepted
    # what is held out and holds noise alone has the rms of the noise, as far as so many samples tell
    assert fit["heldout_rms_before"] == pytest.approx(
        fit["noise_rms"], rel=4 / (fit["heldout_segments"] * samples) ** 0.5
    )


def test_what_comes_nearest_to_being_seen_was_fitted_in_full(consistent: Consistent) -> None:
    (rival,) = consistent.answer["rivals"]
    name, probability, error, why = consistent.page.table("Instead", "Held-out rms")[1]
    assert name == rival["ids"][0]
    assert is_rounded(probability, rival["probability"])
    assert is_rounded(error, rival["heldout_rms"])
    # beside nothing but noise a further mechanism changes the error by no more than chance
    assert rival["heldout_rms"] == pytest.approx(consistent.answer["fit"]["heldout_rms_before"], rel=0.05)
    assert f"{rival['heldout_rms']:.5g}" in rival["why"]
    assert not ADVERBS.search(why)


def test_no_cell_is_empty_of_a_number_that_cannot_be(consistent: Consistent) -> None:
    said = " ".join(consistent.page.texts)
    assert not re.search(r"\b(nan|inf|None(?! is asked for))\b", said)
    assert not re.search(r"(?<![\d.])-?0\.0+ (m/s|mN)", said)
    for table in consistent.page.tables:
        head, rows = table[0], table[1:]
        for column, heading in enumerate(head):
            shown = {row[column] for row in rows}
            assert shown != {"–"} or heading == "Held-out rms", f"nothing but dashes under {heading}"


def test_specimen_operator_date_and_that_it_is_simulated_stand_at_the_head(consistent: Consistent) -> None:
    said = " ".join(consistent.page.texts)
    for wanted in (consistent.session.specimen, consistent.session.created[:10], consistent.session.software):
        assert wanted
        assert wanted in said
    assert "come from the simulated rig, not from a specimen" in said


def test_the_damping_ratio_of_the_contact_mode_has_one_symbol(consistent: Consistent) -> None:
    for file in (consistent.folder / "page" / "diagnosis.html", consistent.folder / "session" / "report.html"):
        page = file.read_text(encoding="utf-8")
        symbols = set(re.findall(r"ζ</i><sub>([^<]*)<", page))
        assert symbols <= {"1", "2"}, file
        assert "2" in symbols, file
        assert not re.search(r"zeta_?[a-z]|ζ_?c", re.sub(r"<[^>]*>", "", page)), file
    for module in Path(figures.__file__).parent.glob("*.py"):  # labels are drawn as curves: no text to read
        assert not re.search(r"zeta_\{?c", module.read_text(encoding="utf-8")), module


def test_calibrations_and_taps_have_dates_that_follow_the_session_s(consistent: Consistent) -> None:
    session = consistent.session
    begun = datetime.fromisoformat(session.created)
    page = (consistent.folder / "session" / "report.html").read_text(encoding="utf-8")
    assert session.pre is not None
    assert session.post is not None
    for moment in (session.pre.time, *(impact.time for impact in session.impacts), session.post.time):
        assert timedelta(0) <= datetime.fromisoformat(moment) - begun < timedelta(hours=2)
    for shown in (session.created, session.pre.time, session.post.time):
        assert shown.replace("T", " ").removesuffix("Z") in page


def test_results_say_where_they_come_from(consistent: Consistent) -> None:
    found, session = consistent.results["provenance"], consistent.session
    file = consistent.folder / "session" / "session.h5"
    assert found["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    assert (found["created"], found["specimen"]) == (session.created, session.specimen)
    assert (found["rig"]["m1_kg"], found["rig"]["k2_n_per_m"]) == (session.rig.m1_kg, session.rig.k2_n_per_m)
    assert found["configuration"]["mesotap"]["load_plan_mn"] == list(LOADS_MN)
    assert found["configuration"]["rig"]["masses"]["uncertainty_kg"] > 0
    for library in ("numpy", "scipy", "numba", "h5py"):
        assert found["analysed_with"][library] == version(library)
    assert found["analysed_with"]["mesotap"] == version("mesotap")
    mesotap("analyze", file, "--json", consistent.folder / "again.json")
    assert json.loads((consistent.folder / "again.json").read_text())["provenance"] == found


def test_the_contact_of_each_load_is_one_row_that_holds_the_true_one(consistent: Consistent) -> None:
    rows = consistent.page.table("Load [mN]")[1:]
    assert len(rows) == len(consistent.truth) == len(LOADS_MN)
    for (_, stiffness, ratio), true in zip(rows, consistent.truth, strict=True):
        k, half = (float(x) for x in stiffness.split(" ± "))
        assert abs(1e6 * k - true["contact_stiffness_n_per_m"]) < 2 * 1e6 * half
        z, half = (float(x) for x in ratio.split(" ± "))
        assert abs(z - 100 * true["zeta2"]) < 2 * half
        assert half < 0.1 * z


def test_the_constants_of_the_fit_are_those_declared_within_their_uncertainty(consistent: Consistent) -> None:
    for name, declared, fitted in consistent.page.table("Constant", "Declared")[1:]:
        value, half = (float(x) for x in declared.split(" ± "))
        assert abs(float(fitted) - value) < 1.5 * half, name


def test_the_limits_are_those_of_the_answer(consistent: Consistent) -> None:
    rows = {(row[0], row[1].split()[-1]): row[2] for row in consistent.page.table("Mechanism", "At most")[1:]}
    limits = {(u["id"], u["parameter"]): u["value"] for u in consistent.answer["upper_limits"]}
    assert rows.keys() == limits.keys()
    assert [key for key, value in limits.items() if not is_rounded(rows[key], value)] == []


def test_every_number_in_the_text_is_one_of_the_answer_or_of_the_session(consistent: Consistent) -> None:
    known = _numbers(consistent.answer) + _numbers(consistent.results["loads"])
    known += [100 * x for x in known]
    known += [float(n) for n in range(1, 10)]  # of tables, figures, equations, symbols
    known += [95.0, float(len(catalogue()))]
    rig = ("kc", "Constant")  # tables of values that are not in the answer of a session in which nothing is missing
    checked = {
        cell for t in consistent.page.tables if any(r in t[0][0] + t[0][1] for r in rig) for row in t for cell in row
    }
    left = " ".join(t for t in consistent.page.texts if t.strip() not in checked and str(consistent.folder) not in t)
    session = consistent.session
    for part in (*session.created.removesuffix("Z").split("T"), *session.specimen.split(), session.software, DOI):
        left = left.replace(part, " ")
    unknown = [n for n in NUMBER.findall(left) if not any(is_rounded(n, value) for value in known)]
    assert unknown == []


def test_the_reconstructed_force_lies_on_the_law_of_eq_9(consistent: Consistent) -> None:
    from analysis.mismatch.evidence.reconstruction import law_along, reconstruct, stitched
    from analysis.mismatch.ring_downs.fit import fit
    from tests.mesotap.tester import problem_of

    found = fit(problem_of(consistent.session).per_impact_constants())
    for number in (0, len(found.segments) - 1):
        segment = found.segments[number]
        stiffness = found.constants.at(segment.group)["kc"]
        motion = stitched(reconstruct(found, number), stiffness)
        off = motion.force - law_along(found, segment, motion)
        assert np.std(off[:300]) < 0.01 * np.std(motion.force[:300])


def test_a_folder_without_a_session_file_is_told_how_to_get_one(tmp_path: Path) -> None:
    (tmp_path / "begun").mkdir()
    said = refused("diagnose", tmp_path / "begun")
    assert "holds no session.h5 yet" in said
    assert "mesotap resume" in said


def _numbers(content: object) -> list[float]:
    if isinstance(content, bool):
        return []
    if isinstance(content, int | float):
        return [float(content)]
    if isinstance(content, dict):
        return [n for value in content.values() for n in _numbers(value)]
    if isinstance(content, list):
        return [n for value in content for n in _numbers(value)]
    return [value_of(n) for n in NUMBER.findall(content)] if isinstance(content, str) else []
