"""Ports: bytes over a real pseudo-terminal and a real socket, and what is said when they fail."""

from __future__ import annotations

import tempfile

import pytest

from rig import DeviceError
from rig.drivers.transport import SerialTransport, TcpTransport
from sim_backend.emulators.ports import PtyPort, TcpPort


class Echo:
    """Sends back what it gets."""

    def receive(self, data: bytes) -> list[bytes]:
        return [data]

    def unasked(self) -> bytes:
        return b""


@pytest.fixture
def pty(tmp_path):
    port = PtyPort(Echo(), tmp_path / "ports" / "ttyX")
    port.plug()
    yield port
    port.unplug()


@pytest.fixture
def tcp():
    port = TcpPort(Echo())
    port.plug()
    yield port
    port.unplug()


def exchanged(wire, data: bytes) -> bytes:
    wire.write(data)
    got = b""
    while len(got) < len(data):
        got += wire.read(5.0)
    return got


ALL_BYTES = bytes(range(256))


def test_every_byte_passes_a_serial_port(pty):
    wire = SerialTransport("a device", str(pty.path), 921600)
    wire.open()
    assert exchanged(wire, ALL_BYTES) == ALL_BYTES
    assert wire.read(0.0) == b""
    wire.close()


def test_every_byte_passes_a_connection(tcp):
    wire = TcpTransport("a device", tcp.host, tcp.tcp_port)
    wire.open()
    assert exchanged(wire, ALL_BYTES) == ALL_BYTES
    assert wire.read(0.0) == b""
    wire.close()


def test_a_pulled_cable_is_told_and_put_back_it_works_again(pty):
    wire = SerialTransport("a device", str(pty.path), 9600)
    wire.open()
    pty.unplug()
    with pytest.raises(DeviceError, match=r"a device on .*ttyX: the connection is gone .*; put the cable back"):
        exchanged(wire, b"x")
    wire.close()
    with pytest.raises(DeviceError, match="there is no such port; plug the device in"):
        wire.open()
    pty.plug()
    wire.open()
    assert exchanged(wire, b"x") == b"x"
    wire.close()


def test_a_device_that_hangs_up_is_told(tcp):
    wire = TcpTransport("a device", tcp.host, tcp.tcp_port)
    wire.open()
    exchanged(wire, b"x")
    tcp.unplug()
    with pytest.raises(DeviceError, match=r"127\.0\.0\.1:\d+: the connection is gone \(the device closed it\)"):
        wire.read(5.0)
    wire.close()
    with pytest.raises(DeviceError, match=r"cannot be connected \(Connection refused\); check its power"):
        wire.open()


def test_one_program_at_a_time_has_a_connection(tcp):
    first, second = (TcpTransport("a device", tcp.host, tcp.tcp_port) for _ in range(2))
    first.open()
    with pytest.raises(DeviceError, match="another program uses it; close that program"):
        second.open()
    first.close()
    second.open()
    second.close()


def test_a_lock_that_cannot_be_had_is_told(tcp, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    wire = TcpTransport("a device", tcp.host, tcp.tcp_port)
    with pytest.raises(DeviceError, match=r"cannot be kept for this program \(.*No such file or directory\)"):
        wire.open()


@pytest.mark.parametrize("wire", [SerialTransport("d", "p", 9600), TcpTransport("d", "p", 1)], ids=["serial", "tcp"])
def test_a_port_that_was_never_opened_is_told(wire):
    with pytest.raises(DeviceError, match="the connection is gone"):
        wire.write(b"x")
    wire.close()
