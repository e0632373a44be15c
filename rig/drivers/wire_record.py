"""Records what goes over the wires to the devices, and plays it back to the drivers.

A recording is JSON lines. The first says what it is: ``format`` "mesotap-wire", ``format_version``, ``software``,
``created``, and the ``parts`` of the configuration. Each line after it is one act on one wire:

====== ===================================================================================================
t      seconds of rig time since the recording began
device what is connected, in the operator's words
port   where
act    ``open``, ``close``, ``write``, ``read``, ``control_out``, ``control_in``, ``bulk_in``, ``clear_halt``
wait_s of ``read``: how long it was waited for the first byte
setup  of control transfers: request type, request, value and index; of bulk transfers the endpoint
hex    the bytes; empty where nothing came
length number of bytes, and ``sha256`` of them, in place of ``hex`` beyond the first samples of a recorder
error  what the port raised instead, and of USB the ``errno`` of it
====== ===================================================================================================

A read that waits for nothing and gets nothing is left out. Each line is handed to the system whole, so that a kill
costs at most the last one.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.drivers.transport import Transport
from rig.errors import RigError
from rig.interface import Clock

WIRE_FORMAT, WIRE_VERSION = "mesotap-wire", 1
LOG = logging.getLogger("mesotap.wire")

LARGEST_RECORDING = 200 * 2**20
"""Bytes of a recording, after which it ends: dialogue of about a day at 100 questions a second."""

SAMPLES_KEPT = 64 * 1024
"""Bytes of bulk transfers that are kept as they are: the first second at 25 kHz, 0.15 MB as text."""


class WireFile:
    """A recording being written; one for all wires of a rig.

    What goes wrong with it (a full disk) ends the recording, and nothing else.

    Parameters
    ----------
    path
        Where to; None only logs, at DEBUG, to ``mesotap.wire``.
    header
        What the first line says besides the format.
    all_samples
        Whether every sample of a recorder is kept too, 0.2 MB a second.

    Raises
    ------
    RigError
        The file is there already, or cannot be begun.
    """

    def __init__(self, path: Path | None, header: dict[str, Any], all_samples: bool = False) -> None:
        self._lock = threading.Lock()
        self._path = path
        self._descriptor = -1
        self._written = 0
        self._samples_left = LARGEST_RECORDING if all_samples else SAMPLES_KEPT
        self._now: Callable[[], float] = lambda: 0.0
        self._begun = 0.0
        self.has_clock = False
        if path is None:
            return
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise RigError(f"{path}: exists already and is left as it is; name another file to record to") from None
        except OSError as error:
            raise RigError(f"{path}: the wire cannot be recorded there ({error.strerror})") from error
        self._put({"format": WIRE_FORMAT, "format_version": WIRE_VERSION, **header})

    def set_clock(self, clock: Clock) -> None:
        """Take times from a rig's clock from now on."""
        self.has_clock = True
        self._now, self._begun = clock.now, clock.now()

    def note(self, device: str, port: str, act: str, data: bytes | None = None, **more: Any) -> None:
        """Record one act; ``data`` are its bytes, None where it has none."""
        entry: dict[str, Any] = {"t": round(self._now() - self._begun, 6), "device": device, "port": port, "act": act}
        entry.update(more)
        if data is not None:
            entry.update(self._bytes(act, data))
        LOG.debug("%s on %s: %s %s", device, port, act, entry.get("hex", entry.get("sha256", "")))
        with self._lock:
            if self._descriptor >= 0:
                self._put(entry)

    def close(self) -> None:
        """End the recording; harmless when it has ended."""
        with self._lock:
            if self._descriptor >= 0:
                os.close(self._descriptor)
                self._descriptor = -1

    def _bytes(self, act: str, data: bytes) -> dict[str, Any]:
        if act != "bulk_in":
            return {"hex": data.hex()}
        self._samples_left -= len(data)
        if self._samples_left >= 0:
            return {"hex": data.hex()}
        return {"length": len(data), "sha256": hashlib.sha256(data).hexdigest()}

    def _put(self, entry: dict[str, Any]) -> None:
        line = json.dumps(entry).encode() + b"\n"
        full = self._written + len(line) > LARGEST_RECORDING
        if full:
            line = b'{"act": "full"}\n'
        try:
            if os.write(self._descriptor, line) < len(line):
                raise OSError(28, os.strerror(28))
        except OSError as error:
            LOG.warning("%s: the recording of the wire ends here: %s", self._path, error.strerror)
            full = True
        self._written += len(line)
        if full:
            os.close(self._descriptor)
            self._descriptor = -1


