"""The USB-1608FS-Plus driver, word by word over the wire: what it sends, what it makes of the answers."""

from __future__ import annotations

import errno
import struct

import numpy as np
import pytest
from usb.core import USBError

from rig import DeviceError, RigError
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.usb1608 import Usb1608
from rig.settings import Channel, Wiring
from sim_backend.clock import VirtualClock
from sim_backend.emulators.usb_bus import UsbBus, gone, overflowed, stalled, timed_out
from tests.rig.drivers.usb_dialogue import (
    CALIBRATION,
    CLEAR_HALT,
    OVERRUN,
    RUNNING,
    SERIAL,
    STATUS,
    Scripted,
    ask,
    bulk,
    connecting,
    out,
    starting,
)

BLOCK = 256 * 3 * 2


def codes(first: int = 0, inputs: int = 3) -> bytes:
    """A block in which input i reads 1000 * i + the sample's index, above the middle."""
    n = first + np.arange(256)[:, None]
    return (32768 + 1000 * np.arange(inputs) + n).astype("<u2").tobytes()


def recorder(device: Scripted, wiring: Wiring | None = None, clock: VirtualClock | None = None, **settings) -> Usb1608:
    return Usb1608(wiring or Wiring(), Usb1608Settings(**settings), clock or VirtualClock(), device.bus)


def started(*pairs, clock: VirtualClock | None = None, **settings) -> tuple[Usb1608, Scripted]:
    """A recorder that streams, and the device with the rest of its script."""
    device = Scripted(connecting(), starting(), *pairs)
    driver = recorder(device, clock=clock, **settings)
    driver.connect()
    driver.start()
    return driver, device


# --- connecting


def test_connecting_reads_serial_number_and_calibration_and_nothing_else():
    device = Scripted(connecting())
    line = recorder(device).connect()
    assert line.startswith("recorder MCC USB-1608FS-Plus 01D2E3F4 on usb 1:2: 25000 Hz, inputs 0 (±5 V), 1 (±5 V), 2")
    assert not device.pairs


def test_every_transfer_of_a_recording():
    driver, device = started(bulk(codes()), bulk(codes(256)), out(0x12))
    blocks = [driver.read_block(), driver.read_block()]
    driver.stop()
    driver.close()
    driver.close()
    assert not device.pairs
    assert device.bus.opened == 0
    assert [b.first_sample for b in blocks] == [0, 256]


def test_codes_become_volts_and_volts_become_units():
    wiring = Wiring(
        accelerometer_a=Channel(input=5, sensitivity_mv_per_g=50.0, gain=4.0),
        accelerometer_b=Channel(input=3, sensitivity_mv_per_g=100.0, gain=1.0, polarity=-1),
        strain_gauge_input=4,
        strain_gauge_gain=2.0,
        strain_gauge_range_v=1.0,
        input_range_v=2.0,
    )
    inputs = ((3, 5), (3, 3), (5, 4))
    device = Scripted(
        connecting(1.25 - 2**-3, 10.0, inputs),
        starting(mask=0b111000, ranges=bytes([0, 0, 0, 3, 5, 3, 0, 0])),
        bulk(codes()),
    )
    driver = recorder(device, wiring)
    driver.connect()
    driver.start()
    block = driver.read_block()
    corrected = lambda place: (32768 + 1000 * place + np.arange(256)) * 1.125 + 10 - 32768  # noqa: E731
    volts = 2.0 / 32768
    assert block.acceleration[0] == pytest.approx(corrected(2) * volts / (0.05 * 4) * 9.80665, rel=1e-12)
    assert block.acceleration[1] == pytest.approx(-corrected(0) * volts / 0.1 * 9.80665, rel=1e-12)
    assert block.strain_mv == pytest.approx(corrected(1) / 32768 * 1e3 / 2, rel=1e-12)


def test_corrected_codes_are_held_within_the_scale():
    content = np.zeros((256, 3), "<u2")
    content[1::2] = 65535
    device = Scripted(connecting(1.1, -100.0), starting(), bulk(content.tobytes()))
    driver = recorder(device)
    driver.connect()
    driver.start()
    a = driver.read_block().acceleration
    step = 5 / 32768 * 9.80665
    assert a[:, 0] == pytest.approx([-32768 * step, 32768 * step])
    assert a[:, 1] == pytest.approx([32767 * step, -32767 * step])


