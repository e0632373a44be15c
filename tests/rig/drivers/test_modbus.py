"""The amplifier's protocol, word for word, and what its driver makes of it."""

from __future__ import annotations

import math

import pytest

from rig import DeviceError, NoAnswer
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.modbus import ModbusDevice, ModbusFault
from rig.drivers.registers import PRESETS, Register, RegisterMap, decode, encode
from rig.drivers.settings import AmplifierRtu
from tests.rig.drivers.wire_dialogue import SILENCE, Dialogue, Registers, rtu

ASK = rtu(1, 3, 0, 77, 0, 2)
GOOD = rtu(1, 3, 4, 0x12, 0x34, 0x56, 0x78)


def asked(*pairs, tries=3, framing="rtu"):
    wire = Dialogue(*pairs)
    device = ModbusDevice(wire, framing, 1, wire.clock, 0.1, tries)
    return wire, device


def test_registers_are_read_by_one_request_and_one_reply():
    wire, device = asked((ASK, GOOD))
    assert device.read("holding", 77, 2) == [0x1234, 0x5678]
    assert device.repeated == 0
    wire.finished()


def test_input_registers_are_another_function():
    wire, device = asked((rtu(1, 4, 0, 77, 0, 2), rtu(1, 4, 4, 0, 1, 0, 2)))
    assert device.read("input", 77, 2) == [1, 2]
    wire.finished()


def test_a_reply_in_two_pieces_is_one():
    wire, device = asked((ASK, (GOOD[:4], GOOD[4:])))
    assert device.read("holding", 77, 2) == [0x1234, 0x5678]
    wire.finished()


def test_tcp_frames_carry_a_number():
    request = bytes([0, 1, 0, 0, 0, 6, 1, 3, 0, 77, 0, 1])
    foreign = bytes([0, 9, 0, 0, 0, 5, 1, 3, 2, 6, 6])
    reply = bytes([0, 1, 0, 0, 0, 5, 1, 3, 2, 0, 7])
    wire, device = asked((request, foreign + reply), framing="tcp")
    assert device.read("holding", 77, 1) == [7]
    wire.finished()


@pytest.mark.parametrize(
    "bad",
    [SILENCE, GOOD[:-3], GOOD[:-1] + bytes([GOOD[-1] ^ 4]), rtu(2, 3, 4, 0, 0, 0, 0), rtu(1, 3, 2, 0, 0)],
    ids=["silence", "truncated", "flipped", "foreign", "too few registers"],
)
def test_a_bad_reply_is_asked_for_again(bad):
    wire, device = asked((ASK, bad), (ASK, GOOD))
    assert device.read("holding", 77, 2) == [0x1234, 0x5678]
    assert device.repeated == 1
    wire.finished()


def test_a_late_reply_does_not_answer_the_next_question():
    other = rtu(1, 3, 4, 0xDE, 0xAD, 0xBE, 0xEF)
    wire, device = asked((ASK, (SILENCE, other)), (ASK, GOOD))
    assert device.read("holding", 77, 2) == [0x1234, 0x5678]
    wire.finished()


@pytest.mark.parametrize(("bad", "said"), [(SILENCE, "does not answer"), (GOOD[:-2] + b"\0\0", "replies are damaged")])
def test_silence_and_damage_are_told_apart(bad, said):
    wire, device = asked(*[(ASK, bad)] * 3)
    with pytest.raises(NoAnswer, match=rf"a device on /dev/ttyX: it.*{said}.*asked 3 times; check its power"):
        device.read("holding", 77, 2)
    wire.finished()


@pytest.mark.parametrize("code", [fault.value[0] for fault in ModbusFault])
def test_exception_codes_are_sentences(code):
    wire, device = asked((ASK, rtu(1, 0x83, code)))
    with pytest.raises(DeviceError, match=rf"a device on /dev/ttyX: .*\(Modbus exception {code}\); "):
        device.read("holding", 77, 2)
    wire.finished()


def test_a_code_without_meaning_is_said_to_have_none():
    _, device = asked((ASK, rtu(1, 0x83, 77)))
    with pytest.raises(DeviceError, match="exception 77, which has no meaning"):
        device.read("holding", 77, 2)


