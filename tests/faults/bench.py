"""A session on the emulated rig to which things happen: when, what is seen of it, and how it goes on."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from daq.errors import RecordingError
from daq.journal import IMPACTS, SessionFolder, impact_in
from daq.records import Impact
from mesotap.configuration.config import Config
from mesotap.operator.console import POLL_S, KeyControl
from mesotap.session.bench import emulated_rig, truth_now
from mesotap.session.runner import Bench, SessionRunner
from mesotap.session.states import State
from rig import RigError
from rig.drivers.settings import AmplifierTcp
from sim_backend.emulators.disturbance import DisturbedWire, foreign_line, foreign_rtu, foreign_tcp
from tests.mesotap.benches import Silent, Watching, header_of, small_config

QUICK = (
    "sim_backend.contact_position_um=12",
    "rig.limits.expected_contact_um=12",
    "mesotap.dwell_s=1",
)
PORTS = (
    "rig.parts.load_cell={driver: modbus-rtu, preset: seneca-ze-sg3, port: /dev/ttyUSB0, expected_id: 14}",
    "rig.parts.stage={driver: conex-cc, port: /dev/ttyUSB1, zero_mm: 0.2, resolution_um: 0.02, "
    "expected_identity: CONEX-CC}",
    "rig.parts.accelerometers={driver: usb-1608fs-plus, serial_number: 01D2E3F4}",
)
FLOAT_MAP = (
    "rig.parts.load_cell={driver: modbus-rtu, port: /dev/ttyUSB0, registers: {signal: {offset: 2, kind: float32}, "
    "signal_is: mv}}",
)
TCP = (
    "rig.parts.load_cell={driver: modbus-tcp, preset: seneca-ze-sg3, host: 192.168.1.5, expected_id: 14}",
    "rig.parts.stage={driver: smc100, port: /dev/ttyUSB1, zero_mm: 0.2, resolution_um: 0.02, "
    "expected_identity: SMC_CC}",
)
SOLENOID = (
    "rig.parts.load_cell={driver: modbus-rtu, port: /dev/ttyUSB0, registers: {signal: {offset: 65, kind: float32}, "
    "signal_is: mv, word_order: low_first, table: input}}",
    "rig.parts.impactor={driver: solenoid, line: 3}",
)
LONGEST_S = 3600.0  # of virtual time that one run may take before it counts as hanging
MOST_EXCHANGES = 200_000


class Hang(BaseException):
    """A run that does not end; no handler of errors takes it for one of its own."""


class Killed(BaseException):
    """The program is gone at this instant: nothing of it runs any more."""


def quick_config(*changes: str) -> Config:
    return small_config(*QUICK, *PORTS, *changes)


def impacts_of(folder: SessionFolder) -> list[Impact]:
    """The impacts of a folder, opened in this process: the tests wrote them."""
    return [impact_in(folder.path / IMPACTS / f"{number:05d}.h5", number)[0] for number in folder.impact_numbers()]


def allowed_mn(config: Config) -> float:
    k1, k2 = config.rig.spring_stiffness()
    step = config.rig.limits.largest_approach_step_um * k1 * k2 / (k1 + k2) * 1e-3
    return config.rig.limits.load_mn + step


@dataclass
class Outcome:
    """What one run came to.

    Attributes
    ----------
    error
        What ended it, None if it came to its end.
    reads
        All that the operator reads of it, as the program prints it.
    made_s, noticed_s, apart_s
        Rig time when the last fault took effect, when the error reached the runner, and when the surfaces were first
        apart from then on (NaN: never).
    further_um
        How far the stage went on towards contact after that.
    """

    error: BaseException | None = None
    reads: str = ""
    made_s: float = float("nan")
    noticed_s: float = float("nan")
    apart_s: float = float("nan")
    further_um: float = 0.0
    _from_um: float = field(default=float("nan"), repr=False)


class FaultyBench:
    """A small session in a folder, and the handles to make things happen."""

    def __init__(
        self, path: Path, config: Config, seed: int = 1, wires: bool = False, round_trip_s: float = 0.0
    ) -> None:
        self.config = config
        self.path = path
        tcp = isinstance(config.rig.parts.load_cell, AmplifierTcp)
        self.amplifier_wire = DisturbedWire(foreign_tcp if tcp else foreign_rtu, seed)
        self.stage_wire = DisturbedWire(foreign_line, seed + 1)
        self.rig = emulated_rig(
            config,
            seed=seed,
            wires=wires,
            amplifier_wire=self.amplifier_wire,
            stage_wire=self.stage_wire,
            round_trip_s=round_trip_s,
        )
        self.controller, self.amplifier, self.recorder = self.rig.controller, self.rig.amplifier, self.rig.recorder
        self._version = self.controller.version
        self.watching = Watching()
        self.runner: SessionRunner | None = None
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._checks: dict[tuple[State, int], int] = {}
        self._waiting: list[tuple[State, int, int, Callable[[], None]]] = []
        self._pauses_s = 0.0
        self._outcome = Outcome()
        self._ends_s = LONGEST_S
        self.mends: list[Callable[[], object]] = []
        self._watch_time()
        self._watch_load()
        SessionFolder.create(path, header_of(config, seed)).close()

    # --- making things happen -------------------------------------------------------------------------------

    def when(self, state: State, load_set: int, nth: int, action: Callable[[], None]) -> None:
        """Do something at the n-th look at the operator's keys within a state, at a step of the load plan."""
        self._waiting.append((state, load_set, nth, action))

    def after(self, delay_s: float, action: Callable[[], None]) -> None:
        """Do something a while from now, in the midst of whatever goes on then."""
        self._due.append((self.rig.clock.now() + delay_s, action))

    def happens(self, at_s: float) -> None:
        """Note when the fault takes effect."""
        self._outcome.made_s = at_s

    def pause(self, seconds: float) -> None:
        """Have the operator pause the session for a while, from the next look at the keys on where he may."""
        self._pauses_s = seconds

    def _stay(self, hold: Callable[[], None], seconds: float) -> None:
        end = self.rig.clock.now() + seconds
        while self.rig.clock.now() < end:
            hold()
            self.rig.clock.sleep(POLL_S)

    def kill(self) -> None:
        """End the program here: what it still tries to send does not leave it."""
        self.amplifier_wire.plugged = self.stage_wire.plugged = False
        raise Killed

    def mend(self) -> None:
        """Repair everything."""
        self._due.clear()
        self._waiting.clear()
        while self.mends:
            self.mends.pop()()
        self.amplifier_wire.mend()
        self.stage_wire.mend()
        self.amplifier.fault = None
        self.amplifier.identity = 14
        self.rig.physics.load_cell.fault = None
        self.rig.physics.push(0.0)
        self.controller.stalled = False
        self.controller.version = self._version
        self.controller.ends_um = (-200.0, 11800.0)
        self.controller.restore_power()
        self.recorder.serial_number = "01D2E3F4"
        self.recorder._faults.clear()
        self.recorder.power_up()
        self.recorder.bus.plug(self.recorder)
        self.recorder.bus.ports[0].taken = False

    # --- running --------------------------------------------------------------------------------------------

    def run(self, control=None) -> Outcome:
        """Carry the session on from wherever its folder says; the rig has kept its own state meanwhile."""
        self._outcome = Outcome()
        self._ends_s = self.rig.clock.now() + LONGEST_S
        self._checks.clear()
        self.rig.restore = lambda state: None  # hardware: the program's memory of it changes nothing
        with SessionFolder.open(self.path) as folder:
            bench = Bench(self.rig, Silent(), self.watching, control or self, lambda: truth_now(self.rig))
            self.runner = SessionRunner(self.config, folder, bench)
            leave = self.runner._leave_safely
            self.runner._leave_safely = lambda error: self._leaving(error, leave)
            try:
                keys = KeyControl(Console(file=io.StringIO()))
                with keys.listening() as self._keys:  # signals end it as they end the program
                    self.runner.run()
            except (RigError, RecordingError, Killed) as error:
                self._outcome.error = error
                self._outcome.reads = "; ".join([str(error), *getattr(error, "__notes__", ())])
        return self._outcome

    def check(self, hold) -> None:
        """Look at the operator's keys: nobody is there, but this is where things are made to happen."""
        progress = self.runner.progress
        key = (progress.state, progress.load_set)
        self._checks[key] = self._checks.get(key, 0) + 1
        for entry in list(self._waiting):
            state, load_set, nth, action = entry
            if (state, load_set) == key and self._checks[key] == nth:
                self._waiting.remove(entry)
                self.happens(self.rig.clock.now())
                action()
        if hold is not None and self._pauses_s:
            seconds, self._pauses_s = self._pauses_s, 0.0
            self._stay(hold, seconds)
        self._keys.check(hold)

    def accepted(self) -> dict[int, tuple]:
        """Everything that was accepted, to the last bit."""
        with SessionFolder.open(self.path) as folder:
            return {
                s.number: (s.load_set, s.load_before_mn, s.load_after_mn, s.acceleration.tobytes())
                for s in impacts_of(folder)
                if s.accepted
            }

    # --- watching -------------------------------------------------------------------------------------------

    def _leaving(self, error: BaseException, leave: Callable[[BaseException], None]) -> None:
        outcome = self._outcome
        outcome.noticed_s = self.rig.clock.now()
        outcome._from_um = self.rig.physics.micrometer.knob_um
        self._note_load()
        if not isinstance(error, Killed | Hang):
            leave(error)

    def _watch_time(self) -> None:
        clock = self.rig.clock
        sleep, sleep_until = clock.sleep, clock.sleep_until

        def passed() -> None:
            if clock.now() > self._ends_s:
                raise Hang
            while self._due and min(self._due, key=lambda due: due[0])[0] <= clock.now():
                due = min(self._due, key=lambda due: due[0])
                self._due.remove(due)
                due[1]()

        def watched_sleep(seconds: float) -> None:
            sleep(seconds)
            passed()
            if self.amplifier_wire.requests + self.stage_wire.requests > MOST_EXCHANGES:
                raise Hang

        def watched_sleep_until(time_s: float) -> None:
            sleep_until(time_s)
            passed()

        clock.sleep, clock.sleep_until = watched_sleep, watched_sleep_until

    def _watch_load(self) -> None:
        micrometer = self.rig.physics.micrometer
        moved = micrometer._moved

        def watched() -> None:
            moved()
            self._note_load()

        micrometer._moved = watched

    def _note_load(self) -> None:
        outcome = self._outcome
        if outcome.noticed_s != outcome.noticed_s:
            return
        if outcome.apart_s != outcome.apart_s and self.rig.physics.true_load_mn() == 0.0:
            outcome.apart_s = self.rig.clock.now()
        further = self.rig.physics.micrometer._knob_um - outcome._from_um
        outcome.further_um = max(outcome.further_um, further)