def test_full_scale_is_where_the_calibrated_scale_ends():
    device = Scripted(connecting(0.99, 100.0))
    driver = recorder(device)
    assert driver.full_scale_m_s2 == pytest.approx(5 * 9.80665)
    driver.connect()
    low, high = 32768 - 100, 65535 * 0.99 + 100 - 32768 + 1
    assert driver.full_scale_m_s2 == pytest.approx(min(low, high) / 32768 * 5 * 9.80665)


def test_without_a_strain_gauge_two_inputs_are_sampled():
    ranges = bytes([1, 1, 0, 0, 0, 0, 0, 0])
    device = Scripted(connecting(inputs=((1, 0), (1, 1))), starting(mask=0b11, ranges=ranges), bulk(codes(inputs=2)))
    driver = recorder(device, Wiring(strain_gauge_input=None))
    driver.connect()
    driver.start()
    assert driver.read_block().strain_mv is None


def test_the_rate_is_the_pacers():
    driver = recorder(Scripted(), Wiring(sample_rate_hz=30000.0))
    assert driver.sample_rate_hz == 40e6 / 1333


@pytest.mark.parametrize(
    ("wiring", "said"),
    [
        ({"input_range_v": 4.0}, r"rig.wiring.input_range_v: .* no range of 4 V; it has 10, 5, 2, 1$"),
        ({"strain_gauge_range_v": 0.1}, "rig.wiring.strain_gauge_range_v"),
        ({"strain_gauge_input": 8}, "no input 8; its inputs are 0 to 7"),
        ({"bits": 24}, "has 16 bits, not 24"),
        ({"sample_rate_hz": 100001.0}, "rig.wiring.sample_rate_hz: 100001 Hz is not possible"),
        ({"sample_rate_hz": 0.001}, "rig.wiring.sample_rate_hz"),
    ],
)
def test_wiring_that_the_recorder_does_not_have_is_refused(wiring, said):
    with pytest.raises(RigError, match=said):
        recorder(Scripted(), Wiring(**wiring))


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ([ask(SERIAL, b"01D2", length=8)], "its serial number reads b'01D2'"),
        ([ask(SERIAL, b"\xff\x00abcde!", length=8)], "its serial number reads"),
        ([ask(SERIAL, b"", length=8)], "its serial number reads b''"),
        ([ask(SERIAL, timed_out(), length=8)], "usb 1:2: it did not answer request 0x48; unplug it"),
        ([ask(SERIAL, stalled(), length=8)], "it refused request 0x48"),
        ([*connecting()[:2], ask(CALIBRATION, b"\x00" * 7, 64, 8)], "calibration memory gave 7 of 8 bytes"),
        ([*connecting()[:2], ask(CALIBRATION, struct.pack("<ff", float("nan"), 0), 64)], "slope nan, .* cannot be"),
        ([*connecting()[:2], ask(CALIBRATION, b"\xff" * 8, 64)], "cannot be; have it calibrated"),
        ([*connecting()[:2], ask(CALIBRATION, b"\x00" * 8, 64)], "input 0 at 5 V is slope 0, intercept 0"),
        ([*connecting()[:2], ask(CALIBRATION, struct.pack("<ff", 1, 9999), 64)], "intercept 9999"),
    ],
)
def test_answers_that_cannot_be_are_told_and_the_device_let_go(pairs, said):
    device = Scripted(pairs)
    with pytest.raises(DeviceError, match=said):
        recorder(device).connect()
    assert not device.pairs
    assert device.bus.opened == 0


def test_no_device_is_told():
    device = Scripted()
    device.bus.unplug(device)
    with pytest.raises(RigError, match="there is none on USB; check its cable"):
        recorder(device).connect()


def test_a_device_in_use_and_one_that_is_forbidden_are_told():
    device = Scripted()
    device.bus.ports[0].taken = True
    with pytest.raises(DeviceError, match="on usb 1:2: another program uses it; close that one"):
        recorder(device).connect()
    device.bus.ports[0].taken, device.bus.ports[0].forbidden = False, True
    with pytest.raises(
        DeviceError, match="this user may not open it; give access to it with the rules that 'mesotap udev'"
    ):
        recorder(device).connect()
    assert device.bus.opened == 0


