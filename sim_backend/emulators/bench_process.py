"""Emulated devices in a process of their own, in real time: they go on when the program that drove them dies.

The process serves the stage and the amplifier on pseudo-terminals or TCP, and everything else (the USB bus, the person
who taps and hangs weights, what tests want to know and to break) by calls over a socket in its folder.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from typing import Any

from usb.core import USBError, USBTimeoutError

from rig import DeadWeights, Impactor
from rig.errors import RigError
from rig.interface import HEED_S
from sim_backend.emulators.ports import PtyPort
from sim_backend.emulators.rig import EmulatedRig
from sim_backend.emulators.usb_bus import UsbBus

CONTROL = "control"
LOOK_S = 0.002  # between two looks at the true load
HISTORY = 100_000
FORGOTTEN_S, LOOK_AGAIN_S = 3600.0, 1.0
FAMILY = "AF_UNIX"
LONGEST_ADDRESS = 107  # bytes of a socket's path that Linux takes (sun_path of unix(7), less its closing zero)
DIGITAL_READ = 0x01  # request of the recorder


@contextmanager
def control_address(folder: Path) -> Iterator[str]:
    """Give the path of the socket in a folder, by way of the open folder where the path itself is too long for one."""
    path = folder / CONTROL
    if len(os.fsencode(path)) <= LONGEST_ADDRESS:
        yield str(path)
        return
    opened = os.open(folder, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{opened}/{CONTROL}"
    finally:
        os.close(opened)


class DevicesProcess:
    """What the process does.

    Parameters
    ----------
    rig
        Emulated rig with ports and a running clock.
    folder
        Where its socket is made.
    """

    def __init__(self, rig: EmulatedRig, folder: Path) -> None:
        self._rig = rig
        self._folder = folder
        self._loads: deque[tuple[float, float]] = deque(maxlen=HISTORY)
        self._ended = threading.Event()
        self._called_s = time.monotonic()

    def serve(self) -> None:
        """Serve until told to end, or until nobody has called for long."""
        for port in self._rig.ports:
            port.plug()
        threading.Thread(target=self._note_loads, daemon=True).start()
        with control_address(self._folder) as address, Listener(address, FAMILY) as listener:
            threading.Thread(target=self._accept, args=(listener,), daemon=True).start()
            while not self._ended.wait(LOOK_AGAIN_S) and time.monotonic() < self._called_s + FORGOTTEN_S:
                pass
        for port in self._rig.ports:
            port.unplug()

    def _accept(self, listener: Listener) -> None:
        while True:
            try:
                connection = listener.accept()
            except OSError:  # closed: the process ends
                return
            threading.Thread(target=self._talk, args=(connection,), daemon=True).start()

    def _talk(self, connection: Connection) -> None:
        while True:
            try:
                name, *arguments = connection.recv()
                self._called_s = time.monotonic()
            except (EOFError, OSError):
                return
            try:
                answer: tuple[str, Any] = ("", getattr(self, f"do_{name}")(*arguments))
            except USBError as error:
                late = isinstance(error, USBTimeoutError)
                answer = ("usb", (late, error.strerror, error.backend_error_code, error.errno))
            except Exception as error:
                answer = ("error", f"{type(error).__name__}: {error}")
            try:
                connection.send(answer)
            except OSError:
                return

    def _note_loads(self) -> None:
        while True:
            with self._rig.lock:
                load = self._rig.physics.true_load_mn()
            self._loads.append((time.monotonic(), load))
            time.sleep(LOOK_S)

    # --- calls ----------------------------------------------------------------------------------------------

    def do_ports(self) -> dict[str, str]:
        """Paths of the serial ports by the name of what is there."""
        return {port.path.name: str(port.path) for port in self._rig.ports if isinstance(port, PtyPort)}

    def do_tap(self, load_mn: float, hint: str) -> None:
        """Have the person tap."""
        self._rig.physics.impactor.tap(load_mn, hint)

    def do_tap_lower_mass(self, side: int) -> None:
        """Have the person tap the lower mass."""
        self._rig.physics.impactor.tap_lower_mass(side)

    def do_push(self, depth_um: float) -> None:
        """Have somebody push the upper mass so much deeper than the stage holds it."""
        with self._rig.lock:
            self._rig.physics.push(depth_um)

    def do_place(self, load_mn: float) -> None:
        """Have the person hang a weight."""
        self._rig.physics.weights.place(load_mn)

    def do_usb(self, method: str, *arguments: Any) -> Any:
        """One transfer to the recorder."""
        with self._rig.lock:
            return getattr(self._rig.recorder, method)(*arguments)

    def do_truth(self) -> dict[str, float]:
        """Truth at the present load."""
        physics = self._rig.physics
        return physics.truth_at_load(physics.true_load_mn() * 1e-3)

    def do_loads(self, since_s: float) -> list[tuple[float, float]]:
        """True loads, mN, since a time of the machine's monotonic clock, s, with their times."""
        return [entry for entry in list(self._loads) if entry[0] >= since_s]

    def do_state(self) -> dict[str, Any]:
        """True load, mN, its peak, where the knob is, um, and a bit for each digital line that is high."""
        with self._rig.lock:
            physics = self._rig.physics
            high = self._rig.recorder.control_in(DIGITAL_READ, 0, 1, 1.0)[0]
            return {
                "load_mn": physics.true_load_mn(),
                "peak_mn": physics.peak_true_load_mn,
                "knob_um": physics.micrometer.knob_um,
                "high_lines": high,
            }

    def do_end(self) -> None:
        """End the process."""
        self._ended.set()


