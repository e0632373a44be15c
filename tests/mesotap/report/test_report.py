"""The report: what it says, that it stands alone, and that nothing in a session can break it."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from analysis.contact.theory import TheoryCurve
from analysis.modal.amplitude import AmplitudePoint
from analysis.modal.spectrum import SpectralMode
from analysis.published import reanalyse
from analysis.results import (
    ImpactResult,
    LoadResult,
    Mode,
    RecordingModes,
    SessionResults,
    Spectrum,
)
from analysis.statistics import BoxStatistics
from calibration.estimate import Estimate
from calibration.gauge import GaugeResult
from daq.records import CalibrationPoints, Impact, RigDescription, Session
from mesotap.answers.comparison import recovered_against
from mesotap.answers.results_files import impacts_csv, json_text, loads_csv, modes_json
from mesotap.answers.rounding import significant, with_ends
from mesotap.answers.trust import DIAGNOSIS, DIAGNOSIS_PAGE
from mesotap.report import figures
from mesotap.report.figures._diagnosis import load_ticks
from mesotap.report.report import published_report, recording_report, results_json, with_uncertainty, write_report
from rig.hardware_log import Repetition

M1, M2, K = 0.107, 0.108, 0.5379e6
RATE, SAMPLES, PRETRIGGER = 25000.0, 5000, 250
TABLE_5_MN = (264.9, 348.3, 431.6, 524.8, 549.4, 627.8, 784.8, 927.0)
TABLE_5_HZ = (1410.0, 1701.0, 1855.0, 1925.0, 1979.0, 2079.0, 2146.0, 2234.0)
DAMPING = (0.028, 0.012, 0.006, 0.0020, 0.0018, 0.0017, 0.0016, 0.0016)
REASONS = ("double impact 6 ms after the first", "peak 11.2 m/s² is above 1 g: the contact may have opened")


THEORY = (
    TheoryCurve(
        "rough flats, elastic (GW)", "Eq. 5", lambda p: 34.4e6 * (0.1 / 0.189) * np.asarray(p, dtype=float) ** 0.94
    ),
    TheoryCurve("exponential heights", "Eq. 8", lambda p: 3 * np.asarray(p, dtype=float) / 0.189e-6),
    TheoryCurve("smooth flats", "Eq. 4", lambda p: np.full(np.shape(p), 58.9e9)),
)


def stiffness_of(f2_hz: float) -> float:
    """Eq. 11 without damping."""
    w2 = (2 * math.pi * f2_hz) ** 2
    return (M1 * M2 * w2**2 - (M1 + M2) * K * w2 + K**2) / ((M1 + M2) * w2 - 2 * K)


def ring_down(f2: float, zeta2: float, rng: np.random.Generator) -> NDArray[np.float64]:
    t = (np.arange(SAMPLES) - PRETRIGGER) / RATE
    on = np.where(t >= 0, t, 0)
    signal = sum(
        a * np.exp(-z * 2 * np.pi * f * on) * np.sin(2 * np.pi * f * on)
        for f, z, a in ((356, 0.004, 1.2), (f2, zeta2, -4))
    )
    return np.stack([signal, signal * 1.01]) + 0.01 * rng.standard_normal((2, SAMPLES))


def make_impact(number: int, load_set: int, rng: np.random.Generator, accepted: bool, reason: str) -> ImpactResult:
    f2 = TABLE_5_HZ[load_set] * (1 + 0.002 * rng.standard_normal())
    zeta = DAMPING[load_set] * (1 + 0.06 * rng.standard_normal())
    k = stiffness_of(f2)
    known = accepted or load_set % 2 == 0
    mu = M1 * M2 / (M1 + M2)
    return ImpactResult(
        name=f"{number:05d}",
        load_set=load_set,
        accepted=accepted,
        reject_reason=reason,
        load_mn=Estimate(TABLE_5_MN[load_set] + 0.2 * rng.standard_normal(), 0.4, 20),
        f1_hz=Estimate(356.0 + 0.1 * rng.standard_normal(), 0.05, 900) if known else None,
        f2_hz=Estimate(f2, 0.4, 900) if known else None,
        zeta1=Estimate(0.0041, 0.0001, 900) if known else None,
        zeta2=Estimate(zeta, 0.0002, 900) if known else None,
        contact_stiffness_n_per_m=Estimate(k, 0.004 * k, 900) if known else None,
        contact_damping_n_s_per_m=Estimate(2 * zeta * mu * 2 * math.pi * f2, 1.0, 900) if known else None,
        peak_acceleration_m_s2=4.0 + rng.random(),
        peak_contact_force_n=0.2 * rng.random(),
    )


def box_of(values: list[float]) -> BoxStatistics:
    q1, median, q3 = np.percentile(values, [25, 50, 75])
    inside = [v for v in values if q1 - 1.5 * (q3 - q1) <= v <= q3 + 1.5 * (q3 - q1)]
    outliers = tuple(v for v in values if v not in inside)
    return BoxStatistics(float(q1), float(median), float(q3), min(inside), max(inside), outliers)


def follow(frequency_hz: float, damping_ratio: float, points: int = 6) -> tuple[AmplitudePoint, ...]:
    """Return a mode that softens: its frequency falls by 0.1 % of its value for every m/s2."""
    amplitudes = 2.0 * 0.4 ** np.arange(points)
    return tuple(
        AmplitudePoint(
            float(a),
            0.01 * number,
            Estimate(frequency_hz * (1 - 0.001 * float(a)), 2e-5 * frequency_hz, 7),
            Estimate(damping_ratio, 0.01 * damping_ratio, 7),
        )
        for number, a in enumerate(amplitudes)
    )


def make_load(load_set: int, impacts: list[ImpactResult], recorded: list[Impact]) -> LoadResult:
    used = [i for i in impacts if i.accepted]
    values = {q: [getattr(i, q).value for i in used] for q in ("f1_hz", "f2_hz", "zeta1", "zeta2")}
    ks = [stiffness_of(f) for f in values["f2_hz"]]
    cs = [i.contact_damping_n_s_per_m.value for i in used if i.contact_damping_n_s_per_m is not None]

    def combined(numbers: list[float], extra: float = 0.0) -> Estimate:
        mean = float(np.mean(numbers))
        spread = float(np.std(numbers, ddof=1) / math.sqrt(len(numbers)))
        return Estimate(mean, math.hypot(spread, extra * mean), len(numbers) - 1)

    accelerations = [s.acceleration[0, PRETRIGGER:] for s in recorded if s.accepted]
    spectrum = np.mean([np.abs(np.fft.rfft(a)) for a in accelerations], axis=0) / RATE
    return LoadResult(
        load_set=load_set,
        target_load_mn=round(TABLE_5_MN[load_set], -1),
        load_mn=Estimate(TABLE_5_MN[load_set], 0.9, 24),
        impacts_used=len(used),
        **{q: combined(v) for q, v in values.items()},
        contact_stiffness_n_per_m=combined(ks, 0.002),
        contact_damping_n_s_per_m=combined(cs),
        stiffness_box=box_of(ks),
        damping_box=box_of(values["zeta2"]),
        spectrum=Spectrum(np.arange(spectrum.size) * RATE / (SAMPLES - PRETRIGGER), spectrum),
        spectral_mode=SpectralMode(
            Estimate(1.001 * TABLE_5_HZ[load_set], 0.4, 7), Estimate(0.97 * DAMPING[load_set], 0.0001, 7)
        ),
        along_decay=follow(TABLE_5_HZ[load_set], DAMPING[load_set]),
        notes=("stiffness grows with amplitude: 1.3 % from the weakest tap to the strongest",) if load_set == 0 else (),
    )


def make_session(loads: int = 8, drifted: bool = False) -> tuple[Session, SessionResults]:
    """Return a session like the one behind Table 5 and Fig. 8, eight accepted taps a load and some rejected."""
    rng = np.random.default_rng(5)
    recorded: list[Impact] = []
    impacts: list[ImpactResult] = []
    results: list[LoadResult] = []
    for load_set in range(loads):
        plan = [""] * 8
        for extra in range(load_set % 3):
            plan.insert(3 * extra + 1, REASONS[extra])
        mine: list[ImpactResult] = []
        records: list[Impact] = []
        for index, reason in enumerate(plan):
            number = len(impacts) + len(mine)
            mine.append(make_impact(number, load_set, rng, not reason, reason))
            impact = Impact(
                number=number,
                load_set=load_set,
                target_load_mn=round(TABLE_5_MN[load_set], -1),
                load_before_mn=TABLE_5_MN[load_set],
                load_after_mn=TABLE_5_MN[load_set],
                time=f"2024-05-06T10:{load_set:02d}:{index:02d}Z",
                sample_rate_hz=RATE,
                pretrigger=PRETRIGGER,
                acceleration=ring_down(TABLE_5_HZ[load_set], DAMPING[load_set], rng),
                accepted=not reason,
                reject_reason=reason,
            )
            records.append(impact)
        recorded += records
        impacts += mine
        results.append(make_load(load_set, mine, records))
    weights = np.repeat([0.0, 100, 200, 400, 600, 800, 1000], 2)

    def gauge(slope: float, hour: int) -> CalibrationPoints:
        voltage = 0.3 + slope * weights + 0.01 * rng.standard_normal(weights.size)
        return CalibrationPoints(weights, voltage, f"2024-05-06T{hour:02d}:00:00Z")

    session = Session(
        created="2024-05-06T09:30:00Z",
        rig=RigDescription(m1_kg=M1, m2_kg=M2, k1_n_per_m=K, k2_n_per_m=K, sample_rate_hz=RATE),
        impacts=tuple(recorded),
        pre=gauge(0.042, 9),
        post=gauge(0.0424 if drifted else 0.042, 12),
        operator="A. Operator",
        specimen="17-4PH flats, Rq 0.189 µm",
        title="Flat rough surfaces, dry",
        software="mesotap 0.1.0",
        complete=True,
        source="session.h5",
    )
    statement = "Before and after differ by 0.9 %." if drifted else "Before and after agree (p = 0.41)."
    calibration = GaugeResult(
        Estimate(0.0420, 3e-6, 26), Estimate(0.3, 0.002, 26), 0.04, drifted, 1e-6 if drifted else 0.41, statement
    )
    springs = (Estimate(K, 0.002 * K), Estimate(K, 0.002 * K))
    return session, SessionResults("session.h5", "ml", tuple(results), tuple(impacts), calibration, springs)


def make_truth(results: SessionResults) -> list[dict[str, Any]]:
    return [
        {
            "load_set": load.load_set,
            "load_mn": TABLE_5_MN[load.load_set],
            "contact_stiffness_n_per_m": stiffness_of(TABLE_5_HZ[load.load_set]),
            "contact_damping_n_s_per_m": 10.0,
            "f1_hz": 356.0,
            "f2_hz": TABLE_5_HZ[load.load_set],
            "zeta1": 0.0041,
            "zeta2": DAMPING[load.load_set],
        }
        for load in results.loads
    ]


VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}


class Page(HTMLParser):
    """Collects tags, references and text, and whether every element is closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.faults: list[str] = []
        self.tags: list[str] = []
        self.references: list[str] = []
        self.ids: list[str] = []
        self.labels: list[str] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        given = dict(attrs)
        self.references += [v or "" for k, v in attrs if k in {"src", "href", "xlink:href", "srcset", "data", "action"}]
        self.labels += [v or "" for k, v in attrs if k == "aria-label"]
        self.ids += [v or "" for k, v in attrs if k == "id"]
        if tag not in VOID and "/" not in given:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in {"style", "script"}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def report(folder: Path, session: Session, results: SessionResults, **more: Any) -> str:
    return write_report(folder, session, results, THEORY, pdf_figures=False, **more).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def session() -> tuple[Session, SessionResults]:
    return make_session()


