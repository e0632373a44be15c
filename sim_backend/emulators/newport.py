"""Emulated CONEX-CC or SMC100, from Newport's manuals: the simulated micrometer behind the controller's lines.

Nothing here is taken from the driver of this project; see `newport_manual` for the sources.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from rig import Clock
from sim_backend.emulators import newport_manual as manual
from sim_backend.emulators.newport_manual import ACTUATORS, PARAMETERS, REFUSALS, State, group
from sim_backend.emulators.newport_motion import ControlledMotion
from sim_backend.emulators.newport_parameters import ControllerModel, Parameters, number_in
from sim_backend.stage import SimulatedStage

COMMAND = re.compile(r"^(\d*(?:\.\d*)?)([A-Z]{2})(.*)$")
LONG_NAMES = ("FR", "QI")  # a third letter belongs to the name
LARGEST_ADDRESS = 31
DECIMALS = 6  # of positions, mm; no page says how many


def _of_the_motion(name: str) -> Any:
    """Return an attribute that is its motion's."""
    return property(lambda self: getattr(self._motion, name), lambda self, value: setattr(self._motion, name, value))


class EmulatedController:
    """Controller of the simulated micrometer.

    Parameters
    ----------
    stage, clock
        The micrometer and its time.
    model
        Which controller, with what on it.
    speed_um_per_s
        VA at work, where the power was on before.

    Attributes
    ----------
    stalled
        Whether the motor is held fast.
    fails_next
        Positioner error bits with which the next move fails, none the one after.
    powered
        Whether the motor has power; see `cut_power`.
    ends_um
        Where the actuator runs into its ends, knob.
    version
        What it says that it is.
    sent
        Every command that came, for tests of what is never sent.
    processing_s
        Time until a question is answered, for the wire.
    """

    def __init__(self, stage: SimulatedStage, model: ControllerModel, speed_um_per_s: float, clock: Clock) -> None:
        self.powered = True
        self.version = manual.VERSIONS[model.kind]
        self.sent: list[str] = []
        self.processing_s = model.processing_s
        self._model = model
        self._clock = clock
        actuator = ACTUATORS[model.actuator] if model.actuator else None
        top = actuator.speed_mm_per_s if actuator else model.ideal_speed_mm_per_s
        self._motion = ControlledMotion(stage, clock, actuator, top, model.zero_mm, model.seed)
        if actuator is None:
            self.ends_um = (model.lowest_mm - model.zero_mm) * 1e3, (model.highest_mm - model.zero_mm) * 1e3
        self._parameters = Parameters(model, top)
        self._boot()
        if model.referenced:
            self._motion.find_home(manual.END_OF_RUN)
            self._state = State.READY_MOVING
            self._parameters.values["VA"] = min(top, speed_um_per_s * 1e-3)

    def _boot(self) -> None:
        """Be as after power-on or RS: parameters from memory, position counted from where it stands."""
        self._parameters.forget()
        self._state = State.NOT_REFERENCED_RESET
        self._bits = 0
        self._error = manual.NONE
        self._buffer = self._unasked = b""
        self._busy_until_s = 0.0
        self._motion.forget()

    stalled = _of_the_motion("stalled")
    fails_next = _of_the_motion("fails_next")
    ends_um = _of_the_motion("ends_um")

    # --- power ----------------------------------------------------------------------------------------------

    def cut_power(self) -> None:
        """Take the motor's power away: it stands, and nothing answers."""
        self.powered = False
        self._boot()

    def restore_power(self) -> None:
        """Give the power back; the controller sends a NUL."""
        if not self.powered:
            self.powered = True
            self._boot()
            self._unasked += b"\0"

    # --- wire -----------------------------------------------------------------------------------------------

    def unasked(self) -> bytes:
        """The NUL of a power cut."""
        data, self._unasked = self._unasked, b""
        return data

    def receive(self, data: bytes) -> list[bytes]:
        """Take bytes in and answer the lines that are complete; a line ends in CR LF (S p. 26)."""
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\r\n")
        replies = [self._take(line.decode("ascii", errors="replace")) for line in lines]
        return [reply.encode() for reply in replies if reply]

    def _take(self, line: str) -> str:
        if line:
            self.sent.append(line)
        if not self.powered or self._clock.now() < self._busy_until_s:
            return ""
        self._keep_up()
        # both cases and blanks anywhere are accepted (S p. 26)
        found = COMMAND.match(line.replace(" ", "").upper())
        if found is None:
            return self._fail(manual.UNKNOWN) if line.strip() else ""
        prefix, name, rest = found.groups()
        if "." in prefix:
            return self._fail(manual.UNKNOWN)  # floating point address (N p. 33)
        if name in LONG_NAMES:
            name, rest = name + rest[:1], rest[1:]
        if not prefix and name != "ST":
            return self._fail(manual.ADDRESS)  # missing (N p. 33); ST without one is for all controllers (S, ST)
        if prefix and int(prefix) != self._model.address:
            return self._fail(manual.ADDRESS) if not 1 <= int(prefix) <= LARGEST_ADDRESS else ""
        return self._execute(name, rest)

    def _fail(self, letter: str) -> str:
        self._error = letter
        return ""

    def _execute(self, name: str, rest: str) -> str:
        told = self._tell(name, rest)
        if told is not None:
            return f"{self._model.address}{name}{told}\r\n"
        if name == "ZT":
            return "".join(f"{self._model.address}{line}\r\n" for line in self._parameters.lines())
        orders: dict[str, Callable[[str], str]] = {
            "PA": lambda value: self._move(value, 0.0),
            "PR": lambda value: self._move(value, self._motion.target_mm),
            "OR": self._home,
            "MM": self._switch,
            "ST": self._stop,
            "PW": self._configure,
            "RS": self._reset,
        }
        if name in orders:
            self._error = orders[name](rest)
        elif name in PARAMETERS:
            self._error = self._set(name, rest)
        else:
            self._error = manual.PARAMETER if name == "PT" else manual.UNKNOWN
        return ""

    # --- questions --------------------------------------------------------------------------------------------

    def _tell(self, name: str, rest: str) -> str | None:
        """Return what a question is answered with, None if it is none."""
        asked = rest.startswith("?")
        answers: dict[str, Callable[[], str]] = {
            "TP": lambda: f"{self._motion.position_mm():.{DECIMALS}f}",
            "TH": lambda: f"{self._motion.set_point_mm():.{DECIMALS}f}",
            "TS": self._status,
            "TE": self._last_error,
            "TB": lambda: self._text(rest),
            "VE": lambda: f" {self.version}",
        }
        if name in answers:
            return answers[name]()
        distance = number_in(rest)
        if name == "PT" and distance is not None:
            return f"{self._parameters.motion_time_s(distance):g}"
        if not asked:
            return None
        if name in PARAMETERS and not self._parameters.wrong_kind(name):
            return f"{self._parameters.values[name]:g}"
        # what MM? says no page was found for; "0" for DISABLE, as MM0 leads there
        others = {
            "PA": f"{self._motion.target_mm:.{DECIMALS}f}",
            "PR": f"{self._motion.target_mm:.{DECIMALS}f}",
            "ID": self._parameters.identifier,
            "PW": str(int(self._state is State.CONFIGURATION)),
            "MM": str(int(group(self._state) != manual.DISABLE)),
        }
        return others.get(name)

    def _status(self) -> str:
        """Return error bits and state."""
        bits = self._bits
        if self._model.tells_errors_once:
            self._bits = 0
        return f"{bits:04X}{self._current_state():02X}"

    def _last_error(self) -> str:
        error, self._error = self._error, manual.NONE
        return error

    def _text(self, letter: str) -> str:
        letter = letter[:1] if letter[:1] in manual.ERRORS else self._last_error()
        return f"{letter} {manual.ERRORS[letter]}"

    # --- orders: each returns its error letter -------------------------------------------------------------------

    def _allow(self, groups: str) -> str:
        """Return the error of an order that is allowed in some groups of states alone, empty if it is now."""
        now = group(self._current_state())
        return "" if now in groups else REFUSALS[now]

    def _set(self, name: str, rest: str) -> str:
        refused = self._parameters.wrong_kind(name) or self._allow(PARAMETERS[name].settable)
        return refused or self._parameters.put(name, rest, self._state)

    def _move(self, rest: str, origin_mm: float) -> str:
        refused = self._allow(manual.READY)
        if refused:
            return refused
        number = number_in(rest)
        if number is None:
            return manual.PARAMETER
        target = origin_mm + number
        if not self._parameters.values["SL"] <= target <= self._parameters.values["SR"]:
            return manual.OUT_OF_LIMITS
        self._bits = 0
        self._motion.begin(target, self._parameters.values["VA"])
        self._state = State.MOVING
        return manual.NONE

    def _home(self, _rest: str) -> str:
        if group(self._state) == manual.HOMING:
            return manual.ALREADY_HOMING
        refused = self._allow(manual.NOT_REFERENCED)
        if refused:
            return refused
        self._bits = 0
        self._state = State.HOMING
        self._motion.search_home(
            int(self._parameters.values["HT"]), self._parameters.values["OH"], self._parameters.values["OT"]
        )
        self._keep_up()
        return manual.NONE

    def _switch(self, rest: str) -> str:
        number = number_in(rest)
        if number not in (0.0, 1.0):
            return manual.PARAMETER
        refused = self._allow(manual.DISABLE if number else manual.READY)
        if refused:
            return refused
        target = State.READY_DISABLE if number else State.DISABLE_READY
        if self._state is not target:  # else it is on its way there
            self._motion.switch(bool(number))
            self._state = target
        return manual.NONE

    def _stop(self, _rest: str) -> str:
        refused = self._allow(manual.DISABLE + manual.READY + manual.MOVING + manual.HOMING)
        if refused:
            return refused
        self._motion.stop()
        if self._state is State.HOMING:
            self._state = State.NOT_REFERENCED_HOMING
        elif self._state is State.MOVING:
            self._state = State.READY_MOVING
        return manual.NONE

    def _configure(self, rest: str) -> str:
        number = number_in(rest)
        if number not in (0.0, 1.0):
            return manual.PARAMETER
        refused = self._allow(manual.NOT_REFERENCED if number else manual.CONFIGURATION)
        if refused:
            return refused
        if number:
            self._state = State.CONFIGURATION
            return manual.NONE
        self._parameters.save()
        self._busy_until_s = self._clock.now() + self._model.saving_s
        self._state = State.NOT_REFERENCED_CONFIGURATION
        return manual.NONE

    def _reset(self, _rest: str) -> str:
        self._boot()
        return manual.NONE

    # --- what happens meanwhile -----------------------------------------------------------------------------------

    def _keep_up(self) -> None:
        """Let happen what has happened by now."""
        failed = self._motion.failure()
        if failed:
            self._bits |= failed
            if self._state is State.HOMING:
                self._state = State.NOT_REFERENCED_HOMING
            elif failed & ~manual.NOT_HARDWARE:
                self._state = State.NOT_REFERENCED_MOVING
            else:
                self._state = State.DISABLE_MOVING
                self._motion.switch(False, at_once=True)
        elif self._state is State.HOMING and not self._motion.moving:
            self._motion.find_home(int(self._parameters.values["HT"]))
            self._state = State.READY_HOMING
        elif self._state is State.MOVING and not self._motion.moving:
            self._state = State.READY_MOVING

    def _current_state(self) -> State:
        """Return the state as TS tells it: switching the motor takes a moment."""
        if self._motion.switching and self._state is State.READY_DISABLE:
            return State.DISABLE_READY
        if self._motion.switching and self._state is State.DISABLE_READY:
            return State.READY_MOVING
        return self._state

    # --- checkpoint ---------------------------------------------------------------------------------------------

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types; moves are part of the micrometer's."""
        if self.powered:
            self._keep_up()
        return {
            "state": int(self._state),
            "referenced": group(self._state) not in manual.NOT_REFERENCED + manual.CONFIGURATION + manual.HOMING,
            "powered": self.powered,
            "bits": self._bits,
            "values": dict(self._parameters.values),
            "stored": dict(self._parameters.stored),
            "motion": self._motion.checkpoint(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._boot()
        self._state, self._bits, self.powered = State(state["state"]), state["bits"], state["powered"]
        self._parameters.values, self._parameters.stored = dict(state["values"]), dict(state["stored"])
        self._motion.restore(state["motion"])