@pytest.mark.parametrize("order", ["high_first", "low_first"])
@pytest.mark.parametrize("kind", ["uint16", "int16", "int32", "uint32", "float32"])
def test_numbers_survive_their_registers(kind, order):
    for value in (0, 1, 255, 30000) if kind.startswith("u") else (0, -1, 1, -30000, 30000):
        assert decode(encode(value, kind, order), kind, order) == value


def test_known_words():
    assert decode([0x4000, 0x0000], "float32", "high_first") == 2.0
    assert decode([0x0000, 0x4000], "float32", "low_first") == 2.0
    assert decode([0xFFFF, 0xFFFE], "int32", "high_first") == -2
    assert decode([0xFFFE], "int16", "high_first") == -2
    with pytest.raises(ValueError, match="are not the registers"):
        decode([1], "int32", "high_first")


def words(value, kind="float32", order="high_first") -> list[int]:
    return [octet for word in encode(value, kind, order) for octet in word.to_bytes(2, "big")]


def bank(*numbers, order="high_first", **words_at) -> dict[int, int]:
    """Registers: pairs of an offset and a float32, and words such as ``r2=5``."""
    held = {int(name[1:]): word for name, word in words_at.items()}
    for offset, number in numbers:
        held |= dict(enumerate(encode(number, "float32", order), offset))
    return held


def ze_sg3(ratio=2.0, full_scale=10.0, unit=5, rate=3, order="high_first", signal=0, status=0) -> dict[int, int]:
    """Registers of a ZE-SG3 as its public drivers place them."""
    rest = dict.fromkeys(range(77, 95), 0)
    held = bank((13, ratio), (15, full_scale), order=order, r0=14, r1=112, r2=unit, r3=0, r33=rate)
    return {**rest, **held, 77: status, **dict(enumerate(encode(signal, "int32", "high_first"), 93))}


def z_sg(weight=1.0, code=27) -> dict[int, int]:
    """Registers of a Z-SG: unit and station as in the Z-SG2, its sampling code at 58, no register past 89."""
    return {**dict.fromkeys(range(90), 0), **bank((65, weight), r0=9, r1=3, r2=0x0500, r3=0x0100, r58=code)}


def z_sg2(weight=1.0, status=0) -> dict[int, int]:
    """Registers of a Z-SG2: N and bipolar in offset 2, station 1 and no parity in 3 (manual p. 42)."""
    return {**dict.fromkeys(range(90), 0), **bank((65, weight), r0=10, r1=3, r2=0x0500, r3=0x0100, r77=status)}


WEIGHT = {"cell_ratio_mv_per_v": 2.0, "cell_full_scale": 10.0}


def cell_of(held, preset="seneca-ze-sg3", **settings):
    wire = Registers(held)
    chosen = AmplifierRtu(driver="modbus-rtu", preset=preset, port="/dev/ttyX", **settings)
    return wire, ModbusLoadCell(wire, "rtu", chosen, wire.clock)


def seneca(order="high_first", expected_id=None, **held):
    return cell_of(ze_sg3(order=order, **held), expected_id=expected_id)


def test_connecting_says_what_answers():
    _, cell = seneca()
    assert cell.connect() == (
        "strain-gauge amplifier on /dev/ttyX: answers at address 1; id 14, firmware 112, unit N, 2 mV/V at 10, "
        "100 readings/s"
    )


@pytest.mark.parametrize(
    ("device", "preset", "right"),
    [
        (z_sg(), "seneca-ze-sg3", "seneca-z-sg"),
        (z_sg2(), "seneca-ze-sg3", "seneca-z-sg2"),
        (ze_sg3(), "seneca-z-sg2", "seneca-ze-sg3"),
        (ze_sg3(), "seneca-z-sg", "seneca-ze-sg3"),
        (z_sg2(), "seneca-z-sg", "seneca-z-sg2"),
    ],
)
def test_another_model_is_refused_by_its_name(device, preset, right):
    _, cell = cell_of(device, preset, **({} if preset == "seneca-ze-sg3" else WEIGHT))
    with pytest.raises(
        DeviceError,
        match=f"read like those of a {right}, not of the {preset} that is configured; give preset: {right}",
    ):
        cell.connect()


