"""The emulated amplifiers, request by request, as the makers' manuals have them."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest

from sim_backend.clock import VirtualClock
from sim_backend.emulators.amplifier import AmplifierModel, EmulatedAmplifier
from sim_backend.emulators.modbus import ModbusServer, Refusal, crc16
from sim_backend.gauge import LARGEST_CODE, STEP_MV, SimulatedLoadCell
from sim_backend.settings import SimulatedGauge

MV_PER_MN = 0.01
SMALLEST_NOISE_MV = 1e-12


class Bench:
    """An amplifier, a gauge without noise unless asked for, and the load on it."""

    def __init__(self, device: str, noise_mv: float = SMALLEST_NOISE_MV, offset_mv: float = 0.0, **model) -> None:
        self.clock = VirtualClock()
        self.load_mn = 0.0
        settings = SimulatedGauge(offset_mv=offset_mv, noise_mv=noise_mv)
        self.gauge = SimulatedLoadCell(settings, MV_PER_MN, self.clock, lambda: self.load_mn, 1)
        self.device = EmulatedAmplifier(self.gauge, AmplifierModel(device, **model), self.clock)

    def words(self, offset: int, count: int = 1) -> list[int]:
        return self.device.read(offset, count)

    def number(self, offset: int, form: str) -> float:
        return struct.unpack(f">{form}", struct.pack(">HH", *self.words(offset, 2)))[0]


@pytest.mark.parametrize("device", ["ze-sg3", "z-sg", "z-sg2"])
def test_a_seneca_reckons_the_load_from_the_cells_data(device):
    bench = Bench(device, ratio_mv_per_v=2.0, full_scale=10.0, excitation_v=5.0)
    bench.load_mn = 300.0  # 3 mV of the 10 mV at full scale
    assert bench.number(63, "f") == pytest.approx(3.0, abs=1e-4)
    assert bench.number(65, "f") == pytest.approx(3.0, abs=1e-4)
    assert bench.number(67, "f") == 0.0


def test_the_more_significant_word_comes_first():
    assert Bench("ze-sg3").words(13, 2) == [0x4000, 0x0000]  # 2.0 mV/V


@pytest.mark.parametrize(
    ("device", "offset", "content"),
    [("ze-sg3", 2, 5), ("ze-sg3", 33, 3), ("z-sg", 58, 0x52), ("z-sg2", 2, 0x0500), ("tlb", 1, 14)],
)
def test_what_stands_where(device, offset, content):
    assert Bench(device).words(offset) == [content]


def test_conversions_without_and_with_the_filter():
    bench = Bench("ze-sg3", mv_per_count=STEP_MV, realistic=True)
    bench.clock.sleep(1.0)
    bench.number(93, "i")
    bench.load_mn = 500.0
    bench.clock.sleep(0.02)
    raw, filtered = bench.number(91, "i"), bench.number(93, "i")
    assert raw == pytest.approx(5.0 / STEP_MV, abs=2)
    assert 0 < filtered < 0.9 * raw
    bench.clock.sleep(1.0)
    assert bench.number(93, "i") == pytest.approx(raw, abs=2)


@pytest.mark.parametrize(
    ("device", "code", "rate_hz"),
    [("ze-sg3", 3, 100.0), ("ze-sg3", 6, 4.7), ("z-sg", 0x52, 49.95), ("z-sg", 27, 151.71)],
)
def test_a_reading_repeats_until_the_next_conversion(device, code, rate_hz):
    bench = Bench(device, noise_mv=0.02, realistic=True)
    bench.device.rate_code = code
    bench.clock.sleep(1.0)
    readings = []
    for _ in range(1000):
        bench.clock.sleep(1e-3)
        readings.append(bench.number(65, "f"))
    changes = sum(a != b for a, b in pairwise(readings))
    assert changes == pytest.approx(rate_hz, abs=1)


def test_an_ideal_one_converts_whenever_it_is_asked():
    bench = Bench("ze-sg3", noise_mv=0.02)
    assert len({bench.number(65, "f") for _ in range(50)}) > 45


def test_what_is_not_measured_draws_no_noise():
    first, second = Bench("ze-sg3", noise_mv=0.02), Bench("ze-sg3", noise_mv=0.02)
    first.words(0, 44)
    first.words(77)
    assert first.number(93, "i") == second.number(93, "i")


@pytest.mark.parametrize("device", ["ze-sg3", "z-sg2"])
def test_a_seneca_tells_full_scale_and_below_zero(device):
    bench = Bench(device)
    bench.gauge.fault = ("offset", 1e3)
    bench.number(65, "f")
    assert bench.words(77)[0] & 2
    bench.gauge.fault = ("offset", -1.0)
    bench.number(65, "f")
    assert bench.words(77)[0] & 6 == 4


def test_a_laumas_tells_magnitudes_in_whole_divisions_and_signs_apart():
    bench = Bench("tlb", mv_per_count=0.01)
    bench.load_mn = 123.4
    assert (bench.number(7, "I"), bench.number(9, "I"), bench.words(6)[0] & 0x180) == (123, 123, 0)
    bench.gauge.fault = ("offset", -2.0)
    assert bench.number(7, "I") == 77
    assert bench.words(6)[0] & 0x180 == 0x180


def test_a_laumas_shows_six_digits_and_says_when_they_do_not_do():
    bench = Bench("tlb", mv_per_count=STEP_MV, realistic=True)
    bench.load_mn = 2000.0
    bench.clock.sleep(10.0)
    bench.number(7, "I")
    assert bench.words(6)[0] & 0x30 == 0x30


def test_a_laumas_on_a_full_converter_has_a_cell_error():
    bench = Bench("tlb")
    bench.gauge.fault = ("offset", 1e3)
    assert bench.number(7, "I") == LARGEST_CODE
    assert bench.words(6)[0] & 1


def test_a_laumas_reads_thirty_two_registers_at_a_time():
    bench = Bench("tlb")
    assert len(bench.words(0, 32)) == 32
    with pytest.raises(Refusal) as refused:
        bench.words(0, 33)
    assert refused.value.code == 3


@pytest.mark.parametrize("device", ["ze-sg3", "z-sg", "z-sg2", "tlb"])
def test_registers_beyond_the_table_are_refused(device):
    with pytest.raises(Refusal) as refused:
        Bench(device).words(1000)
    assert refused.value.code == 2


@pytest.mark.parametrize(("device", "answers"), [("tlb", {3}), ("ze-sg3", {3}), ("z-sg", {3, 4})])
def test_functions_that_read(device, answers):
    server = ModbusServer(Bench(device).device, 1, "rtu")
    for function in (3, 4):
        request = bytes([1, function, 0, 0, 0, 1])
        reply = server.receive(request + crc16(request))[0]
        assert (reply[1] == function) == (function in answers)
        assert reply[1] == function or reply[2] == 1


def test_it_goes_on_from_what_was_kept():
    bench, other = (Bench("ze-sg3", realistic=True, noise_mv=0.02) for _ in range(2))
    bench.clock.sleep(1.0)
    bench.number(93, "i")
    other.clock.sleep(1.0)
    other.device.restore(bench.device.checkpoint())
    assert other.device.checkpoint() == bench.device.checkpoint()
    assert other.number(93, "i") == bench.number(93, "i")  # within the same conversion
