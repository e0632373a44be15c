"""The stage controller's protocol, line for line, and what the stage makes of it."""

from __future__ import annotations

import pytest

from rig import DeviceError, NoAnswer, SessionAborted
from rig.drivers.motor_stage import MotorStage
from rig.drivers.newport import COMMANDS, NewportAxis
from rig.drivers.newport_codes import (
    MEANINGS,
    AxisState,
    CommandError,
    PositionerError,
    ReplyError,
    parse_error,
    parse_status,
)
from rig.drivers.settings import NewportStage
from tests.rig.drivers.wire_dialogue import SILENCE, Dialogue, lines


def axis_of(*pairs, tries=3):
    wire = Dialogue(*pairs)
    return wire, NewportAxis(wire, 1, wire.clock, 0.1, tries)


def test_questions_and_their_answers():
    wire, axis = axis_of(*lines(("1TP", "1TP2.150020"), ("1TS", "1TS000033"), ("1VE", "1VE CONEX-CC 2.0.1")))
    assert axis.position_mm() == 2.15002
    assert axis.status().state is AxisState.READY
    assert axis.version() == "CONEX-CC 2.0.1"
    wire.finished()


def test_a_command_is_followed_by_the_question_whether_it_was_taken():
    wire, axis = axis_of(*lines(("1PA2.000500", ""), ("1TE", "1TE@")))
    axis.move_to(2.0005)
    wire.finished()


def test_a_damaged_command_is_sent_again():
    wire, axis = axis_of(*lines(("1PA2.000500", ""), ("1TE", "1TEA"), ("1PA2.000500", ""), ("1TE", "1TE@")))
    axis.move_to(2.0005)
    wire.finished()


@pytest.mark.parametrize("error", [e for e in CommandError if e is not CommandError.NONE], ids=lambda e: e.name)
def test_a_refusal_is_a_sentence(error):
    wire, axis = axis_of(*lines(*[("1PA2.000000", ""), ("1TE", f"1TE{error.value[0]}")] * 3))
    with pytest.raises(DeviceError, match=r"a device on /dev/ttyX: refuses PA2\.000000: ") as refused:
        axis.move_to(2.0)
    assert error.value[1] in str(refused.value)
    wire.finished()


@pytest.mark.parametrize(
    "bad",
    [b"", b"1TP2.1", b"2TP2.0\r\n", b"1TS000033\r\n", b"1TP2.x5\r\n", b"\xff1TP2\r\n", b"1TPinf\r\n", b"1TP1_0\r\n"],
    ids=["silence", "truncated", "foreign", "other question", "letters", "noise", "infinite", "underscore"],
)
def test_a_bad_reply_is_asked_for_again(bad):
    wire, axis = axis_of((b"1TP\r\n", bad), (b"1TP\r\n", b"1TP2.5\r\n"))
    assert axis.position_mm() == 2.5
    assert axis.repeated == 1
    wire.finished()


def test_a_foreign_line_before_the_reply_is_passed_over():
    wire, axis = axis_of((b"1TP\r\n", b"2TP9.9\r\n1TP2.5\r\n"))
    assert axis.position_mm() == 2.5
    assert axis.repeated == 0
    wire.finished()


def test_a_late_reply_does_not_answer_the_next_question():
    wire, axis = axis_of((b"1TP\r\n", (SILENCE, b"1TP9.9\r\n")), (b"1TP\r\n", b"1TP2.5\r\n"))
    assert axis.position_mm() == 2.5
    wire.finished()


def test_silence_is_told():
    wire, axis = axis_of(*[(b"1TP\r\n", b"")] * 3)
    with pytest.raises(NoAnswer, match="a device on /dev/ttyX: it does not answer, asked TP 3 times; check its power"):
        axis.position_mm()
    wire.finished()


def test_bad_news_has_to_be_said_twice():
    wire, axis = axis_of(*lines(("1TS", "1TS002033"), ("1TS", "1TS000033")))
    assert axis.status().trouble() is None
    wire.finished()


@pytest.mark.parametrize("bit", list(PositionerError), ids=lambda bit: bit.name)
def test_every_error_bit_is_a_sentence(bit):
    status = parse_status(f"{int(bit):04X}3D")
    assert status.trouble() == MEANINGS[bit]
    assert all(MEANINGS[bit])


