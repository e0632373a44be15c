"""Diagnoses that somebody has edited before they are adopted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from daq.errors import RecordingError
from mesotap.answers.adoption import read_diagnosis, with_model, write_adopted
from mesotap.configuration.config import ConfigError, load_config

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


@pytest.mark.parametrize(("body", "place"), [("upper mass", (0,)), ("lower mass", (1,))])
def test_a_part_is_simulated_on_the_body_that_it_was_found_on(
    body: str, place: tuple[int, ...], tmp_path: Path
) -> None:
    values = {"attached_mass_kg": 5e-4, "mount_stiffness_n_per_m": 2e5, "mount_damping_n_s_per_m": 0.2}
    parameters = {name: {"value": value} for name, value in values.items()}
    part = {"id": "attached_mass", "where": "lower mass", "element": body, "parameters": parameters}
    config = with_model(load_config(None), read_diagnosis(edited(tmp_path, [MECHANISM, part], (200.0, 400.0))))
    write_adopted(tmp_path / "adopted.yaml", config)
    _, simulated = load_config(tmp_path / "adopted.yaml").sim_backend.mechanisms
    assert simulated.adopted().place == place


def test_a_place_where_a_mechanism_cannot_act_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text("sim_backend: {mechanisms: [{id: hertz_stiffness, at: upper mass}]}")
    with pytest.raises(ConfigError, match="hertz_stiffness cannot act at 'upper mass', only at: contact"):
        load_config(config)


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
