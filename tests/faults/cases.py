"""The faults that are promised for: where each happens, how it is made, and what is to come of it.

Each case happens in the second load of a small session, so that there are accepted taps to lose.
"""

from __future__ import annotations

import errno
import os
import signal
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mesotap.session.states import State
from rig.drivers.newport_codes import PositionerError
from sim_backend.emulators.disturbance import WireFault
from tests.faults.bench import FLOAT_MAP, TCP, FaultyBench

UNNOTICED, APART, STANDS, AT_CONNECT, KILLED = "unnoticed", "apart", "stands", "at connect", "killed"
AMPLIFIER, ON_TCP, STAGE, RECORDER, PROGRAM = "amplifier", "amplifier on TCP", "stage", "recorder", "program"
LOAD = "load"
NAMES = {
    AMPLIFIER: ("strain-gauge amplifier", "/dev/ttyUSB0"),
    ON_TCP: ("strain-gauge amplifier", "192.168.1.5:502"),
    STAGE: ("micrometer stage", "/dev/ttyUSB1"),
    RECORDER: ("recorder MCC USB-1608FS-Plus", "usb"),
    PROGRAM: ("", ""),
    LOAD: ("load", "mN"),
}


LEANING_UM = 3.3  # makes about 880 mN on these springs: over the limit from the first load on
PAUSED_S = 20.0
LONG_DWELL = ("mesotap.dwell_s=60",)
MOMENTS, SPREAD_S = 4, 0.5
WAITED_S = 5.013  # for a tap, of the 30 that it is waited for


@dataclass(frozen=True)
class Case:
    """One fault.

    Attributes
    ----------
    device, name
        The row's heading.
    make
        Makes it happen.
    expected
        What is to come of it.
    state, nth
        When: at the n-th look at the operator's keys in this state of the second load.
    changes
        Of the configuration.
    between
        Whether it happens between an end by the operator and the next start.
    later_s
        How long after that look it happens, in the midst of whatever goes on then.
    moments
        At how many moments of the half second from then on it is tried on each wire, drawn at random.
    paused
        Whether the operator pauses then.
    from_notice
        Whether the time until the surfaces are apart counts from when it was noticed: what shows in the next move of
        the stage does no harm before, nor does a recorder that is started again and again.
    """

    device: str
    name: str
    make: Callable[[FaultyBench], None]
    expected: str
    state: State = State.SET_LOAD
    nth: int = 2
    changes: tuple[str, ...] = ()
    between: bool = False
    later_s: float = 0.0
    from_notice: bool = False
    moments: int = 1
    paused: bool = False

    def delays_s(self, round_trip_s: float) -> list[float]:
        """How long after that look it is made to happen on a wire: as given, and at moments drawn at random."""
        rng = np.random.default_rng([zlib.crc32(self.name.encode()), round(round_trip_s * 1e3)])
        return [self.later_s, *(self.later_s + rng.uniform(0, SPREAD_S, self.moments - 1))]

    def begin(self, bench: FaultyBench, later_s: float) -> None:
        """Make it happen, now or later."""

        def happen() -> None:
            bench.happens(bench.rig.clock.now())
            self.make(bench)

        if self.paused:
            bench.after(PAUSED_S + later_s, happen)
            bench.pause(2 * PAUSED_S)
        elif later_s:
            if self.state is State.TAP:
                nobody_taps(bench)
            bench.after(later_s, happen)
        else:
            self.make(bench)


def wire(device: str, fault: WireFault, times: int = 1) -> Callable[[FaultyBench], None]:
    def make(bench: FaultyBench) -> None:
        for _ in range(times):
            (bench.stage_wire if device == STAGE else bench.amplifier_wire).inject(fault)

    return make


def setting(target: str, name: str, value) -> Callable[[FaultyBench], None]:
    def make(bench: FaultyBench) -> None:
        setattr(getattr(bench, target), name, value)

    return make


def gauge(value) -> Callable[[FaultyBench], None]:
    def make(bench: FaultyBench) -> None:
        bench.rig.physics.load_cell.fault = value

    return make


def usb(*faults: str) -> Callable[[FaultyBench], None]:
    def make(bench: FaultyBench) -> None:
        at_s = bench.rig.clock.now() + 0.25  # in the midst of the recording, not before it
        for fault in faults:
            bench.recorder.inject(fault, at_s)
        bench.happens(at_s)

    return make


