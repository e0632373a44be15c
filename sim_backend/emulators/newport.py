"""Emulated CONEX-CC or SMC100: the simulated micrometer behind the controller's lines and states."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from rig import Clock
from rig.drivers.newport_codes import PositionerError
from rig.drivers.settings import NewportStage
from sim_backend.stage import CLAMPING_S, DIGITS, SimulatedStage

VERSIONS = {"conex-cc": "CONEX-CC 2.0.1", "smc100": "SMC_CC 3.1.2"}
LINE = re.compile(r"^(\d{0,2})([A-Z]{2})(.*)$")
NUMBER = re.compile(r"^[+-]?\d+(\.\d+)?$")
NOT_REFERENCED, HOMING, MOVING = 0x0A, 0x1E, 0x28
READY_FROM_HOMING, READY_FROM_MOVING, READY_FROM_DISABLE = 0x32, 0x33, 0x34
DISABLED_FROM_READY, DISABLED_FROM_MOVING = 0x3C, 0x3D
FOLLOWING_S = 0.05  # after which a motor that does not turn is switched off


class EmulatedController:
    """Controller of the simulated micrometer. It is referenced at first: its power was on before.

    Attributes
    ----------
    stalled
        Whether the motor is held fast.
    fails_next
        Error with which the next move fails, none the one after.
    powered
        Whether the motor has power; see `cut_power`.
    ends_um
        Where the actuator runs into its ends.
    version
        What it says that it is.
    sent
        Every command that came, for tests of what is never sent.
    """

    def __init__(self, stage: SimulatedStage, settings: NewportStage, speed_um_per_s: float, clock: Clock) -> None:
        self.stalled = False
        self.fails_next = PositionerError(0)
        self.powered = True
        self.ends_um = ((settings.lowest_mm - settings.zero_mm) * 1e3, (settings.highest_mm - settings.zero_mm) * 1e3)
        self.version = VERSIONS[settings.driver]
        self.sent: list[str] = []
        self._stage = stage
        self._settings = settings
        self._speed = speed_um_per_s
        self._clock = clock
        self._buffer = b""
        self._unasked = b""
        self._error = "@"
        self._bits = PositionerError(0)
        self._referenced = True
        self._homing = False
        self._rest = READY_FROM_MOVING  # state when it stands, the motor on
        self._off = DISABLED_FROM_READY  # state when the motor is off
        self._switched_s = -CLAMPING_S  # when the motor was last switched
        self._fails_s: float | None = None  # when a move that cannot be made is noticed
        self._why = PositionerError(0)

    # --- power ----------------------------------------------------------------------------------------------

    def cut_power(self) -> None:
        """Take the motor's power away: it stands, and the controller knows no position any more."""
        self.powered = False
        self._stage.halt()
        self._stage.clamp(False)
        self._referenced = self._homing = False
        self._bits = PositionerError(0)
        self._fails_s = None

    def restore_power(self) -> None:
        """Give the power back; the controller sends a NUL."""
        if not self.powered:
            self.powered = True
            self._unasked += b"\0"

    # --- wire -----------------------------------------------------------------------------------------------

    def unasked(self) -> bytes:
        """The NUL of a power cut."""
        data, self._unasked = self._unasked, b""
        return data

    def receive(self, data: bytes) -> list[bytes]:
        """Take bytes in and answer the lines that are complete."""
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\n")
        replies = [self._answer(line.strip(b"\r").decode("ascii", errors="replace")) for line in lines]
        return [reply for reply in replies if reply and self.powered]

    def _answer(self, line: str) -> bytes:
        self.sent.append(line)
        found = LINE.match(line)
        if found is None or not self.powered:
            return b""
        address, command, value = found.groups()
        if command == "ST" and not address:
            address = str(self._settings.address)
        if address != str(self._settings.address):
            return b""
        self._keep_up()
        answers: dict[str, Callable[[], str]] = {
            "TS": lambda: f"{int(self._bits):04X}{self._state():02X}",
            "TE": self._last_error,
            "TP": lambda: f"{self._to_mm(self._stage.knob_um):.6f}",
            "VE": lambda: f" {self.version}",
            "VA": lambda: f"{self._speed * 1e-3:g}",
            "HT": lambda: "4",
            "SL": lambda: f"{self._settings.lowest_mm:g}",
            "SR": lambda: f"{self._settings.highest_mm:g}",
        }
        if command in answers:
            if command == "VA" and value != "?":
                self._error = self._set_speed(value)
                return b""
            if command in ("SL", "SR", "HT") and value != "?":
                self._error = "D"  # what sets them is not emulated, as nothing may send it
                return b""
            return f"{address}{command}{answers[command]()}\r\n".encode()
        orders: dict[str, Callable[[str], str]] = {"PA": self._move, "OR": self._home, "MM": self._switch}
        if command == "ST":
            self._stage.halt()
            self._homing = False
            self._fails_s = None
        elif command in orders:
            self._error = orders[command](value)
        else:
            self._error = "A"
        return b""

    def _last_error(self) -> str:
        error, self._error = self._error, "@"
        return error

    # --- orders: each returns its error letter ------------------------------------------------------------------

    def _move(self, value: str) -> str:
        if not NUMBER.match(value):
            return "C"
        refused = self._refused()
        if refused:
            return refused
        if not self._settings.lowest_mm <= float(value) <= self._settings.highest_mm:
            return "N"
        target = round((float(value) - self._settings.zero_mm) * 1e3, DIGITS)
        self._begin(target)
        self._rest = READY_FROM_MOVING
        return "@"

    def _set_speed(self, value: str) -> str:
        if not NUMBER.match(value) or not 0 < float(value) <= 0.4:
            return "C"
        if self._state() == MOVING:
            return "M"
        self._speed = float(value) * 1e3
        return "@"

    def _home(self, value: str) -> str:
        if self._state() == HOMING:
            return "E"
        if self._referenced:
            return "K"
        self._homing = True
        self._bits = PositionerError(0)
        self._begin((self._settings.lowest_mm - self._settings.zero_mm) * 1e3)
        return "@"

    def _switch(self, value: str) -> str:
        if value not in ("0", "1"):
            return "C"
        on = value == "1"
        state = self._state()
        if state in (NOT_REFERENCED, HOMING):
            return "H"
        if state == MOVING:
            return "M"
        if on != self._stage.locked:
            return "K" if on else "J"
        self._stage.clamp(not on)
        self._switched_s = self._clock.now()
        self._bits = PositionerError(0)
        if on:
            self._rest = READY_FROM_DISABLE
        else:
            self._off = DISABLED_FROM_READY
        return "@"

    def _refused(self) -> str:
        state = self._state()
        if state == NOT_REFERENCED:
            return "H"
        if state == HOMING:
            return "L"
        if state == MOVING:
            return "M"
        return "J" if state in (DISABLED_FROM_READY, DISABLED_FROM_MOVING) else ""

    # --- motion -------------------------------------------------------------------------------------------------

    def _begin(self, target_um: float) -> None:
        low, high = self.ends_um
        reached = min(max(target_um, low), high)
        if self.fails_next:
            self._fails_s, self._why = self._clock.now() + FOLLOWING_S, self.fails_next
            self.fails_next = PositionerError(0)
            return
        if self.stalled:
            self._fails_s, self._why = self._clock.now() + FOLLOWING_S, PositionerError.FOLLOWING
            return
        over = self._stage.begin(reached, self._speed)
        if reached != target_um:
            end = PositionerError.NEGATIVE_END if target_um < low else PositionerError.POSITIVE_END
            self._fails_s, self._why = over, end

    def _keep_up(self) -> None:
        """Let happen what has happened by now."""
        if self.stalled and self._stage.moving:
            self._stage.halt()
            self._fails_s, self._why = self._clock.now() + FOLLOWING_S, PositionerError.FOLLOWING
        if self._fails_s is not None and self._clock.now() >= self._fails_s:
            self._fails_s = None
            self._bits |= self._why
            self._stage.halt()
            self._homing = False
            if self._referenced:
                self._stage.clamp(True)
                self._off = DISABLED_FROM_MOVING
        if self._homing and not self._stage.moving and self._fails_s is None:
            self._homing = False
            self._referenced = True
            self._rest = READY_FROM_HOMING

    def _state(self) -> int:
        if self._homing:
            return HOMING
        if not self._referenced:
            return NOT_REFERENCED
        if self._stage.moving or self._fails_s is not None:
            return MOVING
        switching = self._clock.now() < self._switched_s + CLAMPING_S
        return self._off if self._stage.locked != switching else self._rest

    def _to_mm(self, position_um: float) -> float:
        return self._settings.zero_mm + position_um * 1e-3

    # --- checkpoint ---------------------------------------------------------------------------------------------

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types; moves are part of the micrometer's."""
        self._keep_up()
        return {
            "referenced": self._referenced,
            "homing": self._homing,
            "powered": self.powered,
            "bits": int(self._bits),
            "rest": self._rest,
            "off": self._off,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._referenced, self._homing, self.powered = state["referenced"], state["homing"], state["powered"]
        self._bits = PositionerError(state["bits"])
        self._rest, self._off = state["rest"], state["off"]
        self._switched_s = -CLAMPING_S
        self._fails_s = None
        self._error, self._buffer, self._unasked = "@", b"", b""
