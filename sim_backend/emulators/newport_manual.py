"""What Newport's manuals say of the CONEX-CC and the SMC100: states, errors, commands; data of the actuators.

Sources
-------
S
    SMC100CC & SMC100PP, User's Manual, EDH0206En (pages as in En2042, 04/16).
C
    CONEX-CC, Controller Documentation (TS on p. 54).
N
    NPC1USB, User's Manual, EDH0403En1010, p. 33: a sister with the same command language.
D
    Data of the actuators as public drivers give them after the data sheets; the sheets were not seen.

docs/emulators.md tells for each item what a page confirms and what is taken from elsewhere or assumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

# --- positioner errors: bits of the first four digits of TS (S, TS; C p. 54) ------------------------------------

NEGATIVE_END, POSITIVE_END = 0x001, 0x002
PEAK_CURRENT, RMS_CURRENT, SHORT_CIRCUIT = 0x004, 0x008, 0x010
FOLLOWING, HOMING_TIMEOUT, WRONG_STAGE = 0x020, 0x040, 0x080
LOW_VOLTAGE, OUTPUT_POWER = 0x100, 0x200
NOT_HARDWARE = FOLLOWING | HOMING_TIMEOUT | WRONG_STAGE
"""Errors that do not end in NOT REFERENCED from READY or MOVING: the drawing on the SMC100 has two ways out of these
states, one marked as following error, to DISABLE, and one marked as hardware fault, to NOT REFERENCED."""


class State(IntEnum):
    """Last two digits of TS (S, TS; C p. 54)."""

    NOT_REFERENCED_RESET = 0x0A
    NOT_REFERENCED_HOMING = 0x0B
    NOT_REFERENCED_CONFIGURATION = 0x0C
    NOT_REFERENCED_DISABLE = 0x0D
    NOT_REFERENCED_READY = 0x0E
    NOT_REFERENCED_MOVING = 0x0F
    NOT_REFERENCED_STAGE = 0x10  # S: ESP stage error; C: no parameters in memory
    NOT_REFERENCED_JOGGING = 0x11  # S alone
    CONFIGURATION = 0x14
    HOMING = 0x1E
    HOMING_KEYPAD = 0x1F  # S alone
    MOVING = 0x28
    READY_HOMING = 0x32
    READY_MOVING = 0x33
    READY_DISABLE = 0x34
    READY_JOGGING = 0x35  # S alone
    DISABLE_READY = 0x3C
    DISABLE_MOVING = 0x3D


# groups of states, as the columns of the command tables have them (S sec. 6.5), HOMING besides
NOT_REFERENCED, CONFIGURATION, DISABLE, READY, MOVING, HOMING = "NCDRMH"
EVERY = "NCDRMH"


def group(state: State) -> str:
    """Return the column of the command tables that a state belongs to."""
    if state <= State.NOT_REFERENCED_JOGGING:
        return NOT_REFERENCED
    if state is State.CONFIGURATION:
        return CONFIGURATION
    if state in (State.HOMING, State.HOMING_KEYPAD):
        return HOMING
    if state is State.MOVING:
        return MOVING
    return READY if state <= State.READY_JOGGING else DISABLE


# --- command errors: letters of TE, texts of TB (S, TE) ------------------------------------------------------------

NONE, UNKNOWN, ADDRESS, PARAMETER, NOT_ALLOWED, ALREADY_HOMING = "@ABCDE"
OUT_OF_LIMITS, NOT_FOR_PP, NOT_FOR_CC = "G", "W", "X"
REFUSALS = {NOT_REFERENCED: "H", CONFIGURATION: "I", DISABLE: "J", READY: "K", HOMING: "L", MOVING: "M"}
ERRORS = {
    NONE: "No error",
    UNKNOWN: "Unknown message code or floating point controller address",
    ADDRESS: "Controller address not correct",
    PARAMETER: "Parameter missing or out of range",
    NOT_ALLOWED: "Command not allowed",
    ALREADY_HOMING: "Home sequence already started",
    "F": "ESP stage name unknown",
    OUT_OF_LIMITS: "Displacement out of limits",
    "H": "Command not allowed in NOT REFERENCED state",
    "I": "Command not allowed in CONFIGURATION state",
    "J": "Command not allowed in DISABLE state",
    "K": "Command not allowed in READY state",
    "L": "Command not allowed in HOMING state",
    "M": "Command not allowed in MOVING state",
    "N": "Current position out of software limit",
    "S": "Communication Time Out",
    "U": "Error during EEPROM access",
    "V": "Error during command execution",
    NOT_FOR_PP: "Command not allowed for PP version",
    NOT_FOR_CC: "Command not allowed for CC version",
}

# --- parameters ---------------------------------------------------------------------------------------------------

SMALLEST, LARGEST = 1e-6, 1e12  # of accelerations, velocities and most others (S, AC and VA)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter that is set by a command and told by the same with a question mark.

    Attributes
    ----------
    settable
        Groups of states in which it can be set. It is told in all: so a real SMC100CC 3.1.2 does, whose parameters a
        public program has read without entering CONFIGURATION.
    low, high
        Range of values.
    only
        ``"cc"`` or ``"pp"`` for parameters of DC or stepper controllers alone, else empty.
    """

    settable: str
    low: float = SMALLEST
    high: float = LARGEST
    only: str = ""


