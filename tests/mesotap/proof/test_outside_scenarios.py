"""Sessions of effects outside the list: how often each comes, what is held back, and a second session of a rig."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from daq.session_file import read_session
from mesotap.commands.prove import outside, subject_of
from mesotap.proof.errors import ProofError
from mesotap.proof.generator.again import again, make_again
from mesotap.proof.generator.concealed import signals
from mesotap.proof.generator.effects import LISTED, OUTSIDE
from mesotap.proof.generator.outside_scenarios import TEN, draw, held_back
from mesotap.proof.generator.plan import random_plan
from mesotap.proof.generator.scenarios import STRONG_GRADES, Scenario, concealed_of, generator_of, make

SMALL = (2, 2)


def test_every_effect_comes_equally_often_at_every_grade() -> None:
    pairs = len(OUTSIDE) * len(STRONG_GRADES)
    sessions = draw(3, 10 * pairs, None, SMALL, tuple(OUTSIDE))
    hidden = Counter((s.effects[0], s.d[0]) for s in sessions if s.kind == "outside")
    assert hidden == dict.fromkeys(((e, d) for e in OUTSIDE for d in STRONG_GRADES), 8)
    assert Counter(s.kind for s in sessions) == {k: pairs * TEN.count(k) for k in set(TEN)}
    assert {s.effects[0] for s in sessions if s.kind == "single"} <= set(LISTED)
    assert sessions[:40] == draw(3, 40, None, SMALL, tuple(OUTSIDE))
    assert {s.kind for s in draw(3, 12, "outside", SMALL, tuple(OUTSIDE))} == {"outside"}


def test_a_seed_holds_back_five_effects_of_different_kinds() -> None:
    for seed in range(20):
        names = held_back(seed)
        assert names == held_back(seed)
        assert len({OUTSIDE[n].nature.kind for n in names if OUTSIDE[n].nature}) == 5
    assert len({held_back(seed) for seed in range(20)}) > 10


def test_sealed_sessions_hold_what_unsealed_ones_do_not() -> None:
    sealed, rest = outside("2x3", 7, None), outside(None, None, 7)
    assert sealed.maker.command == "mesotap prove --outside --size 2x3 --sealed 7"
    hidden = {s.effects[0] for s in sealed.maker.draw(1, 60, "outside")}
    others = {s.effects[0] for s in rest.maker.draw(1, 200, "outside")}
    assert hidden == set(held_back(7))
    assert others == set(OUTSIDE) - hidden
    assert {s.size for s in sealed.maker.draw(1, 9, None)} == {(2, 3)}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((True, True, None, None, None), "--outside and --rigs"),
        ((False, False, "6x8", None, None), "goes with --outside"),
        ((False, False, None, None, 3), "goes with --outside"),
        ((False, True, "6by8", None, None), "expected loads and taps"),
        ((False, True, "9x8", None, None), "at most 8 loads"),
        ((False, True, None, 1, 2), "expected one of them"),
    ],
)
def test_options_that_do_not_go_together_get_a_sentence(options: tuple[bool, bool, str, int, int], said: str) -> None:
    with pytest.raises(ProofError, match=said):
        subject_of(*options)


def test_plan_has_the_size_that_is_asked_for_and_else_that_of_its_seed() -> None:
    plan = random_plan(np.random.default_rng(4), size=(1, 3))
    assert (plan.loads.size, plan.group.tolist()) == (1, [0, 0, 0])
    assert random_plan(np.random.default_rng(4)).loads.size >= 3


def test_truth_tells_the_law_and_the_session_has_the_size(tmp_path: Path) -> None:
    truth = make(5, Scenario(0, "outside", ("contact_quadratic",), (30.0,), size=SMALL), tmp_path)
    assert truth["d"] == pytest.approx(30.0, rel=0.1)
    assert truth["laws"][0]["exponents"] == {"deflection": 2.0, "load": 0.0}
    assert truth["knowing_rms"] > 0
    assert len(read_session(tmp_path / "session-0000.h5").impacts) == 4


@pytest.mark.parametrize(
    "name", [pytest.param("bouc_wen", marks=pytest.mark.slow), "stiffness_step", "sensor_compression"]
)
def test_second_session_is_of_the_same_machine(name: str) -> None:
    scenario = Scenario(0, "outside", (name,), (100.0,), size=SMALL)
    first = concealed_of(generator_of(5, scenario), scenario)
    second = again(np.random.default_rng(1), first, (3, 2))
    was, now = first.hidden[0], second.hidden[0]
    assert (now.strength, second.plan.masses, second.plan.springs) == (
        was.strength,
        first.plan.masses,
        first.plan.springs,
    )
    assert second.plan.loads.size == 3
    assert np.all((second.plan.loads >= first.plan.loads[0]) & (second.plan.loads <= first.plan.loads[-1]))
    for key, value in was.character.items():
        if isinstance(value, np.ndarray):
            assert now.character[key].size == second.plan.group.size
        else:
            assert now.character[key] == value
    # loads between those of the first session have stiffnesses between
    assert np.all((second.plan.kc > 0.95 * first.plan.kc.min()) & (second.plan.kc < 1.05 * first.plan.kc.max()))
    assert now.d > 10.0
    assert np.all(np.isfinite(signals(second)))


def test_second_session_is_written_beside_the_first_with_other_noise(tmp_path: Path) -> None:
    scenario = Scenario(2, "outside", ("contact_quadratic",), (100.0,), size=SMALL)
    one, two = (make_again(5, scenario, tmp_path, which) for which in (1, 2))
    assert make_again(5, scenario, tmp_path, 1) == one
    assert one["strength"] == two["strength"]
    assert one["effect"] == two["effect"]
    assert one["loads_n"] != two["loads_n"]
    assert len(read_session(tmp_path / "session-0002-again-1.h5").impacts) == 4
    assert (tmp_path / "session-0002-again-2.h5").exists()


def test_too_many_loads_find_no_room() -> None:
    scenario = Scenario(0, "null", variety="exact", size=SMALL)
    first = concealed_of(generator_of(5, scenario), scenario)
    with pytest.raises(ValueError, match="do not find room"):
        again(np.random.default_rng(1), first, (60, 2))
