"""Replies of stage and amplifier, damaged and invented: an answer, or a sentence; never anything else."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from rig import DeviceError
from rig.drivers.modbus import ModbusDevice
from rig.drivers.newport import NewportAxis
from rig.drivers.newport_codes import AxisStatus, ReplyError, parse_error, parse_number, parse_reply, parse_status
from rig.drivers.registers import WORDS, decode
from rig.drivers.transport import Transport
from sim_backend.clock import VirtualClock
from sim_backend.emulators.modbus import ModbusServer, crc16
from tests.fuzz.mutations import damaged, damages, fuzzed

SOUND_RTU = bytes([1, 3, 4, 0x12, 0x34, 0x56, 0x78])
SOUND_RTU += crc16(SOUND_RTU)
SOUND_TCP = bytes([0, 1, 0, 0, 0, 7, 1, 3, 4, 0x12, 0x34, 0x56, 0x78])
SOUND_LINES = (b"1TP2.150020\r\n", b"1TS000033\r\n", b"1TE@\r\n", b"1VE CONEX-CC 2.0.1\r\n", b"1VA0.05\r\n")
pieces = st.lists(st.binary(max_size=40), max_size=5)


class Invented(Transport):
    """A wire on which whatever is asked gets the same pieces."""

    def __init__(self, answers: list[bytes]) -> None:
        super().__init__("a device", "/dev/ttyX")
        self.clock = VirtualClock()
        self._answers = answers
        self._coming: list[bytes] = []

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        self._coming = list(self._answers)

    def read(self, timeout_s: float) -> bytes:
        if self._coming:
            return self._coming.pop(0)
        self.clock.sleep(timeout_s)
        return b""


def registers_of(answers: list[bytes], framing: str) -> None:
    try:
        words = ModbusDevice(Invented(answers), framing, 1, 0.05, 2).read("holding", 77, 2)
    except DeviceError as error:
        assert "a device on /dev/ttyX: " in str(error)
        assert "\n" not in str(error)
        return
    assert len(words) == 2
    assert all(0 <= word <= 0xFFFF for word in words)


@fuzzed
@given(damages())
def test_damaged_rtu_replies(damage):
    registers_of([damaged(SOUND_RTU, damage)], "rtu")


@fuzzed
@given(damages())
def test_damaged_tcp_replies(damage):
    registers_of([damaged(SOUND_TCP, damage)], "tcp")


@fuzzed
@given(pieces, st.sampled_from(["rtu", "tcp"]))
def test_invented_modbus_replies(answers, framing):
    registers_of(answers, framing)


@fuzzed
@given(st.binary(max_size=240), st.sampled_from([3, 4, 0x83, 6, 16, 17, 22, 23, 24, 43]))
def test_sound_frames_of_any_content(content, function):
    frame = bytes([1, function]) + content
    registers_of([frame + crc16(frame)], "rtu")
    registers_of([bytes([0, 1, 0, 0, *(len(frame)).to_bytes(2, "big")]) + frame], "tcp")


@fuzzed
@given(st.one_of(pieces, st.builds(lambda line, d: [damaged(line, d)], st.sampled_from(SOUND_LINES), damages())))
def test_replies_of_a_stage(answers):
    questions = (NewportAxis.status, NewportAxis.position_mm, NewportAxis.version, NewportAxis.soft_limits_mm)
    for ask in questions:
        wire = Invented(answers)
        try:
            said = ask(NewportAxis(wire, 1, wire.clock, 0.05, 2))
        except DeviceError as error:
            assert "a device on /dev/ttyX: " in str(error)
            continue
        assert isinstance(said, AxisStatus | str | tuple) or math.isfinite(said)


@fuzzed
@given(st.one_of(st.binary(max_size=30), st.builds(damaged, st.sampled_from(SOUND_LINES), damages())))
def test_lines_of_a_stage(line):
    for command, parse in (("TS", parse_status), ("TP", parse_number), ("TE", parse_error)):
        try:
            value = parse(parse_reply(line, 1, command))
        except ReplyError:
            continue
        assert not isinstance(value, float) or math.isfinite(value)


@fuzzed
@given(st.lists(st.integers(0, 0xFFFF), max_size=3), st.sampled_from(sorted(WORDS)), st.booleans())
def test_registers_of_any_content(words, kind, high_first):
    try:
        decode(words, kind, "high_first" if high_first else "low_first")
    except ValueError:
        assert len(words) != WORDS[kind]


class Nothing:
    def read(self, offset: int, count: int) -> list[int]:
        return [0] * count


@fuzzed
@given(pieces, st.sampled_from(["rtu", "tcp"]))
def test_requests_to_the_emulated_amplifier(requests, framing):
    server = ModbusServer(Nothing(), 1, framing)
    for request in requests:
        assert all(isinstance(reply, bytes) for reply in server.receive(request))
