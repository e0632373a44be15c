"""Who is behind a serial port: stage, amplifier, somebody else, or nobody."""

from __future__ import annotations

import pytest

from mesotap.session.bench import emulated_rig
from rig import DeviceError
from rig.drivers.search import MODBUS_BAUD_RATES, NOBODY, who_answers
from rig.drivers.transport import SerialTransport
from rig.wall_clock import WallClock
from sim_backend.emulators.ports import PtyPort
from tests.mesotap.benches import small_config
from tests.rig.drivers.wire_dialogue import SILENCE, Dialogue, Registers, lines, rtu

ASKED = b"1VE\r\n"
REGISTER = rtu(1, 3, 0, 0, 0, 1)


def wires_of(answers: dict[int, list[tuple[bytes, bytes]]]):
    """Dialogues by baud rate; at the others the stage's question, or the amplifier's, meets silence."""
    made: dict[int, Dialogue] = {}

    def wire(rate: int) -> Dialogue:
        question = REGISTER if rate in MODBUS_BAUD_RATES else ASKED
        made[rate] = Dialogue(*answers.get(rate, [(question, SILENCE)]))
        return made[rate]

    return wire, made


def asked(answers) -> tuple[str, dict[int, Dialogue]]:
    wire, made = wires_of(answers)
    said = who_answers("/dev/ttyX", Dialogue().clock, wire)
    for dialogue in made.values():
        dialogue.finished()
        assert not dialogue.is_open
    return said, made


def test_a_stage_is_found_at_its_speed():
    said, made = asked({57600: lines(("1VE", "1VE SMC_CC 3.1.2"))})
    assert said == "a stage controller, 'SMC_CC 3.1.2'; rig.parts.stage: {driver: smc100, port: /dev/ttyX}"
    assert list(made) == [921600, 57600]


NO_MORE = [(rtu(1, 3, 0, offset, 0, 1), rtu(1, 0x83, 2)) for offset in (58, 2, 33)]
"""What would tell one Seneca from another, refused: it is none."""


def test_an_amplifier_is_found_at_its_speed():
    said, _ = asked({38400: [(REGISTER, rtu(1, 3, 2, 0, 14)), *NO_MORE]})
    assert said.startswith("a device on Modbus at address 1, its first register reads 14; rig.parts.load_cell: ")
    assert "baud_rate: 38400" in said


def test_an_exception_is_an_answer_too():
    said, _ = asked({9600: [(REGISTER, rtu(1, 0x83, 2)), *NO_MORE]})
    assert "asked for its first register it has no such register (Modbus exception 2)" in said


@pytest.mark.parametrize(
    ("held", "preset"),
    [
        ({0: 9, 2: 0x0500, 3: 0x0100, 58: 0x52}, "seneca-z-sg"),
        ({0: 9, 2: 0x0500, 3: 0x0100}, "seneca-z-sg2"),
        ({0: 9, 2: 5, 3: 0, 33: 2}, "seneca-ze-sg3"),
    ],
)
def test_the_preset_of_a_seneca_is_said(held, preset):
    wires = {rate: Dialogue((ASKED, SILENCE)) for rate in (921600, 57600)}
    said = who_answers("/dev/ttyX", Dialogue().clock, lambda rate: wires.get(rate) or Registers(held))
    assert f"and it reads like a {preset}; rig.parts.load_cell" in said


def test_noise_and_silence_are_nobody():
    said, made = asked({921600: [(ASKED, b"\xff\x00 login: ")], 9600: [(REGISTER, b"login: ")]})
    assert said == NOBODY
    assert list(made) == [921600, 57600, *MODBUS_BAUD_RATES]


def test_over_real_ports_each_emulated_device_is_found(tmp_path):
    rig = emulated_rig(small_config(), wires=True)
    found = []
    rig.open()
    try:
        for driver in rig.drivers():
            driver.close()
        for port in rig.ports:
            assert isinstance(port, PtyPort)
            found.append(who_answers(str(port.path), WallClock()))
    finally:
        rig.close()
    assert "a device on Modbus at address 1, its first register reads 14" in found[0]
    assert "a stage controller, 'CONEX-CC 2.0.1'" in found[1]
    assert not [
        line
        for line in rig.controller.sent
        if not line.startswith(("1VE", "1VA?", "1HT?", "1SL?", "1SR?", "1TS", "1TP"))
    ]


def test_a_port_in_use_is_told(tmp_path):
    rig = emulated_rig(small_config(), wires=True)
    rig.open()
    try:
        with pytest.raises(DeviceError, match=r"serial port on .*: another program uses it"):
            who_answers(str(rig.ports[0].path), WallClock())
    finally:
        rig.close()


def test_a_port_that_is_not_there_is_told(tmp_path):
    with pytest.raises(DeviceError, match="there is no such port"):
        who_answers(str(tmp_path / "nowhere"), WallClock(), lambda rate: SerialTransport("x", "/nowhere", rate))
