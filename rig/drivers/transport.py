"""Transports: bytes to and from one port that nobody else uses meanwhile."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import socket
import tempfile
import threading
from abc import ABC, abstractmethod
from pathlib import Path

import serial

from rig.errors import DeviceError
from rig.interface import Clock

PARITIES = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}
LARGEST_READ = 4096
CONNECT_S = 3.0
LARGEST_LEFTOVER = 65536  # bytes; more that nobody asked for is not a late reply
SETTLING_S = 0.1  # in which a line has to fall quiet


class Transport(ABC):
    """A port and the device behind it.

    Attributes
    ----------
    device
        What is connected, in the operator's words, for errors.
    port
        Where.
    lock
        Held over a request and its reply, which belong together.
    """

    def __init__(self, device: str, port: str) -> None:
        self.device = device
        self.port = port
        self.lock = threading.RLock()

    @abstractmethod
    def open(self) -> None:
        """Take the port for this program alone; harmless when it is open. `DeviceError` if that cannot be."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the port; harmless when it is closed."""

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send; `DeviceError` if the port is gone."""

    @abstractmethod
    def read(self, timeout_s: float) -> bytes:
        """Return what has come, waiting for the first byte at most ``timeout_s``; empty if nothing came."""

    def fileno(self) -> int | None:
        """Return the descriptor of the open port, for whoever takes it over; None if it has none."""
        return None

    def discard(self) -> bytes:
        """Read away what has come unasked, such as what is left of an earlier reply; returns it.

        Raises
        ------
        DeviceError
            It does not end.
        """
        unasked = b""
        while data := self.read(0.0):
            unasked += data
            if len(unasked) > LARGEST_LEFTOVER:
                raise self.babbling()
        return unasked

    def babbling(self) -> DeviceError:
        """Return the error for a device that sends and sends."""
        return DeviceError(
            self.device,
            self.port,
            "it sends without being asked, and without end",
            "check which device is connected there, and its speed",
        )

    def gone(self, why: object = "") -> DeviceError:
        """Return the error for a port that was there and is no longer."""
        reason = f" ({why})" if str(why) else ""
        return DeviceError(
            self.device,
            self.port,
            f"the connection is gone{reason}",
            "put the cable back, look whether the device has power, then resume",
        )


class SerialTransport(Transport):
    """A serial port, 8 data bits.

    Parameters
    ----------
    device, port
        What and where.
    baud_rate
        Bits per second.
    parity, stop_bits
        ``none``, ``even`` or ``odd``; 1 or 2.
    """

    def __init__(self, device: str, port: str, baud_rate: int, parity: str = "none", stop_bits: int = 1) -> None:
        super().__init__(device, port)
        self._settings = {"baudrate": baud_rate, "parity": PARITIES[parity], "stopbits": stop_bits}
        self._serial: serial.Serial | None = None

    def open(self) -> None:
        """Open and lock the port; `DeviceError` says whether it is missing, forbidden or in use."""
        if self._serial is not None:
            return
        try:
            self._serial = serial.Serial(
                self.port, timeout=0, write_timeout=CONNECT_S, exclusive=True, **self._settings
            )
        except (OSError, ValueError) as error:
            raise DeviceError(self.device, self.port, *_why_not_opened(self.port, error)) from error
        self._serial.reset_input_buffer()

    def close(self) -> None:
        """Close the port."""
        if self._serial is not None:
            port, self._serial = self._serial, None
            with contextlib.suppress(OSError):  # a cable that is gone needs no closing
                port.close()

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""
        try:
            self._opened().write(data)
        except OSError as error:  # SerialException is one, SerialTimeoutException too
            raise self.gone(error) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, waiting for the first byte."""
        port = self._opened()
        try:
            port.timeout = timeout_s
            first = port.read(1) if timeout_s > 0 else b""
            waiting = port.in_waiting
            return bytes(first + (port.read(waiting) if waiting else b""))
        except (OSError, TypeError) as error:  # TypeError: pyserial 3.5 on a port closed by another thread
            raise self.gone(error) from error

    def fileno(self) -> int | None:
        """Return the descriptor of the port; its lock goes with it."""
        return None if self._serial is None else int(self._serial.fileno())

    def _opened(self) -> serial.Serial:
        if self._serial is None:
            raise self.gone("the port is closed")
        return self._serial