def test_a_nul_says_that_the_power_was_cut():
    wire, axis = axis_of((b"1TS\r\n", b"\x001TS00000A\r\n"))
    assert axis.status().state is AxisState.NOT_REFERENCED
    assert axis.power_came_back
    wire.finished()


def test_a_stop_waits_for_nothing():
    wire, axis = axis_of(*[(b"1ST\r\n", b"")] * 3)
    axis.stop()
    assert wire.clock.now() == 0.0
    wire.finished()


def test_nothing_that_is_kept_in_flash_can_be_sent():
    # VA outside of the configuration state lasts until the next power cut; only PW writes to flash
    assert not COMMANDS & {"PW", "AC", "JR", "SL", "SR", "HT", "BA", "BH", "RS", "SA", "PR"}
    _, axis = axis_of()
    with pytest.raises(DeviceError, match="PW is never sent"):
        axis._tell("PW", "1")


def connecting(velocity="0.05", state="000033", version="CONEX-CC 2.0.1", home="4"):
    pairs = [
        ("1VE", f"1VE {version}"),
        ("1HT?", f"1HT{home}"),
        ("1VA?", f"1VA{velocity}"),
        ("1SL?", "1SL-1"),
        ("1SR?", "1SR25"),
    ]
    pairs += [("1TS", f"1TS{state}")] * (2 if state[:4] != "0000" else 1)
    return pairs


def stage_of(*pairs, **settings):
    wire = Dialogue(*lines(*pairs))
    chosen = NewportStage(**{"driver": "conex-cc", "port": "/dev/ttyX", "resolution_um": 0.02, **settings})
    return wire, MotorStage(wire, chosen, wire.clock, 0.5)


def test_connecting_says_what_answers():
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.000000"))
    expected = "micrometer stage on /dev/ttyX: CONEX-CC 2.0.1, at 0.00 um, ready, 50 um/s towards contact"
    assert stage.connect() == expected
    wire.finished()


def test_a_stage_whose_home_is_wherever_it_stands_is_refused():
    _, stage = stage_of(*connecting(home="1"))
    with pytest.raises(DeviceError, match=r"it takes the place where it stands for its home \(HT1\)"):
        stage.connect()


def test_a_stage_that_is_too_fast_is_slowed_down_before_it_moves_towards_contact():
    slower = [("1VA0.050000", ""), ("1TE", "1TE@"), ("1VA?", "1VA0.05")]
    start = [("1TP", "1TP2.000000"), ("1TS", "1TS000033"), ("1TP", "1TP2.000000")]
    wire, stage = stage_of(*connecting(velocity="0.4"), *start, *slower, *BEGIN, *MOVING, *THERE)
    stage.connect()
    stage.move_by(0.5)
    wire.finished()


def test_a_stage_that_does_not_take_the_slower_speed_does_not_move():
    same = [("1VA0.050000", ""), ("1TE", "1TE@"), ("1VA?", "1VA0.4")] * 3
    start = [("1TP", "1TP2.000000"), ("1TS", "1TS000033"), ("1TP", "1TP2.000000")]
    wire, stage = stage_of(*connecting(velocity="0.4"), *start, *same)
    stage.connect()
    with pytest.raises(DeviceError, match=r"it moves at 0\.4 mm/s where 0\.05 were set"):
        stage.move_by(0.5)
    wire.finished()


@pytest.mark.parametrize("state", ["000046", "000047"])
def test_a_stage_that_is_moved_from_its_keypad_is_not_taken(state):
    _, stage = stage_of(*connecting(state=state), driver="smc100")
    with pytest.raises(DeviceError, match=r"it is moved by hand from its keypad \(jogging\); .*end jogging"):
        stage.connect()


@pytest.mark.parametrize("state", ["000036", "000037", "000038", "000046", "000047"])
def test_a_conex_in_tracking_mode_is_not_taken_and_has_no_keypad(state):
    _, stage = stage_of(*connecting(state=state))
    with pytest.raises(DeviceError, match=r"it is in tracking mode; end that with the maker's program \(TK0\)"):
        stage.connect()


def test_an_smc100_that_lost_its_reference_while_jogging_is_not_referenced():
    _, stage = stage_of(*connecting(state="000011"), ("1TS", "1TS000011"), driver="smc100")
    assert stage.connect().endswith("not referenced")


