"""Plays a recorded dialogue back to the drivers: what they send has to be what was sent then.

With it a recording from a rig far away becomes a test: the drivers, run again, either do the same or part from the
recording at a line that is named.
"""

from __future__ import annotations

import json
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.drivers.transport import Transport
from rig.drivers.wire_record import WIRE_FORMAT, WIRE_VERSION
from rig.errors import DeviceError, RigError
from rig.interface import Clock

SERIAL_ACTS = ("open", "close", "write", "read")
USB_ACTS = ("control_out", "control_in", "bulk_in", "clear_halt")


class WireMismatch(RigError):
    """A driver did something else than the recording has; the text names the line."""


class RecordedFault(DeviceError):
    """What the port raised when the recording was made."""

    def __init__(self, device: str, port: str, text: str) -> None:
        RigError.__init__(self, text)
        self.device, self.port, self.what, self.check = device, port, text, ""


@dataclass(frozen=True, slots=True)
class Act:
    """One act of a recording.

    Attributes
    ----------
    line
        In the file, from 1.
    time_s
        Of rig time since the recording began.
    device, port
        Which wire.
    act
        What was done; see `rig.drivers.wire_record`.
    data
        Its bytes.
    wait_s
        Of a read: how long it could have waited.
    error
        What was raised instead; empty if nothing was.
    setup
        Of USB: request type, request, value and index of a control transfer, the endpoint of a bulk transfer.
    errno
        Of what was raised; None if it had none.
    length
        Number of bytes, also of those that were not kept.
    """

    line: int
    time_s: float
    device: str
    port: str
    act: str
    data: bytes
    wait_s: float
    error: str
    setup: tuple[int, ...] = ()
    errno: int | None = None
    length: int = 0

    def __str__(self) -> str:
        shown = f" {self.data!r}" if self.act == "write" else f" {list(self.setup)}" if self.setup else ""
        return f"{self.act}{shown}"


@dataclass(frozen=True, slots=True)
class WireRecording:
    """A recording that was read.

    Attributes
    ----------
    path
        Its file.
    header
        Its first line.
    acts
        Those on lines.
    transfers
        Those on the USB.
    """

    path: Path
    header: dict[str, Any]
    acts: tuple[Act, ...]
    transfers: tuple[Act, ...] = ()

    def devices(self) -> list[str]:
        """Return the devices in it, in the order in which they were first spoken to."""
        return list(dict.fromkeys(act.device for act in self.acts))


def read_recording(path: Path) -> WireRecording:
    """Return a recording; a last line that a kill cut short is left out.

    Raises
    ------
    RigError
        It cannot be read, or is not a recording of this version; a line of it is named.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise RigError(f"{path}: cannot be read ({error.strerror})") from error
    entries = []
    for number, line in enumerate(lines[:-1], start=1):
        try:
            entry = json.loads(line)
            if not isinstance(entry, dict):
                raise ValueError("is not JSON object")
            entries.append((number, entry))
        except (ValueError, RecursionError) as error:
            raise RigError(f"{path}: line {number} is damaged") from error
    if not entries or entries[0][1].get("format") != WIRE_FORMAT:
        raise RigError(f"{path}: is not a recording of a wire")
    if entries[0][1].get("format_version") != WIRE_VERSION:
        raise RigError(
            f"{path}: is of version {entries[0][1].get('format_version')!r}, this program reads {WIRE_VERSION}"
        )
    acts = [_act(path, number, e) for number, e in entries[1:] if e.get("act") in SERIAL_ACTS]
    transfers = [_act(path, number, e) for number, e in entries[1:] if e.get("act") in USB_ACTS]
    return WireRecording(path, entries[0][1], tuple(acts), tuple(transfers))


def _act(path: Path, line: int, entry: dict[str, Any]) -> Act:
    try:
        data = bytes.fromhex(entry.get("hex", ""))
        return Act(
            line=line,
            time_s=float(entry["t"]),
            device=str(entry["device"]),
            port=str(entry["port"]),
            act=str(entry["act"]),
            data=data,
            wait_s=float(entry.get("wait_s", 0.0)),
            error=str(entry.get("error", "")),
            setup=tuple(int(number) for number in entry.get("setup", ())),
            errno=None if entry.get("errno") is None else int(entry["errno"]),
            length=int(entry.get("length", len(data))),
        )
    except (LookupError, ValueError, TypeError) as error:
        raise RigError(f"{path}: line {line} is damaged ({type(error).__name__}: {error})") from error


class ReplayClock(Clock):
    """The time of the recording: that of the last act played, and what was slept since."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """Seconds since the recording began."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self._now += max(seconds, 0.0)

    def utc(self) -> str:
        """A date that does not matter."""
        return "2026-01-01T00:00:00.000Z"

    def play(self, time_s: float) -> None:
        """Be at the time of an act, at least."""
        self._now = max(self._now, time_s)


class ReplayTransport(Transport):
    """A port at which a recording answers.

    Parameters
    ----------
    recording
        The dialogue.
    device
        Which of its wires.
    clock
        That of all drivers of the recording.
    """

    def __init__(self, recording: WireRecording, device: str, clock: ReplayClock) -> None:
        acts = [act for act in recording.acts if act.device == device]
        super().__init__(device, acts[0].port if acts else "nowhere")
        self._path = recording.path
        self._left = deque(acts)
        self._clock = clock

    def left(self) -> tuple[Act, ...]:
        """Return what was not played yet."""
        return tuple(self._left)

    def skip(self) -> bytes:
        """Pass over the next act, whatever it is; returns its bytes."""
        act = self._left.popleft()
        self._clock.play(act.time_s)
        return act.data

    def open(self) -> None:
        """Open the port, as it was opened then; harmless when it is open."""
        if self._left and self._left[0].act == "open":
            self._played()

    def close(self) -> None:
        """Close the port; harmless at any time."""
        if self._left and self._left[0].act == "close":
            self._played()

    def write(self, data: bytes) -> None:
        """Send, which has to be what was sent then.

        Raises
        ------
        WireMismatch
            It is not.
        """
        if not self._left or (self._left[0].act, self._left[0].data) != ("write", data):
            raise self._parted(f"write {data!r}")
        self._played()

    def read(self, timeout_s: float) -> bytes:
        """Return what came then; time passes as it did.

        Raises
        ------
        WireMismatch
            Nothing was waited for there.
        """
        expected = self._left[0] if self._left else None
        waited = expected is not None and expected.act == "read"
        if expected is not None and waited and (timeout_s > 0 or expected.wait_s <= 0):
            return self._played()
        if timeout_s <= 0:  # reads that waited for nothing and got nothing are not in the recording
            return b""
        raise self._parted("read")

    def _played(self) -> bytes:
        act = self._left.popleft()
        self._clock.play(act.time_s)
        if act.error:
            raise RecordedFault(act.device, act.port, act.error)
        return act.data

    def _parted(self, what: str) -> WireMismatch:
        if not self._left:
            return WireMismatch(
                f"{self._path}: {self.device}: the recording is at its end, but the driver would {what}"
            )
        return WireMismatch(
            f"{self._path}, line {self._left[0].line}: {self.device}: the driver would {what}, the recording has "
            f"{self._left[0]}"
        )
