"""What the guardian does: waits for the end of a session's process, and then takes the surfaces apart.

A session that says nothing for long is dead too: it is killed first, since nobody watches the load any more. What was
done is written into the session's journal, and said where the session's terminal still is.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import sys
import termios
import threading
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from daq.journal_file import append_after_death
from mesotap.session.guardian import APART, ARMED, BEAT, DIED, DISMISSED, GOES_ON, LARGEST_SETUP, SAYS
from rig import Accelerometers, Block, DeadWeights, GaugeScale, Impactor, LoadCell, LoadReading, RigError, Stage
from rig.assembled import AssembledRig
from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.assembly import amplifier, motor_stage, of_another
from rig.drivers.driver import Driver
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.motor_stage import MotorStage
from rig.drivers.recorder_settings import SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, AmplifierTcp, NewportStage
from rig.drivers.transport import InheritedTransport
from rig.drivers.usb1608 import Usb1608
from rig.interlock import Interlock, SafeState
from rig.section import Section
from rig.settings import RigSettings
from rig.wall_clock import WallClock

SILENCE_S = 10.0
"""After which a session under load that shows no sign of life is stopped for good. The longest pause that a sound one
was seen to make is 1.5 s (a disk that is slow to sync); a machine that hangs for so long is not a watch over a load."""

TELLING_S = 2.0  # for a terminal that takes what is said
TRIES, TRY_AGAIN_S = 10, 0.5  # to reach a stage by its port where the inherited one is gone
NOT_HEEDED = (
    "SIGINT",
    "SIGTERM",
    "SIGHUP",
    "SIGQUIT",
    "SIGUSR1",
    "SIGUSR2",
    "SIGPIPE",
    "SIGTSTP",
    "SIGTTOU",
    "SIGTTIN",
)


def main(descriptor: int, parent: int) -> None:
    """Listen to the session until it ends, one way or another."""
    for number in NOT_HEEDED:
        signal.signal(getattr(signal, number), signal.SIG_IGN)
    try:
        watched = os.pidfd_open(parent)
    except OSError:
        watched = -1  # dead before this began; what it said last is in the socket
    session = socket.socket(fileno=descriptor)
    data, descriptors, _, _ = socket.recv_fds(session, LARGEST_SETUP, 8)
    if not data:
        return
    setup = json.loads(data)
    successor = Successor(setup, dict(zip(setup["descriptors"], descriptors, strict=True)))
    if successor.listen(session, watched, parent):
        successor.take_over()


class Successor:
    """What the guardian knows of its session, and does after it.

    Parameters
    ----------
    setup
        What the session said of itself.
    descriptors
        Of the ports that it handed over, by part.
    """

    def __init__(self, setup: dict[str, Any], descriptors: dict[str, int]) -> None:
        self._setup = setup
        self._descriptors = descriptors
        self._settings = RigSettings.model_validate(setup["rig"])
        self._folder = None if setup["folder"] is None else Path(setup["folder"])
        self._scale = GaugeScale(*setup["scale"])
        self._clock = WallClock()
        self._why = DIED

    def listen(self, session: socket.socket, watched: int, parent: int) -> bool:
        """Return once the session needs nobody any more: whether it died under load."""
        armed, heard_s = False, time.monotonic()
        while True:
            ready = select.select([session.fileno(), *([watched] if watched >= 0 else [])], [], [], 1.0)[0]
            if session.fileno() in ready:
                try:
                    message = session.recv(LARGEST_SETUP)
                except OSError:
                    message = b""
                if not message:  # it hung up: it is dying, or dead
                    if watched >= 0:
                        select.select([watched], [], [], SILENCE_S)
                    return armed
                heard_s = time.monotonic()
                said = json.loads(message)
                if "scale" in said:
                    self._scale = GaugeScale(*said["scale"])
                if said.get("state") == DISMISSED:
                    return False
                if said.get("state") in (ARMED, APART):
                    armed = said["state"] == ARMED
                if said.get("state") in (ARMED, BEAT):
                    with contextlib.suppress(OSError):
                        session.send(said["state"].encode(), socket.MSG_DONTWAIT)
            elif watched in ready:
                return armed
            elif armed and time.monotonic() - heard_s > SILENCE_S:
                self._why = f"the program stood still for {SILENCE_S:g} s and was killed"
                with contextlib.suppress(OSError):
                    os.kill(parent, signal.SIGKILL)
                select.select([watched], [], [], SILENCE_S)
                return True

    # --- taking over ----------------------------------------------------------------------------------------

    def take_over(self) -> None:
        """Take the surfaces apart, and say and write what came of it."""
        lines = threading.Thread(target=self._lines_low)  # meanwhile: the load comes first
        lines.start()
        safe = self._retract()
        lines.join()
        at = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        event = {"event": "safe", "at": at, "reason": self._why, "troubles": list(safe.troubles), "by": "guardian"}
        noted = self._folder is not None and append_after_death(self._folder, event)
        for descriptor in self._descriptors.values():  # the folder's lock too: whoever resumes need not wait for us
            with contextlib.suppress(OSError):
                os.close(descriptor)
        goes_on = f"; {GOES_ON}" if noted else ""
        said = f"\n{SAYS}{self._why}; {safe.sentence()}{goes_on}\n"
        telling = threading.Thread(target=_tell, args=(said,), daemon=True)  # a terminal may be halted
        telling.start()
        telling.join(TELLING_S)

    def _retract(self) -> SafeState:
        part = self._settings.parts.stage
        if isinstance(part, str):
            return SafeState(("the load may still be on: back the micrometer off by hand",), 0.0)
        safe = SafeState((), 0.0)
        for attempt in range(TRIES):
            inherited = attempt == 0 and "stage" in self._descriptors
            stage: Stage | None = None
            try:
                stage = self._stage(part, inherited)
                if inherited and isinstance(stage, MotorStage):
                    stage.take_over(tuple(self._setup["travel_um"]), self._setup["stage_round_trip_s"])
                elif isinstance(stage, Driver):
                    stage.connect()
            except Exception as error:  # a driver of others may raise anything
                safe = SafeState((f"not made safe: {error}; back the micrometer off by hand",), 0.0)
                _let_go(stage)
                time.sleep(TRY_AGAIN_S)
                continue
            rig = AssembledRig("", self._clock, self._gauge(), stage, _NoRecorder(), _NoImpactor(), _NoWeights())
            k1, k2 = self._settings.spring_stiffness()
            safe = Interlock(rig, self._settings.limits, self._scale, (k1, k2)).make_safe()
            if safe.moved_um:
                return safe
            _let_go(stage)
            time.sleep(TRY_AGAIN_S)
        return safe

    def _stage(self, part: Section, inherited: bool) -> Stage:
        step = self._settings.limits.largest_approach_step_um
        if not isinstance(part, NewportStage):
            made: Stage = of_another(part, self._settings, None, self._clock)
            return made
        if inherited:
            wire = InheritedTransport(STAGE, part.port, self._descriptors["stage"])
            return MotorStage(wire, part, self._clock, step)
        return motor_stage(part, step, self._clock)

    def _gauge(self) -> LoadCell:
        part = self._settings.parts.load_cell
        if not isinstance(part, AmplifierRtu | AmplifierTcp) or "gauge" not in self._descriptors:
            return _LateGauge(None)
        framing, port = (
            ("rtu", part.port) if isinstance(part, AmplifierRtu) else ("tcp", f"{part.host}:{part.tcp_port}")
        )
        inherited = InheritedTransport(AMPLIFIER, port, os.dup(self._descriptors["gauge"]))
        return _LateGauge(ModbusLoadCell(inherited, framing, part, self._clock), amplifier(part, self._clock))

    def _lines_low(self) -> None:
        """Take the current off a solenoid."""
        solenoid, part = self._settings.parts.impactor, self._settings.parts.accelerometers
        if not isinstance(solenoid, SolenoidSettings):
            return
        if not isinstance(part, str | Usb1608Settings):
            return  # a recorder of others is not taken over
        wanted = part if isinstance(part, Usb1608Settings) else Usb1608Settings()
        with contextlib.suppress(RigError, OSError):
            bus = None
            if self._setup["bus"] is not None:
                from sim_backend.emulators.bench_process import remote_bus

                bus = remote_bus(Path(self._setup["bus"]))
            recorder = Usb1608(self._settings.wiring, wanted, self._clock, bus)
            recorder.connect()
            recorder.set_line(solenoid.line, False)
            recorder.close()


def _let_go(stage: Stage | None) -> None:
    with contextlib.suppress(Exception):  # it is tried anew, whatever ails this one
        if isinstance(stage, Driver):
            stage.close()


def _tell(text: str) -> None:
    """Say something where the session's terminal was, which a session that was killed left without echo."""
    with contextlib.suppress(OSError, termios.error):
        if os.isatty(sys.stderr.fileno()):
            attributes = termios.tcgetattr(sys.stderr)
            attributes[3] |= termios.ECHO | termios.ICANON | termios.ISIG
            termios.tcsetattr(sys.stderr, termios.TCSANOW, attributes)
        os.write(sys.stderr.fileno(), text.encode())


