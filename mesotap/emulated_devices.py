"""The rig of ``--emulate --realtime``: the drivers here, the emulated devices in a process that outlives this one.

What a power cut or a kill does to a session can be tried with it as with real devices.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TypeVar

from mesotap.config import Config, effective_text, parse_config
from rig import Impactor, Operator, RigError
from rig.assembled import AssembledRig
from rig.drivers.assembly import amplifier, motor_stage
from rig.drivers.recorder_settings import SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, NewportStage
from rig.drivers.solenoid import SolenoidImpactor
from rig.drivers.usb1608 import Usb1608
from rig.wall_clock import WallClock
from sim_backend.clock import RunningClock
from sim_backend.emulators.bench_process import CONTROL, Devices, DevicesProcess, RemoteTaps, RemoteWeights, remote_bus
from sim_backend.emulators.rig import DEFAULT_AMPLIFIER, DEFAULT_STAGE, EmulatedRig

STARTING_S = 60.0
LOOK_S = 0.05


class SeparateRig(AssembledRig):
    """Drivers in this process, on emulated devices in another.

    Attributes
    ----------
    devices
        Calls to the other process.
    folder
        Where its socket is.
    """

    def __init__(self, config: Config, folder: Path, operator: Operator) -> None:
        self.devices, self.folder = Devices(folder), folder
        ports, clock, settings = self.devices.call("ports"), WallClock(), config.rig
        load_cell = amplifier(with_port(settings.parts.load_cell, DEFAULT_AMPLIFIER, ports["amplifier"]), clock)
        motor = with_port(settings.parts.stage, DEFAULT_STAGE, ports["stage"])
        part = settings.parts.accelerometers
        wanted = part if isinstance(part, Usb1608Settings) else Usb1608Settings()
        recorder = Usb1608(settings.wiring, wanted, clock, remote_bus(folder))
        impactor: Impactor = RemoteTaps(self.devices)
        if isinstance(settings.parts.impactor, SolenoidSettings):
            impactor = SolenoidImpactor(recorder, settings.parts.impactor, clock)
        super().__init__(
            "emulated rig in a process of its own",
            clock,
            load_cell,
            motor_stage(motor, settings.limits.largest_approach_step_um, clock),
            recorder,
            impactor,
            RemoteWeights(self.devices),
        )


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


def separate_rig(config: Config, operator: Operator, seed: int, folder: Path | None = None) -> SeparateRig:
    """Return the drivers on emulated devices in another process, which is started if it does not run.

    Parameters
    ----------
    folder
        Of an earlier call, so that the same devices are found again; None starts new ones.
    """
    if folder is None or not (folder / CONTROL).exists():
        folder = folder or Path(tempfile.mkdtemp(prefix="mesotap-devices-"))
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "config.yaml").write_text(effective_text(config), encoding="utf-8")
        command = [sys.executable, "-m", "mesotap.emulated_devices", str(folder), str(seed)]
        subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
        begun = time.monotonic()
        while not (folder / CONTROL).exists():
            if time.monotonic() > begun + STARTING_S:
                raise RigError(f"emulated devices: they did not start within {STARTING_S:g} s")
            time.sleep(LOOK_S)
    return SeparateRig(config, folder, operator)


def main(folder: Path, seed: int) -> None:
    """Be the devices until told to end."""
    from mesotap.bench import stiffness_from_theory

    config = parse_config((folder / "config.yaml").read_text(encoding="utf-8"), "config.yaml")
    clock = RunningClock()
    stiffness = stiffness_from_theory(config)
    rig = EmulatedRig(config.rig, config.sim_backend, stiffness, seed, wires=True, clock=clock)
    rig.physics.impactor.strike(0.0)  # what is compiled at first use is compiled before anybody waits
    DevicesProcess(rig, folder).serve()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
