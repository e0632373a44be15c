"""A strain-gauge indicator that answers ``?`` with a line such as ``+0.3371 mV``."""

import os
import pty
import statistics
import threading
from contextlib import contextmanager, suppress
from typing import Literal

from rig import DeviceError, LoadCell, LoadReading
from rig.drivers.driver import Driver
from rig.drivers.plugins import DriverPlugin
from rig.drivers.transport import SerialTransport
from rig.section import Section

REPLY_S = 0.2


class LineGaugeSettings(Section):  # what may stand below rig.parts.load_cell
    driver: Literal["line-gauge"]
    port: str
    baud_rate: int = 9600


class LineGauge(LoadCell, Driver):
    def __init__(self, settings, around):
        self.name = f"line gauge on {settings.port}"
        self._clock = around.clock
        self._wire = around.recorded(SerialTransport("line gauge", settings.port, settings.baud_rate))

    def connect(self):
        self._wire.open()
        return f"{self.name}: answers, {self._ask():.4g} mV"

    def close(self):
        self._wire.close()

    def read(self, duration_s=0.1):
        end, values = self._clock.now() + duration_s, []
        while len(values) < 2 or self._clock.now() < end:
            self.idle()  # the operator may want to end the session
            taken = self._clock.now()  # before it is asked for: what is read is not older
            values.append(self._ask())
        return LoadReading(taken, statistics.fmean(values), statistics.stdev(values), len(values))

    def _ask(self):
        reply = b""
        with self._wire.lock:
            self._wire.discard()
            self._wire.write(b"?\r")
            while not reply.endswith(b"\n") and (more := self._wire.read(REPLY_S)):
                reply += more
        try:
            return float(reply.removesuffix(b" mV\r\n"))
        except ValueError:
            said = f"it answers {reply[:40]!r}, which is no voltage"
            raise DeviceError("line gauge", self._wire.port, said, "check its power, its cable and baud_rate") from None


@contextmanager
def stand_in(around):  # what the driver is tried at by 'mesotap drivers --check'
    ours, theirs = pty.openpty()

    def answer():
        with suppress(OSError):
            while count := len(os.read(ours, 64)):
                os.write(ours, b"%+.4f mV\r\n" % (0.35 + 1e-4 * count))

    threading.Thread(target=answer, daemon=True).start()
    yield {"port": os.ttyname(theirs)}
    os.close(theirs)
    os.close(ours)


DRIVER = DriverPlugin("line-gauge", "load_cell", LineGaugeSettings, LineGauge, {"port": "/dev/ttyUSB0"}, stand_in)
