"""No table of a page is wider than a screen of 1200 px or a sheet of A4."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calibration.estimate import Estimate
from tests.mesotap.report.test_report import make_session, make_truth, report

SCREEN_PX, SHEET_PX = 1200, 680  # 180 mm between the margins of A4
WIDER = "() => [...document.querySelectorAll('table')].filter(t => t.offsetWidth > t.parentElement.clientWidth + 1)"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    session, results = make_session(loads=2)
    next_to_none = Estimate(4e-8, 4.8e-7, 900)  # of the springs' damping, as the simulated rig has it
    loads = tuple(replace(load, zeta1=next_to_none) for load in results.loads)
    folder = tmp_path_factory.mktemp("page")
    report(folder, session, replace(results, loads=loads), truth=make_truth(results))
    return folder / "report.html"


@pytest.mark.long
@pytest.mark.parametrize(("media", "width"), [("screen", SCREEN_PX), ("print", SHEET_PX)])
def test_no_table_is_wider_than_its_page(written: Path, chromium: Any, media: Any, width: int) -> None:
    page = chromium.new_page(viewport={"width": width, "height": 900})
    page.goto(written.as_uri())
    page.emulate_media(media=media)
    assert page.evaluate(f"({WIDER})().map(t => t.caption.innerText.slice(0, 40))") == []
    page.close()


PLACES = """() => ['.summary p', '.trust', '.next', '.first figure'].map(
  s => document.querySelector(s).getBoundingClientRect()).map(r => [r.top, r.bottom])"""
LIGHTS = "() => [...document.querySelectorAll('.trust li')].map(l => l.getClientRects()[0].height)"
AXIS = "() => document.querySelector('.first svg').getBoundingClientRect().width"
LINE_PX = 32
FACE_PX = 300


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize(("width", "height"), [(390, 844), (1200, 900)])
@pytest.mark.parametrize("drifted", [False, True])
def test_the_first_screen_shows_stiffness_lights_and_what_to_do(
    tmp_path: Path, chromium: Any, width: int, height: int, drifted: bool, dark: bool
) -> None:
    session, results = make_session(loads=8)
    assert results.calibration is not None
    results = replace(results, calibration=replace(results.calibration, drifted=drifted))
    report(tmp_path, session, results, truth=make_truth(results))
    page = chromium.new_page(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light")
    page.goto((tmp_path / "report.html").as_uri())
    found, lights, then, figure = page.evaluate(PLACES)
    assert found[1] <= min(lights[0], figure[0])
    assert lights[1] <= then[0]
    assert max(then[1], figure[1]) <= height
    assert max(page.evaluate(LIGHTS)) <= LINE_PX
    assert page.evaluate(AXIS) > FACE_PX
    page.close()