def two_on_one_bus(first: str, second: str) -> tuple[Scripted, Scripted, UsbBus]:
    one = Scripted(ask(SERIAL, first.encode()))
    other = Scripted(ask(SERIAL, second.encode()), connecting()[1:])
    return one, other, UsbBus(one, other)


def test_the_one_with_the_serial_number_is_taken():
    one, other, bus = two_on_one_bus("01AAAAAA", "01BBBBBB")
    driver = Usb1608(Wiring(), Usb1608Settings(serial_number="1bbbbbb"), VirtualClock(), bus)
    assert "01BBBBBB on usb 1:3" in driver.connect()
    assert not one.pairs
    assert not other.pairs
    assert bus.opened == 1


def test_a_serial_number_that_is_not_there_is_told_with_those_that_are():
    one, other, bus = two_on_one_bus("01AAAAAA", "01BBBBBB")
    other.pairs = other.pairs[:1]
    driver = Usb1608(Wiring(), Usb1608Settings(serial_number="01CCCCCC"), VirtualClock(), bus)
    with pytest.raises(RigError, match="none has serial number 01CCCCCC; found 01AAAAAA on usb 1:2; 01BBBBBB on"):
        driver.connect()
    assert bus.opened == 0
    assert not one.pairs
    assert not other.pairs


def test_two_recorders_and_no_serial_number_is_refused():
    *_, bus = two_on_one_bus("01AAAAAA", "01BBBBBB")
    with pytest.raises(RigError, match="there are 2 on USB; name one by its serial_number"):
        Usb1608(Wiring(), Usb1608Settings(), VirtualClock(), bus).connect()


# --- transfers cut short


def test_short_and_empty_packets_are_put_together():
    content = codes()
    driver, device = started(
        bulk(content[:64], BLOCK), bulk(b"", BLOCK - 64), bulk(content[64:640], BLOCK - 64), bulk(content[640:])
    )
    block = driver.read_block()
    assert not device.pairs
    step = 5 / 32768 * 9.80665
    assert block.acceleration[0] == pytest.approx(np.arange(256) * step)
    assert block.first_sample == 0


@pytest.mark.parametrize("sent", [BLOCK - 1, BLOCK - 2, 63, 1, 65])
def test_bytes_that_are_no_whole_packets_end_the_scan_and_leave_a_gap(sent):
    clock = VirtualClock()
    driver, device = started(
        bulk(codes()),
        bulk(codes(256)[:sent], BLOCK),
        ask(STATUS, RUNNING),
        *(out(0x12), out(0x15), CLEAR_HALT),
        starting(),
        bulk(codes(1000)),
        clock=clock,
    )
    driver.read_block()
    clock.sleep(0.04)
    block = driver.read_block()
    assert not device.pairs
    assert block.first_sample == 1000
    assert block.acceleration.shape == (2, 256)


def test_more_than_asked_for_ends_the_scan_and_leaves_a_gap():
    driver, device = started(
        bulk(overflowed(), BLOCK), ask(STATUS, RUNNING), out(0x12), out(0x15), CLEAR_HALT, starting(), bulk(codes())
    )
    assert driver.read_block().first_sample == 1
    assert not device.pairs


def test_packets_without_samples_for_ever_are_given_up():
    empty = [bulk(b"", BLOCK)] * 9
    again = [*empty, ask(STATUS, RUNNING), out(0x12), out(0x15), CLEAR_HALT, *starting()]
    driver, device = started(again, again, again, empty, ask(STATUS, RUNNING))
    with pytest.raises(RigError, match=r"sends packets without samples; .* \(to start it again did not help\)$"):
        driver.read_block()
    assert not device.pairs


# --- overrun, stall, silence


def test_an_overrun_is_mended_in_this_order_and_the_gap_counted_by_the_clock():
    clock = VirtualClock()
    driver, device = started(
        bulk(codes()),
        bulk(stalled(), BLOCK),
        ask(STATUS, OVERRUN),
        *(out(0x12), out(0x15), out(STATUS), CLEAR_HALT),
        starting(),
        bulk(codes()),
        bulk(codes()),
        clock=clock,
    )
    driver.read_block()
    clock.sleep(2.0)
    assert driver.read_block().first_sample == 50000
    assert driver.read_block().first_sample == 50256
    assert not device.pairs


