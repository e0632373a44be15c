"""Whole sessions on the simulated rig: what comes out, and what happens when they are interrupted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from analysis.session import analyse_session
from daq.errors import RecordingError
from daq.journal import SessionFolder
from mesotap.configuration.config import parse_config
from mesotap.session.bench import simulated_rig
from mesotap.session.progress import assemble, progress_of
from mesotap.session.states import TRANSITIONS, Event, State, follow
from rig import RigError, SessionAborted
from tests.mesotap.benches import Watching, header_of, new_runner, runner_in, small_config


def analysed(config, folder):
    with SessionFolder.open(folder) as kept:
        progress = progress_of(kept.events())
        session = assemble(kept.header, config, progress, kept.impacts())
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
    rejected = [s for s in session.impacts if not s.accepted]
    assert rejected, "the simulated operator never taps badly"
    assert all(s.reject_reason for s in rejected)


def test_the_gauge_is_read_without_load_between_loads_where_that_is_asked_for(tmp_path):
    config = small_config("calibration.zero_every_loads=1", "sim_backend.gauge.drift_mv_per_hour=0.4")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    session, results, progress = analysed(config, tmp_path / "s")
    assert len(session.zeros) == len(progress.zeros) == 1
    assert session.impacts[0].time < session.zeros[0].time < session.impacts[-1].time
    assert results.calibration.zero_readings == 1
    for points in (session.pre, session.post):  # times of the readings, through the journal
        assert points.elapsed_s[0] == 0.0
        assert np.all(np.diff(points.elapsed_s) >= config.calibration.averaging_s)
    for load, truth in zip(results.loads, progress.truths, strict=True):
        assert load.load_mn.low < truth["load_mn"] < load.load_mn.high


def test_the_same_seed_is_the_same_session_and_another_is_not(tmp_path):
    config = small_config()
    records = []
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        folder, runner = new_runner(tmp_path / name, config, simulated_rig(config, seed=seed))
        with folder:
            runner.run()
            records.append(np.concatenate([s.acceleration for s in folder.impacts()], axis=1))
    assert np.array_equal(records[0], records[1])
    assert not np.array_equal(records[0], records[2])


class Interrupt:
    """A control that raises at its n-th check within a state; give it the runner once that is made."""

    def __init__(self, error: BaseException, state: State, nth: int = 1) -> None:
        self.error, self.state, self.left = error, state, nth
        self.runner = None

    def check(self, hold) -> None:
        if hold is not None:
            hold()
        if self.runner is not None and self.runner.progress.state is self.state:
            self.left -= 1
            if self.left == 0:
                raise self.error


def test_the_gauge_is_read_without_load_before_an_interrupted_session_goes_on(tmp_path):
    config = small_config()
    control = Interrupt(SessionAborted("ended by the operator"), State.TAP, 2)
    folder, control.runner = new_runner(tmp_path / "s", config, control=control)
    with folder, pytest.raises(SessionAborted):
        control.runner.run()
    with SessionFolder.open(tmp_path / "s") as again:
        assert not progress_of(again.events()).zeros
        runner_in(again, config, simulated_rig(config)).run()
    assert len(analysed(config, tmp_path / "s")[0].zeros) == 1


RUNNING = [
    (State.PRE_CALIBRATION, 1),
    (State.PRE_CALIBRATION, 3),
    (State.APPROACH, 1),
    (State.APPROACH, 40),
    (State.SET_LOAD, 2),
    (State.LOCK, 3),
    (State.TAP, 1),
    (State.TAP, 2),
    (State.RETRACT, 1),
    (State.POST_CALIBRATION, 2),
]


@pytest.mark.parametrize(("state", "nth"), RUNNING, ids=lambda x: getattr(x, "name", x))
def test_an_ended_session_is_safe_and_goes_on(tmp_path, state, nth):
    config = small_config()
    rig = simulated_rig(config)
    control = Interrupt(SessionAborted("ended by the operator"), state, nth)
    folder, runner = new_runner(tmp_path / "s", config, rig, control=control)
    control.runner = runner
    with folder:
        with pytest.raises(SessionAborted) as ended:
            runner.run()
        assert any("surfaces are apart" in note for note in ended.value.__notes__)
        assert rig.true_load_mn() == 0.0
        kept = {s.number: s.acceleration.tobytes() for s in folder.impacts()}
        again = runner_in(folder, config, simulated_rig(config))
        again.run()
        impacts = folder.impacts()
    assert sum(s.accepted for s in impacts) == 4
    assert [s.number for s in impacts] == list(range(len(impacts)))
    for number, record in kept.items():
        assert impacts[number].acceleration.tobytes() == record


def killed_while_tapping(tmp_path, config) -> SessionFolder:
    """A session whose program died between taps, the load still on."""
    control = Interrupt(KeyError("killed"), State.TAP, 75)  # between the first tap and the second
    folder, runner = new_runner(tmp_path / "s", config, control=control)
    control.runner = runner
    with pytest.raises(KeyError):
        runner.run()
    assert progress_of(folder.events()).state is State.TAP
    return folder


def test_an_interrupt_while_connecting_again_is_safe_too(tmp_path):
    config = small_config()
    with killed_while_tapping(tmp_path, config) as folder:
        rig = simulated_rig(config)
        restore, count = rig.restore, 0

        def interrupted(state):
            nonlocal count
            restore(state)
            count += 1
            if count == 2:
                raise SessionAborted("Ctrl-C")

        rig.restore = interrupted
        with pytest.raises(SessionAborted):
            runner_in(folder, config, rig).run()
        assert rig.true_load_mn() == 0.0
        assert folder.events()[-1]["event"] == "safe"
        runner_in(folder, config, simulated_rig(config)).run()
        assert sum(s.accepted for s in folder.impacts()) == 4


def test_a_stage_that_did_not_retract_is_told(tmp_path):
    config = small_config()
    with killed_while_tapping(tmp_path, config) as folder:
        rig = simulated_rig(config)
        rig.stage.retract = lambda travel_um, aim="": rig.stage.read()
        control = Interrupt(SessionAborted("ended"), State.TAP)
        runner = runner_in(folder, config, rig, control=control)
        control.runner = runner
        with pytest.raises(SessionAborted) as ended:
            runner.run()
        assert any("still shows" in note for note in ended.value.__notes__)
        assert not any("are apart;" in note for note in ended.value.__notes__)
        assert progress_of(folder.events()).contact is not None


def test_a_impact_recorded_just_before_the_end_does_not_undo_the_safe_state(tmp_path):
    config = small_config()
    with killed_while_tapping(tmp_path, config) as folder:
        entries = folder.events()
        impact = max(i for i, e in enumerate(entries) if e["event"] == "shot")
        checkpoint = entries[impact]["rig"]
        journal = folder.path / "journal.jsonl"
    lines = journal.read_text().splitlines()
    safe = json.dumps({"event": "safe", "troubles": [], "rig": {**checkpoint, "stage": RETRACTED}})
    journal.write_text("\n".join([*lines[:impact], safe]) + "\n")
    with SessionFolder.open(tmp_path / "s") as folder:
        runner_in(folder, config, simulated_rig(config)).run()
        assert sum(s.accepted for s in folder.impacts()) == 4


RETRACTED = {"knob_um": 50.0, "carriage_um": 50.0, "locked": False}


def test_a_plan_that_goes_down_and_up_again(tmp_path):
    config = small_config("mesotap.load_plan_mn=[900, 300, 600, 300]", "mesotap.impacts_per_load=1")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
        loads = [s.load_before_mn for s in folder.impacts() if s.accepted]
    assert loads == pytest.approx([900, 300, 600, 300], abs=10)


def test_a_impact_file_that_is_gone_stops_everything(tmp_path):
    config = small_config()
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
        (tmp_path / "s" / "shots" / "00001.h5").unlink()
        with pytest.raises(RecordingError, match="impact 00001"):
            runner_in(folder, config, simulated_rig(config))


def test_damped_tube_springs_do_not_count_as_contact_damping(tmp_path):
    config = small_config("sim_backend.tube_damping_ratio=0.003", "mesotap.load_plan_mn=[500, 800]")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
    _, results, progress = analysed(config, tmp_path / "s")
    assert any("zeta1" in note for note in results.notes)
    for load, truth in zip(results.loads, progress.truths, strict=True):
        true = truth["contact_damping_n_s_per_m"]
        assert load.contact_damping_n_s_per_m.low <= true <= load.contact_damping_n_s_per_m.high
        assert load.contact_damping_n_s_per_m.value == pytest.approx(true, rel=0.1)


def test_a_session_is_ended_only_once(tmp_path):
    config = small_config()
    folder, runner = new_runner(tmp_path / "s", config)
    with folder:
        runner.run()
        runner.finish()
        before = (tmp_path / "s" / "journal.jsonl").read_text()
        again = runner_in(folder, config, simulated_rig(config))
        assert again.run().state is State.DONE
        assert len(folder.impacts()) == 4
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
        assert any(not s.accepted and "tap more gently" in s.reject_reason for s in folder.impacts())


def test_taps_too_weak_to_be_felt_end_in_a_question_not_in_silence(tmp_path):
    config = small_config("daq.trigger.threshold_m_s2=50", "daq.trigger.timeout_s=1")
    folder, runner = new_runner(tmp_path / "s", config)
    with folder, pytest.raises(RigError, match=r"[Nn]o tap"):
        runner.run()


def test_a_load_that_is_not_what_it_was_is_set_anew(tmp_path):
    config = small_config()
    with killed_while_tapping(tmp_path, config) as folder:
        rig = simulated_rig(config)
        restore = rig.restore
        rig.restore = lambda state: (restore(state), rig.stage.unlock(), rig.stage.move_by(-4.0))
        watching = Watching()
        control = Interrupt(KeyError("killed"), State.APPROACH)
        runner = runner_in(folder, config, rig, control=control, observer=watching)
        control.runner = runner
        with pytest.raises(KeyError):
            runner.run()
        assert any("is set anew" in text for _, text in watching.seen)


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
    config = small_config("rig.parts.stage=hand", "mesotap.load_tolerance_mn=15")
    rig = simulated_rig(config)
    folder, runner = new_runner(tmp_path / "s", config, rig)
    with folder:
        runner.run()
        assert sum(s.accepted for s in folder.impacts()) == 4
    assert rig.true_load_mn() == 0.0
    assert rig.peak_true_load_mn < config.rig.limits.load_mn


@pytest.mark.parametrize("law", ["hertz_stiffness", "rough_surface_stiffness"])
def test_a_session_on_a_nonlinear_contact_that_can_part(tmp_path, law):
    config = small_config(f"sim_backend.mechanisms=[{{id: {law}}}, {{id: contact_loss}}]")
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
