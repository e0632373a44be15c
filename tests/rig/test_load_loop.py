"""The loop that sets a load, on springs and play alone: k x of a knob that has backlash and moves in steps."""

from __future__ import annotations

import math

import pytest

from rig import InterlockRefusal
from rig.load_loop import LARGEST_TURNS, LoadLoop
from rig.settable import finest_tolerance_mn, largest_mn_per_um, load_step_mn, too_fine, what_can_be_set, whole_steps

PAPER_N_PER_M = (538e3, 538e3)  # 356 Hz with 0.107 and 0.108 kg
MN_PER_UM = 0.95 * largest_mn_per_um(PAPER_N_PER_M)  # a contact in series makes it less than the springs alone


class Knob:
    """A stage that pushes with its knob: going back, the play comes first."""

    def __init__(self, step_um: float, play_um: float) -> None:
        self.step_um, self.play_um = step_um, play_um
        self.knob = self.carriage = 0.0
        self.moves: list[float] = []
        self.loads: list[float] = []

    def move_by(self, travel_um: float, aim: str, load_mn: float) -> float:
        if self.step_um:
            travel_um = round(travel_um / self.step_um) * self.step_um
        self.moves.append(travel_um)
        self.knob += travel_um
        self.carriage = min(max(self.carriage, self.knob), self.knob + self.play_um)
        self.loads.append(MN_PER_UM * max(self.carriage, 0.0))
        return self.loads[-1]


def loop_of(step_um):
    return LoadLoop(largest_mn_per_um(PAPER_N_PER_M), step_um, 0.5)


@pytest.mark.parametrize("play_um", [0.0, 2.0, 5.0])
@pytest.mark.parametrize("step_um", [0.02, 0.1, 0.2], ids=["fine", "TRB6CC", "TRA12CC and CMA25CCL"])
def test_every_load_is_reached_in_few_steps_and_from_below(step_um, play_um):
    tolerance = finest_tolerance_mn(step_um, PAPER_N_PER_M)
    stage, loop, load = Knob(step_um, play_um), loop_of(step_um), 0.0
    for target in (264.9, 348.3, 431.6, 524.8, 549.4, 627.8, 784.8, 927.0, 600.0, 300.0, 900.0):
        begun = len(stage.moves)
        load = loop.close(target, tolerance, load, stage.move_by)
        assert abs(load - target) <= tolerance
        moves = stage.moves[begun:]
        assert len(moves) <= 12 + 5 * play_um / max(step_um, 0.1) / 2
        if moves:
            assert moves[-1] > 0, "the last step goes towards contact"
            assert max(moves) <= 0.5
        turns = sum(a > 0 > b for a, b in zip([1.0, *moves], moves, strict=False))
        assert turns <= 1


@pytest.mark.parametrize("step_um", [0.02, 0.1, 0.2])
def test_from_below_no_step_passes_the_tolerance(step_um):
    tolerance = finest_tolerance_mn(step_um, PAPER_N_PER_M)
    for target in range(100, 1000, 7):
        stage = Knob(step_um, 2.0)
        loop_of(step_um).close(target, tolerance, 0.0, stage.move_by)
        assert max(stage.loads) <= target + tolerance
        assert min(stage.moves) > 0


def test_steps_are_whole_multiples_of_the_stages():
    stage = Knob(0.0, 2.0)
    loop_of(0.2).close(500.0, 28.0, 0.0, stage.move_by)
    loop_of(0.2).close(300.0, 28.0, stage.loads[-1], stage.move_by)
    assert [math.remainder(move, 0.2) for move in stage.moves] == pytest.approx([0.0] * len(stage.moves))


def test_a_tolerance_between_two_steps_ends_soon_and_says_why():
    stage = Knob(0.2, 0.0)
    with pytest.raises(InterlockRefusal, match=r"a step of the stage, 0\.2 um, is up to 55\.4 mN\).*load_tolerance_mn"):
        loop_of(0.2).close(921.0, 6.0, 0.0, stage.move_by)
    assert len(stage.moves) < 40
    assert sum(a > 0 > b for a, b in zip(stage.moves, stage.moves[1:], strict=False)) <= LARGEST_TURNS


def test_a_stage_whose_steps_nobody_knows_is_moved_by_what_is_missing():
    stage = Knob(0.0, 0.0)
    assert abs(loop_of(0.0).close(500.0, 5.0, 0.0, stage.move_by) - 500.0) <= 5.0


def test_a_step_is_the_series_stiffness_times_its_travel():
    """k1 k2 / (k1 + k2) of 400 and 600 kN/m is 240 kN/m: 48 mN for 0.2 um, and 3 % for springs that are stiffer."""
    assert load_step_mn(0.2, (400e3, 600e3)) == pytest.approx(48.0 * 1.03)
    assert finest_tolerance_mn(0.2, (400e3, 600e3)) == pytest.approx(24.0 * 1.03)


def test_whole_steps_fit_into_a_travel():
    assert whole_steps(0.5, 0.2) == pytest.approx(0.4)
    assert whole_steps(0.6, 0.2) == pytest.approx(0.6)
    assert whole_steps(0.1, 0.2) == 0.0
    assert whole_steps(0.123, 0.0) == 0.123


def test_a_tolerance_that_cannot_be_held_says_each_way_out():
    said = too_fine(6.0, 0.2, PAPER_N_PER_M)
    for part in ("load_tolerance_mn of 6 ", "0.2 um", "55.4 mN", "within 27.7 mN", "at least 28", "0.043 um", "117"):
        assert part in said
    assert not too_fine(28.0, 0.2, PAPER_N_PER_M)
    assert not too_fine(28.0, 0.043, PAPER_N_PER_M)
    assert not too_fine(6.0, 0.2, (116e3, 116e3))


def test_loads_nearer_than_a_step_are_named():
    said = what_can_be_set([264.9, 524.8, 549.4], 30.0, 0.2, PAPER_N_PER_M)
    assert said[0] == (
        "loads: 264.9, 524.8, 549.4 mN can be set to +-28 mN (a step of 0.2 um is up to 55.4 mN); asked for are +-30 mN"
    )
    assert said[1].startswith("loads: 524.8 and 549.4 mN are less than a step apart")
    assert len(what_can_be_set([264.9, 524.8], 30.0, 0.2, PAPER_N_PER_M)) == 1
