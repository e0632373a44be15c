"""Carries a session out: a handler a state, everything that was done in the journal before the next thing begins.

The runner drives a `rig.Rig` and cannot tell which. It is a function of the session folder and the rig, so a
session that was killed at any instant goes on from its journal: at most the tap in flight is made again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from calibration.line import fit_line
from calibration.routine import calibrate, check_points
from daq.journal import SessionFolder
from daq.records import CalibrationPoints, Shot
from daq.trigger import NoTap, record_shot
from mesotap.config import Config
from mesotap.session.progress import NO_TAP, SAFE, SHOT, STARTED, Progress, progress_of
from mesotap.session.shots import judged_shot, shot_entry
from mesotap.session.states import Event, State
from rig import GaugeScale, Operator, Rig, RigError
from rig.interlock import Interlock

MISSES_IN_A_ROW = 5  # waits in vain after which the sensors are suspected
LONGEST_PRETENCE_OF_REST = 10  # times a load is set anew because it crept away while dwelling


class Control(Protocol):
    """The operator's wish to interrupt, asked for between steps."""

    def check(self, hold: Callable[[], None]) -> None:
        """Return at once, or stay while paused (calling ``hold`` now and then), or raise `SessionAborted`."""


class Uninterrupted:
    """A control that never interrupts."""

    def check(self, hold: Callable[[], None]) -> None:
        """Return at once."""