def end_in_the_way(bench: FaultyBench) -> None:
    here = bench.rig.physics.micrometer.knob_um
    bench.controller.ends_um = (bench.controller.ends_um[0], here + 0.1)


def cut_power(bench: FaultyBench) -> None:
    bench.controller.cut_power()
    bench.after(0.05, bench.controller.restore_power)


def cut_power_before(bench: FaultyBench) -> None:
    bench.controller.cut_power()
    bench.controller.restore_power()


def fill_the_disk(bench: FaultyBench) -> None:
    sync = os.fsync
    tried = False

    def full(descriptor: int) -> None:
        nonlocal tried
        if not tried:
            bench.happens(bench.rig.clock.now())
        tried = True
        raise OSError(errno.ENOSPC, "No space left on device")

    mend = bench.mend

    def mended() -> None:
        os.fsync = sync
        mend()

    os.fsync = full
    bench.mend = mended


def take_the_recorder(bench: FaultyBench) -> None:
    bench.recorder.bus.ports[0].taken = True


def set_the_clock_back(bench: FaultyBench) -> None:
    clock = bench.rig.clock
    utc = clock.utc
    clock.utc = lambda: utc().replace("2026-01-01T", "2025-12-31T")


def lean(bench: FaultyBench) -> None:
    bench.rig.physics.push(LEANING_UM)


def unplug_power(bench: FaultyBench) -> None:
    bench.controller.cut_power()


def nobody_taps(bench: FaultyBench) -> None:
    impactor = bench.rig.physics.impactor
    impactor.tap = lambda load_mn, hint="": None
    bench.mends.append(lambda: vars(impactor).pop("tap"))


def terminate(bench: FaultyBench) -> None:
    bench.after(0.004, lambda: os.kill(os.getpid(), signal.SIGTERM))


def kill(bench: FaultyBench) -> None:
    bench.after(0.004, bench.kill)


