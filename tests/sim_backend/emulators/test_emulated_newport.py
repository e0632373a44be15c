"""Dialogues with the emulated Newport controllers, written from the manuals: what is sent, what comes back."""

from __future__ import annotations

import pytest

from sim_backend.clock import VirtualClock
from sim_backend.emulators.newport import EmulatedController
from sim_backend.emulators.newport_manual import ACTUATORS, PARAMETERS
from sim_backend.emulators.newport_parameters import ControllerModel
from sim_backend.settings import SimulatedStage as StageSettings
from sim_backend.stage import SimulatedStage

SPEED_UM_PER_S = 400.0  # of the ideal actuator


class Line:
    """A controller, what it is asked, and the time that passes."""

    def __init__(self, **model) -> None:
        self.clock = VirtualClock()
        self.stage = SimulatedStage(StageSettings(speed_um_per_s=SPEED_UM_PER_S), self.clock, lambda: None)
        self.device = EmulatedController(self.stage, ControllerModel(**model), SPEED_UM_PER_S, self.clock)

    def ask(self, *lines: str) -> str:
        """Send lines and return what comes back, without the line ends."""
        replies = [reply for line in lines for reply in self.device.receive(line.encode() + b"\r\n")]
        return "".join(reply.decode() for reply in replies).replace("\r\n", "")

    def wait(self, seconds: float) -> Line:
        self.clock.sleep(seconds)
        return self

    def error(self) -> str:
        return self.ask("1TE")[3:]

    def state(self) -> str:
        return self.ask("1TS")[7:]

    def position(self) -> float:
        return float(self.ask("1TP")[3:])

    def homed(self) -> Line:
        self.ask("1OR")
        assert self.wait(100.0).state() == "32"
        return self


# --- the line


@pytest.mark.parametrize("line", ["1TP", "1TP?", "1tp", "1 T P", " 1TP ?"])
def test_case_blanks_and_a_question_mark_change_nothing(line):
    assert Line().ask(line) == "1TP0.000000"


def test_a_line_ends_in_carriage_return_and_line_feed():
    device = Line().device
    assert device.receive(b"1TS\n") == []
    assert device.receive(b"1T") == []
    device = Line().device
    assert device.receive(b"1T") == []
    assert device.receive(b"S\r") == []
    assert device.receive(b"\n") == [b"1TS00000A\r\n"]


def test_what_follows_a_value_is_ignored():
    line = Line().homed()
    line.ask("1PA1.5;1PA3")
    assert line.error() == "@"
    line.wait(10.0)
    assert line.position() == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("sent", "letter"),
    [("1XX", "A"), ("1.5TP", "A"), ("TP", "B"), ("0TP", "B"), ("32TP", "B"), ("1PA", "C"), ("1MM2", "C")],
)
def test_what_cannot_be_understood_is_kept_as_an_error(sent, letter):
    line = Line().homed()
    assert line.ask(sent) == ""
    assert line.error() == letter


def test_another_controllers_line_is_none_of_its_business():
    line = Line()
    assert line.ask("2TS") == ""
    assert line.error() == "@"


def test_the_last_error_is_told_once_and_in_words():
    line = Line()
    line.ask("1PA1")
    assert line.ask("1TBH") == "1TBH Command not allowed in NOT REFERENCED state"
    assert (line.error(), line.error()) == ("H", "@")


@pytest.mark.parametrize(
    ("kind", "reply"),
    [("conex-cc", "1VE CONEX-CC 2.0.1"), ("smc100", "1VE SMC_CC - Controller-driver version  3. 1. 2")],
)
def test_it_says_who_it_is_as_real_ones_do(kind, reply):
    assert Line(kind=kind).ask("1VE") == reply


# --- states


def test_after_power_on_it_knows_no_place():
    line = Line()
    assert (line.state(), line.position()) == ("0A", 0.0)


@pytest.mark.parametrize(
    ("sent", "letter"), [("1PA1", "H"), ("1PR1", "H"), ("1ST", "H"), ("1MM0", "H"), ("1VA0.1", "H"), ("1PW0", "H")]
)
def test_what_needs_a_home_is_refused_before_there_is_one(sent, letter):
    line = Line()
    line.ask(sent)
    assert line.error() == letter


@pytest.mark.parametrize(
    ("sent", "letter"), [("1OR", "K"), ("1PW1", "K"), ("1PW0", "K"), ("1MM1", "K"), ("1HT1", "K"), ("1KP1", "K")]
)
def test_what_ready_refuses(sent, letter):
    line = Line().homed()
    line.ask(sent)
    assert line.error() == letter