@pytest.mark.parametrize(
    ("controller", "code"), [("conex-cc", 0x11), ("conex-cc", 0x35), ("smc100", 0x36), ("smc100", 0x3F)]
)
def test_a_state_of_the_other_controller_is_a_damaged_reply(controller, code):
    assert AxisState.of(code) is not None
    with pytest.raises(ReplyError, match="is not a state"):
        parse_status(f"0000{code:02X}", controller)


@pytest.mark.parametrize("letter", ["W", "X"])
def test_the_letters_for_the_other_version_of_an_smc100_are_sentences(letter):
    assert "version of the controller" in parse_error(letter, "smc100").value[1]
    with pytest.raises(ReplyError, match="is not an error letter"):
        parse_error(letter, "conex-cc")


def test_only_the_conex_has_a_tracking_mode_to_refuse_in():
    assert parse_error("P", "conex-cc") is CommandError.TRACKING
    with pytest.raises(ReplyError):
        parse_error("P", "smc100")


@pytest.mark.parametrize(
    ("actuator", "travel_mm", "step_um"),
    [("tra12cc", 12, 0.2), ("tra25cc", 25, 0.2), ("trb6cc", 6, 0.1), ("cma12cccl", 12.5, 0.2), ("cma25ccl", 25, 0.2)],
)
def test_an_actuator_brings_its_travel_and_step(actuator, travel_mm, step_um):
    chosen = NewportStage(driver="smc100", port="/dev/ttyX", actuator=actuator)
    assert (chosen.highest_mm, chosen.resolution_um) == (travel_mm, step_um)


def test_without_an_actuator_the_step_is_that_of_the_coarsest():
    assert NewportStage(driver="conex-cc", port="/dev/ttyX").resolution_um == 0.2


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"resolution_um": 0.02}, "is finer than the smallest step of a trb6cc, 0.1 um"),
        ({"highest_mm": 12.0}, r"must lie within the travel of a trb6cc, 0 to 6 mm"),
        ({"actuator": "tra13cc"}, "tra12cc"),
    ],
    ids=["step", "travel", "no such"],
)
def test_what_an_actuator_cannot_do_is_refused(settings, said):
    with pytest.raises(ValueError, match=said):
        NewportStage(driver="conex-cc", port="/dev/ttyX", **{"actuator": "trb6cc", **settings})


def test_a_stage_says_its_step():
    assert stage_of(actuator="trb6cc", resolution_um=0.1)[1].step_um == 0.1


def test_a_stage_without_its_reference_is_not_homed_unasked():
    wire, stage = stage_of(*connecting(state="00000A"), ("1TS", "1TS00000A"))
    assert stage.connect().endswith("CONEX-CC 2.0.1, not referenced")
    with pytest.raises(DeviceError, match="does not know where it is"):
        stage.read()
    wire.finished()


def test_a_stage_is_homed_where_that_is_allowed():
    home = [("1OR", ""), ("1TE", "1TE@"), ("1TS", "1TS00001E"), ("1TS", "1TS000032"), ("1TS", "1TS000032")]
    wire, stage = stage_of(*connecting(state="00000A"), *home, ("1TP", "1TP0.0"), home_at_connect=True)
    assert "at -2000.00 um" in stage.connect()
    wire.finished()


def test_another_controller_is_refused():
    _, stage = stage_of(*connecting(), expected_identity="SMC")
    with pytest.raises(DeviceError, match=r"it says that it is 'CONEX-CC 2\.0\.1', not the 'SMC'"):
        stage.connect()


def ready(*pairs):
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.000000"), ("1TS", "1TS000033"), ("1TP", "1TP2.000000"), *pairs)
    stage.connect()
    return wire, stage


BEGIN = [("1PA2.000500", ""), ("1TE", "1TE@")]
MOVING = [("1TS", "1TS000028"), ("1TP", "1TP2.000200")]
THERE = [("1TS", "1TS000033"), ("1TP", "1TP2.000500")]


def test_a_move_is_followed_to_its_end():
    wire, stage = ready(*BEGIN, *MOVING, *THERE)
    reading = stage.move_by(0.5)
    assert reading.position_um == 0.5
    assert not reading.locked
    wire.finished()


