"""The verdict in words."""

from __future__ import annotations

import io
import re
from dataclasses import replace

from rich.console import Console

from analysis.mismatch.answer import Interval, NextExperiment, Remainder, Rival, SetAside, UpperLimit
from mesotap.answers.diagnosis_json import diagnosis_json
from mesotap.answers.diagnosis_text import (
    left_over,
    next_words,
    print_answer,
    rival_probability,
    unlisted_words,
    verdict_sentence,
    what_was_recorded,
)
from tests.mesotap.answers.made import ANSWER, HERE, LEARNED, NAMED

LEFT = Remainder(0.03, 120.0, 1e-6, HERE, "3 % is left.")


def test_the_verdict_names_what_is_left_out_with_its_probability() -> None:
    said = verdict_sentence(ANSWER)
    assert "it leaves out hunt crossley damping, with a probability of 0.98" in said
    assert "nothing is left beyond noise (p = 0.4)" in said


def test_other_constants_that_show_the_same_are_said_and_written() -> None:
    assert ANSWER.fitted is not None
    twice = replace(ANSWER, fitted=replace(ANSWER.fitted, also=({"m1": 0.214},)))
    shown = io.StringIO()
    print_answer(twice, Console(file=shown, width=200))
    said = " ".join(shown.getvalue().split())
    assert "Every channel shows the same with m1 0.21400 kg: these recordings do not tell which of both it is;" in said
    assert "what is named may be of another size" in said
    assert diagnosis_json(twice, 1.0)["fitted"]["also"] == [{"m1": 0.214}]


def test_two_p_values_of_a_verdict_that_nothing_is_missing_say_what_each_tests() -> None:
    sound = replace(ANSWER, verdict="consistent", mechanisms=(), p_value=0.98)
    assert "nothing is left beyond noise (p = 0.98; recordings and load cell)" in verdict_sentence(sound)
    assert left_over(sound).endswith("in the recordings by themselves, without the load cell (p = 0.4).")
    one_test = replace(sound, p_value=0.4)
    assert "nothing is left beyond noise (p = 0.4)." in verdict_sentence(one_test)
    assert left_over(one_test) == one_test.remainder.statement


def test_one_impact_is_one() -> None:
    assert "1 impact at 104 mN" in what_was_recorded(
        replace(ANSWER, loads_n={"0": 0.104}, fit=replace(ANSWER.fit, segments=1))
    )


def test_a_remainder_beyond_noise_is_in_the_verdict() -> None:
    said = verdict_sentence(replace(ANSWER, remainder=LEFT))
    assert "explains 97 % of what is missing; something small remains in the lower mass at 4.1 kHz" in said


def test_a_name_that_leaves_many_times_the_noise_is_in_doubt_and_what_remains_is_not_called_small() -> None:
    far = replace(ANSWER, remainder=LEFT, fit=replace(ANSWER.fit, noise_rms=0.01, heldout_rms_after=0.28))
    said = verdict_sentence(far)
    assert "something small" not in said
    assert "is still missed by 28 times the noise: the right name may be another one." in said
    near = replace(far, fit=replace(far.fit, heldout_rms_after=0.029))
    assert "times the noise" not in verdict_sentence(near)
    assert "something small" in verdict_sentence(near)


def test_errors_far_over_the_noise_are_told_of_a_described_rig_however_little_they_are_of_all() -> None:
    far = replace(
        ANSWER, rig="beam", loads_n={}, remainder=replace(LEFT, share=0.004),
        fit=replace(ANSWER.fit, noise_rms=0.01, heldout_rms_after=0.13),
    )  # fmt: skip
    said = verdict_sentence(far)
    assert "something small remains" in said
    assert said.endswith("missed by 13 times the noise: more may be at work, which the intervals do not count.")
    doubted = verdict_sentence(replace(far, remainder=replace(LEFT, share=0.02)))
    assert doubted.endswith("missed by 13 times the noise: the right name may be another one.")
    assert "something small" not in doubted


def test_that_this_is_all_there_is_is_not_rounded_to_nothing() -> None:
    for probability, words in ((1.7e-294, "all there is: < 0.0001"), (0.93, "all there is: 0.93")):
        shown = Console(file=io.StringIO(), width=200)
        print_answer(replace(ANSWER, complete_probability=probability), shown)
        assert words in shown.file.getvalue()  # type: ignore[attr-defined]


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
    assert "a force of the deflection that no mechanism listed has, learned from these recordings (contact)" in said