@pytest.mark.parametrize(("device", "preset"), [(z_sg(), "seneca-z-sg"), (z_sg2(), "seneca-z-sg2")])
def test_a_weight_becomes_the_voltage_of_the_bridge(device, preset):
    """1 N of 10 N at 2 mV/V and 5 V is 1 mV."""
    _, cell = cell_of(device, preset, **WEIGHT)
    cell.connect()
    assert cell.read(0.02).voltage_mv == pytest.approx(1.0)


def test_a_z_sg_as_delivered_is_too_slow_for_100_readings_a_second():
    """Its sampling code is 0x0052 by default (manual p. 20): 49.95 Hz."""
    _, cell = cell_of(z_sg(code=0x52), "seneca-z-sg", **WEIGHT)
    with pytest.raises(DeviceError, match=r"makes 49\.95 readings a second, fewer than the 100 asked for"):
        cell.connect()
    _, cell = cell_of(z_sg(code=0x52), "seneca-z-sg", readings_per_s=25, **WEIGHT)
    assert cell.connect().endswith("49.95 readings/s")


def test_a_z_sg2_says_its_unit_in_the_high_byte():
    assert "unit N" in cell_of(z_sg2(), "seneca-z-sg2", **WEIGHT)[1].connect()


@pytest.mark.parametrize("preset", ["seneca-z-sg", "seneca-z-sg2"])
def test_a_weight_needs_to_know_of_which_cell(preset):
    with pytest.raises(ValueError, match="give cell_ratio_mv_per_v and cell_full_scale as they are set"):
        AmplifierRtu(driver="modbus-rtu", preset=preset, port="/dev/ttyX", cell_full_scale=10.0)
    with pytest.raises(ValueError, match="are of no use"):
        AmplifierRtu(driver="modbus-rtu", preset="seneca-ze-sg3", port="/dev/ttyX", **WEIGHT)


def test_a_weight_past_the_full_scale_is_no_reading():
    _, cell = cell_of(z_sg2(status=2), "seneca-z-sg2", **WEIGHT)
    with pytest.raises(DeviceError, match="full scale is reached"):
        cell.read(0.02)


@pytest.mark.parametrize(
    ("cell", "quantum_mv"),
    [
        (cell_of(ze_sg3()), 0.0),
        (cell_of(z_sg(), "seneca-z-sg", **WEIGHT), 10.0 / 30000),
        (cell_of({6: 0, 7: 0, 8: 5}, "laumas-tlb", mv_per_count=0.042), 0.042),
        (cell_of({6: 0, 7: 0, 8: 5}, "laumas-tlb", mv_per_count=0.042, division=5), 0.21),
    ],
    ids=["converter", "weight of 30000 points", "divisions", "divisions of 5"],
)
def test_a_gauge_that_rounds_says_by_how_much(cell, quantum_mv):
    assert cell[1].read(0.02).quantum_mv == pytest.approx(quantum_mv)


def test_rates_may_be_a_list_from_code_0_on():
    own = RegisterMap(signal=Register(offset=2, kind="int32"), adc_rate=1, adc_rates_hz=[50.0, 200.0])
    assert own.adc_rates_hz == {0: 50.0, 1: 200.0}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"order": "low_first"},
            "with the words the other way round; give its register map with word_order: low_first",
        ),
        ({"ratio": 1e9}, "which no bridge has"),
        ({"full_scale": float("nan")}, "which no bridge has"),
        ({"unit": 77}, "its unit reads 77, which is none"),
        ({"rate": 5}, "makes 12 readings a second, fewer than the 100 asked for"),
        ({"rate": 9}, "its converter's rate reads 9, which is none of 0, 1, 2, 3, 4, 5, 6"),
        ({"expected_id": 3}, "it is number 14, not the 3 of rig.parts.load_cell.expected_id"),
    ],
    ids=["word order", "ratio", "full scale", "unit", "rate", "rate code", "identity"],
)
def test_what_cannot_be_is_refused_when_connecting(wrong, said):
    _, cell = seneca(**wrong)
    with pytest.raises(DeviceError, match=said) as refused:
        cell.connect()
    assert str(refused.value).startswith("strain-gauge amplifier on /dev/ttyX: ")