@pytest.mark.parametrize(
    ("sent", "letter"), [("1PA2", "M"), ("1PR1", "M"), ("1OR", "M"), ("1MM0", "M"), ("1VA0.1", "M")]
)
def test_what_moving_refuses(sent, letter):
    line = Line().homed()
    line.ask("1PA1")
    assert line.state() == "28"
    line.ask(sent)
    assert line.error() == letter


def test_disable_and_back():
    line = Line().homed()
    line.ask("1MM0")
    assert line.wait(1.0).state() == "3C"
    line.ask("1PA1")
    assert line.error() == "J"
    line.ask("1MM1")
    assert line.wait(1.0).state() == "34"


def test_the_motor_is_on_in_time_however_often_it_is_told():
    line = Line().homed()
    line.ask("1MM0")
    line.wait(1.0)
    for _ in range(12):
        line.ask("1MM1")
        line.wait(0.01)
    assert line.state() == "34"


def test_home_is_looked_for_at_the_end_or_taken_where_it_stands():
    at_the_end = Line(zero_mm=2.0).homed()
    assert (at_the_end.position(), at_the_end.stage.knob_um) == (0.0, -2000.0)
    here = Line(zero_mm=2.0, home_type=1)
    here.ask("1OR")
    assert here.state() == "32"
    assert (here.position(), here.stage.knob_um) == (0.0, 0.0)


def test_a_home_where_it_stands_puts_the_end_of_the_travel_within_the_software_limits():
    """Position 5 mm is then 5 mm from where it stood, not from the end: what HT is to be asked for."""
    line = Line(home_type=1, zero_mm=2.0, actuator="trb6cc", lowest_mm=0.0, highest_mm=6.0)
    line.ask("1OR", "1PA5")
    line.wait(60.0)
    assert line.ask("1TS") == "1TS00020F"  # positive end, NOT REFERENCED from MOVING


def test_homing_twice_at_once_and_stopping_it():
    line = Line()
    line.ask("1OR")
    assert line.state() == "1E"
    line.ask("1OR")
    assert line.error() == "E"
    line.ask("1ST")
    assert line.state() == "0B"


def test_a_home_search_that_takes_too_long():
    line = Line()
    line.ask("1PW1", "1OT1", "1PW0")
    line.wait(20.0).ask("1OR")
    assert line.wait(2.0).ask("1TS") == "1TS00400B"


def test_stop_without_an_address_stops_every_controller():
    line = Line().homed()
    line.ask("1PA10")
    line.wait(1.0).ask("ST")
    assert line.state() == "33"
    assert 0 < line.position() < 10


# --- errors of the motor


def test_a_following_error_ends_in_disable_and_is_told_once():
    line = Line().homed()
    line.device.stalled = True
    line.ask("1PA1")
    line.wait(1.0)
    assert line.ask("1TS", "1TS") == "1TS00203D1TS00003D"


def test_where_errors_are_kept_they_last_until_the_next_move():
    line = Line(tells_errors_once=False).homed()
    line.device.fails_next = 0x20
    line.ask("1PA1")
    line.wait(1.0)
    assert line.ask("1TS", "1TS") == "1TS00203D1TS00203D"


@pytest.mark.parametrize("bit", [0x004, 0x008, 0x010, 0x100, 0x200])
def test_a_hardware_fault_ends_in_not_referenced(bit):
    line = Line().homed()
    line.device.fails_next = bit
    line.ask("1PA1")
    line.wait(1.0)
    assert line.ask("1TS") == f"1TS{bit:04X}0F"
    line.ask("1PA1")
    assert line.error() == "H"


def test_a_power_cut_is_told_by_a_nul_and_nothing_is_known_any_more():
    line = Line().homed()
    line.ask("1VA0.1")
    line.device.cut_power()
    assert line.ask("1TS") == ""
    line.device.restore_power()
    assert line.device.unasked() == b"\0"
    assert (line.state(), line.ask("1VA?")) == ("0A", "1VA0.4")


# --- parameters


def test_a_target_beyond_a_software_limit_is_refused():
    line = Line().homed()
    line.ask("1SR1")
    line.ask("1PA1.1")
    assert line.error() == "G"
    line.ask("1PA1")
    assert line.error() == "@"


def test_a_velocity_is_lost_at_reset_unless_it_was_saved():
    line = Line().homed()
    line.ask("1VA0.1")
    assert line.ask("1VA?") == "1VA0.1"
    line.ask("1RS")
    assert line.ask("1VA?") == "1VA0.4"
    line.ask("1PW1", "1VA0.2", "1PW0")
    line.wait(20.0).ask("1RS")
    assert line.ask("1VA?") == "1VA0.2"


