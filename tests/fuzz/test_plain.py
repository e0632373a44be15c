"""The plain driver: it tries every target, finds what is wrong, and names how to try it again."""

from __future__ import annotations

import os
import time

import pytest

from tests.fuzz import plain
from tests.fuzz.source import Plain, Target

INPUTS = 20


def whole_numbers(check) -> Target:
    return Target(lambda source: source.integer(0, 199), check)


def wrong(number: int) -> None:
    if number == 7:
        raise KeyError(number)


def first_seven(seed: int) -> int:
    drawn = (Plain(f"planted/{seed}/{number}").integer(0, 199) for number in range(10**6))
    return next(number for number, value in enumerate(drawn) if value == 7)


@pytest.mark.parametrize(("name", "make"), [pytest.param(name, make, id=name) for name, make in plain.named("all")])
def test_some_inputs_of_every_target(tmp_path, name, make):
    assert plain.run(name, make(tmp_path), INPUTS) is None


@pytest.mark.parametrize("seed", [1, 2])
def test_a_planted_fault_is_found(seed):
    failure = plain.run("planted", whole_numbers(wrong), 5000, seed)
    assert failure is not None
    assert failure.number == first_seven(seed)
    assert "KeyError: 7" in failure.what
    assert failure.what.startswith("7\n")


def test_no_fault_no_failure():
    target = whole_numbers(lambda number: None)
    done = []
    assert plain.run("planted", target, 5000, progress=done.append) is None
    assert done == [2000, 4000, 5000]


def test_its_number_brings_a_failure_back():
    target, number = whole_numbers(wrong), first_seven(1)
    assert plain.run("planted", target, number) is None
    again = plain.run("planted", target, 1, first=number)
    assert again == plain.run("planted", target, 5000)


def dies(number: int) -> None:
    if number == 7:
        os.abort()


def never_returns(number: int) -> None:
    while number == 7:
        time.sleep(1.0)


class Unwell:
    def __del__(self) -> None:
        raise ValueError("cannot be put away")


def told_by_nobody(number: int) -> None:
    if number == 7:
        Unwell()


@pytest.mark.parametrize(
    ("check", "what"),
    [
        (dies, "the process died of SIGABRT"),
        (never_returns, "did not return within 0.5 s"),
        (told_by_nobody, "ValueError: cannot be put away"),
    ],
)
def test_what_is_no_exception_is_found_too(check, what):
    longest_s = 0.5 if check is never_returns else plain.LONGEST_S
    failure = plain.run("planted", whole_numbers(check), 5000, longest_s=longest_s)
    assert failure is not None
    assert failure.number == first_seven(1)
    assert what in failure.what
    assert failure.what.startswith("7\n")
    assert check is told_by_nobody or f"in {check.__name__}" in failure.what  # where it was


def test_the_command_names_the_command_that_tries_it_again(monkeypatch, capfd):
    def planted(place):
        return whole_numbers(wrong)

    monkeypatch.setattr("tests.fuzz.usb.TARGETS", (planted,))
    assert plain.main(["usb.planted", "--inputs", "5000", "--seed", "3"]) == 1
    said = capfd.readouterr().out.splitlines()
    again = said[-1].partition("python -m tests.fuzz.plain ")[2].split()
    assert again[0] == "usb.planted"
    assert plain.main([*again]) == 1
    assert capfd.readouterr().out.splitlines() == said


def test_the_command_without_a_failure(monkeypatch, capfd):
    assert plain.main(["wires.lines_of_a_stage", "--inputs", "50"]) == 0
    assert "wires.lines_of_a_stage: 50 inputs of seed 1" in capfd.readouterr().out


@pytest.mark.parametrize("name", ["nothing", "usb.nothing", "all.nothing", ""])
def test_a_target_that_there_is_not(name, capfd):
    assert plain.main([name]) == 2
    assert "there is no target" in capfd.readouterr().err
