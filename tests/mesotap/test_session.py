"""Whole sessions on the simulated rig: what comes out, and what happens when they are interrupted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from analysis.session import analyse_session
from daq.errors import RecordingError
from daq.journal import SessionFolder
from mesotap.bench import simulated_rig
from mesotap.config import parse_config
from mesotap.session.progress import assemble, progress_of
from mesotap.session.states import TRANSITIONS, Event, State, follow
from rig import RigError, SessionAborted
from tests.mesotap.benches import Watching, header_of, new_runner, runner_in, small_config


def analysed(config, folder):
    with SessionFolder.open(folder) as kept:
        progress = progress_of(kept.events())
        session = assemble(kept.header, config, progress, kept.shots())
    results = analyse_session(session, config.analysis, config.calibration, config.rig.masses, config.rig.springs)
    return session, results, progress


def test_every_state_is_left_and_the_last_is_reached():
    reached = {State.CONNECT}
    for _ in State:
        reached |= {after for state in reached for after in TRANSITIONS[state].values()}
    assert reached == set(State)
    assert all(TRANSITIONS[state] for state in State if state is not State.DONE)
    with pytest.raises(ValueError, match="'loaded' cannot happen while connecting"):
        follow(State.CONNECT, Event.LOADED)


@pytest.mark.slow
def test_a_session_recovers_itself(tmp_path):
    config = parse_config("")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    session, results, progress = analysed(config, tmp_path / "s")
    assert len(results.loads) == 8
    for load, truth in zip(results.loads, progress.truths, strict=True):
        assert load.impacts_used == 8
        assert load.f2_hz.value == pytest.approx(truth["f2_hz"], rel=5e-4)
        assert load.zeta2.value == pytest.approx(truth["zeta2"], rel=0.05)
        assert load.contact_stiffness_n_per_m.value == pytest.approx(truth["contact_stiffness_n_per_m"], rel=3e-3)
        assert load.load_mn.value == pytest.approx(truth["load_mn"], abs=1.0)
    rejected = [s for s in session.shots if not s.accepted]
    assert rejected, "the simulated operator never taps badly"
    assert all(s.reject_reason for s in rejected)


def test_the_same_seed_is_the_same_session_and_another_is_not(tmp_path):
    config = small_config()
    records = []
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        folder, runner = new_runner(tmp_path / name, config, simulated_rig(config, seed=seed))
        with folder:
            runner.run()
            records.append(np.concatenate([s.acceleration for s in folder.shots()], axis=1))
    assert np.array_equal(records[0], records[1])
    assert not np.array_equal(records[0], records[2])


class EndAt:
    """A control that ends the session at its n-th check."""

    def __init__(self, checks: int) -> None:
        self.left = checks

    def check(self, hold) -> None:
        hold()
        self.left -= 1
        if self.left == 0:
            raise SessionAborted("ended by the operator")


@pytest.mark.parametrize("checks", [1, 2, 3, 4, 5, 6, 7, 8, 10, 11])
def test_an_ended_session_is_safe_and_goes_on(tmp_path, checks):
    config = small_config()
    rig = simulated_rig(config)
    folder, runner = new_runner(tmp_path / "s", config, rig, control=EndAt(checks))
    with folder:
        with pytest.raises(SessionAborted):
            runner.run()
        assert rig.true_load_mn() == 0.0
        kept = {s.number: s.acceleration.tobytes() for s in folder.shots()}
        again = runner_in(folder, config, simulated_rig(config))
        again.run()
        shots = folder.shots()
    assert sum(s.accepted for s in shots) == 4
    assert [s.number for s in shots] == list(range(len(shots)))
    for number, record in kept.items():
        assert shots[number].acceleration.tobytes() == record


def test_a_session_is_ended_only_once(tmp_path):
    config = small_config()
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
        runner.finish()
        before = (tmp_path / "s" / "journal.jsonl").read_text()
        again = runner_in(folder, config, simulated_rig(config))
        assert again.run().state is State.DONE
        assert len(folder.shots()) == 4
    after = (tmp_path / "s" / "journal.jsonl").read_text()
    assert after.startswith(before)


def test_bad_taps_are_asked_for_again_up_to_a_limit(tmp_path):
    config = small_config(
        "sim_backend.bad_taps={double: 0, too_hard: 1, too_weak: 0, off_centre: 0, clipped: 0}",
        "mesotap.tries_per_load=3",
    )
    watching = Watching()
    folder, runner = new_runner(tmp_path / "s", config, observer=watching)
    with folder:
        with pytest.raises(RigError, match=r"load 300 mN: 3 taps gave \d good ones of 2"):
            runner.run()
        assert any(not s.accepted and "tap more gently" in s.reject_reason for s in folder.shots())


def test_taps_too_weak_to_be_felt_end_in_a_question_not_in_silence(tmp_path):
    config = small_config("daq.trigger.threshold_m_s2=50", "daq.trigger.timeout_s=1")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder, pytest.raises(RigError, match=r"[Nn]o tap"):
        runner.run()


def test_a_load_that_is_not_what_it_was_is_set_anew(tmp_path):
    config = small_config()
    folder, runner = new_runner(tmp_path / "s", config, control=Killed(8))
    with folder:
        with pytest.raises(KeyError):
            runner.run()
        assert progress_of(folder.events()).state is State.TAP
        rig = simulated_rig(config)
        restore = rig.restore
        rig.restore = lambda state: (restore(state), rig.stage.unlock(), rig.stage.move_by(-4.0))
        watching = Watching()
        with pytest.raises(KeyError):
            runner_in(folder, config, rig, control=Killed(2), observer=watching).run()
        assert any("is set anew" in text for _, text in watching.seen)


class Killed:
    """Stops the runner without giving it time to clean up, as a kill does."""

    def __init__(self, checks: int) -> None:
        self.left = checks

    def check(self, hold) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyError("killed")


@pytest.fixture(autouse=True)
def _no_cleaning_up_after_a_kill(monkeypatch):
    from mesotap.session.runner import SessionRunner

    leave = SessionRunner._leave_safely
    monkeypatch.setattr(
        SessionRunner, "_leave_safely", lambda self, error: None if isinstance(error, KeyError) else leave(self, error)
    )


def test_a_gauge_that_drifted_is_told_at_every_load(tmp_path):
    config = small_config("sim_backend.gauge.drift_mv_per_hour=8", "sim_backend.seed=3")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    _, results, progress = analysed(config, tmp_path / "s")
    assert results.calibration.drifted
    assert results.calibration.drift_p_value < 0.01
    for load, truth in zip(results.loads, progress.truths, strict=True):
        assert any("drifted" in note for note in load.notes)
        assert load.load_mn.low <= truth["load_mn"] <= load.load_mn.high


def test_a_session_turned_by_hand(tmp_path):
    config = small_config("sim_backend.stage.hand_turned=true", "mesotap.load_tolerance_mn=15")
    rig = simulated_rig(config)
    folder, runner = new_runner(tmp_path / "s", config, rig)
    with folder:
        runner.run()
        assert sum(s.accepted for s in folder.shots()) == 4
    assert rig.true_load_mn() == 0.0
    assert rig.peak_true_load_mn < config.rig.limits.load_mn


@pytest.mark.parametrize("law", ["hertz", "exponential"])
def test_a_session_on_a_nonlinear_contact_that_can_part(tmp_path, law):
    config = small_config(f"sim_backend.contact.law={law}", "sim_backend.contact.can_part=true")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    _, results, progress = analysed(config, tmp_path / "s")
    for load, truth in zip(results.loads, progress.truths, strict=True):
        assert load.f2_hz.value == pytest.approx(truth["f2_hz"], rel=0.05)


def test_k_c_from_theory_drives_the_simulated_rig(tmp_path):
    config = small_config("sim_backend.contact.stiffness=theory", "mesotap.load_plan_mn=[500]")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    truth = progress_of(runner._folder.events()).truths[0]
    _, results, _ = analysed(config, tmp_path / "s")
    assert results.loads[0].contact_stiffness_n_per_m.value == pytest.approx(
        truth["contact_stiffness_n_per_m"], rel=3e-3
    )


def test_a_folder_with_a_session_is_not_begun_again(tmp_path):
    config = small_config()
    SessionFolder.create(tmp_path / "s", header_of(config)).close()
    with pytest.raises(RecordingError, match="resume"):
        SessionFolder.create(tmp_path / "s", header_of(config))


def test_journal_entries_are_plain_json(tmp_path):
    config = small_config()
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    lines = (tmp_path / "s" / "journal.jsonl").read_text().splitlines()
    events = [json.loads(line)["event"] for line in lines]
    assert events[:4] == ["started", "connected", "calibrated", "contact"]
    assert events[-1] == "calibrated"
    assert events.count("shot") == 4
