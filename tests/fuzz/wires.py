"""Replies of stage and amplifier, damaged and invented: an answer, or a sentence; never anything else."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

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
from tests.fuzz.mutations import damaged, damages
from tests.fuzz.source import Source, Target

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
FUNCTIONS = (3, 4, 0x83, 6, 16, 17, 22, 23, 24, 43)
LONGEST_S = 2 * HOMING_S


def pieces(source: Source) -> list[bytes]:
    return source.several(lambda inner: inner.content(40), 0, 5)


def damaged_line(source: Source) -> bytes:
    return damaged(source.choice(SOUND_LINES), damages()(source))


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
    wire = Invented(answers)
    try:
        words = ModbusDevice(wire, framing, 1, wire.clock, 0.05, 2).read("holding", 77, 2)
    except DeviceError as error:
        assert "a device on /dev/ttyX: " in str(error)
        assert "\n" not in str(error)
        return
    assert len(words) == 2
    assert all(0 <= word <= 0xFFFF for word in words)


def damaged_rtu_replies(place: Path) -> Target:
    return Target(damages(), lambda damage: registers_of([damaged(SOUND_RTU, damage)], "rtu"))


def damaged_tcp_replies(place: Path) -> Target:
    return Target(damages(), lambda damage: registers_of([damaged(SOUND_TCP, damage)], "tcp"))


def invented_modbus_replies(place: Path) -> Target:
    def draw(source: Source) -> tuple[list[bytes], str]:
        return pieces(source), source.choice(("rtu", "tcp"))

    return Target(draw, lambda drawn: registers_of(*drawn))


def sound_frames_of_any_content(place: Path) -> Target:
    def draw(source: Source) -> bytes:
        return bytes([1, source.choice(FUNCTIONS)]) + source.content(240)

    def check(frame: bytes) -> None:
        registers_of([frame + crc16(frame)], "rtu")
        registers_of([bytes([0, 1, 0, 0, *(len(frame)).to_bytes(2, "big")]) + frame], "tcp")

    return Target(draw, check)


QUESTIONS = (
    *(NewportAxis.status, NewportAxis.position_mm, NewportAxis.version, NewportAxis.soft_limits_mm),
    *(NewportAxis.home, NewportAxis.stop, lambda axis: axis.move_to(2.0), lambda axis: axis.switch_motor(True)),
)


def replies_of_a_stage(place: Path) -> Target:
    def draw(source: Source) -> list[bytes]:
        return pieces(source) if source.integer(0, 1) else [damaged_line(source)]

    def check(answers: list[bytes]) -> None:
        for ask in QUESTIONS:
            wire = Invented(answers)
            try:
                said: Any = ask(NewportAxis(wire, 1, wire.clock, 0.05, 2))
            except DeviceError as error:
                assert "a device on /dev/ttyX: " in str(error)
                continue
            assert isinstance(said, AxisStatus | str | tuple | None) or math.isfinite(said)

    return Target(draw, check)


def lines_of_a_stage(place: Path) -> Target:
    def draw(source: Source) -> bytes:
        return source.content(30) if source.integer(0, 1) else damaged_line(source)

    def check(line: bytes) -> None:
        for command, parse in (("TS", parse_status), ("TP", parse_number), ("TE", parse_error)):
            try:
                value = parse(parse_reply(line, 1, command))
            except ReplyError:
                continue
            assert not isinstance(value, float) or math.isfinite(value)

    return Target(draw, check)


def registers_of_any_content(place: Path) -> Target:
    def draw(source: Source) -> tuple[list[int], str, str]:
        words = source.several(lambda inner: inner.integer(0, 0xFFFF), 0, 3)
        return words, source.choice(sorted(WORDS)), source.choice(("high_first", "low_first"))

    def check(drawn: tuple[list[int], str, str]) -> None:
        words, kind, order = drawn
        try:
            decode(words, kind, order)
        except ValueError:
            assert len(words) != WORDS[kind]

    return Target(draw, check)


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


STATES = ("00000A", "00001E", "000028", "000032", "000033", "00003C", "000046", "000047", "002033", "020033")


def told(source: Source) -> bytes | None:
    """What a stage may say: None is what would be right."""
    kind = source.integer(0, 4)
    if kind == 0:
        return None
    if kind == 1:
        return f"1TS{source.choice(STATES)}\r\n".encode()
    if kind == 2:
        return f"1TP{source.number():.6g}\r\n".encode()
    if kind == 3:
        return f"1TE{source.choice('@ABDHKLMN')}\r\n".encode()
    return source.choice((b"", b"\0", b"1TS", b"2TP1.0\r\n"))


def any_behaviour_of_a_stage(place: Path) -> Target:
    def check(drawn: tuple[list[bytes | None], bool]) -> None:
        answers, home = drawn
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

    return Target(lambda source: (source.several(told, 0, 40), source.choice((True, False))), check)


class Registers:
    """Registers that hold zeros but for some."""

    def __init__(self, words: dict[int, int]) -> None:
        self._words = words

    def read(self, offset: int, count: int) -> list[int]:
        return [self._words.get(i, 0) for i in range(offset, offset + count)]


def any_registers_of_an_amplifier(place: Path) -> Target:
    def draw(source: Source) -> tuple[dict[int, int], str]:
        changed = source.several(lambda inner: (inner.integer(0, 99), inner.integer(0, 0xFFFF)), 0, 8)
        return dict(changed), source.choice(sorted(PRESETS))

    def check(drawn: tuple[dict[int, int], str]) -> None:
        changed, preset = drawn
        # as set up: unit N, 2 mV/V at 10 N, the fastest converter
        server = ModbusServer(Registers({2: 5, 13: 0x4000, 15: 0x4120, **changed}), 1, "rtu")
        clock = VirtualClock()
        wire = InProcessTransport("a device", "/dev/ttyX", server, clock)
        weighs = PRESETS[preset].signal_is == "load"
        of = {"cell_ratio_mv_per_v": 2.0, "cell_full_scale": 10.0} if weighs else {}
        chosen = AmplifierRtu(driver="modbus-rtu", preset=preset, port="/dev/ttyX", **of)
        cell = ModbusLoadCell(wire, "rtu", chosen, clock)
        wire.open()
        for action in (cell.connect, cell.read):
            try:
                action()
            except DeviceError as error:
                assert str(error).startswith("strain-gauge amplifier on /dev/ttyX: ")
                assert "\n" not in str(error)

    return Target(draw, check)


def requests_to_the_emulated_amplifier(place: Path) -> Target:
    def check(drawn: tuple[list[bytes], str]) -> None:
        requests, framing = drawn
        server = ModbusServer(Registers({}), 1, framing)
        for request in requests:
            assert all(isinstance(reply, bytes) for reply in server.receive(request))

    return Target(lambda source: (pieces(source), source.choice(("rtu", "tcp"))), check)


TARGETS = (
    damaged_rtu_replies,
    damaged_tcp_replies,
    invented_modbus_replies,
    sound_frames_of_any_content,
    replies_of_a_stage,
    lines_of_a_stage,
    registers_of_any_content,
    any_behaviour_of_a_stage,
    any_registers_of_an_amplifier,
    requests_to_the_emulated_amplifier,
)