READ = rtu(1, 3, 0, 77, 0, 18)


def block(code: int) -> bytes:
    """Registers 77 to 94 of a ZE-SG3."""
    return rtu(1, 3, 36, *[0] * 32, *words(code, "int32"))


def test_a_reading_is_the_mean_of_readings_at_a_steady_rate():
    wire = Dialogue(*[(READ, block(65536 * k)) for k in (1, 2, 3)])
    chosen = AmplifierRtu(driver="modbus-rtu", preset="seneca-ze-sg3", port="/dev/ttyX")
    cell = ModbusLoadCell(wire, "rtu", chosen, wire.clock)
    begun = wire.clock.now()
    reading = cell.read(0.03)
    assert reading.voltage_mv == 2.0
    assert reading.spread_mv == 1.0
    assert reading.samples == 3
    assert reading.time_s - begun == pytest.approx(0.03)
    wire.finished()


def test_full_scale_is_an_error_and_not_a_reading():
    _, cell = seneca(signal=2**23 - 1, status=2)
    cell.connect()
    with pytest.raises(DeviceError, match="full scale is reached; take the load off"):
        cell.read(0.02)


def test_a_negative_weight_has_its_sign_in_the_status():
    ask = rtu(1, 3, 0, 6, 0, 3)
    wire = Dialogue(*[(ask, rtu(1, 3, 6, 0, 0x80, *words(1000, "uint32")))] * 2)
    settings = AmplifierRtu(driver="modbus-rtu", preset="laumas-tlb", port="/dev/ttyX", mv_per_count=0.001)
    assert ModbusLoadCell(wire, "rtu", settings, wire.clock).read(0.02).voltage_mv == -1.0
    wire.finished()


def test_no_number_is_passed_on_as_no_number():
    own = RegisterMap(signal=Register(offset=2, kind="float32"), signal_is="mv")
    wire = Dialogue(*[(rtu(1, 3, 0, 2, 0, 2), rtu(1, 3, 4, 0x7F, 0x80, 0, 0))] * 2)
    settings = AmplifierRtu(driver="modbus-rtu", registers=own, port="/dev/ttyX")
    assert math.isnan(ModbusLoadCell(wire, "rtu", settings, wire.clock).read(0.02).voltage_mv)


@pytest.mark.parametrize(
    ("signal", "said"),
    [
        (words(3.25, order="low_first"), r"with the words the other way round; give .* word_order: low_first"),
        (words(-2.5e-3, order="low_first"), r"but -0.0025 mV with the words the other way round"),
        (words(1e6), r"reads 1e\+06 mV, which no bridge gives; check the register map"),
    ],
    ids=["other order", "small and negative", "neither"],
)
def test_without_ratio_and_full_scale_the_signal_itself_shows_a_wrong_word_order(signal, said):
    own = RegisterMap(signal=Register(offset=2, kind="float32"), signal_is="mv")
    wire = Dialogue((rtu(1, 3, 0, 2, 0, 2), rtu(1, 3, 4, *signal)))
    settings = AmplifierRtu(driver="modbus-rtu", registers=own, port="/dev/ttyX")
    with pytest.raises(DeviceError, match=said):
        ModbusLoadCell(wire, "rtu", settings, wire.clock).read(0.02)
    wire.finished()


@pytest.mark.parametrize("code", [1000, -1000, 70000, 3000000])
def test_counts_in_the_other_order_are_told_too(code):
    def read(order):
        own = RegisterMap(signal=Register(offset=2, kind="int32"), word_order=order)
        wire = Dialogue(*[(rtu(1, 3, 0, 2, 0, 2), rtu(1, 3, 4, *words(code, "int32")))] * 2)
        settings = AmplifierRtu(driver="modbus-rtu", registers=own, port="/dev/ttyX")
        return ModbusLoadCell(wire, "rtu", settings, wire.clock).read(0.02).voltage_mv

    assert read("high_first") == code / 65536
    with pytest.raises(DeviceError, match="give its register map with word_order: high_first"):
        read("low_first")


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_fits_one_request(name):
    offset, count = PRESETS[name].reading_block()
    assert 0 < count <= 32, "a Laumas answers no more than 32 registers"
    assert offset <= PRESETS[name].signal.offset
