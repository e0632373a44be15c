"""Server side of Modbus, written for the emulated amplifier: framing of RTU and TCP, reading of registers.

Independent of the library that the driver uses, so that one is a test of the other. From the Modbus application
protocol V1.1b3, section 6, and Modbus over serial line V1.02, section 2.5.
"""

from __future__ import annotations

import struct
from typing import Protocol

READ_HOLDING, READ_INPUT = 3, 4
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
LARGEST_COUNT = 125
RTU_READ_REQUEST = 8  # bytes: address, function, offset, count, CRC
MBAP = 7  # bytes of the header of TCP: number, protocol, length, address


class Refusal(Exception):
    """A request that is answered with an exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Registers(Protocol):
    """What a device keeps in its registers; ``functions``, if it has it, are those that read them."""

    def read(self, offset: int, count: int) -> list[int]:
        """Return registers; `Refusal` where there are none, or the device fails."""


def crc16(data: bytes) -> bytes:
    """Return the check bytes of an RTU frame, as sent: low byte first; polynomial A001 hex."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _CRC[(crc ^ byte) & 0xFF]
    return struct.pack("<H", crc)


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC = [_crc_of(byte) for byte in range(256)]


class ModbusServer:
    """A device on Modbus; requests for other addresses and damaged ones are not answered.

    Parameters
    ----------
    registers
        What it keeps.
    address
        Its address.
    framing
        ``rtu`` or ``tcp``.
    """

    def __init__(self, registers: Registers, address: int, framing: str) -> None:
        self._registers = registers
        self._functions: tuple[int, ...] = getattr(registers, "functions", (READ_HOLDING, READ_INPUT))
        self._address = address
        self._rtu = framing == "rtu"
        self._buffer = b""

    def unasked(self) -> bytes:
        """Nothing: a Modbus server only answers."""
        return b""

    def receive(self, data: bytes) -> list[bytes]:
        """Take bytes in and answer the requests that are complete."""
        self._buffer += data
        return self._receive_rtu() if self._rtu else self._receive_tcp()

    def _receive_rtu(self) -> list[bytes]:
        # on the wire a pause ends a frame; here every request comes in one piece, and what is no frame is noise
        frame, self._buffer = self._buffer, b""
        if len(frame) != RTU_READ_REQUEST or crc16(frame[:-2]) != frame[-2:] or frame[0] != self._address:
            return []
        reply = frame[:1] + self._answer(frame[1:-2])
        return [reply + crc16(reply)]

    def _receive_tcp(self) -> list[bytes]:
        replies = []
        while len(self._buffer) >= MBAP:
            number, protocol, length, address = struct.unpack(">HHHB", self._buffer[:MBAP])
            if protocol != 0 or not 2 <= length <= 254:
                self._buffer = b""  # out of step: a real device hangs up
                break
            if len(self._buffer) < MBAP - 1 + length:
                break
            request = self._buffer[MBAP : MBAP - 1 + length]
            self._buffer = self._buffer[MBAP - 1 + length :]
            if address == self._address:
                answer = self._answer(request)
                replies.append(struct.pack(">HHHB", number, 0, len(answer) + 1, address) + answer)
        return replies

    def _answer(self, request: bytes) -> bytes:
        """Return the reply to a request: function code and data."""
        function = request[0]
        try:
            if function not in self._functions or len(request) != 5:
                raise Refusal(ILLEGAL_FUNCTION)
            offset, count = struct.unpack(">HH", request[1:])
            if not 1 <= count <= LARGEST_COUNT:
                raise Refusal(ILLEGAL_VALUE)
            words = self._registers.read(offset, count)
        except Refusal as refused:
            return bytes([function | 0x80, refused.code])
        return struct.pack(f">BB{count}H", function, 2 * count, *words)
