"""The verdict in words."""

from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console

from analysis.mismatch.answer import NextExperiment, Remainder, SetAside
from mesotap.answers.diagnosis_json import diagnosis_json
from mesotap.answers.diagnosis_text import next_words, print_answer, verdict_sentence
from tests.mesotap.answers.made import ANSWER, HERE, LEARNED, NAMED

LEFT = Remainder(0.03, 120.0, 1e-6, HERE, "3 % is left.")


def test_the_verdict_names_what_is_left_out_with_its_probability() -> None:
    said = verdict_sentence(ANSWER)
    assert "it leaves out hunt crossley damping, with a probability of 0.98" in said
    assert "nothing is left beyond noise (p = 0.4)" in said


def test_a_remainder_beyond_noise_is_in_the_verdict() -> None:
    said = verdict_sentence(replace(ANSWER, remainder=LEFT))
    assert "explains 97 % of what is missing; something small remains in the lower mass at 4.1 kHz" in said


def test_recordings_without_loads_are_not_counted_as_impacts() -> None:
    said = verdict_sentence(replace(ANSWER, rig="beam", loads_n={}))
    assert said.startswith("The rig as described does not explain these recordings")


def test_a_rig_that_is_far_off_is_to_be_checked() -> None:
    assert "check its stiffness and mass" in verdict_sentence(replace(ANSWER, rig="beam", far_off=True))


def test_what_has_no_name_is_told_with_its_place() -> None:
    said = verdict_sentence(replace(ANSWER, verdict="unexplained", mechanisms=()))
    assert said.endswith("and no mechanism listed does; it lies in the lower mass at 4.1 kHz.")


def test_a_drifting_load_cell_leaves_the_loads_in_doubt() -> None:
    drift = replace(NAMED, id="load_drift", where="load cell")
    assert "the load cell drifted" in verdict_sentence(replace(ANSWER, mechanisms=(drift,)))


def test_a_learned_law_is_told_as_one() -> None:
    said = verdict_sentence(replace(ANSWER, verdict="new_physics", mechanisms=(LEARNED,)))
    assert "law in the contact (a law learned from these recordings)" in said


def test_the_terminal_shows_the_runner_up_and_the_limits() -> None:
    shown = Console(file=io.StringIO(), width=200)
    print_answer(ANSWER, shown)
    text = shown.file.getvalue()  # type: ignore[attr-defined]
    assert all(word in text for word in ("squeeze_film", "micro_slip", "104 mN", "last: 0.02 m/s2"))


def test_what_no_force_takes_away_is_not_called_small() -> None:
    said = verdict_sentence(replace(ANSWER, remainder=Remainder(0.0, 0.0, 1e-6, HERE, "Something is left.")))
    assert "something else remains in the lower mass at 4.1 kHz" in said
    assert "small" not in said


def test_a_tap_that_was_set_aside_is_told_in_words_and_to_programs() -> None:
    assert "set aside" not in verdict_sentence(ANSWER)
    assert "set_aside" not in diagnosis_json(ANSWER, 1.0)
    off = SetAside("00014", "796 mN", "Tap 15 (at 796 mN) was off centre.")
    answer = replace(ANSWER, set_aside=(off,))
    assert verdict_sentence(answer).endswith("One tap shows what no other does and is set aside.")
    two = replace(ANSWER, set_aside=(off, off))
    assert verdict_sentence(two).endswith("2 taps show what no other does and are set aside.")
    shown = Console(file=io.StringIO(), width=200)
    print_answer(answer, shown)
    assert "set aside: Tap 15 (at 796 mN) was off centre." in shown.file.getvalue()  # type: ignore[attr-defined]
    said = [{"segment": "00014", "group": "796 mN", "statement": off.statement}]
    assert diagnosis_json(answer, 1.0)["set_aside"] == said


def test_the_next_recording_is_asked_for_in_a_sentence() -> None:
    assert ANSWER.next_experiment is not None
    assert next_words(ANSWER, ANSWER.next_experiment) == "tap with 0.50 of the load at 104 mN to tell a from b."
    stronger = NextExperiment(None, 3.0, ("micro_slip", "relaxation"), "", ("tap",))
    beam = replace(ANSWER, rig="beam", loads_n={})
    assert next_words(beam, stronger) == "record it 3 times as strong to tell micro slip from relaxation."