PARAMETERS = {
    "AC": Parameter("CDR"),
    "BA": Parameter("C"),  # 0 is out of range: the other of BA and BH being set makes it 0
    "BH": Parameter("C"),
    "DV": Parameter("C", 12, 48, only="cc"),
    "FD": Parameter("CD", only="cc"),
    "FE": Parameter("CD", only="cc"),
    "FF": Parameter("CD", 0, only="cc"),
    "FRM": Parameter("C", 1, 2000, only="pp"),
    "FRS": Parameter("C", only="pp"),
    "HT": Parameter("C", 0, 4),
    "JR": Parameter("CDR", 1e-3),
    "KD": Parameter("CD", 0, only="cc"),
    "KI": Parameter("CD", 0, only="cc"),
    "KP": Parameter("CD", 0, only="cc"),
    "KV": Parameter("CD", 0, only="cc"),
    "OH": Parameter("C"),
    "OT": Parameter("C", 1, 1e3),
    "QIL": Parameter("C", 0.05, 3),
    "QIR": Parameter("C", 0.05, 1.5, only="cc"),
    "QIT": Parameter("C", 0.01, 100, only="cc"),
    "SA": Parameter("C", 2, 31),
    "SC": Parameter("CD", 0, 1, only="cc"),
    "SL": Parameter("CDR", -LARGEST, 0),
    "SR": Parameter("CDR", 0, LARGEST),
    "SU": Parameter("C", only="cc"),
    "VA": Parameter("CDR"),
    "VB": Parameter("C", 0, only="pp"),
    "ZX": Parameter("C", 1, 3),
}
HOME_SWITCH_AND_INDEX, CURRENT_POSITION, HOME_SWITCH, END_AND_INDEX, END_OF_RUN = range(5)  # HT

EXECUTION_S = 0.010
"""Until a question is answered: typically 10 ms for the first controller (S p. 26, sec. 6.4)."""

SAVING_S = 10.0
"""PW0 writes the flash, in up to 10 s, without a reply to anything meanwhile (S, PW)."""

VERSIONS = {
    "conex-cc": "CONEX-CC 2.0.1",
    "smc100": "SMC_CC - Controller-driver version  3. 1. 2",
    "smc100pp": "SMC_PP - Controller-driver version  3. 1. 2",
}
"""What real ones of the first two answer to VE, as two public programs have noted it; the third by analogy."""


@dataclass(frozen=True, slots=True)
class Actuator:
    """A motor actuator (D).

    Attributes
    ----------
    travel_mm
        From one end to the other.
    step_um
        Minimal incremental motion: positions at rest are its multiples.
    encoder_um
        What the encoder counts, and so the resolution of TP.
    speed_mm_per_s
        As fast as it can be driven.
    repeatability_um
        It stands anywhere so far to either side of such a multiple. No source: half a step is assumed.
    acceleration_mm_per_s2
        No source: assumed.
    """

    travel_mm: float
    step_um: float
    encoder_um: float
    speed_mm_per_s: float
    repeatability_um: float
    acceleration_mm_per_s2: float


ACTUATORS = {
    "tra12cc": Actuator(12.0, 0.2, 0.030517578, 0.4, 0.1, 1.6),
    "trb6cc": Actuator(6.0, 0.1, 0.01447, 0.2, 0.05, 0.8),
    "cma25ccl": Actuator(25.0, 0.2, 0.048828, 0.4, 0.1, 1.6),
}
IDEAL_SPEED_MM_PER_S = ACTUATORS["tra12cc"].speed_mm_per_s
"""As fast as an actuator without a name is: with the step of the simulated micrometer, and otherwise like this one."""