class InheritedTransport(Transport):
    """A port that a program which is no more had open: its descriptor, its settings and its lock passed on.

    Parameters
    ----------
    device, port
        What and where.
    descriptor
        Of the open port or connection; this object closes it.
    """

    def __init__(self, device: str, port: str, descriptor: int) -> None:
        super().__init__(device, port)
        self._descriptor = descriptor

    def open(self) -> None:
        """Be open already."""
        if self._descriptor < 0:
            raise self.gone("the port is closed")

    def close(self) -> None:
        """Let go of the port."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""
        rest = memoryview(data)
        try:
            while rest:
                if not select.select([], [self._descriptor], [], CONNECT_S)[1]:
                    raise self.gone("it takes no bytes")
                rest = rest[os.write(self._descriptor, rest) :]
        except (OSError, ValueError) as error:
            raise self.gone(error) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, waiting for the first byte."""
        try:
            if not select.select([self._descriptor], [], [], timeout_s)[0]:
                return b""
            data = os.read(self._descriptor, LARGEST_READ)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise self.gone(error) from error
        if not data:
            raise self.gone("the device closed it")
        return data


class TcpTransport(Transport):
    """A connection to a device on Ethernet; a lock file keeps two programs of this machine apart."""

    def __init__(self, device: str, host: str, tcp_port: int) -> None:
        super().__init__(device, f"{host}:{tcp_port}")
        self._address = (host, tcp_port)
        self._socket: socket.socket | None = None
        self._lock_file = -1

    def open(self) -> None:
        """Connect; `DeviceError` if nobody answers there."""
        if self._socket is not None:
            return
        self._take()
        try:
            self._socket = socket.create_connection(self._address, timeout=CONNECT_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            self.close()
            raise DeviceError(
                self.device,
                self.port,
                f"cannot be connected ({error.strerror or error})",
                "check its power, its network cable and the address in rig.parts",
            ) from error

    def close(self) -> None:
        """Close the connection and free the lock."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._lock_file >= 0:
            os.close(self._lock_file)
            self._lock_file = -1

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""
        try:
            self._opened().sendall(data)
        except OSError as error:
            raise self.gone(error.strerror or error) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, waiting for the first byte."""
        connection = self._opened()
        try:
            if not select.select([connection], [], [], timeout_s)[0]:
                return b""
            data = connection.recv(LARGEST_READ)
        except OSError as error:
            raise self.gone(error.strerror or error) from error
        if not data:
            raise self.gone("the device closed it")
        return data

    def fileno(self) -> int | None:
        """Return the descriptor of the connection."""
        return None if self._socket is None else self._socket.fileno()

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise self.gone("it is closed")
        return self._socket

    def _take(self) -> None:
        name = "".join(c if c.isalnum() else "-" for c in self.port)
        path = Path(tempfile.gettempdir()) / f"mesotap-{name}.lock"
        try:
            self._lock_file = _opened_file(path)
            fcntl.flock(self._lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self.close()
            raise DeviceError(self.device, self.port, *IN_USE) from error
        except OSError as error:
            self.close()
            raise DeviceError(
                self.device,
                self.port,
                f"cannot be kept for this program ({path}: {error.strerror})",
                "give this user access to that file",
            ) from error


def _opened_file(path: Path) -> int:
    """Open a lock file, which another user may have made, to be locked and not to be written."""
    try:
        return os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return os.open(path, os.O_CREAT | os.O_RDONLY, 0o644)


IN_USE = ("another program uses it", "close that program, then try again")


def _why_not_opened(port: str, error: Exception) -> tuple[str, str]:
    """Return what happened and what to check."""
    text = str(error)
    if "exclusively lock" in text or getattr(error, "errno", None) == 16:  # EBUSY
        return IN_USE
    if not Path(port).exists():
        return "there is no such port", "plug the device in; 'mesotap devices' lists the ports that are there"
    if isinstance(error, PermissionError) or getattr(error, "errno", None) == 13:  # EACCES
        return (
            "there is no permission to open it",
            "install the rules that 'mesotap udev' prints, or add this user to the group dialout and log in again",
        )
    return f"it cannot be opened ({text})", "check the cable and the port in rig.parts"


def settle(transport: Transport, clock: Clock, quiet_s: float) -> bytes:
    """Read away what still comes, until nothing has come for ``quiet_s``: a late reply must not answer the next.

    A line that never falls quiet is left after a tenth of a second: the request that follows notices.

    Returns what was read.
    """
    unasked = b""
    end = clock.now() + SETTLING_S
    while data := transport.read(quiet_s):
        unasked += data
        if clock.now() > end or len(unasked) > LARGEST_LEFTOVER:
            break
    return unasked
