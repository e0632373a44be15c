"""``mesotap analyze A --mac B``: modes of two recordings beside each other, by shapes that were put in."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.mesotap.test_cli import mesotap, refused

FREQUENCIES_HZ = (90.0, 250.0, 400.0)
SHAPES = np.array([[1.0, 0.5, 1.0], [2.0, 0.4, -1.0], [3.0, -1.0, 0.5]])  # a column a mode


def recording(file: Path, names: str, shapes: np.ndarray, frequencies=FREQUENCIES_HZ, seed: int = 1) -> Path:
    t = np.arange(1600) / 1600
    tones = [np.exp(-2 * np.pi * f * 0.008 * t) * np.sin(2 * np.pi * f * t) for f in frequencies]
    data = shapes @ np.array(tones) + 1e-3 * np.random.default_rng(seed).standard_normal((len(shapes), t.size))
    header = f"time [s],{names}"
    np.savetxt(file, np.column_stack([t, data.T]), delimiter=",", header=header, comments="")
    return file


def by_definition(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.array([[abs(a @ b) ** 2 / ((a @ a) * (b @ b)) for b in second.T] for a in first.T])


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("mac")
    first = recording(folder / "a.csv", "tip,mid,root", SHAPES)
    # another day: channels in another order, the modes a little lower, the two upper ones having changed places
    turned = SHAPES[[2, 0, 1]][:, [0, 2, 1]]
    return first, recording(folder / "b.csv", "root,tip,mid", turned, (88.0, 246.0, 391.0), seed=2)


@pytest.mark.slow
def test_modes_are_recognised_by_shape_whatever_the_order_of_channels(pair, tmp_path: Path) -> None:
    first, second = pair
    said = mesotap("analyze", first, "--mac", second, "--json", tmp_path / "a.json", "--report", tmp_path / "page")
    assert f"- a row a mode of {first}, a column a mode of {second}\n" in said.stdout
    assert "in their order" not in said.stdout
    answer = json.loads((tmp_path / "a.json").read_text())
    found = answer["mac_with"]
    assert found["channels"] == [["tip", "tip"], ["mid", "mid"], ["root", "root"]]
    assert found["frequency_hz"] == pytest.approx([88.0, 246.0, 391.0], rel=1e-3)
    expected = by_definition(SHAPES, SHAPES[:, [0, 2, 1]])
    assert np.array(found["mac"]) == pytest.approx(expected, abs=0.01)
    assert json.loads((tmp_path / "page" / "modes.json").read_text())["mac_with"] == found
    page = (tmp_path / "page" / "report.html").read_text()
    shown = page[page.index('id="beside"') :]
    rows = [row.split("<td>")[2:] for row in shown[: shown.index("</table>")].split("<tr>")[2:]]
    assert [[float(cell.split("<")[0]) for cell in row] for row in rows] == np.round(expected, 2).tolist()


def test_other_names_are_compared_in_their_order_and_that_is_said(pair, tmp_path: Path) -> None:
    other = recording(tmp_path / "c.csv", "x,y,z", SHAPES, seed=3)
    said = mesotap("analyze", pair[0], "--mac", other, "--json", tmp_path / "a.json").stdout
    assert "channels are compared in their order: tip with x, mid with y, root with z" in said
    found = json.loads((tmp_path / "a.json").read_text())["mac_with"]
    assert np.diag(found["mac"]) == pytest.approx(np.ones(3), abs=0.01)


@pytest.mark.slow
def test_one_channel_says_nothing_of_shapes(pair, tmp_path: Path) -> None:
    single = recording(tmp_path / "one.csv", "tip", SHAPES[:1])
    said = mesotap("analyze", single, "--json", tmp_path / "one.json", "--report", tmp_path / "page").stdout
    assert "there is one channel: shapes and MPC, which are between channels, say nothing" in said
    answer = json.loads((tmp_path / "one.json").read_text())
    assert {mode["mpc"] for mode in answer["modes"]} == {None}
    assert "of one channel it says nothing" in (tmp_path / "page" / "report.html").read_text()
    assert "has one channel, over which all shapes are the same" in refused("analyze", single, "--mac", single)
    assert "has 1 channels and" in refused("analyze", pair[0], "--mac", single)
