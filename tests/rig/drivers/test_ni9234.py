"""The NI 9234 driver on a package that notes every call: what is asked of NI-DAQmx, and what is made of its errors."""

from __future__ import annotations

import enum
import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from daq.settings import Trigger
from daq.trigger import record_impact
from rig import DeviceError, Impactor, RigError
from rig.drivers.ni9234 import Ni9234, modules
from rig.drivers.recorder_settings import Ni9234Settings
from rig.settings import Channel, Hammer, Wiring
from sim_backend.clock import VirtualClock

OVERWRITTEN, NOT_YET, GONE = -200279, -200284, -201003


class DaqError(Exception):
    def __init__(self, text: str, error_code: int) -> None:
        super().__init__(text)
        self.error_code = error_code


class Constants:
    AccelUnits = enum.Enum("AccelUnits", "G METERS_PER_SECOND_SQUARED")
    AccelSensitivityUnits = enum.Enum("AccelSensitivityUnits", "MILLIVOLTS_PER_G")
    ExcitationSource = enum.Enum("ExcitationSource", "INTERNAL NONE")
    Coupling = enum.Enum("Coupling", "AC DC")
    AcquisitionType = enum.Enum("AcquisitionType", "CONTINUOUS FINITE")
    TaskMode = enum.Enum("TaskMode", "TASK_COMMIT")
    ForceUnits = enum.Enum("ForceUnits", "NEWTONS")
    ForceIEPESensorSensitivityUnits = enum.Enum("ForceIEPESensorSensitivityUnits", "MILLIVOLTS_PER_NEWTON")


class FakeDaqmx:
    """A package with one module in one chassis; ``errors_to_come`` are raised by the next reads, None is a good one."""

    constants = Constants
    errors = SimpleNamespace(Error=Exception)

    def __init__(self, clock: VirtualClock, product: str = "NI 9234") -> None:
        self.clock = clock
        self.product = product
        self.calls: list[tuple] = []
        self.channels: list[SimpleNamespace] = []
        self.errors_to_come: list[Exception | None] = []
        self.refuse: dict[str, Exception] = {}
        self.rate = 25600.0
        self.system = SimpleNamespace(Device=self._device, System=SimpleNamespace(local=self._local))
        self.stream_readers = SimpleNamespace(AnalogMultiChannelReader=lambda stream: self)
        self.sample = 0

    def _device(self, name: str) -> SimpleNamespace:
        self._note("device", name)
        return SimpleNamespace(product_type=self.product)

    def _local(self) -> SimpleNamespace:
        self._note("local")
        return SimpleNamespace(devices=[SimpleNamespace(name="cDAQ1Mod1", product_type=self.product)])

    def _note(self, what: str, *more) -> None:
        self.calls.append((what, *more))
        if what in self.refuse:
            raise self.refuse[what]

    def Task(self) -> SimpleNamespace:  # noqa: N802
        self._note("task")
        timing = SimpleNamespace(
            cfg_samp_clk_timing=lambda rate, sample_mode, samps_per_chan: self._note("timing", rate, sample_mode.name),
            samp_clk_rate=self.rate,
        )
        ai = SimpleNamespace(
            add_ai_accel_chan=lambda channel, **more: self._channel("accel", channel, more),
            add_ai_voltage_chan=lambda channel, **more: self._channel("voltage", channel, more),
            add_ai_force_iepe_chan=lambda channel, **more: self._channel("force", channel, more),
        )
        return SimpleNamespace(
            ai_channels=ai,
            timing=timing,
            in_stream=None,
            control=lambda mode: self._note("control", mode.name),
            start=lambda: self._note("start"),
            stop=lambda: self._note("stop"),
            close=lambda: self._note("close"),
        )

    def _channel(self, kind: str, name: str, more: dict) -> SimpleNamespace:
        self._note(kind, name)
        self.channels.append(SimpleNamespace(kind=kind, name=name, **more))
        return self.channels[-1]

    def read_many_sample(self, data, number_of_samples_per_channel, timeout) -> int:
        if self.errors_to_come:
            error = self.errors_to_come.pop(0)
            if error is not None:
                self.clock.sleep(timeout)
                raise error
        n = number_of_samples_per_channel
        data[:] = self.sample + np.arange(n) + 1000 * np.arange(len(data))[:, None]
        self.sample += n
        self.clock.sleep(n / self.rate)
        return n


WIRED = Wiring(
    accelerometer_a=Channel(input=0, gain=1.0),
    accelerometer_b=Channel(input=1, gain=1.0, sensitivity_mv_per_g=50.0, polarity=-1),
    strain_gauge_input=3,
    strain_gauge_gain=100.0,
    bits=24,
)


def connected(wiring: Wiring = WIRED, **settings) -> tuple[Ni9234, FakeDaqmx]:
    clock = VirtualClock()
    fake = FakeDaqmx(clock)
    driver = Ni9234(wiring, Ni9234Settings(**settings), clock, fake)
    driver.connect()
    return driver, fake