def recorded(transport: Transport, file: WireFile | None) -> Transport:
    """Return a transport that is recorded, if there is a file to record to."""
    return transport if file is None else RecordingTransport(transport, file)


def recorded_usb(bus: Any, file: WireFile | None) -> Any:
    """Return a backend of pyusb that is recorded, if there is a file to record to."""
    return bus if file is None else RecordingUsb(bus, "recorder", file)


class RecordingTransport(Transport):
    """A transport that records what goes through another one.

    Parameters
    ----------
    inner
        The transport to the device.
    file
        The recording.
    """

    def __init__(self, inner: Transport, file: WireFile) -> None:
        super().__init__(inner.device, inner.port)
        self.inner = inner
        self._file = file

    def open(self) -> None:
        """Open the port."""
        self._recorded("open", self.inner.open)

    def close(self) -> None:
        """Close the port."""
        self._recorded("close", self.inner.close)

    def write(self, data: bytes) -> None:
        """Send."""
        self._recorded("write", lambda: self.inner.write(data), data)

    def read(self, timeout_s: float) -> bytes:
        """Return what has come."""
        try:
            data = self.inner.read(timeout_s)
        except RigError as error:
            self._file.note(self.device, self.port, "read", wait_s=timeout_s, error=str(error))
            raise
        if data or timeout_s > 0:
            self._file.note(self.device, self.port, "read", data, wait_s=timeout_s)
        return data

    def fileno(self) -> int | None:
        """Return the descriptor of the open port: who takes it over is not recorded."""
        return self.inner.fileno()

    def _recorded(self, act: str, do: Callable[[], None], data: bytes | None = None) -> None:
        try:
            do()
        except RigError as error:
            self._file.note(self.device, self.port, act, data, error=str(error))
            raise
        self._file.note(self.device, self.port, act, data)


def told(error: Exception) -> dict[str, Any]:
    """Return what is kept of what a bus raised."""
    return {"error": str(error), "errno": getattr(error, "errno", None)}


class RecordingUsb:
    """A backend of pyusb that records the transfers through another one; all else goes straight to that.

    Parameters
    ----------
    inner
        The backend to the bus.
    device
        What the recorder is called in the recording.
    file
        The recording.
    """

    def __init__(self, inner: Any, device: str, file: WireFile) -> None:
        self._inner = inner
        self._device = device
        self._file = file

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def ctrl_transfer(
        self, handle: Any, request_type: int, request: int, value: int, index: int, data: Any, timeout: int
    ) -> int:
        """Control transfer, either way."""
        inward = bool(request_type & 0x80)
        act, setup = "control_in" if inward else "control_out", [request_type, request, value, index]
        sent = bytes(data)
        try:
            count = int(self._inner.ctrl_transfer(handle, request_type, request, value, index, data, timeout))
        except Exception as error:
            self._file.note(self._device, "usb", act, b"" if inward else sent, setup=setup, **told(error))
            raise
        self._file.note(self._device, "usb", act, bytes(data)[:count] if inward else sent, setup=setup)
        return count

    def bulk_read(self, handle: Any, endpoint: int, interface: int, buffer: Any, timeout: int) -> int:
        """Bulk transfer from the device."""
        try:
            count = int(self._inner.bulk_read(handle, endpoint, interface, buffer, timeout))
        except Exception as error:
            self._file.note(self._device, "usb", "bulk_in", setup=[endpoint], **told(error))
            raise
        self._file.note(self._device, "usb", "bulk_in", bytes(memoryview(buffer).cast("B")[:count]), setup=[endpoint])
        return count

    def clear_halt(self, handle: Any, endpoint: int) -> None:
        """Take a stalled endpoint back into use."""
        self._file.note(self._device, "usb", "clear_halt", setup=[endpoint])
        self._inner.clear_halt(handle, endpoint)
