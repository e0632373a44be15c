"""Parameters of an emulated Newport controller: working values, values in memory, and who may set which."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sim_backend.emulators import newport_manual as manual
from sim_backend.emulators.newport_manual import ACTUATORS, PARAMETERS, State

NUMBER = re.compile(r"^[+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?")  # what follows it is ignored (S p. 26)
JERK_S = 0.04  # default of JR in a public driver
ACCELERATIONS_PER_SPEED = 4.0  # 1/s: a quarter of a second to full speed; no source


def number_in(text: str) -> float | None:
    """Return the number that a text begins with, None if there is none."""
    found = NUMBER.match(text)
    return float(found.group()) if found else None


@dataclass(frozen=True, slots=True)
class ControllerModel:
    """Which controller, with what on it.

    Attributes
    ----------
    kind
        ``conex-cc``, ``smc100`` (SMC100CC) or ``smc100pp``.
    address
        1 to 31.
    actuator
        Its name in `newport_manual.ACTUATORS`; empty for an ideal one, which has the micrometer's own resolution and
        speed.
    zero_mm
        Position at which the micrometer's knob is at 0, once the controller has found its home.
    lowest_mm, highest_mm
        Software limits SL and SR.
    home_type
        HT: 0 to 4.
    referenced
        Whether the power was on before and a home found. Real controllers wake up NOT REFERENCED.
    ideal_speed_mm_per_s
        As fast as an ideal actuator can be driven.
    saving_s
        How long PW0 takes.
    tells_errors_once
        Whether TS forgets the error bits that it has told. One public driver says so of the SMC100's manual; the page
        itself was not seen.
    processing_s
        Time until a question is answered, for the wire; the manual's 10 ms, none for the ideal actuator.
    """

    kind: str = "conex-cc"
    address: int = 1
    actuator: str = ""
    zero_mm: float = 2.0
    lowest_mm: float = 0.0
    highest_mm: float = 12.0
    home_type: int = manual.END_OF_RUN
    referenced: bool = False
    ideal_speed_mm_per_s: float = manual.IDEAL_SPEED_MM_PER_S
    saving_s: float = manual.SAVING_S
    tells_errors_once: bool = True
    seed: int = 0

    @property
    def processing_s(self) -> float:
        """Time until a question is answered, s."""
        return manual.EXECUTION_S if self.actuator else 0.0


class Parameters:
    """Working values, lost at power-off, and those in memory, which PW0 writes.

    Parameters
    ----------
    model
        Whose memory it is.
    speed_mm_per_s
        Largest speed of the motor.

    Attributes
    ----------
    values, stored
        By command name: at work, and in memory.
    identifier
        What ID tells; no page says what it looks like without a stage that knows its name.
    """

    def __init__(self, model: ControllerModel, speed_mm_per_s: float) -> None:
        self.identifier = f"{(model.actuator or 'ideal').upper()}_PN:0_UD:0"
        self._kind = model.kind
        lowest_mm, highest_mm = model.lowest_mm, model.highest_mm
        values = dict.fromkeys(PARAMETERS, 1.0)
        values |= {"VA": speed_mm_per_s, "OH": speed_mm_per_s / 2, "JR": JERK_S, "BA": 0.0, "BH": 0.0}
        values |= {"SL": lowest_mm, "SR": highest_mm, "HT": model.home_type, "SA": 2, "SC": 1, "ZX": 3}
        values["OT"] = min(PARAMETERS["OT"].high, 1.0 + 2 * (highest_mm - lowest_mm) / values["OH"])
        values["AC"] = ACCELERATIONS_PER_SPEED * speed_mm_per_s
        if model.actuator:
            actuator = ACTUATORS[model.actuator]
            values["SU"], values["AC"] = actuator.encoder_um * 1e-3, actuator.acceleration_mm_per_s2
        self.stored: dict[str, float] = values
        self.forget()

    def forget(self) -> None:
        """Take up what is in memory, as at power-on."""
        self.values = dict(self.stored)

    def save(self) -> None:
        """Write what is at work into memory."""
        self.stored = dict(self.values)

    def wrong_kind(self, name: str) -> str:
        """Return the error of a parameter that this kind of controller does not have, empty if it has."""
        only = PARAMETERS[name].only
        if only == "pp" and self._kind != "smc100pp":
            return manual.NOT_FOR_CC if self._kind == "smc100" else manual.UNKNOWN
        return manual.NOT_FOR_PP if only == "cc" and self._kind == "smc100pp" else ""

    def put(self, name: str, text: str, state: State) -> str:
        """Set a parameter in a state that allows it; returns the error letter."""
        number = number_in(text)
        high = PARAMETERS[name].high
        if name == "VA" and state is not State.CONFIGURATION:
            high = self.stored["VA"]  # what CONFIGURATION has saved is the largest (S, VA)
        if number is None or not PARAMETERS[name].low <= number <= high:
            return manual.PARAMETER
        self.values[name] = number
        if name in ("BA", "BH"):
            self.values["BH" if name == "BA" else "BA"] = 0.0  # never both
        return manual.NONE

    def motion_time_s(self, distance_mm: float) -> float:
        """Return how long a move takes (PT)."""
        return abs(distance_mm) / self.values["VA"] + self.values["VA"] / self.values["AC"]

    def lines(self) -> list[str]:
        """Return every parameter as the commands that would set them (S, ZT)."""
        names = [name for name in PARAMETERS if not self.wrong_kind(name)]
        return ["PW1", f"ID{self.identifier}", *(f"{name}{self.values[name]:g}" for name in names), "PW0"]
