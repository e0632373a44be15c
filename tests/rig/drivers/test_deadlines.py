"""Every dialogue ends, whatever a device sends: one that floods the wire, babbles, or trickles."""

from __future__ import annotations

import contextlib
import socket
import threading

import pytest

from rig import DeviceError
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.modbus import ModbusDevice
from rig.drivers.newport import NewportAxis
from rig.drivers.reply_time import ReplyTime
from rig.drivers.settings import AmplifierTcp
from rig.drivers.transport import LARGEST_LEFTOVER, SETTLING_S, TcpTransport, Transport, settle
from rig.wall_clock import WallClock
from sim_backend.clock import VirtualClock

TRIES, TIMEOUT_S = 3, 0.1
LONGEST_S = 1.0  # of rig time: three tries of a time-out, twice that for what is still read, and falling quiet


class Flooding(Transport):
    """A device that sends the same again and again, whether it is asked or not."""

    def __init__(self, chunk: bytes, every_s: float, unasked: bool) -> None:
        super().__init__("a device", "/dev/ttyX")
        self.clock = VirtualClock()
        self._chunk, self._every_s, self._unasked = chunk, every_s, unasked

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        self.clock.sleep(1e-4)

    def read(self, timeout_s: float) -> bytes:
        if timeout_s == 0.0:
            return self._chunk if self._unasked else b""
        self.clock.sleep(self._every_s)
        return self._chunk


CHUNKS = {
    "noise": b"\xaa" * 500,
    "lines": b"2TS000033\r\n" * 4,
    "frames": bytes([1, 3, 2, 0, 0, 9, 9]) * 70,
    "drip": b"x",
}


@pytest.mark.parametrize("unasked", [True, False], ids=["always", "when asked"])
@pytest.mark.parametrize("every_s", [1e-4, 0.01])
@pytest.mark.parametrize("chunk", CHUNKS.values(), ids=CHUNKS)
@pytest.mark.parametrize("ask", ["rtu", "tcp", "newport"])
def test_a_device_that_never_falls_silent_is_left(ask, chunk, every_s, unasked):
    wire = Flooding(chunk, every_s, unasked)
    with pytest.raises(DeviceError, match="a device on /dev/ttyX: "):
        if ask == "newport":
            NewportAxis(wire, 1, wire.clock, TIMEOUT_S, TRIES).status()
        else:
            ModbusDevice(wire, ask, 1, wire.clock, TIMEOUT_S, TRIES).read("holding", 77, 2)
    assert wire.clock.now() < LONGEST_S


def test_what_comes_unasked_without_end_is_told():
    wire = Flooding(b"x" * 4096, 1e-4, True)
    with pytest.raises(DeviceError, match="it sends without being asked, and without end"):
        wire.discard()


def test_a_line_that_does_not_fall_quiet_is_not_waited_for():
    wire = Flooding(b"x", 0.01, False)
    assert len(settle(wire, wire.clock, 0.02)) <= LARGEST_LEFTOVER
    assert wire.clock.now() == pytest.approx(SETTLING_S, abs=0.02)


def test_a_flooding_peer_on_ethernet_is_left():
    """A real socket whose other end writes as fast as it can."""
    listener = socket.create_server(("127.0.0.1", 0))

    def flood() -> None:
        connection, _ = listener.accept()
        with connection, contextlib.suppress(OSError):
            while True:
                connection.sendall(b"\x55" * 65536)

    thread = threading.Thread(target=flood, daemon=True)
    thread.start()
    host, port = listener.getsockname()
    settings = AmplifierTcp(driver="modbus-tcp", preset="seneca-ze-sg3", host=host, tcp_port=port)
    gauge = ModbusLoadCell(TcpTransport("an amplifier", host, port), "tcp", settings, WallClock())
    try:
        with pytest.raises(DeviceError, match=r"an amplifier on 127\.0\.0\.1"):
            gauge.connect()
    finally:
        gauge.close()
        listener.close()
        thread.join()


@pytest.mark.parametrize(("round_trip_s", "limit_s"), [(0.0, 0.06), (0.016, 0.06), (0.05, 0.065), (0.2, 0.23)])
def test_a_reply_is_waited_for_as_long_as_the_wire_asks_for(round_trip_s, limit_s):
    time = ReplyTime(None)
    for _ in range(5):
        assert time.limit_s == 0.5
        time.learn(round_trip_s)
    assert time.limit_s == pytest.approx(limit_s)


def test_one_reply_that_was_lost_does_not_count():
    time = ReplyTime(None)
    for took_s in (0.016, 0.3, 0.016, 0.017, 0.016):
        time.learn(took_s)
    assert time.round_trip_s == 0.017


def test_a_time_that_was_given_is_kept():
    time = ReplyTime(0.3)
    for _ in range(6):
        time.learn(0.05)
    assert (time.limit_s, time.round_trip_s) == (0.3, 0.05)
