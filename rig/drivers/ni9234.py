"""The NI 9234 as the recorder of a tester, through NI-DAQmx (``pip install mesotap[ni]``, and NI's own driver).

Four inputs of ±5 V and 24 bits, IEPE supply built in. Its rates are 51.2 kHz over whole numbers: where 25 kHz are
asked for it gives 25.6, and every record says so.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from typing import Any

import numpy as np

from rig.drivers.driver import Driver
from rig.drivers.recorder_settings import Ni9234Settings
from rig.errors import DeviceError, RigError
from rig.interface import Accelerometers, Clock
from rig.readings import Block
from rig.settings import STANDARD_GRAVITY, Wiring

NAME = "NI 9234"
INPUTS, RANGE_V, BITS = 4, 5.0, 24
BASE_RATE_HZ = 51200.0
LARGEST_DIVISOR = 31
IEPE_A = 0.002

BLOCK_SAMPLES = 256
BUFFER_S = 4.0
"""Samples that NI-DAQmx keeps for this program before it calls that an overrun."""

READ_MARGIN_S = 0.1
MOST_RESTARTS = 3

OVERRUNS = {-200279, -200222, -200613, -200361, -200714}
"""NI-DAQmx: samples were overwritten, or acquisition stopped so that they would not be; the module's memory ran over
(-200361), or its driver could not fetch in time (-200714). Names: nidaqmx ``error_codes.py``, DAQmxErrors
SAMPLES_NO_LONGER_AVAILABLE, ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE and ..._ONE_DATA_XFER_MECH,
INPUT_FIFO_OVERFLOW_2, ACQ_STOPPED_DRIVER_CANT_XFER_DATA_FAST_ENOUGH."""

TIMED_OUT = {-200284}
"""NI-DAQmx: the samples have not come yet (SAMPLES_NOT_YET_AVAILABLE)."""


class Ni9234(Accelerometers, Driver):
    """Recorder of accelerometers A and B, and of the strain gauge if that is wired to it.

    Parameters
    ----------
    wiring
        Section ``rig.wiring``.
    settings
        Which module, and whether it feeds the accelerometers.
    clock
        Rig time; tells how many samples a gap has lost.
    nidaqmx
        The package; None imports it when connecting.

    Attributes
    ----------
    sample_rate_hz
        The module's rate nearest above the one asked for; once connected what NI-DAQmx says, Hz.

    Raises
    ------
    RigError
        The wiring asks for something that this recorder does not have.
    """

    bits = BITS

    def __init__(self, wiring: Wiring, settings: Ni9234Settings, clock: Clock, nidaqmx: Any = None) -> None:
        _check_wiring(wiring, settings)
        self.full_scale_m_s2 = wiring.full_scale_m_s2()
        self._asked_hz = wiring.sample_rate_hz
        self.sample_rate_hz = BASE_RATE_HZ / min(LARGEST_DIVISOR, math.floor(BASE_RATE_HZ / self._asked_hz))
        self._wiring = wiring
        self._settings = settings
        self._clock = clock
        self._ni = nidaqmx
        self._task: Any = None
        self._reader: Any = None
        self._running = False
        self._started_s = 0.0
        self._next = 0

    def connect(self) -> str:
        """Make the task, feed the accelerometers, and return a line that says what answered.

        Raises
        ------
        RigError
            NI-DAQmx is not installed, there is no such module, or it is another one.
        """
        self._attach()
        fed = f"fed with {IEPE_A * 1e3:g} mA" if self._settings.iepe else "not fed"
        return (
            f"recorder {NAME} {self._settings.module}: {self.sample_rate_hz:g} Hz, accelerometers {fed}, "
            f"full scale {self.full_scale_m_s2:.1f} m/s2"
        )

    def close(self) -> None:
        """End the task; harmless when called twice."""
        self.stop()
        self._detach()

    def start(self) -> None:
        """Begin to stream; after a failure the task is made anew.

        Raises
        ------
        RigError
            It does not start.
        """
        self.stop()
        if self._task is None:
            self._attach()
        self._call(self._task.start)
        self._started_s = self._clock.now()
        self._next = 0
        self._running = True

    def read_block(self) -> Block:
        """Return the next 256 samples, waiting for them; a gap in ``first_sample`` for samples that were lost.

        Raises
        ------
        RigError
            Not started, or the module could not be brought to stream again.
        """
        if not self._running:
            raise RigError(f"recorder {NAME}: it does not stream; start it before blocks are read")
        values = np.empty((len(self._wiring.inputs()), BLOCK_SAMPLES))
        fault: Exception | None = None
        for _ in range(MOST_RESTARTS + 1):
            try:
                if fault is not None:
                    self._restart()
                timeout_s = BLOCK_SAMPLES / self.sample_rate_hz + READ_MARGIN_S
                self._reader.read_many_sample(values, BLOCK_SAMPLES, timeout_s)
            except self._ni.errors.Error as error:
                fault = error
                if _code(error) not in OVERRUNS | TIMED_OUT:
                    break
            else:
                first = self._next
                self._next += BLOCK_SAMPLES
                polarity = [[self._wiring.accelerometer_a.polarity], [self._wiring.accelerometer_b.polarity]]
                strain, force = self._wiring.sorted_out(list(values))
                if strain is not None:
                    strain = strain * (1e3 / self._wiring.strain_gauge_gain)
                if force is not None and self._wiring.hammer is not None:
                    force = force * self._wiring.hammer.polarity
                return Block(first, values[:2] * polarity, strain, force)
        self._running = False
        self._detach()
        raise self._told(fault)

    def stop(self) -> None:
        """End the stream; harmless when it does not run, or when the module is gone."""
        if self._running and self._task is not None:
            try:
                self._task.stop()
            except self._ni.errors.Error:
                self._detach()  # start() makes a new task
        self._running = False

    def _restart(self) -> None:
        self._task.stop()
        self._task.start()
        since = self._clock.now() - self._started_s
        self._next = max(self._next + 1, round(since * self.sample_rate_hz))

    def _attach(self) -> None:
        self._ni = self._ni or _nidaqmx()
        self._call(self._make_task)
        if self._settings.iepe:
            self._clock.sleep(self._settings.settle_s)

    def _make_task(self) -> None:
        ni, module = self._ni, self._settings.module
        kind = str(ni.system.Device(module).product_type)
        if "9234" not in kind:
            raise DeviceError(f"recorder {NAME}", module, f"it is a {kind}", "name another module in rig.parts")
        self._detach()
        self._task = ni.Task()
        wiring, constants = self._wiring, ni.constants
        excitation = constants.ExcitationSource.INTERNAL if self._settings.iepe else constants.ExcitationSource.NONE
        for channel in (wiring.accelerometer_a, wiring.accelerometer_b):
            millivolts_per_g = channel.sensitivity_mv_per_g * channel.gain
            reach = RANGE_V / (millivolts_per_g * 1e-3) * STANDARD_GRAVITY
            added = self._task.ai_channels.add_ai_accel_chan(
                f"{module}/ai{channel.input}",
                min_val=-reach,
                max_val=reach,
                units=constants.AccelUnits.METERS_PER_SECOND_SQUARED,
                sensitivity=millivolts_per_g,
                sensitivity_units=constants.AccelSensitivityUnits.MILLIVOLTS_PER_G,
                current_excit_source=excitation,
                current_excit_val=IEPE_A if self._settings.iepe else 0.0,
            )
            added.ai_coupling = constants.Coupling.AC
        if wiring.strain_gauge_input is not None:
            added = self._task.ai_channels.add_ai_voltage_chan(
                f"{module}/ai{wiring.strain_gauge_input}", min_val=-RANGE_V, max_val=RANGE_V
            )
            added.ai_coupling = constants.Coupling.DC
        if wiring.hammer is not None:
            millivolts_per_n = wiring.hammer.sensitivity_mv_per_n * wiring.hammer.gain
            added = self._task.ai_channels.add_ai_force_iepe_chan(
                f"{module}/ai{wiring.hammer.input}",
                min_val=-RANGE_V / (millivolts_per_n * 1e-3),
                max_val=RANGE_V / (millivolts_per_n * 1e-3),
                units=constants.ForceUnits.NEWTONS,
                sensitivity=millivolts_per_n,
                sensitivity_units=constants.ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON,
                current_excit_source=excitation,
                current_excit_val=IEPE_A if self._settings.iepe else 0.0,
            )
            added.ai_coupling = constants.Coupling.AC
        timing = self._task.timing
        timing.cfg_samp_clk_timing(
            self._asked_hz,
            sample_mode=constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=round(BUFFER_S * self.sample_rate_hz),
        )
        self.sample_rate_hz = float(timing.samp_clk_rate)
        self._reader = ni.stream_readers.AnalogMultiChannelReader(self._task.in_stream)
        # committed, the task feeds the accelerometers between recordings too, so that they need not settle each time
        self._task.control(constants.TaskMode.TASK_COMMIT)

    def _detach(self) -> None:
        if self._task is not None:
            task, self._task = self._task, None
            try:
                task.close()
            except self._ni.errors.Error:
                return  # the module is gone: NI-DAQmx has ended the task already

    def _call(self, action: Any) -> None:
        try:
            action()
        except self._ni.errors.Error as error:
            self._detach()
            raise self._told(error) from error
        except DeviceError:
            self._detach()
            raise

    def _told(self, error: Exception | None) -> DeviceError:
        code = _code(error)
        if code in OVERRUNS:
            what, check = "samples were overwritten again and again", "close other programs"
        elif code in TIMED_OUT:
            what, check = "it sends nothing", "look at the chassis in NI MAX, unplug it and plug it in again"
        else:
            what, check = f"NI-DAQmx refuses ({_reason(error)})", "look at the module in NI MAX"
        return DeviceError(f"recorder {NAME}", self._settings.module, what, check)


def modules(nidaqmx: Any = None) -> list[tuple[str, str]]:
    """Return name and kind of every NI module that NI-DAQmx knows; none where its package is not installed.

    Raises
    ------
    RigError
        The package is there, and NI's driver under it is not or fails.
    """
    if nidaqmx is None and importlib.util.find_spec("nidaqmx") is None:
        return []
    ni = nidaqmx or _nidaqmx()
    try:
        return [(str(device.name), str(device.product_type)) for device in ni.system.System.local().devices]
    except ni.errors.Error as error:
        raise RigError(f"NI-DAQmx: {_reason(error)}; install NI's driver, or look at NI MAX") from error


def _reason(error: Exception | None) -> str:
    """First line of what NI-DAQmx says, without its full stop."""
    said = str(error).strip()
    return said.splitlines()[0][:200].rstrip(".") if said else "no reason given"


def _code(error: Exception | None) -> int | None:
    return getattr(error, "error_code", None)


def _nidaqmx() -> Any:
    """Return the package with all of its parts that are used here."""
    try:
        for part in ("constants", "errors", "stream_readers", "system"):
            importlib.import_module(f"nidaqmx.{part}")
        return importlib.import_module("nidaqmx")
    except ImportError as error:
        raise RigError(
            f"recorder {NAME}: the package nidaqmx is not installed; pip install 'mesotap[ni]', and NI's own driver"
        ) from error


def _check_wiring(wiring: Wiring, settings: Ni9234Settings) -> None:
    if wiring.input_range_v != RANGE_V:
        raise RigError(f"rig.wiring.input_range_v: the {NAME} has ±{RANGE_V:g} V, not ±{wiring.input_range_v:g}")
    if max(wiring.inputs()) >= INPUTS:
        raise RigError(f"rig.wiring: the {NAME} has no input {max(wiring.inputs())}; its inputs are 0 to 3")
    if wiring.bits != BITS:
        raise RigError(f"rig.wiring.bits: the {NAME} has {BITS} bits, not {wiring.bits}")
    if wiring.sample_rate_hz > BASE_RATE_HZ:
        raise RigError(
            f"rig.wiring.sample_rate_hz: {wiring.sample_rate_hz:g} Hz is not possible with the {NAME}, "
            f"at most {BASE_RATE_HZ:g}"
        )
    if wiring.hammer is not None and wiring.hammer.range_v != RANGE_V:
        raise RigError(f"rig.wiring.hammer.range_v: the {NAME} has ±{RANGE_V:g} V, not ±{wiring.hammer.range_v:g}")
    for name in ("accelerometer_a", "accelerometer_b", "hammer"):
        sensor = getattr(wiring, name)
        if settings.iepe and sensor is not None and sensor.gain != 1.0:
            raise RigError(
                f"rig.wiring.{name}.gain: {sensor.gain:g}, but the {NAME} feeds the sensors itself, without a "
                "conditioner; give 1, or iepe: false"
            )
