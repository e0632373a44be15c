"""The emulated USB-1608FS-Plus, transfer by transfer, as its maker and open drivers describe it."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import usb.core

from sim_backend.clock import VirtualClock
from sim_backend.emulators.usb1608 import EmulatedUsb1608

IN, OUT = 0xC0, 0x40
TRISTATE, PORT, LATCH, START, STOP, RANGES, CLEAR = 0x00, 0x01, 0x02, 0x11, 0x12, 0x14, 0x15
CALIBRATION, RESET, STATUS, SERIAL = 0x30, 0x42, 0x44, 0x48
INHIBIT_STALL = 0x80
RATE_HZ, PACER = 25000.0, 1599  # 40 MHz / 25 kHz - 1


class Ramp:
    """Input 0 rises by 10 uV a sample, from 0 V."""

    def __init__(self, clock: VirtualClock) -> None:
        self.inputs = [0]
        self.rate_hz = 0.0
        self._clock = clock
        self._taken, self._begun_s = 0, 0.0

    def begin(self, sample_rate_hz: float) -> None:
        self.rate_hz, self._begun_s, self._taken = sample_rate_hz, self._clock.now(), 0

    def take(self, samples: int):
        number = self._taken + np.arange(samples)
        self._taken += samples
        self._clock.sleep_until(self._begun_s + self._taken / self.rate_hz)
        return 1e-5 * number[None, :].astype(float)

    def end(self) -> None:
        pass


class Plugged:
    def __init__(self, **options) -> None:
        self.clock = VirtualClock()
        self.source = Ramp(self.clock)
        self.lines: list[tuple[int, bool]] = []
        self.emulated = EmulatedUsb1608(
            self.source, self.clock, on_line=lambda line, high: self.lines.append((line, high)), **options
        )
        self.device = usb.core.find(backend=self.emulated.bus, idVendor=0x09DB, idProduct=0x00EA)

    def put(self, request: int, value: int = 0, data: bytes = b"") -> None:
        self.device.ctrl_transfer(OUT, request, value, 0, data)

    def get(self, request: int, length: int, value: int = 0) -> bytes:
        return bytes(self.device.ctrl_transfer(IN, request, value, 0, length))

    def start(self, count: int = 0, pacer: int = PACER, mask: int = 1, options: int = 0) -> None:
        self.put(START, 0, struct.pack("<IIBB", count, pacer, mask, options))

    def status(self) -> int:
        return int.from_bytes(self.get(STATUS, 2), "little")

    def samples(self, count: int, timeout_ms: int = 1000) -> np.ndarray:
        return np.frombuffer(bytes(self.device.read(0x81, 2 * count, timeout_ms)), dtype="<u2")


@pytest.mark.parametrize("code", range(9))
def test_four_ranges_are_sold_and_others_refused(code):
    plugged = Plugged()
    if code in (0, 1, 3, 5):
        plugged.put(RANGES, 0, bytes([code] * 8))
        assert plugged.get(RANGES, 8) == bytes([code] * 8)
    else:
        with pytest.raises(usb.core.USBError, match="Pipe"):
            plugged.put(RANGES, 0, bytes([code] * 8))


@pytest.mark.parametrize(("code", "volts"), [(0, 10.0), (1, 5.0), (3, 2.0), (5, 1.0)])
def test_a_code_is_a_step_of_its_range(code, volts):
    plugged = Plugged()
    plugged.put(RANGES, 0, bytes([code] * 8))
    plugged.start()
    codes = plugged.samples(2048)
    assert np.array_equal(codes, 32768 + np.round(1e-5 * np.arange(2048) / (volts / 32768)))


def test_inputs_come_in_turn_from_the_lowest_and_open_ones_read_zero():
    plugged = Plugged()
    plugged.start(mask=0b101)
    codes = plugged.samples(512).reshape(-1, 2)
    assert (codes[:, 1] == 32768).all()
    assert codes[-1, 0] > 32768


def test_a_second_start_and_a_change_of_ranges_are_refused_while_it_runs():
    plugged = Plugged()
    plugged.start()
    assert plugged.status() == 0b010
    for refused in (plugged.start, lambda: plugged.put(RANGES, 0, bytes(8))):
        with pytest.raises(usb.core.USBError, match="Pipe"):
            refused()


def test_an_overrun_stalls_the_endpoint_and_is_remembered_until_the_status_is_written():
    plugged = Plugged()
    plugged.start()
    plugged.clock.sleep(32769 / RATE_HZ + 0.1)
    with pytest.raises(usb.core.USBError, match="Pipe"):
        plugged.samples(512)
    assert plugged.status() == 0b100
    plugged.device.clear_halt(0x81)
    plugged.put(STOP)
    plugged.put(CLEAR)
    plugged.start()
    assert len(plugged.samples(512)) == 512
    assert plugged.status() == 0b110
    plugged.put(STATUS)
    assert plugged.status() == 0b010


def test_an_overrun_need_not_stall():
    plugged = Plugged()
    plugged.start(options=INHIBIT_STALL)
    plugged.clock.sleep(2.0)
    plugged.device.read(0x81, 64, 100)  # what is left over, and no stall
    assert plugged.status() == 0b100


def test_the_memory_holds_32768_samples():
    plugged = Plugged()
    plugged.start()
    plugged.clock.sleep(32768 / RATE_HZ)
    assert len(plugged.samples(512)) == 512


@pytest.mark.parametrize(("scans", "packets"), [(100, [200]), (320, [512, 128, 0]), (256, [512, 0])])
def test_a_finite_scan_ends_in_a_short_packet_or_an_empty_one(scans, packets):
    plugged = Plugged()
    plugged.start(count=scans)
    got = [len(plugged.device.read(0x81, 512, 1000)) for _ in packets]
    assert got == packets
    assert plugged.status() == 0
    with pytest.raises(usb.core.USBTimeoutError):
        plugged.device.read(0x81, 512, 100)


def test_the_pacer_runs_at_100_khz_at_most():
    plugged = Plugged()
    plugged.start(pacer=99)
    assert plugged.source.rate_hz == 100e3


def test_without_a_pacer_it_waits_for_a_clock_that_nobody_gives():
    plugged = Plugged()
    plugged.start(pacer=0)
    with pytest.raises(usb.core.USBTimeoutError):
        plugged.samples(256)
    assert plugged.status() == 0b010


def test_lines_are_inputs_and_the_latch_is_empty_after_power_on():
    plugged = Plugged()
    assert (plugged.get(TRISTATE, 1), plugged.get(LATCH, 1), plugged.get(PORT, 1)) == (b"\xff", b"\x00", b"\x00")
    assert plugged.lines == []


def test_a_latched_bit_shows_once_its_line_is_an_output():
    plugged = Plugged()
    plugged.put(LATCH, 0b1000)
    assert plugged.lines == []
    plugged.put(TRISTATE, 0xF7)
    assert plugged.lines == [(3, True)]
    assert plugged.get(PORT, 1) == b"\x08"
    plugged.put(RESET)
    assert plugged.lines == [(3, True), (3, False)]


def test_the_resistors_as_delivered_hold_every_line_high_until_it_is_an_output():
    plugged = Plugged(pulled_up=True)
    assert plugged.lines == [(line, True) for line in range(8)]
    plugged.put(TRISTATE, 0xF7)
    assert plugged.lines[-1] == (3, False)
    assert plugged.get(PORT, 1) == b"\xf7"


def test_the_serial_number_is_eight_characters_and_the_memory_768_bytes_with_a_date():
    plugged = Plugged()
    assert plugged.get(SERIAL, 8) == b"01D2E3F4"
    memory = plugged.get(CALIBRATION, 768)
    assert len(memory) == 768
    assert struct.unpack_from("<ff", memory, 0) == (1.0, 0.0)
    year, month, day = memory[0x200:0x203]
    assert 10 <= year <= 99
    assert 1 <= month <= 12
    assert 1 <= day <= 31