def test_the_terminal_shows_the_runner_up_and_the_limits() -> None:
    shown = Console(file=io.StringIO(), width=200)
    print_answer(ANSWER, shown)
    text = shown.file.getvalue()  # type: ignore[attr-defined]
    assert all(word in text for word in ("squeeze_film", "micro_slip", "104 mN", "last: 0.02 m/s²"))


def test_the_terminal_writes_numbers_as_the_page_does() -> None:
    shown = Console(file=io.StringIO(), width=200)
    limits = [
        UpperLimit("micro_slip", name, value, unit, 0.95)
        for name, value, unit in (("large", 4592.0, "N/m"), ("huge", 4.592e9, "N/m3"), ("small", 3.21e-5, "1"))
    ]
    strong = replace(NAMED, parameters={"k": Interval(4.59e9, 4.5e9, 4.68e9, "N/m")})
    print_answer(replace(ANSWER, mechanisms=(strong,), upper_limits=tuple(limits)), shown)
    text = shown.file.getvalue()  # type: ignore[attr-defined]
    assert all(number in text for number in (" 4600 N/m ", " 4.6 × 10⁹ N/m³ ", " 3.2 × 10⁻⁵ "))
    assert "k = 4.590 × 10⁹ (4.500 × 10⁹ to 4.680 × 10⁹) N/m" in text
    assert not re.search(r"\de[+-]\d", text.split("Upper limits")[1])


def test_the_terminal_says_that_none_of_the_best_is_named_and_gives_their_errors() -> None:
    shown = Console(file=io.StringIO(), width=200)
    best = (Rival(("squeeze_film",), 0.0, 0.0189, "It explains more."), Rival(("adhesion",), 0.0, 0.0191, "Less."))
    print_answer(replace(ANSWER, verdict="unexplained", mechanisms=(), rivals=best), shown)
    text = shown.file.getvalue()  # type: ignore[attr-defined]
    assert all(word in text for word in ("The best candidates, none of which is named", "0.0189", "0.0191"))


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


def test_constants_that_end_far_from_what_was_declared_are_told_with_the_verdict() -> None:
    assert ANSWER.fitted is not None
    moved = replace(ANSWER, fitted=replace(ANSWER.fitted, off={"m1": 38.2, "m2": 115.0}))
    assert "It moves m2 by 115 and m1 by 38 declared uncertainties" in verdict_sentence(moved)
    assert "k_c and c_c reach to what masses as declared and loads as measured give" in verdict_sentence(moved)
    springs = replace(moved, fitted=replace(ANSWER.fitted, off={"k1": 38.2}))
    assert "k_c and c_c may then be wrong by far more" in verdict_sentence(springs)
    assert diagnosis_json(moved, 1.0)["fitted"]["off_declared"] == {"m1": 38.2, "m2": 115.0}
    assert "declared uncertainties" not in verdict_sentence(ANSWER)


def test_samples_that_were_put_right_are_told_in_words() -> None:
    answer = replace(ANSWER, set_aside=(SetAside("run.csv, channel x", "", "One sample, at 1.5 s."),))
    assert verdict_sentence(answer).endswith("Samples that cannot be the rig's own motion are set aside.")
    assert "taps" not in verdict_sentence(answer)


def test_of_a_described_rig_the_element_stands_beside_the_name_and_the_place() -> None:
    shown = Console(file=io.StringIO(), width=200)
    in_foot = replace(HERE, component="spring", element="foot")
    beam = replace(
        ANSWER, rig="beam", loads_n={}, location=in_foot, mechanisms=(replace(NAMED, where="spring", element="foot"),)
    )
    assert f"leaves out {NAMED.id.replace('_', ' ')} (foot), with" in verdict_sentence(beam)
    print_answer(beam, shown)
    assert "where: spring: foot; " in shown.file.getvalue()  # type: ignore[attr-defined]


def test_the_probability_that_neither_name_nor_rivals_have_is_told() -> None:
    capped = replace(
        ANSWER,
        mechanisms=(replace(NAMED, probability=0.8),),
        rivals=(Rival(("hertz_stiffness",), 0.02, None, "It is worse."),),
    )
    assert unlisted_words(capped) == "The rest of the probability, 0.18, is for causes that are not listed."
    assert unlisted_words(capped) in rival_probability(capped)
    assert unlisted_words(replace(capped, mechanisms=(replace(NAMED, probability=0.98),))) == ""
    assert unlisted_words(replace(capped, verdict="consistent")) == ""