class _LateGauge(LoadCell):
    """A gauge that is connected when it is first asked: while the load is on there is no time for it."""

    def __init__(self, *ways: ModbusLoadCell | None) -> None:
        self._ways = [way for way in ways if way is not None]
        self._connected: ModbusLoadCell | None = None

    def read(self, duration_s: float = 0.1) -> LoadReading:
        """Connect one way or the other, and read."""
        error = RigError(f"{self.name}: it was not handed over")
        for way in [self._connected] if self._connected else self._ways:
            try:
                if way is not self._connected:
                    way.connect()
                    self._connected = way
                return way.read(duration_s)
            except RigError as failure:
                error = failure
        raise error


class _NoRecorder(Accelerometers):
    """No recorder: the guardian records nothing."""

    def start(self) -> None:
        """Do nothing."""

    def read_block(self) -> Block:
        """Refuse."""
        raise RigError("guardian: it records nothing")

    def stop(self) -> None:
        """Do nothing."""


class _NoImpactor(Impactor):
    """No impactor: the guardian taps nothing."""

    def tap(self, load_mn: float, hint: str = "") -> None:
        """Refuse."""
        raise RigError("guardian: it taps nothing")


class _NoWeights(DeadWeights):
    """No weights: the guardian calibrates nothing."""

    def place(self, load_mn: float) -> None:
        """Refuse."""
        raise RigError("guardian: it calibrates nothing")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
