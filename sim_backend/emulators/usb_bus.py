"""A USB bus for pyusb that exists in memory: its devices answer transfers, can be unplugged, plugged in and taken."""

from __future__ import annotations

import array
import errno
from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Protocol

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

BUS = 1
BULK = 2
DIRECTION_IN = 0x80


def gone() -> USBError:
    """What libusb says of a device that was unplugged."""
    return USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)


def stalled() -> USBError:
    """What libusb says of a stall."""
    return USBError("Pipe error", -9, errno.EPIPE)


def timed_out() -> USBTimeoutError:
    """What libusb says of a time-out."""
    return USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)


def overflowed() -> USBError:
    """What libusb says of a packet larger than the room for it."""
    return USBError("Overflow", -8, errno.EOVERFLOW)


class Gadget(Protocol):
    """A device on the bus, with one interface and one bulk endpoint towards the host."""

    vendor: int
    product: int
    endpoint: int
    packet: int

    def control_out(self, request: int, value: int, data: bytes, timeout_s: float) -> None:
        """Take a vendor request; raises `USBError`."""

    def control_in(self, request: int, value: int, length: int, timeout_s: float) -> bytes:
        """Answer a vendor request; raises `USBError`."""

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        """Send what the endpoint has; raises `USBError`."""

    def clear_halt(self) -> None:
        """Take the endpoint back into use."""

    def power_up(self) -> None:
        """Be as after plugging in."""

    def look(self) -> None:
        """Somebody lists the bus; who was unplugged may plug itself in."""


@dataclass(eq=False)
class Port:
    """A place on the bus.

    Attributes
    ----------
    gadget
        What is plugged in there.
    address
        Given anew each time.
    plugged
        Whether it is.
    taken
        Whether another program has claimed it.
    forbidden
        Whether the user may not open it.
    """

    gadget: Gadget
    address: int
    plugged: bool = True
    taken: bool = False
    forbidden: bool = False


@dataclass(frozen=True, eq=False)
class Plugged:
    """A device as the host sees it, until it is unplugged: then it is another one."""

    port: Port
    address: int

    def gadget(self) -> Gadget:
        """Return what answers; raises `USBError` once it is gone."""
        if not self.port.plugged or self.port.address != self.address:
            raise gone()
        return self.port.gadget


class UsbBus(IBackend):
    """The bus, to be handed to pyusb as its backend.

    Attributes
    ----------
    ports
        One for each device.
    opened
        Handles open now: 0 again once everybody has let go.
    """

    def __init__(self, *gadgets: Gadget):
        self.ports = [Port(gadget, i + 2) for i, gadget in enumerate(gadgets)]
        self.opened = 0

    def unplug(self, gadget: Gadget) -> None:
        """Pull the cable."""
        self._port(gadget).plugged = False

    def plug(self, gadget: Gadget) -> None:
        """Plug it in again: it powers up, and has a new address."""
        port = self._port(gadget)
        if not port.plugged:
            port.address = 1 + max(p.address for p in self.ports)
            port.plugged = True
            gadget.power_up()

    def _port(self, gadget: Gadget) -> Port:
        return next(port for port in self.ports if port.gadget is gadget)

    # --- what pyusb asks of a backend -----------------------------------------------------------------------

    def enumerate_devices(self) -> Iterator[Plugged]:
        """Devices on the bus."""
        for port in self.ports:
            port.gadget.look()
        return iter([Plugged(port, port.address) for port in self.ports if port.plugged])

    def get_device_descriptor(self, dev: Plugged) -> SimpleNamespace:
        """Descriptor of a device."""
        gadget = dev.port.gadget
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0xFF,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=gadget.vendor,
            idProduct=gadget.product,
            bcdDevice=0x0100,
            iManufacturer=0,
            iProduct=0,
            iSerialNumber=0,
            bNumConfigurations=1,
            address=dev.address,
            bus=BUS,
            port_number=1,
            port_numbers=(1,),
            speed=2,
        )

    def get_configuration_descriptor(self, dev: Plugged, config: int) -> SimpleNamespace:
        """Descriptor of its only configuration."""
        if config:
            raise IndexError(config)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=25,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=250,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: Plugged, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Descriptor of its only interface."""
        if intf or alt or config:
            raise IndexError(intf)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=1,
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(self, dev: Plugged, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Descriptor of its only endpoint."""
        if ep:
            raise IndexError(ep)
        gadget = dev.port.gadget
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=gadget.endpoint,
            bmAttributes=BULK,
            wMaxPacketSize=gadget.packet,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, dev: Plugged) -> Plugged:
        """Open a device; the handle is the device as it is plugged in now."""
        dev.gadget()
        if dev.port.forbidden:
            raise USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        self.opened += 1
        return dev

    def close_device(self, dev_handle: Plugged) -> None:
        """Close a device, be it there or not."""
        self.opened -= 1

    def get_configuration(self, dev_handle: Plugged) -> int:
        """The only configuration."""
        dev_handle.gadget()
        return 1

    def claim_interface(self, dev_handle: Plugged, intf: int) -> None:
        """Claim the only interface, unless another program has."""
        dev_handle.gadget()
        if dev_handle.port.taken:
            raise USBError("Resource busy", -6, errno.EBUSY)

    def release_interface(self, dev_handle: Plugged, intf: int) -> None:
        """Release it."""
        dev_handle.gadget()

    def is_kernel_driver_active(self, dev_handle: Plugged, intf: int) -> bool:
        """No kernel driver wants these devices."""
        dev_handle.gadget()
        return False

    def bulk_read(self, dev_handle: Plugged, ep: int, intf: int, buff: array.array[int], timeout: int) -> int:
        """Bulk transfer from the device."""
        gadget = dev_handle.gadget()
        content = gadget.bulk_in(len(buff), timeout * 1e-3)
        memoryview(buff)[: len(content)] = content
        return len(content)

    def ctrl_transfer(
        self,
        dev_handle: Plugged,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: array.array[int],
        timeout: int,
    ) -> int:
        """Control transfer, either way."""
        gadget = dev_handle.gadget()
        if bmRequestType & DIRECTION_IN:
            content = gadget.control_in(bRequest, wValue, len(data), timeout * 1e-3)[: len(data)]
            memoryview(data)[: len(content)] = content
            return len(content)
        gadget.control_out(bRequest, wValue, bytes(data), timeout * 1e-3)
        return len(data)

    def clear_halt(self, dev_handle: Plugged, ep: int) -> None:
        """Clear a halt."""
        dev_handle.gadget().clear_halt()