@pytest.mark.parametrize("velocity", ["0.5", "0", "-1", "1E13", "fast"])
def test_a_velocity_beyond_what_was_saved_is_out_of_range(velocity):
    line = Line().homed()
    line.ask(f"1VA{velocity}")
    assert line.error() == "C"


def test_a_slower_velocity_takes_longer():
    line = Line().homed()
    line.ask("1VA0.1", "1PA1")
    assert line.wait(9.0).state() == "28"
    assert line.wait(2.0).state() == "33"


def test_saving_is_silent():
    line = Line(saving_s=8.0)
    line.ask("1PW1", "1HT1", "1PW0")
    assert line.wait(7.9).ask("1TS") == ""
    assert line.wait(0.2).ask("1TS") == "1TS00000C"


def test_backlash_and_hysteresis_are_never_compensated_both():
    line = Line()
    line.ask("1PW1", "1BA0.01")
    line.ask("1BH0.02")
    assert line.ask("1BA?", "1BH?") == "1BA01BH0.02"
    line.ask("1BH0")
    assert line.error() == "C"


@pytest.mark.parametrize(
    ("kind", "sent", "letter"),
    [("smc100pp", "1KP1", "W"), ("smc100", "1FRM10", "X"), ("conex-cc", "1FRM10", "A")],
)
def test_parameters_that_this_kind_does_not_have(kind, sent, letter):
    line = Line(kind=kind)
    line.ask("1PW1", sent)
    assert line.error() == letter


def test_every_parameter_is_told_as_the_command_that_sets_it():
    line = Line(kind="smc100")
    replies = line.device.receive(b"1ZT\r\n")[0].decode().split("\r\n")
    assert (replies[0], replies[-2]) == ("1PW1", "1PW0")
    told = {reply[1:4] if reply[1:3] in ("FR", "QI") else reply[1:3] for reply in replies[2:-2]}
    assert told == {name for name, parameter in PARAMETERS.items() if parameter.only != "pp"}


# --- actuators


@pytest.mark.parametrize("name", ACTUATORS)
def test_an_actuator_stands_at_multiples_of_its_step_within_its_repeatability(name):
    data = ACTUATORS[name]
    line = Line(actuator=name, highest_mm=data.travel_mm, seed=3).homed()
    off = []
    for i in range(20):
        line.ask(f"1PA{1 + i * 0.00007:.5f}")
        line.wait(30.0)
        knob = line.stage.knob_um + 2000.0
        off.append(knob - round(knob / data.step_um) * data.step_um)
    assert 0 < max(abs(x) for x in off) <= data.repeatability_um + 0.011  # the micrometer's own resolution


def test_a_step_below_the_smallest_does_not_move_it_by_that_much():
    line = Line(actuator="tra12cc").homed()
    line.ask("1PA1")
    before = line.wait(30.0).stage.knob_um
    line.ask("1PR0.00002")
    assert line.wait(1.0).stage.knob_um - before != pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize("name", ACTUATORS)
def test_a_position_is_told_in_counts_of_the_encoder(name):
    line = Line(actuator=name, highest_mm=ACTUATORS[name].travel_mm).homed()
    line.ask("1PA1.2345")
    counts = line.wait(30.0).position() * 1e3 / ACTUATORS[name].encoder_um
    assert counts == pytest.approx(round(counts), abs=0.04)  # six decimals of a mm


def test_it_is_as_fast_as_its_data_sheet_and_no_faster():
    line = Line(actuator="trb6cc", highest_mm=6.0)
    assert line.ask("1VA?") == "1VA0.2"
    line.ask("1PW1", "1VA1", "1PW0")
    line.wait(20.0).homed()
    line.ask("1PA1")
    assert line.wait(1.0).ask("1TS") == "1TS00203D"


def test_a_question_takes_ten_milliseconds_on_a_real_one():
    assert Line(actuator="tra12cc").device.processing_s == 0.010
    assert Line().device.processing_s == 0.0


# --- kept states


def test_it_goes_on_from_what_was_kept():
    line = Line(actuator="tra12cc", seed=1).homed()
    line.ask("1PA1", "1VA0.1")
    line.wait(30.0).ask("1VA0.1")
    kept, place = line.device.checkpoint(), line.stage.checkpoint()
    other = Line(actuator="tra12cc", seed=2)
    other.stage.restore(place)
    other.device.restore(kept)
    assert other.ask("1TP", "1TS", "1VA?") == line.ask("1TP", "1TS", "1VA?")
    for both in (line, other):
        both.ask("1PA1.001")
        both.wait(30.0)
    assert other.stage.knob_um == line.stage.knob_um