def test_what_is_asked_of_the_package():
    driver, fake = connected()
    assert fake.calls == [
        ("device", "cDAQ1Mod1"),
        ("task",),
        ("accel", "cDAQ1Mod1/ai0"),
        ("accel", "cDAQ1Mod1/ai1"),
        ("voltage", "cDAQ1Mod1/ai3"),
        ("timing", 25000.0, "CONTINUOUS"),
        ("control", "TASK_COMMIT"),
    ]
    a, b, strain = fake.channels
    assert (a.sensitivity, b.sensitivity) == (100.0, 50.0)
    assert a.units is Constants.AccelUnits.METERS_PER_SECOND_SQUARED
    assert b.max_val == pytest.approx(100 * 9.80665)
    assert (a.current_excit_source.name, a.current_excit_val, a.ai_coupling.name) == ("INTERNAL", 0.002, "AC")
    assert strain.ai_coupling.name == "DC"
    assert fake.clock.now() == 5.0  # the accelerometers settle
    driver.close()
    driver.close()
    assert fake.calls[-1] == ("close",)


def test_a_hammer_is_fed_and_read_in_newtons():
    hammer = Hammer(input=2, gain=1.0, polarity=-1)
    driver, fake = connected(WIRED.model_copy(update={"hammer": hammer}))
    asked = fake.channels[-1]
    assert (asked.kind, asked.name, asked.sensitivity) == ("force", "cDAQ1Mod1/ai2", 22.5)
    assert asked.units is Constants.ForceUnits.NEWTONS
    assert asked.max_val == pytest.approx(5 / 22.5e-3)
    assert (asked.current_excit_source.name, asked.ai_coupling.name) == ("INTERNAL", "AC")
    driver.start()
    block = driver.read_block()
    assert block.force is not None
    assert block.force[0] == -3000.0  # the fake's fourth channel, turned
    assert block.strain_mv is not None
    assert block.strain_mv[0] == 2000.0 * 10


def test_a_hammer_behind_a_conditioner_is_refused_where_the_module_feeds_it():
    with pytest.raises(RigError, match=r"hammer\.gain"):
        Ni9234(WIRED.model_copy(update={"hammer": Hammer(input=2)}), Ni9234Settings(), VirtualClock(), object())


def test_behind_a_conditioner_nothing_is_fed():
    wiring = WIRED.model_copy(update={"accelerometer_a": Channel(input=0, gain=10.0)})
    _, fake = connected(wiring, iepe=False)
    assert fake.channels[0].sensitivity == 1000.0
    assert (fake.channels[0].current_excit_source.name, fake.channels[0].current_excit_val) == ("NONE", 0.0)
    assert fake.clock.now() == 0.0


def test_the_actual_rate_reaches_the_record():
    both_alike = WIRED.model_copy(update={"accelerometer_b": Channel(input=1, gain=1.0)})
    driver, fake = connected(both_alike)
    assert driver.sample_rate_hz == 25600.0

    class Nobody(Impactor):
        def tap(self, load_mn: float, hint: str = "") -> None:
            pass

    trigger = Trigger(threshold_m_s2=1e-3, pretrigger_samples=256, record_samples=1024)
    record = record_impact(driver, Nobody(), fake.clock, trigger, 500.0)
    assert record.sample_rate_hz == 25600.0


@pytest.mark.parametrize(
    ("asked", "nearest"), [(25000.0, 25600.0), (25600.0, 25600.0), (51200.0, 51200.0), (17000.0, 51200 / 3)]
)
def test_the_rate_before_connecting_is_the_next_one_above(asked, nearest):
    wiring = WIRED.model_copy(update={"sample_rate_hz": asked})
    assert Ni9234(wiring, Ni9234Settings(), VirtualClock(), object()).sample_rate_hz == pytest.approx(nearest)


def test_units_and_polarity():
    driver, _ = connected()
    driver.start()
    block = driver.read_block()
    assert block.acceleration[0] == pytest.approx(np.arange(256))
    assert block.acceleration[1] == pytest.approx(-1000.0 - np.arange(256))
    assert block.strain_mv == pytest.approx((2000.0 + np.arange(256)) * 10.0)
    assert block.first_sample == 0
    assert driver.read_block().first_sample == 256


@pytest.mark.parametrize("code", [OVERWRITTEN, NOT_YET, -200222, -200361, -200714])
def test_what_can_be_mended_leaves_a_gap_by_the_clock(code):
    driver, fake = connected()
    driver.start()
    driver.read_block()
    fake.clock.sleep(1.0)
    fake.errors_to_come = [DaqError("x", code)]
    first = driver.read_block().first_sample
    assert first == round((fake.clock.now() - 5.0 - 256 / 25600) * 25600)
    assert fake.calls[-2:] == [("stop",), ("start",)]


@pytest.mark.parametrize(
    ("code", "said"),
    [(OVERWRITTEN, "overwritten again and again; close other programs"), (NOT_YET, "cDAQ1Mod1: it sends nothing")],
)
def test_what_comes_again_and_again_is_given_up_within_half_a_second(code, said):
    driver, fake = connected()
    driver.start()
    fake.errors_to_come = [DaqError("x", code)] * 4
    before = fake.clock.now()
    with pytest.raises(DeviceError, match=said):
        driver.read_block()
    assert fake.clock.now() - before < 0.5
    assert not fake.errors_to_come


