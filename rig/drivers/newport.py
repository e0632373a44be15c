"""Protocol layer of Newport's CONEX-CC and SMC100: lines ``{address}{command}{value}`` over a serial transport.

The protocol has no checksum. What is read back is therefore held against what was asked (address and command are
repeated in every reply), bad news has to be said twice, and absolute moves are used, which may be sent again.
Nothing here configures the controller or writes to its flash memory (``PW``).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from rig.drivers.newport_codes import (
    AxisState,
    AxisStatus,
    CommandError,
    Controller,
    ReplyError,
    parse_error,
    parse_number,
    parse_reply,
    parse_status,
)
from rig.drivers.reply_time import ReplyTime
from rig.drivers.transport import Transport, settle
from rig.errors import DeviceError, NoAnswer
from rig.hardware_log import repeated
from rig.interface import Clock

LOG = logging.getLogger("mesotap.rig.stage")
QUIET_S = 0.015
SLOW_S = 0.005  # round trip from which two questions are sent together
END = b"\n"
VELOCITY_TOLERANCE = 0.01  # digits that a controller prints
LONGEST_LINE = 200  # bytes; more without an end of line is noise
COMMANDS = frozenset({"MM", "OR", "PA", "ST", "VA"})
"""All that is ever told: nothing that outlasts a power cut, nothing relative."""

HERE_IS_HOME = 1
"""Kind of home search (``HT``) that takes the place where the stage stands for its home and moves nothing."""

T = TypeVar("T")


class NewportAxis:
    """One controller and its actuator.

    Parameters
    ----------
    transport
        Opened port.
    address
        Controller address.
    clock
        Rig time.
    timeout_s
        Time that a reply may take; None finds out from the first ones.
    tries
        How often a question is asked before the controller counts as silent.
    controller
        Which one it is, for its own codes; None takes those of either.
    """

    def __init__(
        self,
        transport: Transport,
        address: int,
        clock: Clock,
        timeout_s: float | None,
        tries: int,
        controller: Controller | None = None,
    ) -> None:
        self._transport = transport
        self._address = address
        self._clock = clock
        self.reply_time = ReplyTime(timeout_s)
        self._tries = tries
        self._status = partial(parse_status, controller=controller)
        self._error = partial(parse_error, controller=controller)
        self._gave_up = False  # on a reply, the last time that something was asked
        self.repeated = 0
        """How many questions had to be asked again so far."""
        self.power_came_back = False
        """A NUL was seen: the motor's power was cut and came back since this was last set to False."""

    # --- questions ------------------------------------------------------------------------------------------

    def status(self) -> AxisStatus:
        """Errors and state.

        A reply has no check bytes, so errors count once two answers in a row name them; or, as controllers forget them
        once they have told them, once the state to which an error leads was told twice.
        """
        first = self.glance()
        if not first.errors:
            return first
        second = self.glance()
        fits = first.state is second.state and first.state in (AxisState.DISABLED, AxisState.NOT_REFERENCED)
        return AxisStatus(first.errors if fits else first.errors & second.errors, second.state, second.code)

    def glance(self) -> AxisStatus:
        """Errors and state by one answer, for whoever has no time to ask twice."""
        return self._ask("TS", self._status)

    def look(self, confirmed: bool = True) -> tuple[AxisStatus, float | None]:
        """State, and where each reply takes its time also the position, mm, which is asked for together with it.

        ``confirmed``: errors count once two answers name them, see `status`.
        """
        told = self._both() if self.reply_time.round_trip_s > SLOW_S else None
        if told is None:
            return self.status() if confirmed else self.glance(), None
        status, position = told
        return self.status() if status.errors and confirmed else status, position

    def _both(self) -> tuple[AxisStatus, float] | None:
        """The replies to two questions that were sent together; None if they did not come as they should."""
        with self._transport.lock:
            self._watch_for_nul(self._transport.discard())
            begun = self._clock.now()
            for command in ("TS", "TP"):
                self._transport.write(self._line(command, ""))
            first = self._next_line(b"", begun + self.reply_time.limit_s)
            second = None if first is None else self._next_line(first[1], begun + self.reply_time.limit_s)
            try:
                if first is not None and second is not None:
                    status = self._status(parse_reply(first[0], self._address, "TS"))
                    return status, parse_number(parse_reply(second[0], self._address, "TP"))
            except ReplyError:
                pass
            self._note("two questions were asked again one by one")
            self._watch_for_nul(settle(self._transport, self._clock, QUIET_S))
        return None

    def position_mm(self) -> float:
        """Position of the encoder, mm."""
        return self._ask("TP", parse_number)

    def velocity_mm_s(self) -> float:
        """Velocity of moves, mm/s."""
        return self._ask("VA", parse_number, "?")

    def home_kind(self) -> int:
        """How it looks for its home (``HT``)."""
        return round(self._ask("HT", parse_number, "?"))

    def soft_limits_mm(self) -> tuple[float, float]:
        """Limits within which the controller moves, mm."""
        return self._ask("SL", parse_number, "?"), self._ask("SR", parse_number, "?")

    def version(self) -> str:
        """What the controller says that it is."""
        return self._ask("VE", str)

    # --- commands -------------------------------------------------------------------------------------------

    def home(self) -> None:
        """Begin to look for the reference."""
        self._tell("OR", "", CommandError.HOMING_ALREADY, CommandError.HOMING)

    def move_to(self, position_mm: float) -> None:
        """Begin to move to ``position_mm``."""
        self._tell("PA", f"{position_mm:.6f}")

    def set_velocity(self, mm_per_s: float) -> None:
        """Set the velocity of the moves to come, and see that it was understood; the next power cut undoes it.

        Raises
        ------
        DeviceError
            It says that it moves faster than it was told.
        """
        said = math.nan
        for _ in range(self._tries):
            self._tell("VA", f"{mm_per_s:.6f}")
            said = self.velocity_mm_s()
            if said <= mm_per_s * (1 + VELOCITY_TOLERANCE):
                return
        raise DeviceError(
            self._transport.device,
            self._transport.port,
            f"it moves at {said:g} mm/s where {mm_per_s:g} were set",
            "switch it off and on again, and check its cable",
        )

    def begin_retraction(self, position_mm: float, mm_per_s: float, stop: bool = True) -> None:
        """Stop, switch the motor on and send it to ``position_mm``, all without waiting for a word.

        May be repeated: what the controller was not ready to take is taken then. Without ``stop`` a motion that has
        begun meanwhile goes on.
        """
        orders = [("VA", f"{mm_per_s:.6f}"), ("MM", "1"), ("PA", f"{position_mm:.6f}")]
        if stop:
            orders.insert(0, ("ST", ""))
        with self._transport.lock:
            for command, value in orders:
                self._transport.write(self._line(command, value))

    def switch_motor(self, on: bool) -> None:
        """Switch the motor's control loop on or off; the screw holds the position."""
        self._tell("MM", "1" if on else "0", CommandError.READY if on else CommandError.DISABLED)

    def stop(self) -> None:
        """Stop at once. Sent three times before anything is asked: a stop must not wait for a reply."""
        with self._transport.lock:
            for _ in range(3):
                self._transport.write(self._line("ST", ""))

    # --- lines ----------------------------------------------------------------------------------------------

    def _line(self, command: str, value: str) -> bytes:
        return f"{self._address}{command}{value}\r\n".encode("ascii")

    def _tell(self, command: str, value: str = "", *so_already: CommandError) -> None:
        """Send a command and have the controller say that it took it, or that it is as wanted already."""
        if command not in COMMANDS:
            raise DeviceError(
                self._transport.device, self._transport.port, f"{command} is never sent", "report this as a fault"
            )
        error = CommandError.NONE
        with self._transport.lock:
            for _ in range(self._tries):
                self._watch_for_nul(self._transport.discard())
                self._transport.write(self._line(command, value))
                error = self._ask("TE", self._error)
                if error is CommandError.NONE or error in so_already:
                    return
                # a damaged line is not the operator's business as long as the next one gets through
                self.repeated += 1
                self._note("a command was sent again", f"{command}{value}: {error.value[1]}")
        raise DeviceError(
            self._transport.device,
            self._transport.port,
            f"refuses {command}{value}: {error.value[1]}",
            "look at the controller's display and at the settings in rig.parts.stage",
        )

    def _ask(self, command: str, parse: Callable[[str], T], suffix: str = "") -> T:
        """Return the parsed reply to a question."""
        heard = False
        with self._transport.lock:
            for attempt in range(self._tries):
                if attempt:
                    self.repeated += 1
                    self._note("a question was asked again", command)
                    if self._watch_for_nul(settle(self._transport, self._clock, QUIET_S)) and not heard:
                        self.reply_time.came_late()
                elif unasked := self._watch_for_nul(self._transport.discard()):
                    if self._gave_up:
                        self.reply_time.came_late()
                    self._note("bytes that nobody asked for were discarded", repr(unasked[:LONGEST_LINE]))
                self._gave_up = attempt > 0
                begun = self._clock.now()
                self._transport.write(self._line(command, suffix))
                deadline = begun + self.reply_time.limit_s
                pending = b""
                while (line := self._next_line(pending, deadline)) is not None:
                    whole, pending = line
                    heard = True
                    try:
                        answer = parse(parse_reply(whole, self._address, command))
                    except ReplyError:
                        self._note("a line was foreign or damaged", repr(whole))
                        continue  # the true reply may follow
                    self.reply_time.learn(self._clock.now() - begun)
                    return answer
        what = "its replies make no sense" if heard else "it does not answer"
        raise NoAnswer(
            self._transport.device,
            self._transport.port,
            f"{what}, asked {command} {self._tries} times",
            "check its power, its cable, and the address and speed in rig.parts.stage",
        )

    def _note(self, what: str, detail: str = "") -> None:
        repeated(LOG, self._transport.device, what, detail)

    def _watch_for_nul(self, data: bytes) -> bytes:
        """Return the bytes without a NUL, which says that the motor's power was cut and came back."""
        if b"\0" not in data:
            return data
        self.power_came_back = True
        self._note("the motor's power was cut and came back")
        return data.replace(b"\0", b"")

    def _next_line(self, pending: bytes, deadline: float) -> tuple[bytes, bytes] | None:
        """Return the next whole line and what came after it; None once it is too late."""
        while True:
            left = deadline - self._clock.now()
            if END in pending and left > -self.reply_time.limit_s:
                break  # a line that has come is read, if it is not one of very many
            if left <= 0 or len(pending) > LONGEST_LINE:
                return None
            data = self._transport.read(left)
            if not data:
                return None
            pending += self._watch_for_nul(data)
        line, _, rest = pending.partition(END)
        return line, rest
