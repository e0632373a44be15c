"""What the page is told of each tap and load, against what the simulated rig truly is."""

from __future__ import annotations

import pytest

from daq.session_file import read_session
from mesotap.console.analyst_process import Analyst, answers
from mesotap.console.session_people import tap_message
from mesotap.session.progress import assemble
from tests.mesotap.benches import header_of, new_runner, small_config


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    config = small_config()
    folder, runner = new_runner(tmp_path_factory.mktemp("analyst") / "s", config)
    with folder:
        runner.run()
        return assemble(header_of(config), config, runner.progress, folder.impacts()), runner.progress.truths


def test_each_tap_is_told_alone_and_with_its_load(session, tmp_path):
    whole, truths = session
    analyst = Analyst()
    theory = list(answers(analyst, {"kind": "begun", "config": whole.config, "created": whole.created}, b""))
    assert theory[0]["curves"]
    points = [list(pair) for pair in zip(whole.pre.load_mn.tolist(), whole.pre.voltage_mv.tolist(), strict=True)]
    assert not list(answers(analyst, {"kind": "points", "when": "before", "points": points}, b""))
    for impact in whole.impacts:
        told = list(answers(analyst, *tap_message(impact)))
        truth = truths[impact.load_set]
        assert (told[0]["kind"], told[0]["number"]) == ("modes", impact.number)
        assert told[0]["modes"]["f2_hz"]["value"] == pytest.approx(truth["f2_hz"], rel=0.005)
        assert told[0]["modes"]["k_c"]["value"] == pytest.approx(truth["contact_stiffness_n_per_m"], rel=0.03)
        assert told[-1]["loads"][-1]["load_set"] == impact.load_set
    rejected = {"kind": "judged", "number": 0, "accepted": False, "reason": "a draught"}
    outcome = list(answers(analyst, rejected, b""))[-1]
    assert [load["used"] for load in outcome["loads"]] == [1, 2]
    (written,) = answers(analyst, {"kind": "snapshot", "path": str(tmp_path / "so-far.h5")}, b"")
    kept = read_session(written["path"])
    assert [i.reject_reason for i in kept.impacts] == ["by hand: a draught", "", "", ""]


@pytest.mark.parametrize(("stretched", "drifted"), [(1.0, False), (1.05, True)])
def test_before_and_after_are_compared_once_both_are_there(session, stretched, drifted):
    whole, _ = session
    analyst = Analyst()
    list(answers(analyst, {"kind": "begun", "config": whole.config, "created": whole.created}, b""))
    points = [list(pair) for pair in zip(whole.pre.load_mn.tolist(), whole.pre.voltage_mv.tolist(), strict=True)]
    after = [[load, stretched * voltage] for load, voltage in points]
    assert not list(answers(analyst, {"kind": "points", "when": "before", "points": points}, b""))
    for point in after[:-1]:
        assert not list(answers(analyst, {"kind": "points", "when": "after", "points": [point]}, b""))
    (told,) = answers(analyst, {"kind": "points", "when": "after", "points": after[-1:]}, b"")
    assert (told["kind"], told["drifted"]) == ("compared", drifted)
    assert f"({100 * (stretched - 1):+.2f} %)" in told["statement"]
