"""What the page is told of each tap and load, against what the simulated rig truly is."""

from __future__ import annotations

import re

import numpy as np
import pytest

from daq.hits import is_left_out
from daq.session_file import read_session
from mesotap.console.analyst_process import Analyst, answers
from mesotap.console.board import Board
from mesotap.console.frames import taken
from mesotap.console.records import record_frame
from mesotap.console.session_people import tap_message
from mesotap.session.progress import assemble
from tests.mesotap.benches import header_of, new_runner, small_config
from tests.mesotap.console.test_board import BEGUN


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    config = small_config()
    folder, runner = new_runner(tmp_path_factory.mktemp("analyst") / "s", config)
    with folder:
        runner.run()
        return assemble(header_of(config), config, runner.progress, folder.impacts()), runner.progress.truths


@pytest.mark.slow
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


def test_what_a_choice_of_hits_leaves_out_is_told_and_what_the_hammer_shows(tmp_path):
    hammer = "rig.wiring.hammer={input: 3}"
    config = small_config(
        "mesotap.load_plan_mn=[400]", "mesotap.impacts_per_load=2", "mesotap.surplus_impacts=2", hammer
    )
    folder, runner = new_runner(tmp_path / "s", config)
    analyst = Analyst()
    board = Board(lambda part, frame: None, lambda frame: None)
    with folder:
        runner.run()
        recorded = folder.impacts()
        filed = assemble(header_of(config), config, runner.progress, recorded)
    begun = {"kind": "begun", "config": filed.config, "created": filed.created}
    board.hear({**BEGUN, "folder": str(tmp_path / "s"), "wanted": 4, "used": 2}, b"")
    list(answers(analyst, begun, b""))
    for impact in recorded:
        message, numbers = tap_message(impact)
        board.hear(message, numbers)
        for told in answers(analyst, message, numbers):
            board.hear(told, b"")
    assert (board.state["wanted"], board.state["used"]) == (4, 2)
    accepted = [impact for impact in recorded if impact.accepted]
    assert board.response["taps"] == len(accepted)
    assert board.response["load_set"] == 0
    assert min(c for c in board.response["coherence"][20:] if c is not None) > 0.5
    left = {i.number: i.reject_reason for i in filed.impacts if is_left_out(i)}
    assert len(left) == 2
    assert {n: t["left_out"] for n, t in board.taps.items() if t.get("left_out")} == left
    assert board.loads["loads"][0]["used"] == 2
    for impact in recorded:
        tap = board.taps[impact.number]
        assert tap["peak_force_n"] == pytest.approx(np.max(np.abs(impact.force - np.median(impact.force))))
        assert re.match(r"hammer [\d.]+ N, excites to \d+ Hz", tap["hammer"])
        drawn, numbers = taken(board.records[impact.number])
        shown = np.frombuffer(numbers, "<f4")
        n, bins = drawn["samples"], drawn["bins"]
        assert (drawn["forces"], shown.size) == (1, 3 * n + 2 * bins)
        force, spectrum = shown[2 * n + bins : 3 * n + bins], shown[3 * n + bins :]
        assert force.max() == pytest.approx(tap["peak_force_n"], rel=1e-5)
        line = round(1000 / drawn["bin_hz"])
        turns = np.exp(-2j * np.pi * line * drawn["bin_hz"] * np.arange(n) / impact.sample_rate_hz)
        assert spectrum[line] == pytest.approx(abs(np.sum(force * turns)) / impact.sample_rate_hz, rel=0.05)


def test_without_hammer_and_surplus_nothing_of_them_is_told(session):
    whole, _ = session
    analyst = Analyst()
    list(answers(analyst, {"kind": "begun", "config": whole.config, "created": whole.created}, b""))
    message, numbers = tap_message(whole.impacts[0])
    assert message["peak_force_n"] is None
    assert {m["kind"] for m in answers(analyst, message, numbers)} == {"modes", "results"}
    assert taken(record_frame(message, numbers))[0]["forces"] == 0
