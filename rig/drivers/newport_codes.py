"""What Newport's CONEX-CC and SMC100 controllers say, in their letters and in sentences.

Sources, for the makers' command manuals could not be had: qmi 0.54.2 (``single_axis_motion_controller.py``, tables of
states and of positioner errors of the CONEX-CC), hvl_ccb 0.19.6 (``dev/newport/newport.py``, SMC100PP: letters of
``TE``, errors, states), pystages (``smc100.py``) and SMC100Chained (``StatusLibrary``) for the SMC100. Where they
agree and where not stands in docs/hardware.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntFlag
from typing import Literal

Controller = Literal["conex-cc", "smc100"]

LARGEST_NUMBER = 1e6  # mm, or any other quantity of these controllers


class CommandError(Enum):
    """Letters that ``TE`` answers after a command; some only one of the controllers knows."""

    NONE = ("@", "")
    CODE = ("A", "the command or its address is not known to the controller")
    ADDRESS = ("B", "the controller's address is not correct")
    PARAMETER = ("C", "a parameter is missing or out of range")
    NOT_ALLOWED = ("D", "the command is not allowed")
    HOMING_ALREADY = ("E", "homing has begun already")
    STAGE_UNKNOWN = ("F", "the stage is not known to the controller")
    DISPLACEMENT = ("G", "the displacement is out of the limits")
    NOT_REFERENCED = ("H", "not allowed before the stage has found its reference")
    CONFIGURATION = ("I", "not allowed in configuration state")
    DISABLED = ("J", "not allowed while the motor is off")
    READY = ("K", "not allowed while the stage is ready")
    HOMING = ("L", "not allowed while the stage looks for its reference")
    MOVING = ("M", "not allowed while the stage moves")
    SOFT_LIMIT = ("N", "the position is outside the soft limits")
    TRACKING = ("P", "not allowed in tracking mode")
    TIMED_OUT = ("S", "communication timed out")
    EEPROM = ("U", "its memory failed")
    EXECUTION = ("V", "the command could not be carried out")
    NOT_PP = ("W", "the command is not for the PP version of the controller")
    NOT_CC = ("X", "the command is not for the CC version of the controller")

    @classmethod
    def of(cls, letter: str, controller: Controller | None = None) -> CommandError | None:
        """Return the error of a letter; None if the controller (None: either) has no such letter."""
        return next((e for e in cls if e.value[0] == letter and controller in (None, ONLY.get(e, controller))), None)


ONLY: dict[CommandError, Controller] = {
    CommandError.TRACKING: "conex-cc",  # a public CONEX-CC driver (class NewportConexCC, table errorDict)
    CommandError.NOT_PP: "smc100",  # hvl_ccb, ControllerErrors
    CommandError.NOT_CC: "smc100",
}
"""Letters that one controller has and the other has not."""


class PositionerError(IntFlag):
    """Bits of the error word in the answer to ``TS``: qmi, hvl_ccb and pystages agree on all ten."""

    NEGATIVE_END = 0x001
    POSITIVE_END = 0x002
    PEAK_CURRENT = 0x004
    RMS_CURRENT = 0x008
    SHORT_CIRCUIT = 0x010
    FOLLOWING = 0x020
    HOMING_TIMED_OUT = 0x040
    WRONG_STAGE = 0x080
    LOW_VOLTAGE = 0x100
    POWER = 0x200


MEANINGS: dict[PositionerError, tuple[str, str]] = {
    PositionerError.NEGATIVE_END: (
        "it ran into its end on the retracted side",
        "move it off the end by hand and correct zero_mm",
    ),
    PositionerError.POSITIVE_END: (
        "it ran into its end on the side of the contact",
        "mount the specimen higher or correct zero_mm",
    ),
    PositionerError.PEAK_CURRENT: ("the motor's current was too high", "look what blocks it"),
    PositionerError.RMS_CURRENT: ("the motor's current was too high for too long", "look what blocks it"),
    PositionerError.SHORT_CIRCUIT: ("the motor is short-circuited", "check the motor's cable"),
    PositionerError.FOLLOWING: ("the motor did not follow (following error)", "look what blocks it"),
    PositionerError.HOMING_TIMED_OUT: ("it did not find its reference in time", "look what blocks it"),
    PositionerError.WRONG_STAGE: ("another actuator is plugged in than was configured", "plug in the right one"),
    PositionerError.LOW_VOLTAGE: ("its supply voltage is too low", "check the power supply"),
    PositionerError.POWER: ("its output power was exceeded", "look what blocks it"),
}


class AxisState(Enum):
    """Kinds of state in the answer to ``TS``, by what they are called."""

    NOT_REFERENCED = "not referenced"
    CONFIGURATION = "in configuration"
    HOMING = "looking for its reference"
    MOVING = "moving"
    READY = "ready"
    DISABLED = "motor off"
    JOGGING = "moved by hand from its keypad (jogging)"
    TRACKING = "in tracking mode"

    @classmethod
    def of(cls, code: int, controller: Controller | None = None) -> AxisState | None:
        """Return the state of a code; None if the controller (None: either) has no such code."""
        tables = STATES.values() if controller is None else (STATES[controller],)
        return next((table[code] for table in tables if code in table), None)


BOTH: dict[int, AxisState] = {
    **dict.fromkeys(range(0x0A, 0x11), AxisState.NOT_REFERENCED),
    0x14: AxisState.CONFIGURATION,
    0x1E: AxisState.HOMING,
    0x1F: AxisState.HOMING,  # by the SMC100's keypad; no source lists it for the CONEX-CC
    0x28: AxisState.MOVING,
    **dict.fromkeys((0x32, 0x33, 0x34), AxisState.READY),  # from homing, moving, disable
    **dict.fromkeys((0x3C, 0x3D, 0x3E), AxisState.DISABLED),  # from ready, moving; 3E from tracking or jogging
}
STATES: dict[Controller, dict[int, AxisState]] = {
    "conex-cc": {
        **BOTH,
        # READY T is ready in tracking mode (TK1), in which nobody says that a PA keeps to the velocity VA
        **dict.fromkeys((0x36, 0x37, 0x38), AxisState.TRACKING),
        0x3F: AxisState.DISABLED,
        **dict.fromkeys((0x46, 0x47), AxisState.TRACKING),
    },
    "smc100": {
        **BOTH,
        0x11: AxisState.NOT_REFERENCED,  # from jogging
        0x35: AxisState.READY,  # from jogging
        **dict.fromkeys((0x46, 0x47), AxisState.JOGGING),
    },
}
"""State codes of each controller: qmi for the CONEX-CC; hvl_ccb, pystages and SMC100Chained for the SMC100."""


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """Answer to ``TS``."""

    errors: PositionerError
    state: AxisState
    code: int

    def trouble(self) -> tuple[str, str] | None:
        """Return what happened and what to do, of the gravest error; None if there is none."""
        for bit in reversed(PositionerError):
            if bit in self.errors:
                return MEANINGS[bit]
        return None


class ReplyError(ValueError):
    """A line that is not a sound reply to what was asked."""


def parse_reply(line: bytes, address: int, command: str) -> str:
    """Return the value in a reply line such as ``1TP2.15``, without its end of line.

    Raises
    ------
    ReplyError
        The line is not ASCII, or does not repeat address and command.
    """
    try:
        text = line.strip(b"\r\n").decode("ascii")
    except UnicodeDecodeError as error:
        raise ReplyError("the line is not ASCII") from error
    prefix = f"{address}{command}"
    if not text.startswith(prefix):
        raise ReplyError(f"{text!r} does not answer {prefix}")
    return text[len(prefix) :].strip(" ")


def parse_status(value: str, controller: Controller | None = None) -> AxisStatus:
    """Return the status in the value of a ``TS`` reply: four hexadecimal digits of errors, two of state.

    ``controller`` says whose codes these are; None takes either's.
    """
    if len(value) != 6 or any(c not in "0123456789ABCDEFabcdef" for c in value):
        raise ReplyError(f"{value!r} is not a status")
    errors, code = int(value[:4], 16), int(value[4:], 16)
    state = AxisState.of(code, controller)
    if state is None:
        raise ReplyError(f"{code:02X} is not a state")
    if errors & ~sum(PositionerError):
        raise ReplyError(f"{errors:04X} has error bits that mean nothing")
    return AxisStatus(PositionerError(errors), state, code)


def parse_error(value: str, controller: Controller | None = None) -> CommandError:
    """Return the error in the value of a ``TE`` reply."""
    error = CommandError.of(value, controller)
    if error is None:
        raise ReplyError(f"{value!r} is not an error letter")
    return error


def parse_number(value: str) -> float:
    """Return the number in a reply: digits, sign, point, exponent; nothing else that Python calls a float."""
    if not value or any(c not in "0123456789+-.eE" for c in value):
        raise ReplyError(f"{value!r} is not a number")
    try:
        number = float(value)
    except ValueError as error:
        raise ReplyError(f"{value!r} is not a number") from error
    if abs(number) > LARGEST_NUMBER:
        raise ReplyError(f"{value!r} is out of all bounds")
    return number