@pytest.fixture(scope="module")
def small() -> tuple[Session, SessionResults]:
    return make_session(loads=2)


@pytest.fixture(scope="module")
def written(session: tuple[Session, SessionResults], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "new" / "folder"
    write_report(folder, *session, THEORY, make_truth(session[1]), pdf_figures=False)
    return folder


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures of a page empty, but for what a screen reader says, where a test is about its words."""
    monkeypatch.setattr(
        figures, "inline_svg", lambda figure, name, label: f'<svg role="img" aria-label="{label}"></svg>'
    )


@pytest.fixture(scope="module")
def page(written: Path) -> Page:
    return Page((written / "report.html").read_text(encoding="utf-8"))


TABLES = ("results.json", "results.csv", "impacts.csv", "budgets.csv")


@pytest.mark.usefixtures("undrawn")
def test_writes_page_numbers_and_figures(
    small: tuple[Session, SessionResults], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "save", lambda figure, path: path.touch())  # what is in one, others ask
    steps: list[str] = []
    write_report(tmp_path, *small, THEORY, on_progress=steps.append)
    assert [s for s in steps if "figure" in s] == [f"figure {n} of 8" for n in range(1, 9)]
    found = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    names = ("amplitude", "calibration", "damping", "impacts", "record", "spectra", "stiffness")
    assert found == {"report.html", *TABLES, *(f"figures/{n}.pdf" for n in names)}


@pytest.mark.usefixtures("undrawn")
def test_units_of_a_reason_are_set_as_in_the_head_of_its_table(
    small: tuple[Session, SessionResults], tmp_path: Path
) -> None:
    session, results = small
    told = tuple(replace(i, reject_reason=i.reject_reason and "peak 11.2 m/s2") for i in results.impacts)
    assert "peak 11.2 m/s2" in {i.reject_reason for i in told}
    text = Page(report(tmp_path, session, replace(results, impacts=told))).text
    assert text.count("peak 11.2 m/s²") > 1
    assert "m/s2" not in text


def test_page_stands_alone(written: Path, page: Page) -> None:
    html = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?:|//[a-z]|url\((?!#)|@import|file:", html)
    assert all(reference.startswith("#") for reference in page.references)
    assert not {"script", "link", "img", "iframe", "object"} & set(page.tags)


def test_page_is_well_formed_and_its_ids_are_unique(page: Page) -> None:
    assert page.faults == []
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert {reference.removeprefix("#") for reference in page.references} <= set(page.ids)


LOCAL = re.compile(r'<li class="(?:good|open|doubt|bad)"><b><a href="([^"]+)"')


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "change",
    [
        lambda s, r: (s, r),
        lambda s, r: (replace(s, pre=None, post=None), replace(r, calibration=None)),
        lambda s, r: (s, without_values(r)),
        lambda s, r: (replace(s, impacts=()), replace(r, loads=(), impacts=())),
    ],
    ids=["sound", "no calibration", "no values", "no taps"],
)
@pytest.mark.parametrize(
    ("verdict", "paged"),
    [("", False), ("consistent", True), ("consistent", False), ("missing_physics", True), ("unexplained", True)],
)
def test_what_is_said_of_trust_leads_to_evidence_that_is_there(
    small: tuple[Session, SessionResults], tmp_path: Path, change: Any, verdict: str, paged: bool
) -> None:
    if verdict:
        (tmp_path / "session.h5").write_bytes(b"recorded")
        of = [{"file": "session.h5", "sha256": hashlib.sha256(b"recorded").hexdigest()}]
        named = [{"statement": "Friction.", "probability": 0.9}] if verdict == "missing_physics" else []
        found = {"version": 2, "verdict": verdict, "mechanisms": named, "recordings": of}
        (tmp_path / DIAGNOSIS).write_text(json.dumps(found))
        if paged:
            (tmp_path / DIAGNOSIS_PAGE).write_text("its page")
    html = report(tmp_path, *change(*small))
    page, links = Page(html), LOCAL.findall(html)
    assert len(links) >= 3
    assert (DIAGNOSIS_PAGE in links) == (bool(verdict) and paged)
    for link in links:
        assert link.removeprefix("#") in page.ids if link.startswith("#") else (tmp_path / link).is_file(), link


def luminance(colour: str) -> float:
    """Relative luminance of a CSS colour (WCAG 2.2)."""
    digits = colour.lstrip("#")
    digits = "".join(2 * d for d in digits) if len(digits) == 3 else digits
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("dark", [False, True])
def test_words_stand_out_from_what_is_behind_them_by_day_and_by_night(written: Path, dark: bool) -> None:
    """By 4.5 to 1, as WCAG 2.2 asks for (1.4.3); diagnoses and rigs have the same style."""
    style = (written / "report.html").read_text(encoding="utf-8")
    light, night = re.findall(r":root \{([^}]*)\}", style)[:2]
    assert "@media screen and (prefers-color-scheme: dark)" in style
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]+)", night if dark else light))
    behind = {"paper": ("ink", "soft", "warn", "note", "good", "bad"), "faint": ("ink", "soft", "warn", "good")}
    behind |= {"warn-paper": ("ink", "warn", "bad"), "note-paper": ("note",)}
    for paper, inks in behind.items():
        for ink in inks:
            one, other = sorted(luminance(colours[name]) + 0.05 for name in (paper, ink))
            assert other / one >= 4.5, (ink, paper)


def test_page_stays_small(written: Path) -> None:
    assert (written / "report.html").stat().st_size < 1_000_000


def test_published_numbers_are_in_the_table(page: Page) -> None:
    for load in TABLE_5_MN:
        assert f"{load} ± 1.9" in page.text
    assert re.search(r"3\.95\d? ± 0\.0\d+", page.text)


def test_every_rejected_tap_is_listed_with_its_reason(session: tuple[Session, SessionResults], page: Page) -> None:
    rejected = [impact for impact in session[1].impacts if not impact.accepted]
    assert rejected
    for impact in rejected:
        assert re.search(rf"{impact.name} 2024.{{10,80}}{re.escape(impact.reject_reason)}", page.text)


def test_summary_names_closest_theory_and_counts_taps(page: Page) -> None:
    assert "exponential heights (Eq. 8) is closest" in page.text
    assert "71 taps at 8 loads: 64 used, 7 rejected." in page.text


def test_truth_is_held_against_the_result(page: Page) -> None:
    assert "Simulated." in page.text
    assert "48 of 56 true values lie inside" in page.text
    assert "outside" in page.text


@pytest.mark.usefixtures("undrawn")
def test_no_word_of_simulation_for_a_real_session(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    text = Page(report(tmp_path, *small)).text
    assert "Simulated" not in text
    assert "Recovered against true" not in text


@pytest.mark.usefixtures("undrawn")
def test_incomplete_session_has_a_banner(small: tuple[Session, SessionResults], page: Page, tmp_path: Path) -> None:
    session, results = small
    assert "Incomplete session." in Page(report(tmp_path, replace(session, complete=False), results)).text
    assert "Incomplete session." not in page.text


@pytest.mark.usefixtures("undrawn")
def test_drift_is_said_wherever_loads_are(page: Page, tmp_path: Path) -> None:
    drifted = Page(report(tmp_path, *make_session(loads=2, drifted=True)))
    assert "The strain gauge drifted. Before and after differ by 0.9 %." in drifted.text
    tables, heads = drifted.tags.count("table"), drifted.text.count("Load † mN")
    assert (tables, heads) == (5, 4)  # the table of rejected taps holds targets, not loads
    captions = 5  # all but those of calibration and record
    assert drifted.text.count("† The strain gauge drifted: loads are in doubt.") == heads + captions
    assert sum("loads are in doubt" in label for label in drifted.labels) == captions + 1  # that of the first screen
    assert not any("drifted" in label for label in page.labels)
    assert "†" not in page.text


@pytest.mark.parametrize(
    "draw",
    [
        lambda r: figures.stiffness_figure(r, THEORY),
        figures.damping_figure,
        figures.impacts_figure,
        figures.spectra_figure,
        figures.amplitude_figure,
    ],
)
def test_figures_with_loads_have_a_footnote_after_drift(draw: Callable[[SessionResults], Any]) -> None:
    sound, drifted = (make_session(loads=2, drifted=d)[1] for d in (False, True))
    labels = [[axes.get_xlabel() for axes in draw(results).axes] for results in (sound, drifted)]
    assert "†" not in "".join(labels[0])
    assert labels[1][-1].endswith("† The strain gauge drifted: loads are in doubt.")


def test_drift_is_in_every_row_of_the_files() -> None:
    for drift in (False, True):
        results = make_session(loads=2, drifted=drift)[1]
        said = replace(results.loads[0], notes=("the strain gauge drifted during the test: widened",) * drift)
        results = replace(results, loads=(said, results.loads[1]))
        tables = [list(csv.DictReader(text.splitlines())) for text in (loads_csv(results), impacts_csv(results))]
        mapping = results_json(results)
        rows = [row["notes"] for table in tables for row in table]
        rows += ["; ".join(row["notes"]) for part in ("loads", "impacts") for row in mapping[part]]
        assert len(rows) == 2 * (2 + 17)
        assert {row.count("the strain gauge drifted") for row in rows} == {int(drift)}


@pytest.mark.usefixtures("undrawn")
def test_file_of_the_simulated_rig_is_called_simulated(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    text = Page(report(tmp_path, replace(small[0], software="mesotap 0.1.0 (simulated rig)"), small[1])).text
    assert "Simulated. No specimen" in text
    assert "Recovered against true" not in text


@pytest.mark.parametrize(("true", "deviation"), [(1e-7, None), (0.0, None), (-2e-6, None), (0.004, -50.0)])
def test_no_share_of_next_to_nothing(
    small: tuple[Session, SessionResults], true: float, deviation: float | None
) -> None:
    load = replace(small[1].loads[0], zeta1=Estimate(0.002, 0.001 if deviation is None else 0.0015))
    truth = [{"load_set": 0, "zeta1": true}]
    found = recovered_against(replace(small[1], loads=(load,)), truth)[0][1]["zeta1"]
    assert found.deviation_percent == (None if deviation is None else pytest.approx(deviation))
    assert found.inside is (load.zeta1 is not None and load.zeta1.low <= true <= load.zeta1.high)


@pytest.mark.usefixtures("undrawn")
def test_dash_keeps_the_verdict(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    loads = tuple(replace(load, zeta1=Estimate(1e-6, 1e-5)) for load in small[1].loads)
    truth = [entry | {"zeta1": 1e-9} for entry in make_truth(small[1])]
    text = Page(report(tmp_path, small[0], replace(small[1], loads=loads), truth=truth)).text
    assert text.count("– inside") == 2
    assert "A dash for the deviation" in text


@pytest.mark.usefixtures("undrawn")
def test_loads_without_calibration_are_those_of_the_file(
    small: tuple[Session, SessionResults], page: Page, tmp_path: Path
) -> None:
    bare = Page(report(tmp_path, replace(small[0], pre=None, post=None), replace(small[1], calibration=None))).text
    assert bare.lower().count("loads are those written in the session file") == 4
    assert "Loads are the gauge's voltages" not in bare
    assert "written in the session file" not in page.text


@pytest.mark.usefixtures("undrawn")
def test_spectra_are_held_against_the_fit(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    load = replace(small[1].loads[0], f2_hz=Estimate(1410.0, 0.4), zeta2=Estimate(0.028, 1e-4))
    text = Page(report(tmp_path, small[0], replace(small[1], loads=(load,)))).text
    assert re.search(r"1410\.00 ± 0\.78 1411\.41 ± 0\.9\d \+0\.10\d? 2\.800 ± 0\.020 2\.716 ± 0\.024 −3\.00", text)


def test_change_is_drawn_against_the_table(small: tuple[Session, SessionResults]) -> None:
    load = replace(small[1].loads[0], f2_hz=Estimate(TABLE_5_HZ[0] * 1.001, 0.4))
    axes = figures.amplitude_figure(replace(small[1], loads=(load,))).axes
    change, damping = (np.asarray(a.get_lines()[i].get_ydata()) for a, i in ((axes[0], 1), (axes[1], 0)))
    amplitude = np.asarray(axes[1].get_lines()[0].get_xdata())
    assert change == pytest.approx(100 * ((1 - 0.001 * amplitude) / 1.001 - 1))
    assert damping == pytest.approx(100 * DAMPING[0])


def test_one_wild_point_does_not_hide_the_others(small: tuple[Session, SessionResults]) -> None:
    load = small[1].loads[0]
    wild = AmplitudePoint(1e-4, 0.2, Estimate(2000.0, 900.0, 2), Estimate(0.9, 5.0, 2))
    sound = figures.amplitude_figure(replace(small[1], loads=(load,)))
    other = figures.amplitude_figure(replace(small[1], loads=(replace(load, along_decay=(*load.along_decay, wild)),)))
    for before, after in zip(sound.axes, other.axes, strict=True):
        assert after.get_ylim() == pytest.approx(before.get_ylim())
        assert any(line.get_marker() == "^" for line in after.get_lines())


def test_unknown_numbers_along_the_decay(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    session, results = small
    odd = (
        AmplitudePoint(math.nan, 0.1, Estimate(1410.0, 1.0), Estimate(0.02, 0.01)),
        AmplitudePoint(0.1, 0.1, Estimate(math.nan, 1.0), Estimate(math.inf, 0.01)),
        AmplitudePoint(0.2, 0.1, Estimate(1409.0, math.inf), Estimate(-0.01, math.nan)),
    )
    check = SpectralMode(Estimate(math.nan, 1.0), Estimate(0.02, math.nan))
    few = replace(results.loads[1], along_decay=odd[:1], spectral_mode=check, f2_hz=None)
    lone = replace(results.loads[0], along_decay=(*odd, *results.loads[0].along_decay), spectral_mode=check)
    text = Page(report(tmp_path, session, replace(results, loads=(lone, few)))).text
    assert not re.search(r"\b(nan|inf|None)\b", text)
    written = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["loads"]
    assert written[0]["spectral_mode"] == {"frequency_hz": None, "damping_ratio": None}
    assert written[0]["along_decay"][0]["amplitude_m_s2"] is None
    assert written[0]["along_decay"][1]["frequency_hz"] is None
    assert len(written[0]["along_decay"]) == 9


@pytest.mark.usefixtures("undrawn")
def test_notes_of_one_load_share_a_letter(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    first, second = small[1].loads
    loads = (replace(first, notes=("one", "both", "two")), replace(second, notes=("both", "three")))
    text = Page(report(tmp_path, small[0], replace(small[1], loads=loads))).text
    assert "a both b one; two c three" in text


def test_text_of_users_is_escaped(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    session, results = small
    evil = '<b>x</b> & <script>alert(1)</script> "quoted"'
    impacts = tuple(replace(i, reject_reason=evil) if not i.accepted else i for i in results.impacts)
    session = replace(session, specimen=evil, operator=evil, title=evil, software=evil, source=evil)
    results = replace(results, impacts=impacts, source=evil, notes=(evil,), method=evil)
    results = replace(results, loads=(replace(results.loads[0], notes=(evil,)), *results.loads[1:]))
    html = report(tmp_path, session, results)
    page = Page(html)
    assert not {"b", "script"} & set(re.findall(r"<(b|script)>x", html))
    assert "script" not in page.tags
    assert page.faults == []
    assert page.text.count(evil) >= 8


def test_names_of_theories_cannot_break_a_figure(small: tuple[Session, SessionResults]) -> None:
    odd = TheoryCurve("$broken\nπ \N{CJK UNIFIED IDEOGRAPH-63A5} \\frac", "", lambda p: np.full(np.shape(p), 1e7))
    assert figures.inline_svg(figures.stiffness_figure(small[1], [odd]), "k", "label").startswith("<svg")


def without_values(results: SessionResults) -> SessionResults:
    nothing: dict[str, Any] = dict.fromkeys(
        ("load_mn", "f1_hz", "f2_hz", "zeta1", "zeta2", "contact_stiffness_n_per_m", "contact_damping_n_s_per_m")
    )
    loads = tuple(
        replace(
            r,
            **nothing,
            stiffness_box=None,
            damping_box=None,
            spectrum=None,
            impacts_used=0,
            notes=("all taps rejected",),
        )
        for r in results.loads
    )
    impacts = tuple(
        replace(i, **nothing, accepted=False, reject_reason="noise", peak_contact_force_n=None) for i in results.impacts
    )
    return replace(results, loads=loads, impacts=impacts, calibration=None)


def test_results_without_any_value(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    session = replace(small[0], pre=None, post=None)
    text = Page(report(tmp_path, session, without_values(small[1]), truth=make_truth(small[1]))).text
    assert "No contact stiffness could be estimated" in text
    assert "No calibration of the strain gauge." in text
    assert "all taps rejected" in text
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_one_load_without_values_beside_a_good_one(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    session, results = small
    mixed = replace(results, loads=(results.loads[0], without_values(results).loads[1]))
    text = Page(report(tmp_path, session, mixed, truth=make_truth(results))).text
    assert "At 264.9" in text
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_empty_session(tmp_path: Path) -> None:
    session = Session(created="", rig=RigDescription(), impacts=())
    springs = (Estimate(math.nan, math.nan), Estimate(math.nan, math.nan))
    text = Page(report(tmp_path, session, SessionResults("", "era", (), (), None, springs), truth=[])).text
    assert "0 taps at 0 loads: 0 used, 0 rejected." in text
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_unknown_uncertainty_is_no_number(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    session, results = small
    lone = replace(
        results.loads[0], f2_hz=Estimate(1410.0, math.nan), contact_stiffness_n_per_m=Estimate(4e6, math.inf)
    )
    results = replace(results, loads=(lone, results.loads[1]))
    assert not re.search(r"\b(nan|inf|None)\b", Page(report(tmp_path, session, results)).text)
    written = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["loads"][0]
    assert written["f2_hz"] is None
    assert "f2_hz: the data give no finite 95 % interval" in written["notes"]


@pytest.mark.long
def test_same_input_gives_the_same_bytes(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_report(tmp_path / name, *small, THEORY)
    files = sorted(p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*") if p.is_file())
    assert len(files) == 12
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_settings_of_the_caller_do_not_show(small: tuple[Session, SessionResults]) -> None:
    import matplotlib as mpl

    plain = figures.inline_svg(figures.damping_figure(small[1]), "zeta", "label")
    with mpl.rc_context({"font.size": 20, "axes.facecolor": "red", "lines.linewidth": 9, "text.color": "red"}):
        styled = figures.inline_svg(figures.damping_figure(small[1]), "zeta", "label")
    assert styled == plain


ESTIMATES = ("load_mn", "f1_hz", "f2_hz", "zeta1", "zeta2", "contact_stiffness_n_per_m", "contact_damping_n_s_per_m")


def check_estimate(estimate: Any) -> None:
    assert estimate is None or set(estimate) == {"value", "low", "high"}
    if estimate is not None:
        assert all(isinstance(v, float) and math.isfinite(v) for v in estimate.values())
        assert estimate["low"] <= estimate["value"] <= estimate["high"]


def test_json_keeps_the_contract(session: tuple[Session, SessionResults]) -> None:
    mapping = json.loads(json_text(results_json(session[1])))
    assert mapping["format"] == "mesotap-results"
    assert mapping["version"] == 1
    assert (mapping["source"], mapping["method"], mapping["notes"]) == ("session.h5", "ml", [])
    assert (len(mapping["loads"]), len(mapping["impacts"])) == (8, 71)
    for load in mapping["loads"]:
        assert isinstance(load["load_set"], int)
        assert isinstance(load["impacts_used"], int)
        assert all(isinstance(note, str) for note in load["notes"])
        for quantity in ESTIMATES:
            check_estimate(load[quantity])
        assert len(load["along_decay"]) == 6
        for holder in (load["spectral_mode"], *load["along_decay"]):
            check_estimate(holder["frequency_hz"])
            check_estimate(holder["damping_ratio"])
        assert load["along_decay"][0]["amplitude_m_s2"] == 2.0
    for impact in mapping["impacts"]:
        assert re.fullmatch(r"\d{5}", impact["id"])
        assert isinstance(impact["accepted"], bool)
        assert isinstance(impact["reject_reason"], str)
        assert isinstance(impact["peak_acceleration_m_s2"], float)
        for quantity in ESTIMATES:
            check_estimate(impact[quantity])
    check_estimate(mapping["calibration"]["sensitivity_mv_per_mn"])
    assert mapping["calibration"]["drifted"] is False


def test_json_says_why_a_value_is_missing(small: tuple[Session, SessionResults]) -> None:
    bare = replace(without_values(small[1]), notes=())
    bare = replace(bare, loads=tuple(replace(load, notes=()) for load in bare.loads))
    mapping = results_json(bare)
    assert mapping["calibration"] is None
    assert all(load["f2_hz"] is None and load["notes"] for load in mapping["loads"])


def test_json_interval_is_the_estimates(small: tuple[Session, SessionResults]) -> None:
    estimate = small[1].loads[0].f2_hz
    assert estimate is not None
    written = results_json(small[1])["loads"][0]["f2_hz"]
    assert (written["value"], written["low"], written["high"]) == (estimate.value, estimate.low, estimate.high)


def test_csv_has_a_row_a_load_and_a_row_an_impact(written: Path) -> None:
    with (written / "results.csv").open(newline="", encoding="utf-8") as stream:
        loads = list(csv.DictReader(stream))
    with (written / "impacts.csv").open(newline="", encoding="utf-8") as stream:
        impacts = list(csv.DictReader(stream))
    assert [float(row["load_mn"]) for row in loads] == list(TABLE_5_MN)
    assert float(loads[0]["load_mn_low"]) < 264.9 < float(loads[0]["load_mn_high"])
    assert len(impacts) == 71
    assert {row["accepted"] for row in impacts} == {"0", "1"}
    assert any(row["f2_hz"] == "" for row in impacts)


@pytest.mark.parametrize(
    ("value", "half_width", "scale", "text"),
    [
        (7.0312e6, 0.012e6, 1e-6, "7.031 ± 0.012"),
        (264.9, 1.94, 1, "264.9 ± 1.9"),
        (0.0016, 0.00004, 100, "0.1600 ± 0.0040"),
        (12345.0, 1234.0, 1, "12300 ± 1200"),
        (1.0, 0.0996, 1, "1.00 ± 0.10"),
        (-0.001, 0.5, 1, "0.00 ± 0.50"),
        (5.89e10, 1e8, 1, "(5.890 ± 0.010) × 10¹⁰"),
        (2.5e-7, 5e-9, 1, "(2.500 ± 0.050) × 10⁻⁷"),
        (3.5, 0.0, 1, "3.5"),
    ],
)
def test_rounded_to_the_uncertainty(value: float, half_width: float, scale: float, text: str) -> None:
    assert with_uncertainty(Estimate(value, half_width / Estimate(0, 1).half_width), scale) == text


@given(
    st.floats(-1e12, 1e12, allow_nan=False),
    st.floats(1e-9, 1e9),
)
def test_rounding_loses_less_than_the_uncertainty(value: float, half_width: float) -> None:
    estimate = Estimate(value, half_width / Estimate(0, 1).half_width)
    text = with_uncertainty(estimate)
    if "±" not in text:
        assert half_width <= 2e-12 * abs(value)
        return
    digits, _, power = text.partition(" × 10")
    scale = 10.0 ** int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))) if power else 1.0
    shown, uncertainty = (float(part) * scale for part in digits.strip("()").split(" ± "))
    assert uncertainty == pytest.approx(half_width, rel=0.051)
    assert abs(shown - value) <= 0.051 * half_width + 1e-12 * abs(value)
    assert len(digits.strip("()").split(" ± ")[1].replace(".", "").strip("0")) <= 2


def test_unknown_numbers_are_dashes() -> None:
    assert with_uncertainty(None) == "–"
    assert with_uncertainty(Estimate(math.nan, 1.0)) == "–"
    assert with_uncertainty(Estimate(2.5, math.nan)) == "2.5 (interval unknown)"
    assert significant(None) == significant(math.inf) == "–"


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0.00"), (0.107, "0.107"), (9.999, "10.0"), (1234.5, "1230"), (5e9, "5.00 × 10⁹")]
)
def test_significant_digits(value: float, text: str) -> None:
    assert significant(value) == text


@dataclass
class Beam:
    data: NDArray[np.float64]
    rate_hz: float = 5000.0
    names: tuple[str, ...] = ("middle", "$tip$ <i>")
    unit: str = "m/s²"
    source: str = "beam.mat"


def beam() -> Beam:
    t = np.arange(20000) / 5000
    data = [
        np.exp(-3 * t) * np.sin(2 * np.pi * 160 * t) * a + np.exp(-6 * t) * np.sin(2 * np.pi * 580 * t) for a in (1, -2)
    ]
    return Beam(np.array(data))


def modes(*notes: str) -> RecordingModes:
    first = Mode(Estimate(160.0, 0.01), Estimate(0.003, 1e-5), (1.0, -2.0), shape=(-0.5, 1.0))
    second = Mode(Estimate(580.0, 0.02), Estimate(0.0016, 2e-5), (1.0, math.nan), shape=(1.0, 0.5j))
    return RecordingModes("beam.mat", "era", (first, second), notes)


def test_page_of_a_recording(tmp_path: Path) -> None:
    path = recording_report(tmp_path, beam(), modes("a <note>"))
    page = Page(path.read_text(encoding="utf-8"))
    assert {p.name for p in tmp_path.iterdir()} == {"report.html", "modes.json", "modes.pdf"}
    assert page.faults == page.open == []
    assert "160.000 ± 0.020" in page.text
    assert "$tip$ <i>" in page.text
    assert "a <note>" in page.text
    assert "Mode 1 2 1 1.00 0.32 2 0.32 1.00" in page.text  # (0.25 + 0.25) / (1.25 * 1.25)
    assert not re.search(r"https?:|\bnan\b", path.read_text(encoding="utf-8"))


@pytest.mark.usefixtures("undrawn")
def test_one_tap_at_one_load_is_one(small: tuple[Session, SessionResults], tmp_path: Path) -> None:
    session, results = small
    one = replace(results, loads=results.loads[:1], impacts=results.impacts[:1])
    text = Page(report(tmp_path, replace(session, impacts=session.impacts[:1]), one)).text
    assert "1 tap at 1 load:" in text


def test_shapes_have_signs_or_phases(tmp_path: Path) -> None:
    text = Page(recording_report(tmp_path, beam(), modes()).read_text(encoding="utf-8")).text
    assert re.search(r"160\.000 ± 0\.020 \S+ ± \S+ – −1\.00 2\.00 ", text)
    assert "1.00 ∠ 0° – " in text  # of the second channel no amplitude is known


def test_modes_with_most_points_are_followed(tmp_path: Path) -> None:
    counts = (3, 1, 6, 0, 5, 4, 2)
    found = tuple(
        Mode(Estimate(100.0 * n, 0.1), Estimate(0.003, 1e-5), (1.0, 1.0), follow(100.0 * n, 0.003, count))
        for n, count in enumerate(counts, start=1)
    )
    many = RecordingModes("beam.mat", "ml", found)
    assert [number for number, _ in figures.shown_modes(many)] == [1, 3, 5, 6]
    page = Page(recording_report(tmp_path, beam(), many).read_text(encoding="utf-8"))
    assert (tmp_path / "amplitude.pdf").exists()
    assert page.faults == page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert "the 4 with the most points of 5" in page.text
    written = json.loads((tmp_path / "modes.json").read_text(encoding="utf-8"))["modes"]
    assert [len(mode["along_decay"]) for mode in written] == list(counts)
    assert written[0]["along_decay"][0]["amplitude"] == 2.0


def test_page_of_a_recording_without_modes(tmp_path: Path) -> None:
    path = recording_report(tmp_path, Beam(np.zeros((2, 100))), RecordingModes("", "ml", (), ("too much noise",)))
    assert "No mode could be identified." in Page(path.read_text(encoding="utf-8")).text


def test_modes_json_keeps_the_contract() -> None:
    mapping = json.loads(json_text(modes_json(modes("why"))))
    assert (mapping["format"], mapping["version"], mapping["source"]) == ("mesotap-modes", 1, "beam.mat")
    assert mapping["notes"] == ["why"]
    for mode in mapping["modes"]:
        check_estimate(mode["frequency_hz"])
        check_estimate(mode["damping_ratio"])
    assert mapping["modes"][1]["amplitude"] == [1.0, None]
    assert mapping["modes"][1]["shape"] == [[1.0, 0.0], [0.0, 0.5]]
    assert np.array(mapping["mac"]) == pytest.approx(np.array([[1.0, 0.32], [0.32, 1.0]]))


def test_page_of_the_published_tables(tmp_path: Path) -> None:
    html = published_report(tmp_path, reanalyse()).read_text(encoding="utf-8")
    page = Page(html)
    assert {p.name for p in tmp_path.iterdir()} == {"report.html", "published.json", "table3.pdf", "table5.pdf"}
    assert page.faults == page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"https?:|\bnan\b", html)
    assert "264.9 1410 3.94" in page.text or "264.9 1410 3.95" in page.text
    assert json.loads((tmp_path / "published.json").read_text(encoding="utf-8"))["format"] == "mesotap-published"


@pytest.mark.parametrize(("suffix", "start"), [(".svg", b"<?xml"), (".pdf", b"%PDF"), (".png", b"\x89PNG")])
def test_figure_files(suffix: str, start: bytes, tmp_path: Path) -> None:
    stiffness = np.array([stiffness_of(f) for f in TABLE_5_HZ])
    figure = figures.published_figure(np.array(TABLE_5_MN), stiffness, THEORY)
    assert figures.save(figure, tmp_path / f"table5{suffix}").read_bytes().startswith(start)


def test_unknown_figure_format_is_refused(tmp_path: Path) -> None:
    figure = figures.published_figure(np.array([100.0]), np.array([1e6]), [])
    with pytest.raises(ValueError, match=r"\.svg, \.pdf or \.png"):
        figures.save(figure, tmp_path / "table5.bmp")


def test_at_most_four_spectra_with_both_ends(session: tuple[Session, SessionResults]) -> None:
    assert [load.load_set for load in figures.shown_spectra(session[1])] == [0, 2, 5, 7]


def test_dense_lines_keep_their_peaks() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(500_000) / 1e5
    data = rng.standard_normal((1, t.size))
    data[0, 123_456] = 50.0
    figure = figures.modes_figure(Beam(data, rate_hz=1e5), RecordingModes("", "ml", ()))
    drawn = np.asarray(figure.axes[0].get_lines()[0].get_ydata())
    assert drawn.size <= 3000
    assert drawn.max() == pytest.approx(50.0, abs=0.01)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("hardware", "said"),
    [
        (None, "Nobody kept count of what had to be repeated"),
        ((), "No request had to be repeated."),
        (
            (Repetition("stage <x>", "a question was asked again", 7, "2026-01-01T00:00:01Z", "2026-01-01T00:09:00Z"),),
            "stage <x> a question was asked again 7 2026-01-01 00:00:01 2026-01-01 00:09:00",
        ),
    ],
)
def test_how_the_hardware_behaved(
    small: tuple[Session, SessionResults], tmp_path: Path, hardware: tuple[Repetition, ...] | None, said: str
) -> None:
    session, results = small
    text = Page(report(tmp_path, replace(session, hardware=hardware), results)).text
    assert "How the hardware behaved" in text
    assert said in text


def test_impacts_of_nearly_the_same_load_share_a_label_in_the_map_of_the_residual():
    places, labels = load_ticks([0.2639, 0.2640, 0.2642, 0.345, 0.346, 0.926])
    assert (places, labels) == ([1.5, 4.0, 5.5], ["264", "346", "926"])


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((1.0000872, 0.99998, 1.00019), "1.00009 (0.99998 to 1.00019)"),
        ((0.2, 0.1, 0.4), "0.2000 (0.1000 to 0.4000)"),
        ((-5.21, -5.226, -5.193), "-5.210 (-5.226 to -5.193)"),
        ((1e17, 9.998e16, 1.0002e17), "1.00000 × 10¹⁷ (9.9980 × 10¹⁶ to 1.00020 × 10¹⁷)"),
        ((1200.0, 0.0, math.inf), "1200 (not determined by these data)"),
        ((2.0, 2.0, 2.0), "2.000 (2.000 to 2.000)"),
    ],
)
def test_as_many_digits_as_an_interval_leaves(numbers: tuple[float, float, float], text: str) -> None:
    assert with_ends(*numbers) == text