class Observer(Protocol):
    """Who watches a session."""

    def progress(self, state: State, text: str) -> None:
        """Something went on within a state."""

    def shot(self, shot: Shot, accepted: int, wanted: int) -> None:
        """A tap was recorded and judged."""


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything around the runner: the rig and the people."""

    rig: Rig
    operator: Operator
    observer: Observer
    control: Control
    annotate: Callable[[], dict[str, Any]] = dict
    """More to keep with each load that was set, such as the truth of a simulated rig."""


class SessionRunner:
    """Runs one session in its folder from wherever the journal leaves it.

    Parameters
    ----------
    config
        The configuration in force when the session began.
    folder
        The session's folder, locked for this program.
    bench
        Rig and people.
    """

    def __init__(self, config: Config, folder: SessionFolder, bench: Bench) -> None:
        self._config = config
        self._folder = folder
        self._bench = bench
        self._rig = bench.rig
        self._reconcile()
        self.progress: Progress = progress_of(folder.events())
        self._interlock = Interlock(
            self._rig,
            config.rig.limits,
            GaugeScale(config.rig.gauge_sensitivity_mv_per_mn),
            config.rig.spring_stiffness(),
        )
        self._handlers: dict[State, Callable[[], None]] = {
            State.CONNECT: self._connect,
            State.PRE_CALIBRATION: lambda: self._calibrate("before"),
            State.APPROACH: self._approach,
            State.SET_LOAD: self._set_load,
            State.LOCK: self._lock_and_dwell,
            State.TAP: self._tap,
            State.RETRACT: self._retract,
            State.POST_CALIBRATION: lambda: self._calibrate("after"),
        }

    def run(self) -> Progress:
        """Carry the session on until its file can be written.

        Every exit but the last state leaves the surfaces apart, and says so in the journal.

        Raises
        ------
        RigError
            What the rig or the interlock refused; the session can be resumed.
        SessionAborted
            The operator ended it; the session can be resumed.
        """
        if self.progress.state in (State.FILE, State.DONE):
            return self.progress
        self._open()
        try:
            if self.progress.pre is not None:
                self._use_scale(self.progress.pre)
            while self.progress.state in self._handlers:
                self._bench.control.check(self._hold)
                self._handlers[self.progress.state]()
        except BaseException as error:
            # SessionAborted and KeyboardInterrupt too: whatever the exit, the surfaces are taken apart
            self._leave_safely(error)
            raise
        finally:
            self._rig.close()
        return self.progress

    def finish(self) -> None:
        """Note that the session file was written."""
        if self.progress.state is State.FILE:
            self._done(Event.FILED)

    # --- the states -----------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Connect, and take the rig up where it was left, if it still is there."""
        for line in self._rig.open():
            self._tell(State.CONNECT, line)
        if self.progress.checkpoint:
            self._rig.restore(self.progress.checkpoint)
        if self.progress.contact is None:
            return
        self._interlock.contact = self.progress.contact
        if self.progress.pre is not None:
            self._use_scale(self.progress.pre)
        expected = self.progress.load_mn
        try:
            load = self._interlock.check()
        except RigError as error:
            self._leave_safely(error)
            self._rig.close()
            raise
        self._rig.restore(self.progress.checkpoint)  # looking must not have changed anything
        if self.progress.state in (State.LOCK, State.TAP) and abs(load - expected) > self._largest_change(expected):
            self._tell(
                State.CONNECT, f"the load is {load:.0f} mN, not the {expected:.0f} mN it was left at; it is set anew"
            )
            self._interlock.retract()
            self._note(SAFE)

    def _connect(self) -> None:
        self._done(Event.CONNECTED)

    def _calibrate(self, when: str) -> None:
        points = calibrate(
            self._rig,
            self._config.calibration,
            self._bench.operator.say,
            lambda done, total: self._tell(self.progress.state, f"weight {done} of {total}"),
        )
        complaints = check_points(points, self._config.calibration, self._config.rig.gauge_sensitivity_mv_per_mn)
        for complaint in complaints:
            self._bench.operator.say(f"Calibration {when} the test: {complaint}.")
        if complaints and when == "before":
            raise RigError(f"calibration before the test: {complaints[0]}")
        self._done(
            Event.CALIBRATED,
            load_mn=points.load_mn.tolist(),
            voltage_mv=points.voltage_mv.tolist(),
            time=points.time,
        )
        if when == "before":
            self._use_scale(points)

    def _approach(self) -> None:
        load = self._interlock.approach(lambda text: self._tell(State.APPROACH, text))
        contact = self._interlock.contact
        position = math.nan if contact is None else contact[0]
        self._done(Event.CONTACT, position_um=position if math.isfinite(position) else None, load_mn=load)

    def _set_load(self) -> None:
        target = self._target()
        load = self._interlock.set_load(
            target, self._config.mesotap.load_tolerance_mn, lambda text: self._tell(State.SET_LOAD, text)
        )
        self._interlock.lock()
        self._done(Event.LOADED, load_mn=load, truth=self._bench.annotate())

    def _lock_and_dwell(self) -> None:
        self._tell(State.LOCK, f"resting {self._config.mesotap.dwell_s:g} s at {self.progress.load_mn:.0f} mN")
        self._rig.clock.sleep(self._config.mesotap.dwell_s)
        load = self._interlock.check()
        moved = abs(load - self._target()) > self._largest_change(self._target())
        again = sum(e["event"] == Event.LOADED.value for e in self._events_of_this_load())
        self._done(Event.LOAD_MOVED if moved and again < LONGEST_PRETENCE_OF_REST else Event.SETTLED)

    def _tap(self) -> None:
        shots = [e for e in self._events_of_this_load() if e["event"] == SHOT]
        accepted = sum(bool(e["accepted"]) for e in shots)
        wanted = self._config.mesotap.impacts_per_load
        if accepted >= wanted:
            last = self.progress.load_set + 1 >= len(self._config.mesotap.load_plan_mn)
            self._done(Event.PLAN_DONE if last else Event.LOAD_DONE)
            return
        tries = self._tries_since_start(shots)
        if tries >= self._config.mesotap.tries_per_load:
            raise RigError(
                f"load {self._target():.0f} mN: {tries} taps gave {accepted} good ones of {wanted}; "
                f"the last was not used: {shots[-1]['reject_reason'] or 'accepted'}; change the tap, then resume"
            )
        before = self._interlock.read_load()
        if abs(before[0] - self._target()) > 2 * self._largest_change(self._target()):
            self._done(Event.LOAD_MOVED)
            return
        shot = self._record(before, self._what_was_wrong())
        if shot is not None:
            self._bench.observer.shot(shot, accepted + shot.accepted, wanted)

    def _record(self, before: tuple[float, float], hint: str) -> Shot | None:
        """Have one tap made, judge it, and put it on the disk; None if none came."""
        try:
            record = record_shot(
                self._rig.accelerometers,
                self._rig.impactor,
                self._rig.clock,
                self._config.daq.trigger,
                before[0],
                hint,
            )
        except NoTap as error:
            self._note(NO_TAP, reason=str(error))
            if self._missed_in_a_row() >= MISSES_IN_A_ROW:
                raise
            self._tell(State.TAP, str(error))
            return None
        place = (self._next_number(), self.progress.load_set, self._target())
        shot = judged_shot(record, before, self._interlock.read_load(), place, self._config, self._rig.accelerometers)
        checkpoint = self._rig.checkpoint()
        self._folder.write_shot(shot, checkpoint)
        self._note(SHOT, checkpoint, **shot_entry(shot))
        return shot

    def _retract(self) -> None:
        self._interlock.retract(lambda text: self._tell(State.RETRACT, text))
        self._done(Event.APART)

    # --- the journal ----------------------------------------------------------------------------------------

    def _done(self, event: Event, **details: Any) -> None:
        """Journal the event that ends the present state, and move on."""
        self._note(event.value, **details)

    def _note(self, event: str, checkpoint: dict[str, Any] | None = None, **details: Any) -> None:
        state = self._rig.checkpoint() if checkpoint is None else checkpoint
        entry = {"event": event, "at": self._rig.clock.utc(), **details, "rig": state}
        self._folder.append(entry)
        self.progress.apply(entry)

    def _reconcile(self) -> None:
        """Journal a shot that reached the disk just before the program was killed."""
        known = {e["number"] for e in self._folder.events() if e["event"] == SHOT}
        for number in self._folder.shot_numbers():
            if number not in known:
                shot, checkpoint = self._folder.read_shot(number)
                self._folder.append({"event": SHOT, "at": shot.time, **shot_entry(shot), "rig": checkpoint})
        self._folder.append({"event": STARTED})

    def _next_number(self) -> int:
        numbers = self._folder.shot_numbers()
        return numbers[-1] + 1 if numbers else 0

    def _events_of_this_load(self) -> list[dict[str, Any]]:
        """Entries since the present step of the load plan began."""
        events = self._folder.events()
        ends = [i for i, e in enumerate(events) if e["event"] == Event.LOAD_DONE.value]
        return events[ends[-1] + 1 :] if ends else events

    def _what_was_wrong(self) -> str:
        """Why the last tap at this load was not used; empty if it was."""
        taps = [e for e in self._events_of_this_load() if e["event"] in (SHOT, NO_TAP)]
        if not taps:
            return ""
        return str(taps[-1]["reason"] if taps[-1]["event"] == NO_TAP else taps[-1]["reject_reason"])

    def _missed_in_a_row(self) -> int:
        """How often nothing was felt since the last tap or the last start."""
        missed = 0
        for entry in reversed(self._folder.events()):
            if entry["event"] != NO_TAP:
                break
            missed += 1
        return missed

    def _tries_since_start(self, shots: list[dict[str, Any]]) -> int:
        """Taps at this load since the program was started last: who resumes may try again."""
        events = self._folder.events()
        start = max(i for i, e in enumerate(events) if e["event"] == STARTED)
        since = {e["number"] for e in events[start:] if e["event"] == SHOT}
        return sum(e["number"] in since for e in shots)

    # --- the rig --------------------------------------------------------------------------------------------

    def _target(self) -> float:
        return self._config.mesotap.load_plan_mn[self.progress.load_set]

    def _largest_change(self, load_mn: float) -> float:
        quality = self._config.daq.quality
        allowed = max(quality.largest_load_change_mn, quality.largest_load_change_percent / 100 * load_mn)
        return max(allowed, self._config.mesotap.load_tolerance_mn)

    def _use_scale(self, points: CalibrationPoints) -> None:
        self._interlock.scale = fit_line(points, self._config.calibration.weight_uncertainty_mn).scale

    def _hold(self) -> None:
        """Keep watch over the load while paused."""
        if self.progress.contact is not None:
            self._interlock.check()

    def _tell(self, state: State, text: str) -> None:
        self._bench.observer.progress(state, text)

    def _leave_safely(self, error: BaseException) -> None:
        troubles = self._interlock.make_safe()
        for trouble in troubles:
            error.add_note(trouble)
        if not troubles:
            self._note(SAFE, reason=str(error) or type(error).__name__)
