"""The recorder's driver on the emulated device: the same session as simulated, and every fault of the wire."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import usb.core
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.settings import Trigger
from daq.trigger import NoTap, SamplesLost, record_impact
from rig import Impactor, RigError
from rig.drivers.recorder_settings import SolenoidSettings, Usb1608Settings
from rig.drivers.solenoid import SolenoidImpactor
from rig.drivers.usb1608 import Usb1608
from rig.settings import Channel, Hammer, RigSettings, Wiring
from sim_backend.clock import VirtualClock
from sim_backend.emulators.counting import TURNS, CountingSource, numbers
from sim_backend.emulators.usb1608 import EmulatedUsb1608, Fault, bus_of
from sim_backend.recorder import calibration_table
from sim_backend.rig import SimulatedRig
from sim_backend.settings import BadTaps, SimBackendSettings, SimulatedRecorder

WIRING = Wiring()
NONE_BAD = BadTaps(double=0, too_hard=0, too_weak=0, off_centre=0, clipped=0)


class Streaming:
    """A recorder on an emulated device that counts its samples."""

    def __init__(self, wiring: Wiring = WIRING, calibration=None, **options) -> None:
        self.clock = VirtualClock()
        self.wiring = wiring
        ideal = calibration_table(SimulatedRecorder(), 0)
        source = CountingSource(self.clock, wiring)
        self.device = EmulatedUsb1608(source, self.clock, calibration=ideal if calibration is None else calibration)
        self.driver = Usb1608(wiring, Usb1608Settings(**options), self.clock, self.device.bus)
        self.driver.connect()
        self.driver.start()
        self.origin = round(self.clock.now() * self.driver.sample_rate_hz)
        self.slack = 1

    def read(self):
        """Read a block, every sample of which has to be the one that the block says it is."""
        block = self.driver.read_block()
        said = numbers(block, self.wiring)
        due = self.origin + block.first_sample + np.arange(256)
        off = (said - due) % TURNS
        # after a gap the scan begins between two samples of the first one: one sample either way is rounding
        assert np.all((off <= 1) | (off >= TURNS - self.slack)), off
        assert (off == off[0, 0]).all()
        return block


# --- the same physics


def recorded(emulated: bool, wiring: Wiring, errors: SimulatedRecorder, seed: int):
    rig_settings, settings = RigSettings(wiring=wiring), SimBackendSettings(recorder=errors)
    rig = SimulatedRig(rig_settings, settings, seed=seed)
    rig.stage.move_by(149.0)
    rig.stage.advance(10.0, 0.1, lambda: rig.true_load_mn() >= 500.0)
    recorder = rig.accelerometers
    if emulated:
        table = calibration_table(errors, seed)
        device = EmulatedUsb1608(rig.accelerometers.signal, rig.clock, calibration=table)
        recorder = Usb1608(wiring, Usb1608Settings(), rig.clock, device.bus)
        recorder.connect()
    records = []
    for _ in range(4):
        records.append(record_impact(recorder, rig.impactor, rig.clock, Trigger(), 500.0))
        rig.load_cell.read()
    return records, recorder.full_scale_m_s2, rig.checkpoint()


@pytest.mark.parametrize(
    "errors", [SimulatedRecorder(), SimulatedRecorder(gain_error_percent=2, offset_error_codes=80)]
)
@pytest.mark.parametrize(
    "wiring",
    [
        WIRING,
        Wiring(strain_gauge_input=None),
        Wiring(hammer=Hammer(input=3)),
        Wiring(strain_gauge_input=None, hammer=Hammer(input=5, range_v=10.0, polarity=-1)),
        Wiring(
            accelerometer_a=Channel(input=6, sensitivity_mv_per_g=98.7, gain=10.0, polarity=-1),
            accelerometer_b=Channel(input=2, sensitivity_mv_per_g=101.3, gain=9.9),
            strain_gauge_input=4,
            strain_gauge_gain=3.0,
            input_range_v=10.0,
            sample_rate_hz=40000.0,
        ),
    ],
)
def test_over_the_wire_the_same_samples_come_as_from_the_simulated_recorder(wiring, errors):
    simulated, emulated = recorded(False, wiring, errors, 5), recorded(True, wiring, errors, 5)
    for one, other in zip(simulated[0], emulated[0], strict=True):
        assert np.array_equal(one.acceleration, other.acceleration)
        assert (one.strain_mv is None and other.strain_mv is None) or np.array_equal(one.strain_mv, other.strain_mv)
        assert (one.force is not None) is (wiring.hammer is not None)
        assert (one.force is None and other.force is None) or np.array_equal(one.force, other.force)
        assert (one.time, one.pretrigger, one.sample_rate_hz) == (other.time, other.pretrigger, other.sample_rate_hz)
    assert emulated[1] == pytest.approx(simulated[1], rel=1e-12)
    assert simulated[2] == emulated[2]  # where the rig was left, down to its random numbers


def test_an_accelerometer_the_other_way_round_than_declared_shows():
    true = Wiring(accelerometer_b=Channel(input=1, polarity=1))
    rig = SimulatedRig(RigSettings(wiring=true), SimBackendSettings(bad_taps=NONE_BAD), seed=1)
    rig.stage.move_by(149.0)
    rig.stage.advance(10.0, 0.1, lambda: rig.true_load_mn() >= 500.0)
    device = EmulatedUsb1608(rig.accelerometers.signal, rig.clock)
    driver = Usb1608(Wiring(), Usb1608Settings(), rig.clock, device.bus)
    driver.connect()
    driver.start()
    rig.impactor.tap(500.0)
    a, b = np.hstack([driver.read_block().acceleration for _ in range(30)])
    assert np.corrcoef(a, b)[0, 1] < -0.99


# --- faults of the wire


def test_a_quiet_wire_loses_nothing():
    stream = Streaming()
    blocks = [stream.read() for _ in range(300)]
    assert [b.first_sample for b in blocks] == [256 * i for i in range(300)]


@pytest.mark.parametrize("fault", ["short", "empty"])
def test_packets_cut_short_lose_nothing(fault):
    stream = Streaming()
    for i in range(20):
        stream.device.inject(fault)
        assert stream.read().first_sample == 256 * i


@pytest.mark.parametrize(
    "fault", ["overrun", "stall", "timeout", "hang", "truncated", "odd", "overflow", "stopped", "replug"]
)
def test_a_fault_costs_its_samples_and_not_the_stream(fault):
    stream = Streaming()
    before = stream.read()
    at = stream.clock.now()
    stream.device.inject(fault)
    after = stream.read()
    assert after.first_sample > before.first_sample + 256
    assert stream.clock.now() - at < 0.5
    assert stream.read().first_sample == after.first_sample + 256


def test_fetching_too_late_overruns_the_memory():
    stream = Streaming()
    stream.read()
    stream.clock.sleep(32768 / 3 / 25000 - 0.001)
    assert stream.read().first_sample == 256  # it was still in the FIFO
    stream.clock.sleep(0.5)
    block = stream.read()
    assert block.first_sample == round((stream.clock.now() - 256 / 25000) * 25000)
    assert 0x44 in stream.device.requests


def test_samples_left_from_the_scan_before_are_not_taken_for_new_ones():
    stream = Streaming()
    stream.read()
    stream.driver.stop()
    stream.clock.sleep(1.0)
    stream.driver.start()
    stream.origin = round(stream.clock.now() * 25000)
    stream.read()


def test_a_scan_left_running_by_a_killed_program_is_ended():
    stream = Streaming()
    stream.read()
    again = Usb1608(WIRING, Usb1608Settings(), stream.clock, stream.device.bus)
    again.connect()
    again.start()
    stream.driver, stream.origin = again, round(stream.clock.now() * 25000)
    assert stream.read().first_sample == 0


def test_the_cable_pulled_and_put_back_within_the_patience():
    stream = Streaming(reconnect_s=0.5)
    stream.read()
    now = stream.clock.now()
    stream.device.inject("unplug", now)
    stream.device.inject("plug", now + 0.3)
    block = stream.read()
    assert block.first_sample >= 0.3 * 25000
    assert stream.device.bus.opened == 1


def test_the_cable_pulled_for_good_is_told_within_half_a_second():
    stream = Streaming()
    stream.read()
    stream.device.inject("unplug")
    now = stream.clock.now()
    with pytest.raises(RigError, match="MCC USB-1608FS-Plus on usb 1:2: it is gone from the bus; check its cable"):
        stream.read()
    assert stream.clock.now() - now < 0.5
    stream.driver.stop()
    with pytest.raises(RigError, match="there is none on USB"):
        stream.driver.start()
    stream.device.bus.plug(stream.device)
    stream.driver.start()
    stream.origin = round(stream.clock.now() * 25000)
    stream.read()


def test_a_device_that_answers_nothing_is_told_within_half_a_second():
    stream = Streaming()
    stream.read()
    stream.device.inject("silent")
    now = stream.clock.now()
    with pytest.raises(RigError, match=r"did not answer .*; unplug it and plug it in again"):
        stream.read()
    assert stream.clock.now() - now <= 0.5
    stream.driver.stop()


def test_another_device_in_its_place_is_not_taken():
    stream = Streaming(serial_number="01D2E3F4")
    stream.read()
    stream.device.inject("swapped")
    with pytest.raises(RigError, match="none has serial number 01D2E3F4; found 01FFFFFF"):
        stream.read()


def test_each_foreign_answer_while_connecting_is_told():
    said = set()
    for seed in range(40):
        clock = VirtualClock()
        device = EmulatedUsb1608(CountingSource(clock, WIRING), clock, seed=seed)
        device.inject("foreign")
        with pytest.raises(RigError) as caught:
            Usb1608(WIRING, Usb1608Settings(), clock, device.bus).connect()
        said.add(str(caught.value).split(":")[0])
    assert said == {"recorder MCC USB-1608FS-Plus on usb 1"}


STREAM_FAULTS = sorted(set(Fault) - {Fault.SWAPPED, Fault.UNPLUG, Fault.PLUG, Fault.SILENT})


@given(st.lists(st.tuples(st.sampled_from(STREAM_FAULTS), st.floats(0.0, 2.0)), max_size=12))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_whatever_comes_together_no_sample_is_altered_or_joined(schedule):
    stream = Streaming()
    stream.slack += len(schedule)  # a gap is a sample at least, even where no time has passed
    for fault, at_s in schedule:
        stream.device.inject(fault, at_s)
    due = 0
    while stream.clock.now() < 2.5:
        try:
            block = stream.read()
        except RigError as error:
            assert "\n" not in str(error)
            stream.driver.start()
            stream.origin, due = round(stream.clock.now() * 25000), 0
            continue
        assert block.first_sample >= due
        due = block.first_sample + 256
    assert stream.read().first_sample == due


# --- records


class Tapping(Impactor):
    """Lets the counting source look like a tap: the trigger sees the jump where the count turns over."""

    def tap(self, load_mn: float, hint: str = "") -> None:
        pass


@given(st.floats(0.0, 3.0), st.sampled_from(["overrun", "stall", "timeout", "truncated", "odd", "replug"]))
@settings(max_examples=30, deadline=None, derandomize=True)
def test_a_record_is_unbroken_or_there_is_none(at_s, fault):
    stream = Streaming()
    stream.device.inject(fault, at_s)
    trigger = Trigger(threshold_m_s2=20.0, pretrigger_samples=300, record_samples=4000, timeout_s=5.0)
    try:
        record = record_impact(stream.driver, Tapping(), stream.clock, trigger, 500.0)
    except SamplesLost:
        return
    step = 5 / 32768 * 9.80665
    count = np.round(record.acceleration[0] / step) + TURNS // 2
    assert np.array_equal(np.diff(count) % TURNS, np.ones(3999))
    assert record.strain_mv is not None


def test_a_gap_in_the_record_costs_the_tap_and_the_next_one_is_recorded():
    stream = Streaming()
    trigger = Trigger(threshold_m_s2=20.0, pretrigger_samples=300, record_samples=4000, timeout_s=5.0)
    stream.device.inject("overrun", 60000 / 25000 - 0.1 + 0.11)
    with pytest.raises(NoTap, match="tap again"):
        record_impact(stream.driver, Tapping(), stream.clock, trigger, 500.0)
    assert record_impact(stream.driver, Tapping(), stream.clock, trigger, 500.0).acceleration.shape == (2, 4000)


# --- the device itself


def device_as_pyusb_sees_it(**options):
    clock = VirtualClock()
    emulated = EmulatedUsb1608(CountingSource(clock, WIRING), clock, **options)
    return usb.core.find(backend=emulated.bus, idVendor=0x09DB, idProduct=0x00EA), emulated, clock


def test_calibration_memory_reads_as_floats_of_range_and_input():
    table = calibration_table(SimulatedRecorder(gain_error_percent=1, offset_error_codes=30), 3)
    device, *_ = device_as_pyusb_sees_it(calibration=table)
    memory = bytes(device.ctrl_transfer(0xC0, 0x30, 0, 0, 768))
    assert len(memory) == 768
    assert struct.unpack_from("<ff", memory, (7 * 8 + 2) * 8) == tuple(map(float, table[7, 2]))
    assert bytes(device.ctrl_transfer(0xC0, 0x30, 40, 0, 8)) == memory[40:48]


@pytest.mark.parametrize("request_number", [0x50, 0x30, 0x31, 0x99])
def test_what_must_not_be_sent_is_refused(request_number):
    device, *_ = device_as_pyusb_sees_it()
    with pytest.raises(usb.core.USBError, match="Pipe"):
        device.ctrl_transfer(0x40, request_number, 0, 0, b"")


def test_ranges_are_refused_while_a_scan_runs():
    device, *_ = device_as_pyusb_sees_it()
    device.ctrl_transfer(0x40, 0x14, 0, 0, bytes(8))
    device.ctrl_transfer(0x40, 0x11, 0, 0, struct.pack("<IIBB", 0, 1599, 1, 0))
    with pytest.raises(usb.core.USBError, match="Pipe"):
        device.ctrl_transfer(0x40, 0x14, 0, 0, bytes(8))
    assert bytes(device.ctrl_transfer(0xC0, 0x44, 0, 0, 2)) == b"\x02\x00"


def test_reading_without_a_scan_takes_its_time_and_gets_nothing():
    device, _, clock = device_as_pyusb_sees_it()
    with pytest.raises(usb.core.USBTimeoutError):
        device.read(0x81, 512, 250)
    assert clock.now() == 0.25


def test_several_devices_on_one_bus():
    clock = VirtualClock()
    devices = [EmulatedUsb1608(CountingSource(clock, WIRING), clock, f"0000000{i}") for i in range(3)]
    bus = bus_of(devices)
    driver = Usb1608(WIRING, Usb1608Settings(serial_number="2"), clock, bus)
    assert "00000002" in driver.connect()
    devices[2].inject("replug")
    driver.start()
    assert driver.serial_number == "00000002"


def test_a_solenoid_on_a_line_is_switched_for_as_long_as_the_preload_asks():
    clock, seen = VirtualClock(), []
    source = CountingSource(clock, WIRING)
    device = EmulatedUsb1608(source, clock, on_line=lambda line, high: seen.append((line, high, clock.now())))
    driver = Usb1608(WIRING, Usb1608Settings(), clock, device.bus)
    driver.connect()
    SolenoidImpactor(driver, SolenoidSettings(line=3, pulse_ms=4.0, pulse_ms_per_n=2.0), clock).tap(500.0)
    assert [(line, high) for line, high, _ in seen] == [(3, True), (3, False)]
    assert seen[1][2] - seen[0][2] == pytest.approx(5e-3)
