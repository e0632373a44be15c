"""Protocol layer of amplifiers on Modbus: requests and replies by pymodbus, over a transport of this package.

RTU replies carry no number, so a reply that comes late could answer the next request. Before each request what is
left in the port is discarded, after a failure the line is left to fall quiet, and a reply has to fit what was asked.
"""

from __future__ import annotations

import logging
from enum import Enum
from typing import Any

from pymodbus import FramerType, ModbusException
from pymodbus.client.base import ModbusBaseSyncClient
from pymodbus.pdu import ExceptionResponse
from pymodbus.transport import CommParams, CommType

from rig.drivers.reply_time import PATIENT_S, ReplyTime
from rig.drivers.transport import LARGEST_LEFTOVER, Transport, settle
from rig.errors import DeviceError, NoAnswer
from rig.hardware_log import repeated
from rig.interface import Clock

LOG = logging.getLogger("mesotap.rig.amplifier")
FUNCTIONS = {"holding": 3, "input": 4}
QUIET_S = 0.015  # without a byte, after which a late reply is taken to be over

# what pymodbus logs is said here in sentences, so it does not go to the terminal by itself
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class ModbusFault(Enum):
    """Exception codes of the Modbus application protocol (V1.1b3, section 7), and what they mean here."""

    FUNCTION = (1, "it does not know the function", "check the preset in rig.parts.load_cell")
    ADDRESS = (2, "it has no such register", "check the preset or the register map in rig.parts.load_cell")
    VALUE = (3, "it refuses the number of registers", "check the register map in rig.parts.load_cell")
    FAILURE = (4, "it failed", "switch it off and on again")
    ACKNOWLEDGE = (5, "it needs more time", "wait until it is ready, then resume")
    BUSY = (6, "it is busy", "wait until it is ready, then resume")
    MEMORY = (8, "its memory is damaged", "switch it off and on again; if that does not help it needs repair")
    PATH = (10, "the gateway finds no way to it", "check gateway and address")
    TARGET = (11, "it does not answer the gateway", "check its power, its cable and its address")

    @classmethod
    def of(cls, code: int) -> tuple[str, str]:
        """Return what a code says happened, and what to check."""
        for fault in cls:
            if fault.value[0] == code:
                return f"{fault.value[1]} (Modbus exception {code})", fault.value[2]
        return f"it answers Modbus exception {code}, which has no meaning", "check that it is the device configured"


class _Client(ModbusBaseSyncClient):
    """pymodbus's client over a transport of ours, without retries of its own."""

    def __init__(self, transport: Transport, framer: FramerType, clock: Clock, reply_time: ReplyTime) -> None:
        link = CommParams(
            comm_name=transport.device,
            comm_type=CommType.SERIAL,
            host=transport.port,
            timeout_connect=PATIENT_S,
            reconnect_delay=0.0,
        )
        super().__init__(framer, 0, link, None, None, None)
        self._transport = transport
        self._clock = clock
        self._deadline_s = 0.0
        self._reply_time = reply_time
        self.received = 0

    def connect(self) -> bool:
        """Be connected: the transport was opened before."""
        return True

    def close(self) -> None:
        """Leave the transport as it is: who opened it closes it."""

    def send(self, request: bytes, addr: Any = None) -> int:
        """Send a frame, after what is left of an earlier reply was discarded."""
        self.discard()
        self.received = 0
        self._deadline_s = self._clock.now() + self._reply_time.limit_s
        self._transport.write(request)
        return len(request)

    def discard(self) -> bytes:
        """Read away what came after it was given up, or unasked."""
        if unasked := self._transport.discard():
            repeated(LOG, self._transport.device, "bytes that nobody asked for were discarded", unasked[:64].hex(" "))
        return unasked

    def recv(self, size: int | None) -> bytes:
        """Return what came; nothing once it is too late, however much still comes."""
        left = self._deadline_s - self._clock.now()
        if left <= 0 or self.received > LARGEST_LEFTOVER:
            return b""
        data = self._transport.read(left)
        self.received += len(data)
        return data


class ModbusDevice:
    """Reads registers of one device, as often as it takes.

    Parameters
    ----------
    transport
        Opened port.
    framing
        ``rtu`` or ``tcp``.
    address
        Device address.
    clock
        Rig time.
    timeout_s
        Time that a reply may take; None finds out from the first ones.
    tries
        How often a question is asked before the device counts as silent.
    """

    def __init__(
        self, transport: Transport, framing: str, address: int, clock: Clock, timeout_s: float | None, tries: int
    ) -> None:
        self._transport = transport
        self._clock = clock
        self.reply_time = ReplyTime(timeout_s)
        framer = FramerType.RTU if framing == "rtu" else FramerType.SOCKET
        self._client = _Client(transport, framer, clock, self.reply_time)
        self._address = address
        self._tries = tries
        self._gave_up = False  # on a reply, the last time that something was asked
        self.repeated = 0
        """How many questions had to be asked again so far."""

    def read(self, table: str, offset: int, count: int) -> list[int]:
        """Return ``count`` registers from ``offset`` on.

        Raises
        ------
        NoAnswer
            Nothing, or nothing sound, came back in all tries.
        DeviceError
            The device answers with an exception code, or its port is gone.
        """
        answered = "it does not answer"
        with self._transport.lock:
            for attempt in range(self._tries):
                if attempt:
                    self.repeated += 1
                    repeated(LOG, self._transport.device, "a question was asked again", f"{answered}, {table} {offset}")
                    if settle(self._transport, self._clock, QUIET_S) and not self._client.received:
                        self.reply_time.came_late()
                elif self._client.discard() and self._gave_up:
                    self.reply_time.came_late()
                self._gave_up = attempt > 0
                ask = self._client.read_input_registers if table == "input" else self._client.read_holding_registers
                begun = self._clock.now()
                try:
                    reply = ask(offset, count=count, device_id=self._address)
                except ModbusException:
                    answered = self._what_came()
                    continue
                self.reply_time.learn(self._clock.now() - begun)
                if isinstance(reply, ExceptionResponse):
                    raise DeviceError(
                        self._transport.device, self._transport.port, *ModbusFault.of(reply.exception_code)
                    )
                if reply.function_code == FUNCTIONS[table] and len(reply.registers) == count:
                    return list(reply.registers)
                answered = "it answers something else than was asked"
        raise NoAnswer(
            self._transport.device,
            self._transport.port,
            f"{answered}, asked {self._tries} times",
            "check its power, its cable and termination, and the address and speed in rig.parts.load_cell",
        )

    def _what_came(self) -> str:
        return (
            f"its replies are damaged ({self._client.received} bytes)"
            if self._client.received
            else "it does not answer"
        )
