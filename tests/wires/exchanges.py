"""Every exchange of a recording, wherever in a session, asked again: ``python -m tests.wires.exchanges FILE``.

What a session asks depends on the session: it cannot be run again from its recording. Each of its questions can: the
driver puts it once more to the recording, which answers what the device answered, and what the driver makes of that
(a number, a state, a question asked again, a sentence) is compared or read. Where the driver would do something else
than it did then, `WireMismatch` names the line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.wire_replay import ReplayTransport, WireMismatch
from rig.errors import RigError
from tests.wires.replaying import Replayed

READ_HOLDING, READ_INPUT = 3, 4
MBAP = 6  # bytes ahead of the address in a frame of Modbus TCP
QUESTIONS = ("TS", "TP", "TE", "VE")  # which the controller answers without a question mark


@dataclass(frozen=True, slots=True)
class Exchange:
    """A question and what the driver made of its answer.

    Attributes
    ----------
    line, time_s
        Of the recording.
    device
        Which one was asked.
    question
        In words, or the line sent.
    answer
        What the driver returned, or its sentence; None for a command, which is not answered.
    """

    line: int
    time_s: float
    device: str
    question: str
    answer: Any


def exchanges(recording: Path) -> Iterator[Exchange]:
    """Ask every question of a recording again.

    Raises
    ------
    WireMismatch
        The driver would do something else than it did then.
    """
    rig = Replayed(recording)
    ask = {AMPLIFIER: _ask_amplifier, STAGE: _ask_stage}
    while going := [wire for wire in rig.wires.values() if wire.left()]:
        wire = min(going, key=lambda wire: wire.left()[0].line)
        act = wire.left()[0]
        rig.clock.play(act.time_s)
        if act.act == "write":
            question, answer = ask[wire.device](rig, wire)
            yield Exchange(act.line, act.time_s, wire.device, question, answer)
        elif act.act == "read":
            wire.skip()  # what came unasked, or was waited for between two questions
        elif isinstance(told := _answered(wire.open if act.act == "open" else wire.close), str):
            yield Exchange(act.line, act.time_s, wire.device, act.act, told)


def _answered(ask: Callable[[], Any]) -> Any:
    try:
        return ask()
    except WireMismatch:
        raise
    except RigError as error:
        return str(error)


def _ask_amplifier(rig: Replayed, wire: ReplayTransport) -> tuple[str, Any]:
    assert rig.load_cell is not None
    device, frame = rig.load_cell._wire, wire.left()[0].data
    if len(frame) == 8:  # RTU: address, function, offset, count, check bytes
        function, offset, count = frame[1], int.from_bytes(frame[2:4]), int.from_bytes(frame[4:6])
    else:
        device._client.transaction.next_tid = int.from_bytes(frame[:2]) - 1
        function, offset, count = frame[MBAP + 1], int.from_bytes(frame[8:10]), int.from_bytes(frame[10:12])
    table = {READ_HOLDING: "holding", READ_INPUT: "input"}[function]
    return f"{table} {offset}, {count} words", _answered(lambda: device.read(table, offset, count))


def _ask_stage(rig: Replayed, wire: ReplayTransport) -> tuple[str, Any]:
    assert rig.stage is not None
    axis, line = rig.stage._axis, wire.left()[0].data
    text = line.decode("ascii").strip().lstrip("0123456789")
    if text == "TS" and [(act.act, act.data[-4:]) for act in wire.left()[1:2]] == [("write", b"TP\r\n")]:
        return "TS and TP", _answered(axis._both)
    command, suffix = text[:2], text[2:]
    if suffix != "?" and command not in QUESTIONS:
        return text, _answered(lambda: wire.write(line))
    meanings: dict[str, Callable[[], Any]] = {
        "TS": axis.glance,
        "TP": axis.position_mm,
        "TE": lambda: axis._ask("TE", axis._error),
        "VE": axis.version,
    }
    return text, _answered(meanings.get(text, lambda: axis._ask(command, str, suffix)))


def main() -> None:
    """Print the exchanges of a recording, a line each."""
    for exchange in exchanges(Path(sys.argv[1])):
        print(
            f"{exchange.line:7d} {exchange.time_s:10.3f} s  {exchange.device}: {exchange.question} -> {exchange.answer}"
        )


if __name__ == "__main__":
    main()