def test_a_module_that_is_gone_is_told_and_found_again_at_the_next_start():
    driver, fake = connected()
    driver.start()
    fake.errors_to_come = [DaqError("Device cannot be accessed.\nDevice: cDAQ1Mod1", GONE)]
    with pytest.raises(DeviceError, match=r"refuses \(Device cannot be accessed\); look at the module in NI MAX$"):
        driver.read_block()
    fake.refuse = {"device": DaqError("Device identifier is invalid.", -200220)}
    with pytest.raises(DeviceError, match="Device identifier is invalid"):
        driver.start()
    fake.refuse = {}
    driver.start()
    assert driver.read_block().first_sample == 0


def test_stopping_never_fails():
    driver, fake = connected()
    driver.start()
    fake.refuse = {"stop": DaqError("gone", GONE), "close": DaqError("gone", GONE)}
    driver.stop()
    driver.stop()
    driver.close()


def test_another_module_is_refused():
    clock = VirtualClock()
    driver = Ni9234(WIRED, Ni9234Settings(), clock, FakeDaqmx(clock, "NI 9215"))
    with pytest.raises(DeviceError, match="cDAQ1Mod1: it is a NI 9215; name another module"):
        driver.connect()


def test_an_error_without_a_word_is_still_a_sentence():
    clock = VirtualClock()
    fake = FakeDaqmx(clock)
    fake.refuse = {"task": DaqError("", -1)}
    with pytest.raises(DeviceError, match=r"refuses \(no reason given\)"):
        Ni9234(WIRED, Ni9234Settings(), clock, fake).connect()


def test_reading_before_starting_is_told():
    with pytest.raises(RigError, match="does not stream"):
        connected()[0].read_block()


def test_the_modules_that_are_there_are_listed():
    fake = FakeDaqmx(VirtualClock())
    assert modules(fake) == [("cDAQ1Mod1", "NI 9234")]
    fake.refuse["local"] = DaqError("Could not find an installation of NI-DAQmx. Please ensure.", -1)
    with pytest.raises(RigError, match=r"NI-DAQmx: Could not find an installation .*; install NI's driver"):
        modules(fake)


def test_without_the_package_it_says_how_to_get_it(monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr("rig.drivers.ni9234.importlib.import_module", missing)
    with pytest.raises(RigError, match=r"nidaqmx is not installed; pip install 'mesotap\[ni\]'"):
        Ni9234(WIRED, Ni9234Settings(), VirtualClock()).connect()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"bits": 16}, "has 24 bits, not 16"),
        ({"input_range_v": 10.0}, "rig.wiring.input_range_v: the NI 9234 has ±5 V, not ±10"),
        ({"strain_gauge_input": 4}, "no input 4; its inputs are 0 to 3"),
        ({"sample_rate_hz": 60000.0}, "60000 Hz is not possible"),
        (
            {"accelerometer_b": Channel(input=1, gain=10.0)},
            "rig.wiring.accelerometer_b.gain: 10, but .* give 1, or iepe",
        ),
    ],
)
def test_wiring_that_the_recorder_does_not_have_is_refused(change, said):
    with pytest.raises(RigError, match=said):
        Ni9234(WIRED.model_copy(update=change), Ni9234Settings(), VirtualClock(), object())


def test_the_real_package_takes_these_calls():
    """Where NI's package is installed, its signatures have to fit what the fake accepts."""
    nidaqmx = pytest.importorskip("nidaqmx")
    from nidaqmx import constants, errors, stream_readers, system
    from nidaqmx.task.collections import AIChannelCollection

    accel = inspect.signature(AIChannelCollection.add_ai_accel_chan)
    names = [
        "min_val",
        "max_val",
        "units",
        "sensitivity",
        "sensitivity_units",
        "current_excit_source",
        "current_excit_val",
    ]
    accel.bind(None, "Dev1/ai0", **dict.fromkeys(names))
    inspect.signature(AIChannelCollection.add_ai_force_iepe_chan).bind(None, "Dev1/ai2", **dict.fromkeys(names))
    inspect.signature(AIChannelCollection.add_ai_voltage_chan).bind(None, "Dev1/ai3", min_val=0, max_val=1)
    inspect.signature(stream_readers.AnalogMultiChannelReader.read_many_sample).bind(None, None, 256, 0.1)
    for kind in (
        "ForceUnits",
        "ForceIEPESensorSensitivityUnits",
        "AccelUnits",
        "AccelSensitivityUnits",
        "ExcitationSource",
        "Coupling",
        "AcquisitionType",
        "TaskMode",
    ):
        for name in getattr(Constants, kind).__members__:
            assert hasattr(getattr(constants, kind), name)
    assert issubclass(nidaqmx.DaqError, errors.Error)
    assert hasattr(system.Device, "product_type")
