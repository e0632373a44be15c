"""A session on emulated devices that outlive it: begun, ended from outside, looked at, and resumed."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from daq.journal import JOURNAL, SessionFolder
from mesotap.configuration.config import Config, parse_config
from mesotap.session.guardian_process import SILENCE_S
from mesotap.session.states import Event
from rig import RigError
from sim_backend.emulators.bench_process import Devices
from tests.faults.bench import allowed_mn

CONFIG = """
mesotap: {load_plan_mn: [300, 900], impacts_per_load: 2, dwell_s: 1}
calibration: {weights_mn: [0, 500, 1000], averaging_s: 0.1, repeats: 1}
daq: {trigger: {record_samples: 2000}}
rig:
  limits: {expected_contact_um: 12}
  parts:
    # replies that a busy machine makes late are no faults of the wire
    load_cell: {driver: modbus-rtu, preset: seneca-ze-sg3, port: an amplifier, reply_timeout_s: 0.3}
    stage: {driver: conex-cc, port: a stage, zero_mm: 0.2, resolution_um: 0.02, reply_timeout_s: 0.3}
    accelerometers: {driver: usb-1608fs-plus}
    impactor: {driver: solenoid, line: 3}
sim_backend:
  contact_position_um: 12
  gauge: {weight_settling_s: 0.1}
  bad_taps: {double: 0, too_hard: 0, too_weak: 0, off_centre: 0, clipped: 0}
"""
STARTING_S, ENDING_S = 120.0, 300.0
USUAL_END_S = 15.0  # from a signal until all of it is told
NOTHING_TO_DO_S = 3.0  # for a guardian whose session died with the surfaces apart
GRACE_S = 1.0  # from the end of the program until the surfaces are on their way apart
TRAVEL_S = 0.3  # 6 um at 200 um/s, a clamp that opens, and a busy machine
LOOK_S = 0.02
FILED = f'"event": "{Event.FILED.value}"'


@dataclass
class Ended:
    """What came of a session that was ended from outside: loads in mN, times in s from then on."""

    load_mn: float
    peak_mn: float
    apart_s: float | None
    high_lines: int
    code: int | None


class SeparateSession:
    """One session and its devices."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self.config: Config = parse_config(CONFIG)
        folder.parent.mkdir(parents=True, exist_ok=True)
        self._file = folder.parent / f"{folder.name}.yaml"
        self._file.write_text(CONFIG)
        self._log = folder.parent / f"{folder.name}.log"
        self.process = self._mesotap(
            "run", "--emulate", "--realtime", "-c", str(self._file), "-o", str(folder), "--seed", str(seed)
        )
        self._wait(lambda: (folder / "session.json").exists(), STARTING_S)
        header = json.loads((folder / "session.json").read_text())
        self.devices = Devices(Path(header["devices"]))

    def _mesotap(self, *arguments: str) -> subprocess.Popen[bytes]:
        with self._log.open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "mesotap", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )

    def _wait(self, done, longest_s: float) -> None:
        begun = time.monotonic()
        while not done():
            assert time.monotonic() < begun + longest_s, self.said()
            assert self.process.poll() is None, self.said()
            time.sleep(LOOK_S)

    def said(self) -> str:
        """What it printed so far."""
        return self._log.read_text(errors="replace")

    def reach(self, text: str, times: int = 1) -> None:
        """Wait until it has printed this so often."""
        self._wait(lambda: self.said().count(text) >= times, STARTING_S)

    def ended(self) -> bool:
        """Whether it has come to its end by itself."""
        return self.process.poll() is not None

    def end_by(self, number: int) -> Ended:
        """Send a signal, and look until the surfaces are apart and the program is gone."""
        at = time.monotonic()
        load = self.devices.call("state")["load_mn"]
        os.kill(self.process.pid, number)
        if number == signal.SIGSTOP:
            at += SILENCE_S
        end, latest = at + USUAL_END_S, at + ENDING_S
        apart: float | None = None
        while time.monotonic() < (latest if apart is None else end):
            apart = self._apart(at)
            told = "goes on" in self.said() or (load == 0.0 and time.monotonic() > at + NOTHING_TO_DO_S)
            if apart is not None and self.process.poll() is not None and told:
                break
            time.sleep(LOOK_S)
        loads = self.devices.call("loads", at)
        state = self.devices.call("state")
        return Ended(
            load,
            max([state["peak_mn"]] + [mn for _, mn in loads]),
            self._apart(at),
            state["high_lines"],
            self.process.poll(),
        )

    def _apart(self, at: float) -> float | None:
        """When the load was gone for good, s after ``at``."""
        loads = self.devices.call("loads", at)
        last = max((i for i, (_, mn) in enumerate(loads) if mn > 0.0), default=-1)
        return loads[last + 1][0] - at if last + 1 < len(loads) else None

    def hold_to_safety(self, ended: Ended, timed: bool) -> None:
        """Apart, in time where that is judged, within the limit, no current on the solenoid."""
        assert ended.apart_s is not None, f"the load stays on: {self.said()}"
        in_time = ended.apart_s <= GRACE_S + TRAVEL_S
        assert in_time or not timed, f"apart after {ended.apart_s:.2f} s: {self.said()}"
        assert ended.peak_mn <= allowed_mn(self.config)
        assert ended.high_lines == 0, "the solenoid's line is still high"

    def accepted(self) -> dict[int, bytes]:
        """Accepted taps on the disk, while nobody works there."""
        begun = time.monotonic()
        while True:
            try:
                with SessionFolder.open(self.folder) as folder:
                    return {s.number: s.acceleration.tobytes() for s in folder.impacts() if s.accepted}
            except ValueError:  # the guardian still holds the folder's lock
                assert time.monotonic() < begun + STARTING_S
                time.sleep(0.1)

    def resume(self) -> int:
        """Go on until the session is filed; the exit code, 0 for a report that is not waited for."""
        self.process = self._mesotap("resume", str(self.folder))
        begun = time.monotonic()
        while (code := self.process.poll()) is None and FILED not in (self.folder / JOURNAL).read_text():
            assert time.monotonic() < begun + ENDING_S, self.said()
            time.sleep(LOOK_S)
        if code is None:
            self.process.kill()
            self.process.wait()
        return code or 0

    def close(self) -> None:
        """End everything."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        with contextlib.suppress(RigError):  # it has ended with its session
            self.devices.call("end")
        self.devices.close()


def killed_and_resumed(
    folder: Path, seed: int, number: int, reach: tuple[str, int], wait_s: float, timed: bool
) -> bool:
    """End one session, hold it to its promises, resume it to its end; False if it had ended before."""
    session = SeparateSession(folder, seed)
    try:
        session.reach(*reach)
        time.sleep(wait_s)
        if session.ended():
            return False
        try:
            ended = session.end_by(number)
        except RigError:  # it came to its end just then, and its devices with it
            assert session.process.wait(ENDING_S) == 0, session.said()
            return False
        if "session file" in session.said():
            return False
        session.hold_to_safety(ended, timed)
        kept = session.accepted()
        assert session.resume() == 0, session.said()
        after = session.accepted()
        assert after.items() >= kept.items(), "an accepted tap was lost or altered"
        assert len(after) == 4
        return True
    finally:
        session.close()
