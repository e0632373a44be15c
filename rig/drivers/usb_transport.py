"""USB transport: transfers to one device, and errors that name it, where it is plugged in and what to check."""

from __future__ import annotations

import array
import errno
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import usb.core
import usb.util
from usb.backend import IBackend

from rig.errors import DeviceError, RigError

VENDOR_OUT, VENDOR_IN = 0x40, 0xC0
"""bmRequestType of vendor requests to the device."""

CONTROL_TIMEOUT_MS = 100
"""This long without an answer to a control transfer is silence: the shortest that a public driver of the recorder takes
(Jasper's Python driver 100 ms, 200 for the start of a scan; his C driver 2000, uldaq 1000). Not more, for while it is
waited for nobody watches the load, and two in a row have to fit into the half second until the surfaces are apart."""

PLUG_AGAIN = "unplug it and plug it in again"

_GONE = {errno.ENODEV, errno.EIO, errno.ENOENT, errno.ESHUTDOWN, errno.ENXIO}
"""What the kernel says of a transfer under which the cable was pulled."""


class UsbFault(DeviceError):
    """A transfer failed in a way that stopping and starting again may mend."""


class UsbStalled(UsbFault):
    """The device refused a request, or stalled its endpoint."""


class UsbSilent(UsbFault):
    """Nothing came in time."""


class UsbMute(UsbSilent):
    """Not even a request was answered in time."""


class UsbDead(UsbMute):
    """Neither samples came nor an answer: asking once more would only cost time."""


class UsbDamaged(UsbFault):
    """What came is not what was asked for."""


class UsbOverrun(UsbDamaged):
    """The device's memory ran over."""


class UsbGone(UsbFault):
    """The device is no longer on the bus; it has to be looked for and opened again."""


def connected(vendor: int, product: int, backend: IBackend | None = None, name: str = "USB") -> list[Any]:
    """Return the devices on the bus with these numbers, called ``name`` in errors, as pyusb devices.

    Raises
    ------
    RigError
        libusb is missing, or it fails to list the bus.
    """
    try:
        return list(usb.core.find(find_all=True, backend=backend, idVendor=vendor, idProduct=product))
    except usb.core.NoBackendError as error:
        raise RigError(f"{name}: libusb is not installed; on Debian: apt-get install libusb-1.0-0") from error
    except usb.core.USBError as error:
        raise RigError(f"{name}: the bus cannot be listed ({error.strerror}); plug the hub in again") from error


class UsbTransport:
    """Interface 0 of one device; one transfer at a time, from whichever thread.

    Parameters
    ----------
    device
        One of `connected`.
    name
        What it is called in errors.
    """

    def __init__(self, device: Any, name: str) -> None:
        self._device = device
        self._lock = threading.RLock()
        self.name = name
        self.port = f"usb {device.bus}:{device.address}"

    def open(self) -> None:
        """Take the device for this program alone."""
        with self._told():
            with suppress(NotImplementedError):  # systems without kernel drivers to detach
                if self._device.is_kernel_driver_active(0):
                    self._device.detach_kernel_driver(0)
            usb.util.claim_interface(self._device, 0)

    def close(self) -> None:
        """Let go of the device; harmless when it is gone."""
        with self._lock, suppress(usb.core.USBError):  # unplugged: the kernel has let go already
            usb.util.dispose_resources(self._device)

    def send(self, request: int, value: int = 0, data: bytes = b"") -> None:
        """Make a vendor request that carries ``data`` to the device.

        Raises
        ------
        UsbFault
            By its kind: stalled, silent, gone, or fewer bytes taken than sent.
        """
        with self._told(request):
            taken = self._device.ctrl_transfer(VENDOR_OUT, request, value, 0, data or None, CONTROL_TIMEOUT_MS)
        if taken != len(data):
            raise self.damaged(f"took {taken} of {len(data)} bytes of request 0x{request:02X}")

    def ask(self, request: int, length: int, value: int = 0) -> bytes:
        """Make a vendor request and return the answer, at most ``length`` bytes.

        Raises
        ------
        UsbFault
            By its kind: stalled, silent or gone.
        """
        with self._told(request):
            answer = self._device.ctrl_transfer(VENDOR_IN, request, value, 0, length, CONTROL_TIMEOUT_MS)
        return bytes(answer)

    def read_into(self, endpoint: int, buffer: array.array[int], timeout_s: float) -> int:
        """Read from a bulk endpoint until ``buffer`` (unsigned bytes) is full or a short packet ends the transfer.

        Returns the number of bytes read, 0 after a zero-length packet.

        Raises
        ------
        UsbFault
            By its kind: stalled, silent, gone, or a packet larger than the room for it.
        """
        with self._told():
            return int(self._device.read(endpoint, buffer, max(1, round(timeout_s * 1e3))))

    def clear_halt(self, endpoint: int) -> None:
        """Take a stalled endpoint back into use."""
        with self._told():
            self._device.clear_halt(endpoint)

    def damaged(self, what: str, check: str = PLUG_AGAIN) -> UsbDamaged:
        """Return an error that says what came instead of what was asked for."""
        return UsbDamaged(self.name, self.port, what, check)

    def unusable(self, what: str, check: str) -> DeviceError:
        """Return an error that no starting again will mend."""
        return DeviceError(self.name, self.port, what, check)

    @contextmanager
    def _told(self, request: int | None = None) -> Iterator[None]:
        """Turn what libusb reports into a sentence about this device."""
        try:
            with self._lock:
                yield
        except usb.core.USBError as error:
            raise self._fault(error, request) from error

    def _fault(self, error: usb.core.USBError, request: int | None) -> DeviceError:
        what = "a transfer" if request is None else f"request 0x{request:02X}"
        number = error.errno
        if isinstance(error, usb.core.USBTimeoutError) or number == errno.ETIMEDOUT:
            if request is None:
                return UsbSilent(self.name, self.port, "it sent nothing", PLUG_AGAIN)
            return UsbMute(self.name, self.port, f"it did not answer {what}", PLUG_AGAIN)
        if number == errno.EPIPE:
            return UsbStalled(self.name, self.port, f"it refused {what}", PLUG_AGAIN)
        if number in _GONE:
            return UsbGone(self.name, self.port, "it is gone from the bus", "check its cable and the hub")
        if number == errno.EOVERFLOW:
            return self.damaged("it sent more than was asked for", "use a shorter cable, or another hub")
        if number == errno.EBUSY:
            return self.unusable("another program uses it", "close that one")
        if number in (errno.EACCES, errno.EPERM):
            return self.unusable(
                "this user may not open it", "give access to it with the rules that 'mesotap udev' prints"
            )
        return self.damaged(f"{what} failed ({error.strerror})")