def test_a_device_that_does_not_let_its_errors_be_cleared_goes_on_all_the_same():
    refused = ("out", STATUS, 0, b""), stalled()
    driver, device = started(
        bulk(stalled(), BLOCK), ask(STATUS, OVERRUN), out(0x12), out(0x15), refused, CLEAR_HALT, starting(),
        bulk(codes()),
    )  # fmt: skip
    assert driver.read_block().first_sample == 1
    assert not device.pairs


@pytest.mark.parametrize(("range_v", "code"), [(10.0, 0), (5.0, 1), (2.0, 3), (1.0, 5)])
def test_the_ranges_sold_have_the_codes_of_the_makers_library(range_v, code):
    """uldaq, AiUsb1608fs_Plus::mapRangeCode; the calibration of range code and input is at (8 code + input) 8 bytes."""
    inputs = ((code, 0), (code, 1))
    device = Scripted(
        connecting(inputs=inputs),
        starting(mask=0b11, ranges=bytes([code, code, 0, 0, 0, 0, 0, 0])),
        bulk(codes(inputs=2)),
    )
    driver = recorder(device, Wiring(strain_gauge_input=None, input_range_v=range_v))
    driver.connect()
    driver.start()
    driver.read_block()
    assert not device.pairs


@pytest.mark.parametrize("range_v", [2.5, 1.25, 0.625, 0.3125])
def test_ranges_that_are_not_sold_are_refused(range_v):
    with pytest.raises(RigError, match=r"the MCC USB-1608FS-Plus has no range of .* V; it has 10, 5, 2, 1$"):
        recorder(Scripted(), Wiring(strain_gauge_range_v=range_v))


def test_the_defaults_can_be_had():
    recorder(Scripted(), Wiring())


def test_a_control_transfer_is_given_as_long_as_by_public_drivers():
    device = Scripted(connecting())
    given = []
    device.control_out = lambda request, value, data, timeout_s: (
        given.append(timeout_s),
        device._next(("out", request, value, data)),
    )[1]
    recorder(device).connect()
    assert given
    assert min(given) >= 0.1


def test_a_gap_is_at_least_one_sample_though_the_clock_stood():
    driver, _ = started(
        bulk(codes()), bulk(stalled(), BLOCK), ask(STATUS, RUNNING), out(0x12), out(0x15), CLEAR_HALT, starting(),
        bulk(codes()),
    )  # fmt: skip
    driver.read_block()
    assert driver.read_block().first_sample == 257


def test_overruns_without_end_are_given_up_and_say_why():
    mend = [out(0x12), out(0x15), out(STATUS), CLEAR_HALT]
    again = [bulk(stalled(), BLOCK), ask(STATUS, OVERRUN), *mend, *starting()]
    driver, device = started(again, again, again, again[:2])
    with pytest.raises(
        RigError, match=r"its memory ran over, .*; close other programs \(to start it again did not help\)$"
    ):
        driver.read_block()
    assert not device.pairs
    with pytest.raises(RigError, match="does not stream"):
        driver.read_block()


@pytest.mark.parametrize(
    ("status", "said"), [(RUNNING, "it samples, but sends nothing"), (b"\0\0", "it stopped by itself")]
)
def test_silence_is_told_in_the_words_of_the_status(status, said):
    again = [bulk(timed_out(), BLOCK), ask(STATUS, status), out(0x12), out(0x15), CLEAR_HALT, *starting()]
    driver, device = started(again, again, again, again[:2])
    with pytest.raises(RigError, match=said):
        driver.read_block()
    assert not device.pairs


def test_a_status_of_one_byte_will_do_and_an_empty_one_is_a_fault():
    mend = [out(0x12), out(0x15), CLEAR_HALT, *starting()]
    driver, device = started(
        bulk(timed_out(), BLOCK), ask(STATUS, b"\x02", length=2), mend,
        bulk(timed_out(), BLOCK), ask(STATUS, b"", length=2), mend, bulk(codes()),
    )  # fmt: skip
    driver.read_block()
    assert not device.pairs


def test_a_start_that_stalls_is_tried_again():
    device = Scripted(connecting(), out(0x12), out(0x15), (starting()[2][0], stalled()), starting())
    driver = recorder(device)
    driver.connect()
    driver.start()
    assert not device.pairs