STOP = [("1ST", "")] * 3
STANDING = [("1TP", "1TP2.000700"), ("1TP", "1TP2.000700"), ("1TS", "1TS000033")]


def test_a_stage_that_goes_too_far_is_stopped_within_one_question():
    back = [("1PA2.000500", ""), ("1TE", "1TE@"), *THERE]
    far = [("1TS", "1TS000028"), ("1TP", "1TP2.000700")]
    wire, stage = ready(*BEGIN, *far, *STOP, *STANDING, *back)
    assert stage.move_by(0.5).position_um == 0.5
    wire.finished()


def test_a_stage_that_is_moved_from_its_keypad_does_not_stand():
    back = [("1PA2.000500", ""), ("1TE", "1TE@"), *THERE]
    far = [("1TS", "1TS000028"), ("1TP", "1TP2.000700")]
    jogging = [("1TP", "1TP2.000700"), ("1TP", "1TP2.000700"), ("1TS", "1TS000046")]
    wire, stage = ready(*BEGIN, *far, *STOP, *jogging, *STANDING[1:], *back)
    assert stage.move_by(0.5).position_um == 0.5
    wire.finished()


def test_a_following_error_stops_and_is_told():
    wire, stage = ready(*BEGIN, ("1TS", "1TS00203D"), ("1TS", "1TS00203D"))
    with pytest.raises(DeviceError, match="micrometer stage on /dev/ttyX: the motor did not follow"):
        stage.move_by(0.5)
    wire.finished()


def test_silence_in_a_move_stops_it():
    wire, stage = ready(*BEGIN, *[("1TS", "")] * 3, *STOP)
    with pytest.raises(NoAnswer):
        stage.move_by(0.5)
    wire.finished()


def test_a_signal_in_a_move_stops_it():
    wire, stage = ready(*BEGIN, *STOP)

    def signalled(seconds):
        if seconds > 0:
            raise SessionAborted("session ended by SIGTERM")

    wire.clock.sleep = signalled
    with pytest.raises(SessionAborted):
        stage.move_by(0.5)
    wire.finished()


def test_a_move_that_never_ends_is_ended():
    _wire, stage = ready(*BEGIN, *MOVING * 103, *STOP)
    with pytest.raises(DeviceError, match=r"it still moves 1\.\d s after it was sent \+0.50 um"):
        stage.move_by(0.5)


def test_a_position_outside_the_travel_is_not_sent():
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.0"), ("1TS", "1TS000033"), ("1TP", "1TP11.9999"))
    stage.connect()
    with pytest.raises(DeviceError, match=r"10000.4 um lies outside its travel of -2000.0 to 10000.0 um"):
        stage.move_by(0.5)
    wire.finished()


def test_a_clamped_stage_does_not_move():
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.0"), ("1TS", "1TS00003C"))
    stage.connect()
    with pytest.raises(DeviceError, match="it is clamped"):
        stage.move_by(0.5)
    wire.finished()


def test_the_clamp_is_the_motor_switched_off():
    off = [("1TS", "1TS000033"), ("1MM0", ""), ("1TE", "1TE@"), ("1TS", "1TS000033"), ("1TS", "1TS00003C")]
    on = [("1TS", "1TS00003C"), ("1MM1", ""), ("1TE", "1TEK"), ("1TS", "1TS000034")]
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.0"), *off, *on)
    stage.connect()
    stage.lock()
    stage.unlock()
    wire.finished()


def test_a_stage_that_lost_its_reference_goes_apart_by_finding_it():
    home = [("1OR", ""), ("1TE", "1TE@"), ("1TS", "1TS00001E"), ("1TS", "1TS000032")]
    at_rest = [("1TS", "1TS000032"), ("1TP", "1TP0.0")]
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.0"), ("1TS", "1TS00000A"), *home, *at_rest)
    stage.connect()
    assert stage.move_by(-100.0).position_um == -2000.0
    wire.finished()


def test_a_stage_that_lost_its_reference_goes_no_step_towards_contact():
    wire, stage = stage_of(*connecting(), ("1TP", "1TP2.0"), ("1TS", "1TS00000A"))
    stage.connect()
    with pytest.raises(DeviceError, match="does not know where it is"):
        stage.move_by(0.5)
    wire.finished()