CASES = [
    *(
        Case(device, name, wire(device, fault), UNNOTICED)
        for device in (AMPLIFIER, STAGE)
        for name, fault in (
            ("a bit of a reply flipped", WireFault.FLIPPED_REPLY),
            ("a bit of a request flipped", WireFault.FLIPPED_REQUEST),
            ("a reply late", WireFault.LATE),
            ("a reply truncated", WireFault.TRUNCATED),
            ("a reply twice", WireFault.DUPLICATED),
            ("the reply of another device", WireFault.FOREIGN),
            ("a reply lost", WireFault.LOST),
        )
    ),
    Case(AMPLIFIER, "silent from now on", wire(AMPLIFIER, WireFault.SILENT), APART),
    Case(AMPLIFIER, "silent at the largest load", wire(AMPLIFIER, WireFault.SILENT), APART, State.TAP, 1),
    Case(AMPLIFIER, "all replies damaged", wire(AMPLIFIER, WireFault.FLIPPED_REPLY, 50), APART),
    Case(AMPLIFIER, "cable pulled and put back", wire(AMPLIFIER, WireFault.PULLED), APART),
    Case(AMPLIFIER, "exception: failure", setting("amplifier", "fault", 4), APART),
    Case(AMPLIFIER, "exception: busy", setting("amplifier", "fault", 6), APART),
    Case(AMPLIFIER, "exception: no such register", setting("amplifier", "fault", 2), APART),
    Case(AMPLIFIER, "gauge answers no number", setting("amplifier", "fault", "nan"), APART, changes=FLOAT_MAP),
    Case(AMPLIFIER, "gauge frozen", setting("amplifier", "fault", "frozen"), APART),
    Case(AMPLIFIER, "gauge jumps", gauge(("offset", -10.0)), APART, from_notice=True),
    Case(AMPLIFIER, "gauge saturated", gauge(("offset", 1e3)), APART),
    *(
        Case(AMPLIFIER, f"{name} {when}", make, APART, state, nth, changes, later_s=later, moments=MOMENTS)
        for name, make in (
            ("silent", wire(AMPLIFIER, WireFault.SILENT)),
            ("frozen", setting("amplifier", "fault", "frozen")),
        )
        for when, state, nth, changes, later in (
            ("in a dwell of 60 s", State.LOCK, 50, LONG_DWELL, 0.03),
            ("while a tap is waited for", State.TAP, 1, (), WAITED_S),
        )
    ),
    *(
        Case(LOAD, f"880 mN more {when}", lean, APART, state, nth, changes, later_s=later, moments=MOMENTS)
        for when, state, nth, changes, later in (
            ("in a dwell of 60 s", State.LOCK, 50, LONG_DWELL, 0.03),
            ("while a tap is waited for", State.TAP, 1, (), WAITED_S),
            ("between two steps", State.SET_LOAD, 2, (), 0.005),
        )
    ),
    Case(LOAD, "880 mN more while paused", lean, APART, State.TAP, 1, moments=MOMENTS, paused=True),
    *(
        Case(STAGE, f"power lost {when}", unplug_power, STANDS, state, nth, changes, later_s=later, moments=MOMENTS)
        for when, state, nth, changes, later in (
            ("in a dwell of 60 s", State.LOCK, 50, LONG_DWELL, 0.03),
            ("while a tap is waited for", State.TAP, 1, (), WAITED_S),
        )
    ),
    Case(STAGE, "power lost while paused", unplug_power, STANDS, State.TAP, 1, moments=MOMENTS, paused=True),
    Case(AMPLIFIER, "another one plugged in", setting("amplifier", "identity", 15), AT_CONNECT, between=True),
    *(
        Case(ON_TCP, name, wire(ON_TCP, fault), UNNOTICED, changes=TCP)
        for name, fault in (
            ("a reply late", WireFault.LATE),
            ("a reply truncated", WireFault.TRUNCATED),
            ("a reply twice", WireFault.DUPLICATED),
            ("the reply to another question", WireFault.FOREIGN),
            ("a reply lost", WireFault.LOST),
        )
    ),
    Case(ON_TCP, "silent from now on", wire(ON_TCP, WireFault.SILENT), APART, changes=TCP),
    Case(ON_TCP, "cable pulled and put back", wire(ON_TCP, WireFault.PULLED), APART, changes=TCP),
    Case(STAGE, "silent from now on", wire(STAGE, WireFault.SILENT), STANDS),
    Case(STAGE, "cable pulled and put back", wire(STAGE, WireFault.PULLED), STANDS),
    Case(STAGE, "stalled", setting("controller", "stalled", True), STANDS),
    Case(
        STAGE,
        "following error",
        setting("controller", "fails_next", PositionerError.FOLLOWING),
        APART,
        from_notice=True,
    ),
    Case(
        STAGE,
        "motor current too high",
        setting("controller", "fails_next", PositionerError.PEAK_CURRENT),
        APART,
        from_notice=True,
    ),
    Case(
        STAGE,
        "supply voltage too low",
        setting("controller", "fails_next", PositionerError.LOW_VOLTAGE),
        APART,
        from_notice=True,
    ),
    Case(STAGE, "end of run", end_in_the_way, APART, from_notice=True),
    Case(STAGE, "power cut and back", cut_power, APART, from_notice=True),
    Case(STAGE, "power cut between two starts", cut_power_before, APART, between=True),
    Case(STAGE, "another one plugged in", setting("controller", "version", "SMC_CC 3.1.2"), AT_CONNECT, between=True),
    Case(RECORDER, "overrun", usb("overrun"), UNNOTICED, State.TAP, 1),
    Case(RECORDER, "endpoint stalls", usb("stall"), UNNOTICED, State.TAP, 1),
    Case(RECORDER, "a transfer truncated", usb("truncated"), UNNOTICED, State.TAP, 1),
    Case(RECORDER, "one time-out", usb("timeout"), UNNOTICED, State.TAP, 1),
    Case(RECORDER, "silent from now on", usb("silent"), APART, State.TAP, 1, from_notice=True),
    Case(RECORDER, "cable pulled and put back", usb("unplug"), APART, State.TAP, 1, from_notice=True),
    Case(RECORDER, "another one plugged in", usb("swapped"), APART, State.TAP, 1, from_notice=True),
    Case(RECORDER, "another program uses it", take_the_recorder, AT_CONNECT, between=True),
    Case(PROGRAM, "disk full", fill_the_disk, APART, State.TAP, 1),
    Case(PROGRAM, "clock set back a day", set_the_clock_back, UNNOTICED),
    Case(PROGRAM, "SIGTERM", terminate, APART),
    Case(PROGRAM, "SIGTERM at the largest load", terminate, APART, State.TAP, 1),
    Case(PROGRAM, "killed (SIGKILL)", kill, KILLED),
]
