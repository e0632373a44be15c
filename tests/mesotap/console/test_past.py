"""The list of past sessions: what is said of each, and what they are compared by."""

from __future__ import annotations

import json

import pytest

from daq.journal import SessionFolder
from mesotap.catalogue.folders import goes_on
from mesotap.console.past import results_of, sessions_in
from mesotap.session.progress import Progress
from mesotap.session.states import State
from tests.mesotap.benches import header_of, small_config


def estimate(value: float, half: float) -> dict[str, float]:
    return {"value": value, "low": value - half, "high": value + half}


@pytest.mark.parametrize("calibration", [{"drifted": True}, {"drifted": False}, None, "damaged"])
def test_a_session_whose_gauge_drifted_is_marked(tmp_path, calibration):
    SessionFolder.create(tmp_path / "s", header_of(small_config())).close()
    load = {
        "target_load_mn": 300.0,
        "load_mn": estimate(341.0, 4.0),
        "contact_stiffness_n_per_m": estimate(5e6, 1e4),
        "zeta2": estimate(0.01, 1e-4),
    }
    (tmp_path / "s" / "results.json").write_text(json.dumps({"loads": [load], "calibration": calibration}))
    (session,) = sessions_in(tmp_path)
    assert session.summary["drifted"] is (calibration == {"drifted": True})
    (told,) = results_of(session)
    assert (told["target_mn"], told["load_mn"], told["load_half_mn"]) == (300.0, 341.0, 4.0)


def test_a_session_without_results_has_not_drifted(tmp_path):
    SessionFolder.create(tmp_path / "s", header_of(small_config())).close()
    (session,) = sessions_in(tmp_path)
    assert session.summary["drifted"] is False
    assert results_of(session) == []


def test_a_session_that_has_ended_says_where_it_goes_on():
    assert goes_on(Progress(state=State.DONE)) == ""
    assert goes_on(Progress(state=State.APPROACH, load_set=1)) == "goes on at step 2 of the load plan (approaching)"
    assert goes_on(Progress(state=State.CONNECT)) == "goes on with connecting"
