"""Replies of stage and amplifier, damaged and invented: an answer, or a sentence; never anything else."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from rig import DeviceError
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.modbus import ModbusDevice
from rig.drivers.motor_stage import HOMING_S, MotorStage
from rig.drivers.newport import NewportAxis
from rig.drivers.newport_codes import AxisStatus, ReplyError, parse_error, parse_number, parse_reply, parse_status
from rig.drivers.registers import PRESETS, WORDS, decode
from rig.drivers.settings import AmplifierRtu, NewportStage
from rig.drivers.transport import Transport
from sim_backend.clock import VirtualClock
from sim_backend.emulators.modbus import ModbusServer, crc16
from sim_backend.emulators.wire import InProcessTransport
from tests.fuzz.mutations import damaged, damages, fuzzed

SOUND_RTU = bytes([1, 3, 4, 0x12, 0x34, 0x56, 0x78])
SOUND_RTU += crc16(SOUND_RTU)
SOUND_TCP = bytes([0, 1, 0, 0, 0, 7, 1, 3, 4, 0x12, 0x34, 0x56, 0x78])
SOUND_LINES = (
    b"1TP2.150020\r\n",
    b"1TS000033\r\n",
    b"1TE@\r\n",
    b"1VE CONEX-CC 2.0.1\r\n",
    b"1VA0.05\r\n",
    b"1TP-1e7\r\n",
)
LONGEST_S = 2 * HOMING_S
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
    questions = (
        *(NewportAxis.status, NewportAxis.position_mm, NewportAxis.version, NewportAxis.soft_limits_mm),
        *(NewportAxis.home, NewportAxis.stop, lambda axis: axis.move_to(2.0), lambda axis: axis.switch_motor(True)),
    )
    for ask in questions:
        wire = Invented(answers)
        try:
            said = ask(NewportAxis(wire, 1, wire.clock, 0.05, 2))
        except DeviceError as error:
            assert "a device on /dev/ttyX: " in str(error)
            continue
        assert isinstance(said, AxisStatus | str | tuple | None) or math.isfinite(said)


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


RIGHT = {"VE": " CONEX-CC 2.0.1", "VA": "0.05", "SL": "-1", "SR": "25", "TS": "000033", "TP": "2.0", "TE": "@"}


class Babbling(Invented):
    """A stage controller that answers what it likes: None is what would be right."""

    def __init__(self, answers: list[bytes | None]) -> None:
        super().__init__([])
        self._next = iter(answers)

    def write(self, data: bytes) -> None:
        command = data[1:3].decode()
        if command in RIGHT:
            answer = next(self._next, None)
            self._coming = [f"1{command}{RIGHT[command]}\r\n".encode() if answer is None else answer]


states = st.sampled_from(["00000A", "00001E", "000028", "000032", "000033", "00003C", "002033", "020033"])
told = st.one_of(
    st.none(),
    states.map(lambda state: f"1TS{state}\r\n".encode()),
    st.floats().map(lambda number: f"1TP{number:.6g}\r\n".encode()),
    st.sampled_from("@ABDHKLMN").map(lambda letter: f"1TE{letter}\r\n".encode()),
    st.sampled_from([b"", b"\0", b"1TS", b"2TP1.0\r\n"]),
)


@fuzzed
@given(st.lists(told, max_size=40), st.booleans())
def test_any_behaviour_of_a_stage(answers, home):
    wire = Babbling(answers)
    chosen = NewportStage(driver="conex-cc", port="/dev/ttyX", home_at_connect=home)
    stage = MotorStage(wire, chosen, wire.clock, 0.5)
    actions = (stage.connect, stage.unlock, stage.read, lambda: stage.move_by(0.5), lambda: stage.move_by(-100.0))
    for action in (*actions, lambda: stage.advance(1.0, 0.5, lambda: False), stage.lock):
        begun = wire.clock.now()
        try:
            action()
        except DeviceError as error:
            assert str(error).startswith(("micrometer stage on /dev/ttyX: ", "a device on /dev/ttyX: "))
            assert "\n" not in str(error)
        assert wire.clock.now() - begun < LONGEST_S


@fuzzed
@given(st.dictionaries(st.integers(0, 99), st.integers(0, 0xFFFF), max_size=8), st.sampled_from(sorted(PRESETS)))
def test_any_registers_of_an_amplifier(changed, preset):
    # as set up: unit N, 2 mV/V at 10 N, the fastest converter
    words = {2: 5, 13: 0x4000, 15: 0x4120, **changed}

    class Server:
        def read(self, offset: int, count: int) -> list[int]:
            return [words.get(i, 0) for i in range(offset, offset + count)]

    clock = VirtualClock()
    wire = InProcessTransport("a device", "/dev/ttyX", ModbusServer(Server(), 1, "rtu"), clock)
    cell = ModbusLoadCell(wire, "rtu", AmplifierRtu(driver="modbus-rtu", preset=preset, port="/dev/ttyX"), clock)
    wire.open()
    for action in (cell.connect, cell.read):
        try:
            action()
        except DeviceError as error:
            assert str(error).startswith("strain-gauge amplifier on /dev/ttyX: ")
            assert "\n" not in str(error)


class Nothing:
    def read(self, offset: int, count: int) -> list[int]:
        return [0] * count


@fuzzed
@given(pieces, st.sampled_from(["rtu", "tcp"]))
def test_requests_to_the_emulated_amplifier(requests, framing):
    server = ModbusServer(Nothing(), 1, framing)
    for request in requests:
        assert all(isinstance(reply, bytes) for reply in server.receive(request))
