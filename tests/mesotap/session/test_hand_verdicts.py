"""Taps accepted and rejected by hand: kept, counted, and known to whoever resumes."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import pytest

from analysis.session import analyse_session
from daq.journal import SessionFolder
from mesotap.answers.results_files import impacts_csv, results_json
from mesotap.session.hand_verdicts import HandVerdict, with_hand_verdicts
from mesotap.session.recovery import recover
from mesotap.session.runner import Bench, SessionRunner
from mesotap.session.states import State
from rig import SessionAborted
from sim_backend.rig import SimulatedRig
from tests.mesotap.benches import Silent, Watching, header_of, simulated_rig, small_config


class Verdicts:
    """Rejects the first tap after the second one has come, and ends the session after ``ends`` taps."""

    def __init__(self, ends: int = 1000) -> None:
        self.watching, self.ends, self.given = Watching(), ends, False

    def check(self, hold) -> None:
        if len(self.watching.impacts) >= self.ends:
            raise SessionAborted("that is enough")

    def take(self) -> list[HandVerdict]:
        if self.watching.impacts and not self.given:
            self.given = True
            return [HandVerdict(self.watching.impacts[0].number, False, "somebody leaned on the table")]
        return []


def run(folder: SessionFolder, config, verdicts: Verdicts, rig: SimulatedRig) -> SessionRunner:
    bench = Bench(rig, Silent(), verdicts.watching, verdicts, verdicts=verdicts.take)
    runner = SessionRunner(config, folder, bench)
    runner.run()
    return runner


def test_a_tap_rejected_by_hand_is_made_up_for(tmp_path):
    config = small_config()
    with SessionFolder.create(tmp_path / "s", header_of(config)) as folder:
        runner = run(folder, config, Verdicts(), simulated_rig(config))
        assert runner.progress.state is State.FILE
        impacts = with_hand_verdicts(folder.impacts(), folder.events())
    assert [i.load_set for i in impacts if i.accepted] == [0, 0, 1, 1]
    (rejected,) = [i for i in impacts if not i.accepted]
    assert rejected.reject_reason == "by hand: somebody leaned on the table"


class AtLast(Verdicts):
    """Rejects the first tap while the session already ends."""

    def take(self) -> list[HandVerdict]:
        return super().take() if len(self.watching.impacts) >= self.ends else []


def test_a_verdict_given_while_the_session_ends_is_kept(tmp_path):
    config = small_config()
    with SessionFolder.create(tmp_path / "s", header_of(config)) as folder, pytest.raises(SessionAborted):
        run(folder, config, AtLast(ends=2), simulated_rig(config))
    assert [i.accepted for i in recover(tmp_path / "s").session.impacts] == [False, True]


def test_the_reason_of_a_tap_accepted_by_hand_is_among_the_results(tmp_path):
    config = small_config()
    with SessionFolder.create(tmp_path / "s", header_of(config)) as folder:
        run(folder, config, Verdicts(), simulated_rig(config))
        kept = recover(tmp_path / "s").session
    overruled = {"hand_reason": "the second impact is small", "overruled": "a second impact came"}
    impacts = (*kept.impacts[:1], replace(kept.impacts[1], extra=overruled), *kept.impacts[2:])
    session, words = replace(kept, impacts=impacts), "accepted by hand: the second impact is small"
    results = analyse_session(session, config.analysis, config.calibration, config.rig.masses, config.rig.springs)
    rows = list(csv.DictReader(io.StringIO(impacts_csv(results))))
    assert [words in row["notes"] for row in rows] == [i.number == 1 for i in impacts]
    assert rows[1]["reject_reason"] == ""
    told = results_json(results)["impacts"]
    assert [any(words in note for note in i["notes"]) for i in told] == [i.number == 1 for i in impacts]


def test_a_verdict_by_hand_survives_an_end_and_recovery(tmp_path):
    config = small_config()
    with SessionFolder.create(tmp_path / "s", header_of(config)) as folder, pytest.raises(SessionAborted):
        run(folder, config, Verdicts(ends=2), simulated_rig(config))
    kept = recover(tmp_path / "s").session
    assert [i.accepted for i in kept.impacts] == [False, True]
    with SessionFolder.open(tmp_path / "s") as folder:
        runner = SessionRunner(config, folder, Bench(simulated_rig(config), Silent(), Watching(), Verdicts()))
        runner.run()
        impacts = with_hand_verdicts(folder.impacts(), folder.events())
    assert [i.load_set for i in impacts if i.accepted] == [0, 0, 1, 1]
    assert not impacts[0].accepted
