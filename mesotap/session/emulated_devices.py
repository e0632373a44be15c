"""The rig of ``--emulate --realtime``: the drivers here, the emulated devices in a process that outlives this one.

What a power cut or a kill does to a session can be tried with it as with real devices.
"""

from __future__ import annotations

import contextlib
import os
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TypeVar

from daq.errors import RecordingError, one_line
from mesotap.configuration.config import Config, effective_text, parse_config
from rig import Impactor, Operator, RigError
from rig.assembled import AssembledRig
from rig.drivers.assembly import amplifier, motor_stage
from rig.drivers.recorder_settings import SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, NewportStage
from rig.drivers.solenoid import SolenoidImpactor
from rig.drivers.usb1608 import Usb1608
from rig.drivers.wire_record import WireFile, recorded_usb
from rig.wall_clock import WallClock
from sim_backend.clock import RunningClock
from sim_backend.emulators.bench_process import CONTROL, Devices, DevicesProcess, RemoteTaps, RemoteWeights, remote_bus
from sim_backend.emulators.rig import DEFAULT_AMPLIFIER, DEFAULT_STAGE, EmulatedRig

STARTING_S = 60.0
LOOK_S = 0.05
LONGEST_SHOWN = 100
WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class SeparateRig(AssembledRig):
    """Drivers in this process, on emulated devices in another.

    Attributes
    ----------
    devices
        Calls to the other process.
    folder
        Where its socket is.
    settings
        Section ``rig`` with the amplifier and the stage that there are, whatever the configuration names.
    """

    def __init__(self, config: Config, folder: Path, operator: Operator, wire_file: WireFile | None = None) -> None:
        self.devices, self.folder = Devices(folder), folder
        ports, clock, settings = self.devices.call("ports"), WallClock(), config.rig
        if wire_file is not None:
            wire_file.set_clock(clock)
        gauge = with_port(settings.parts.load_cell, DEFAULT_AMPLIFIER, ports["amplifier"])
        load_cell = amplifier(gauge, clock, wire_file)
        motor = with_port(settings.parts.stage, DEFAULT_STAGE, ports["stage"])
        parts = settings.parts.model_copy(update={"load_cell": gauge, "stage": motor})
        self.settings = settings.model_copy(update={"parts": parts})
        part = settings.parts.accelerometers
        wanted = part if isinstance(part, Usb1608Settings) else Usb1608Settings()
        recorder = Usb1608(settings.wiring, wanted, clock, recorded_usb(remote_bus(folder), wire_file))
        impactor: Impactor = RemoteTaps(self.devices)
        if isinstance(settings.parts.impactor, SolenoidSettings):
            impactor = SolenoidImpactor(recorder, settings.parts.impactor, clock)
        super().__init__(
            "emulated rig in a process of its own",
            clock,
            load_cell,
            motor_stage(motor, settings.limits.largest_approach_step_um, clock, wire_file),
            recorder,
            impactor,
            RemoteWeights(self.devices),
        )

    def tap_lower_mass(self, side: int = 0) -> None:
        """Have the person tap the lower mass by hand, whatever taps the upper one; see `SimulatedImpactor`."""
        self.devices.call("tap_lower_mass", side)

    def end_devices(self) -> None:
        """Have the other process end, which nobody will call any more."""
        with contextlib.suppress(RigError):  # it has ended already
            self.devices.call("end")


Settings = TypeVar("Settings", AmplifierRtu, NewportStage)


def with_port(part: object, default: Settings, port: str) -> Settings:
    """Return the settings of a part that is configured, else the default, at another port.

    Raises
    ------
    RigError
        The part is of another kind.
    """
    if isinstance(part, str):
        part = default
    if not isinstance(part, type(default)):
        raise RigError("rig.parts: --emulate with --realtime needs a motor stage and an amplifier on a serial line")
    return part.model_copy(update={"port": port})


def refuse_foreign_devices(folder: Path, said_by: Path) -> None:
    """Refuse a folder that a session names if no devices of this person run in it: nothing is made or called there.

    Parameters
    ----------
    folder
        Where the devices should be.
    said_by
        The file that says so.

    Raises
    ------
    RecordingError
        There are none, or they are somebody else's.
    """
    where = f"{said_by}: emulated devices should run in {one_line(str(folder))[:LONGEST_SHOWN]}, but"
    begin = "; begin a new session, or save what there is with 'mesotap recover'"
    try:
        place, socket = folder.lstat(), (folder / CONTROL).lstat()
    except (OSError, ValueError):
        raise RecordingError(f"{where} there are none any more{begin}") from None
    ours = all(found.st_uid == os.getuid() for found in (place, socket)) and not place.st_mode & WRITABLE_BY_OTHERS
    if not (folder.is_absolute() and stat.S_ISDIR(place.st_mode) and stat.S_ISSOCK(socket.st_mode) and ours):
        raise RecordingError(f"{where} what is there was not started by you{begin}")
    try:
        Devices(folder).close()
    except (OSError, EOFError):
        raise RecordingError(f"{where} they answer no more{begin}") from None


def separate_rig(
    config: Config, operator: Operator, seed: int, folder: Path | None = None, wire_file: WireFile | None = None
) -> SeparateRig:
    """Return the drivers on emulated devices in another process, which is started if it does not run.

    Parameters
    ----------
    folder
        Of an earlier call, so that the same devices are found again; None starts new ones.
    wire_file
        Where to record what goes over the wires; None for nowhere.
    """
    if folder is None or not (folder / CONTROL).exists():
        folder = folder or Path(tempfile.mkdtemp(prefix="mesotap-devices-"))
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "config.yaml").write_text(effective_text(config), encoding="utf-8")
        return _started(config, folder, seed, operator, wire_file)
    return SeparateRig(config, folder, operator, wire_file)


def _started(config: Config, folder: Path, seed: int, operator: Operator, wire_file: WireFile | None) -> SeparateRig:
    """Start the devices; they are ended again where they cannot be used."""
    command = [sys.executable, "-m", "mesotap.session.emulated_devices", str(folder), str(seed)]
    nowhere = subprocess.DEVNULL  # whoever reads what this program prints does not wait for the devices to end
    process = subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere, start_new_session=True)
    begun = time.monotonic()
    try:
        while not (folder / CONTROL).exists():
            if process.poll() is not None:
                raise RigError(f"emulated devices: they ended at once (exit code {process.returncode})")
            if time.monotonic() > begun + STARTING_S:
                raise RigError(f"emulated devices: they did not start within {STARTING_S:g} s")
            time.sleep(LOOK_S)
        return SeparateRig(config, folder, operator, wire_file)
    except BaseException:
        process.kill()
        process.wait()
        raise


def main(folder: Path, seed: int) -> None:
    """Be the devices until told to end."""
    from mesotap.session.bench import stiffness_from_theory

    config = parse_config((folder / "config.yaml").read_text(encoding="utf-8"), "config.yaml")
    clock = RunningClock()
    stiffness = stiffness_from_theory(config)
    rig = EmulatedRig(config.rig, config.sim_backend, stiffness, seed, wires=True, clock=clock)
    rig.physics.impactor.tap(0.0)  # what is compiled at first use is compiled before anybody waits
    DevicesProcess(rig, folder).serve()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