class Devices:
    """The other end of the socket: calls to the devices' process.

    Parameters
    ----------
    folder
        Where the process has its socket.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with control_address(folder) as address:
            self._connection = Client(address, FAMILY)
        self._lock = threading.Lock()

    def call(self, name: str, *arguments: Any) -> Any:
        """Make one call; raises what it raised there, if that is of USB, else a RuntimeError.

        Raises
        ------
        RigError
            The process is gone.
        """
        try:
            with self._lock:
                self._connection.send((name, *arguments))
                kind, answer = self._connection.recv()
        except (OSError, EOFError):
            raise _gone() from None
        if kind == "usb":
            late, text, code, number = answer
            raise (USBTimeoutError if late else USBError)(text, code, number)
        if kind == "error":
            raise RuntimeError(answer)
        return answer

    def call_while(self, idle: Callable[[], None], name: str, *arguments: Any) -> None:
        """Make a call that lasts, over a connection of its own; ``idle`` is called meanwhile and may end the wait."""
        devices = Devices(self._folder)
        try:
            devices._connection.send((name, *arguments))
            while not devices._connection.poll(HEED_S):
                idle()
            kind, answer = devices._connection.recv()
        except (OSError, EOFError):
            raise _gone() from None
        finally:
            devices.close()
        if kind:
            raise RuntimeError(answer)

    def close(self) -> None:
        """Hang up."""
        self._connection.close()


def _gone() -> RigError:
    return RigError("the process of the emulated devices has ended, and all of them with it")


class RemoteRecorder:
    """The recorder in the other process, as a device on a USB bus here."""

    vendor, product, endpoint, packet = 0x09DB, 0x00EA, 0x81, 64

    def __init__(self, devices: Devices) -> None:
        self._devices = devices

    def control_out(self, request: int, value: int, data: bytes, timeout_s: float) -> None:
        """Take a vendor request."""
        self._devices.call("usb", "control_out", request, value, data, timeout_s)

    def control_in(self, request: int, value: int, length: int, timeout_s: float) -> bytes:
        """Answer a vendor request."""
        return bytes(self._devices.call("usb", "control_in", request, value, length, timeout_s))

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        """Send what the endpoint has."""
        return bytes(self._devices.call("usb", "bulk_in", length, timeout_s))

    def clear_halt(self) -> None:
        """Take the endpoint back into use."""
        self._devices.call("usb", "clear_halt")

    def power_up(self) -> None:
        """Stay as it is: it is not plugged in here."""

    def look(self) -> None:
        """Be looked at."""


def remote_bus(folder: Path) -> UsbBus:
    """Return a bus with the other process's recorder on it."""
    return UsbBus(RemoteRecorder(Devices(folder)))


class RemoteTaps(Impactor):
    """The person in the other process who taps."""

    def __init__(self, devices: Devices) -> None:
        self._devices = devices

    def tap(self, load_mn: float, hint: str = "") -> None:
        """Ask for one tap."""
        self._devices.call("tap", load_mn, hint)


class RemoteWeights(DeadWeights):
    """The person in the other process who hangs weights."""

    def __init__(self, devices: Devices) -> None:
        self._devices = devices

    def place(self, load_mn: float) -> None:
        """Ask for a weight."""
        self._devices.call_while(self.idle, "place", load_mn)
