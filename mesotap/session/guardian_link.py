"""The session's end of the guardian, a process that takes the surfaces apart when the session's own dies under load.

It is started with the session and holds the other end of a socket. It is given the stage's and the gauge's open ports,
whose locks stay with it, and the folder's lock: nobody else comes in between. While the session lives it does nothing
but listen; see `guardian_process` for what it does then.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from daq.journal import SessionFolder
from mesotap.configuration.config import Config
from mesotap.session.emulated_devices import SeparateRig
from mesotap.session.guardian import APART, ARMED, BEAT, DISMISSED, LARGEST_SETUP, Guardian
from rig import GaugeScale, Rig, RigError
from rig.assembled import AssembledRig
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.motor_stage import MotorStage
from rig.settings import RigSettings
from sim_backend.emulators.rig import EmulatedRig

STARTING_S = 30.0  # a busy machine may take long to start it
ANSWERING_S = 5.0
BEAT_S = 0.5  # between two signs of life
DEAF_S = 5.0  # without an answer to them, after which a guardian is none
DISMISSING_S = 5.0


class GuardianProcess(Guardian):
    """The session's end of it.

    Parameters
    ----------
    settings
        Section ``rig``.
    rig
        Its parts, connected when `start` is called.
    folder
        The session's; None where nothing is recorded.
    bus
        Where the recorder is, if not on this machine's USB: the folder of emulated devices.
    """

    def __init__(
        self, settings: RigSettings, rig: AssembledRig, folder: SessionFolder | None, bus: Path | None = None
    ) -> None:
        self._settings = settings
        self._rig = rig
        self._folder = folder
        self._bus = bus
        self._scale = GaugeScale(settings.gauge_sensitivity_mv_per_mn)
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._ready = self._armed = self._leaving = False
        self._beat_s = self._heard_s = 0.0

    def start(self) -> None:
        """Start it, and hand it the ports.

        Raises
        ------
        RigError
            It does not start.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "mesotap.session.guardian_process", str(theirs.fileno()), str(os.getpid())]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], start_new_session=True
            )
            theirs.close()
            ours.settimeout(ANSWERING_S)
            self._socket, self._ready = ours, False
            setup, descriptors = self._setup()
            socket.send_fds(ours, [json.dumps(setup).encode()], descriptors)
        except OSError as error:
            raise RigError(
                f"guardian: it cannot be started ({error.strerror}); nothing is loaded without it"
            ) from error

    def scale(self, scale: GaugeScale) -> None:
        """Tell it how the gauge reads."""
        self._scale = scale
        if self._socket is not None:
            self._send({"scale": [scale.sensitivity_mv_per_mn, scale.offset_mv]})

    def arm(self, load: bool) -> None:
        """Tell it whether the surfaces may touch, and wait until it has understood that they may."""
        self._armed = load
        if self._socket is None:
            return
        self._send({"state": ARMED if load else APART})
        if load and not self._heard(ARMED):
            raise RigError(
                "guardian: it does not answer; nothing is loaded without it: end other programs, then resume"
            )

    def beat(self) -> None:
        """Show that this program is alive; one that has died is started again."""
        now = time.monotonic()
        if self._socket is None:
            return
        if self._process is not None and self._process.poll() is not None and not self._leaving:
            self._replace()  # it has died: until the next one listens nobody would take over
            return
        if now - self._beat_s < BEAT_S:
            return
        self._beat_s = now
        self._send({"state": BEAT})
        if self._answers():
            self._heard_s = now
        elif self._ready and not self._leaving and now - self._heard_s > DEAF_S:
            self._replace()  # it was stopped, or hangs

    def leave(self) -> None:
        """Leave it as it is, dead or alive."""
        self._leaving = True

    def dismiss(self) -> None:
        """Have it end, and wait for that, so that the ports are free."""
        if self._socket is not None:
            with contextlib.suppress(OSError, RigError):
                self._socket.send(json.dumps({"state": DISMISSED}).encode())
        if self._process is not None:
            try:
                self._process.wait(DISMISSING_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
        if self._socket is not None:  # not earlier: a word not yet read would be lost with it
            self._socket.close()
            self._socket = None

    # --- the socket -----------------------------------------------------------------------------------------

    def _setup(self) -> tuple[dict[str, Any], list[int]]:
        """Return what it has to know, and the descriptors it is given, named in their order."""
        stage, gauge = self._rig.stage, self._rig.load_cell
        names: list[str] = []
        descriptors: list[int] = []
        setup: dict[str, Any] = {
            "rig": self._settings.model_dump(mode="json"),
            "folder": None if self._folder is None else str(self._folder.path.resolve()),
            "scale": [self._scale.sensitivity_mv_per_mn, self._scale.offset_mv],
            "bus": None if self._bus is None else str(self._bus),
        }
        if self._folder is not None:
            names.append("folder")
            descriptors.append(self._folder.lock_descriptor)
        if isinstance(stage, MotorStage):
            setup["travel_um"], setup["stage_round_trip_s"] = list(stage.travel_um), stage.round_trip_s
            names.append("stage")
            descriptors.append(_descriptor(stage))
        if isinstance(gauge, ModbusLoadCell):
            names.append("gauge")
            descriptors.append(_descriptor(gauge))
        return {**setup, "descriptors": names}, descriptors

    def _send(self, message: dict[str, Any]) -> None:
        """Send; a guardian that is no more is replaced by a new one."""
        if self._socket is None:
            return
        try:
            self._socket.send(json.dumps(message).encode(), socket.MSG_DONTWAIT)
        except BlockingIOError:
            return  # it has not read what came before: signs of life enough
        except OSError:
            if not self._leaving:
                self._replace()

    def _replace(self) -> None:
        """Start another one; it finds in its socket that there is a load, and nobody waits for it meanwhile."""
        if self._process is not None:
            self._process.kill()
        self.dismiss()
        self.start()
        self._send({"state": ARMED if self._armed else APART})

    def _answers(self) -> bool:
        """Read away what it said; whether it said anything."""
        heard = False
        while self._socket is not None and select.select([self._socket], [], [], 0.0)[0]:
            try:
                if not self._socket.recv(LARGEST_SETUP):
                    break
            except OSError:
                break
            heard = self._ready = True
        return heard

    def _heard(self, word: str) -> bool:
        """Wait until it says ``word``."""
        end = time.monotonic() + (ANSWERING_S if self._ready else STARTING_S)
        while self._socket is not None and (left := end - time.monotonic()) > 0:
            if not select.select([self._socket], [], [], left)[0]:
                return False
            said = self._socket.recv(LARGEST_SETUP).decode()
            self._ready = True
            self._heard_s = time.monotonic()
            if said == word:
                return True
            if not said:
                return False
        return False


def _descriptor(driver: MotorStage | ModbusLoadCell) -> int:
    descriptor = driver.descriptor()
    if descriptor is None:
        raise RigError("guardian: a port that is to be handed over is closed")
    return descriptor


def guardian_for(rig: Rig, config: Config, folder: SessionFolder | None = None) -> Guardian:
    """Return who takes the surfaces apart if this program dies: for devices that do not die with it."""
    if isinstance(rig, EmulatedRig) or not isinstance(rig, AssembledRig):
        return Guardian()
    if isinstance(rig, SeparateRig):
        return GuardianProcess(rig.settings, rig, folder, rig.folder)
    return GuardianProcess(config.rig, rig, folder)
