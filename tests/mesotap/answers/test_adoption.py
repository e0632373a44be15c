"""Diagnoses that somebody has edited before they are adopted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from daq.errors import RecordingError
from mesotap.answers.adoption import read_diagnosis

MECHANISM = {"id": "hertz_stiffness", "where": "contact", "parameters": {}}


def edited(folder: Path, mechanisms: list[Any], loads: tuple[float, ...]) -> Path:
    contact = {"contact_stiffness_n_per_m": {"value": 4e6}, "damping_ratio": {"value": 0.01}}
    path = folder / "diagnosis.json"
    content = {
        "format": "mesotap-diagnosis",
        "version": 1,
        "mechanisms": mechanisms,
        "adopted": {"loads": [{"load_mn": load, **contact} for load in loads], "rig": {}},
    }
    path.write_text(json.dumps(content))
    return path


def test_loads_are_adopted_in_their_order(tmp_path: Path) -> None:
    model = read_diagnosis(edited(tmp_path, [MECHANISM], (400.0, 200.0)))
    assert [p.load_mn for p in model.loads] == [200.0, 400.0]


@pytest.mark.parametrize(
    ("mechanisms", "loads", "said"),
    [
        ([MECHANISM, MECHANISM], (200.0,), "names hertz_stiffness twice"),
        ([MECHANISM], (200.0, 400.0, 200.0), "tells of the load 200 mN twice"),
        ([MECHANISM], (200.0, -400.0), "tells of a load of -400 mN"),
        ([MECHANISM], (0.0,), "tells of a load of 0 mN"),
    ],
)
def test_what_no_diagnosis_says_is_refused(
    mechanisms: list[Any], loads: tuple[float, ...], said: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match=said) as error:
        read_diagnosis(edited(tmp_path, mechanisms, loads))
    assert str(error.value).startswith(f"{tmp_path / 'diagnosis.json'}: ")