def test_stopping_never_fails():
    driver, device = started((out(0x12)[0], gone()))
    driver.stop()
    driver.stop()
    assert not device.pairs


# --- the cable


def test_a_recorder_that_comes_back_is_connected_and_started_again():
    clock = VirtualClock()
    driver, device = started(bulk(codes()), bulk(gone(), BLOCK), connecting(), starting(), bulk(codes()), clock=clock)
    driver.read_block()
    clock.sleep(0.1)
    assert driver.read_block().first_sample == 2500
    assert not device.pairs
    assert device.bus.opened == 1


def test_a_recorder_that_stays_away_is_told_soon_and_found_at_the_next_start():
    clock = VirtualClock()
    driver, device = started(bulk(codes()), connecting(), starting(), bulk(codes()), clock=clock)
    driver.read_block()
    device.bus.unplug(device)
    before = clock.now()
    with pytest.raises(RigError, match=r"on usb 1:2: it is gone from the bus; check its cable and the hub$"):
        driver.read_block()
    assert clock.now() - before < 0.5
    driver.stop()
    device.bus.plug(device)
    driver.start()
    assert driver.read_block().first_sample == 0
    assert not device.pairs
    assert device.bus.opened == 1


def test_another_recorder_in_its_place_is_not_taken():
    driver, device = started(bulk(gone(), BLOCK), serial_number="01D2E3F4", reconnect_s=0.0)
    device.pairs.append(ask(SERIAL, b"01FFFFFF"))
    with pytest.raises(RigError, match=r"none has serial number 01D2E3F4; found 01FFFFFF on usb 1:2$"):
        driver.read_block()
    assert not device.pairs


def test_what_libusb_cannot_name_is_still_one_sentence():
    device = Scripted(ask(SERIAL, USBError("Other error", -99, None), length=8))
    with pytest.raises(DeviceError, match=r"request 0x48 failed \(Other error\); unplug it and plug it in again"):
        recorder(device).connect()


@pytest.mark.parametrize("number", [errno.EIO, errno.ENODEV, errno.ENOENT])
def test_every_way_to_say_that_it_is_gone(number):
    driver, device = started(bulk(USBError("?", -1, number), BLOCK), connecting(), starting(), bulk(codes()))
    assert driver.read_block().first_sample == 1
    assert not device.pairs


# --- digital lines


def test_a_line_becomes_an_output_only_when_low_and_others_stay():
    latch, tristate = 0x02, 0x00
    device = Scripted(
        connecting(),
        ask(latch, b"\x81"), out(latch, 0x81 & ~0b1000),
        ask(tristate, b"\xff"), out(tristate, 0xF7),
        ask(latch, b"\x81"), out(latch, 0x89),
        ask(latch, b"\x89"), out(latch, 0x81),
    )  # fmt: skip
    driver = recorder(device)
    driver.connect()
    driver.set_line(3, True)
    driver.set_line(3, False)
    assert not device.pairs


def test_a_line_without_a_device_is_told():
    with pytest.raises(RigError, match="it is not connected"):
        recorder(Scripted()).set_line(0, True)


def test_a_register_that_does_not_answer_is_told():
    device = Scripted(connecting(), ask(0x02, b"", length=1))
    driver = recorder(device)
    driver.connect()
    with pytest.raises(DeviceError, match="register 0x02 gave 0 of 1 byte"):
        driver.set_line(0, True)


def test_reading_before_starting_is_told():
    with pytest.raises(RigError, match="does not stream; start it"):
        recorder(Scripted()).read_block()


def test_the_driver_knows_no_request_that_could_do_harm():
    from rig.drivers.usb1608_protocol import Request

    assert not {0x50, 0x31, 0x32, 0x42} & {int(r) for r in Request}


def test_neither_samples_nor_a_status_is_given_up_without_another_question():
    """The surfaces have to be apart within half a second, and each question to a dead device costs 100 ms."""
    clock = VirtualClock()
    driver, device = started(bulk(timed_out(), BLOCK), ask(STATUS, timed_out(), length=2), clock=clock)
    with pytest.raises(RigError, match="it did not answer request 0x44"):
        driver.read_block()
    assert not device.pairs
