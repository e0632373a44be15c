"""Carries a session out: a handler a state, everything that was done in the journal before the next thing begins.

The runner drives a `rig.Rig` and cannot tell which. It is a function of the session folder and the rig, so a
session that was killed at any instant goes on from its journal: at most the tap in flight is made again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from calibration.line import fit_line
from calibration.routine import calibrate, check_points, read_empty
from daq.errors import RecordingError, UnwrittenError
from daq.journal import SessionFolder
from daq.records import CalibrationPoints, Impact
from daq.trigger import NoTap, record_impact
from mesotap.configuration.config import Config
from mesotap.session.guardian import Guardian
from mesotap.session.hand_verdicts import BY_HAND, IMPACT, HandVerdict, verdicts_in
from mesotap.session.impacts import impact_entry, judged_impact
from mesotap.session.progress import NO_TAP, NOTES, SAFE, STARTED, ZERO, Progress, progress_of
from mesotap.session.states import Event, State
from mesotap.session.watching import GaugeWatch
from rig import GaugeScale, Operator, Rig, RigError
from rig.attention import Attention, Hold
from rig.interlock import Interlock, SafeState
from rig.settling import rest
from rig.watch import LoadWatch

MISSES_IN_A_ROW = 5  # waits in vain after which the sensors are suspected
MOST_SETTINGS = 10  # times a load is set, since the last start, before it counts as creeping
DWELL_SLICE_S = 1.0
NOTHING_MOVED = "nothing was moved"
GOES_ON = "'mesotap resume' goes on"


class Control(Protocol):
    """The operator's wish to interrupt, asked for between steps."""

    def check(self, hold: Hold | None) -> None:
        """Return at once, or stay while paused (calling ``hold`` now and then), or raise `SessionAborted`.

        Where ``hold`` is None, in the midst of a move or a reading, it does not stay.
        """


class Uninterrupted:
    """A control that never interrupts."""

    def check(self, hold: Hold | None) -> None:
        """Return at once."""


class Observer(Protocol):
    """Who watches a session."""

    def progress(self, state: State, text: str) -> None:
        """Something went on within a state."""

    def impact(self, impact: Impact, accepted: int, wanted: int) -> None:
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
    guardian: Guardian = field(default_factory=Guardian)
    gauge: GaugeWatch = field(default_factory=GaugeWatch)
    verdicts: Callable[[], Sequence[HandVerdict]] = tuple
    """Takes what was decided by hand on taps since it was called last."""


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
        self._connected = False
        self._reconcile()
        self.progress: Progress = progress_of(folder.events())
        self._interlock = Interlock(
            self._rig,
            config.rig.limits,
            GaugeScale(config.rig.gauge_sensitivity_mv_per_mn),
            config.rig.spring_stiffness(),
        )
        self._interlock.shown = bench.gauge.load
        self._watch = LoadWatch(self._rig, self._interlock, config.rig.limits.stale_reading_s)
        self._attention = Attention(self._rig, self._watch, bench.guardian.beat, bench.control.check)
        self._attention.attend(bench.operator)
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
        error: BaseException | None = None
        try:
            try:
                self._carry_on()
            finally:
                self._attention.leaving = True  # from here on nothing interrupts
                self._bench.guardian.leave()
        except BaseException as caught:
            # SessionAborted and KeyboardInterrupt too: whatever the exit, the surfaces are taken apart
            error = caught
            self._leave_safely(error)
            raise
        finally:
            self._let_go(error)
        return self.progress

    def _carry_on(self) -> None:
        self._interlock.expect_contact(self.progress.felt_before)
        if self.progress.pre is not None:
            self._use_scale(self.progress.pre)
        self._open()
        while self.progress.state in self._handlers:
            self._bench.control.check(self._attention.hold)
            self._take_verdicts()
            self._handlers[self.progress.state]()
        self._take_verdicts()

    def _let_go(self, error: BaseException | None) -> None:
        """Let go of guardian and rig; what fails hides nothing that was said before."""
        for end in (self._bench.guardian.dismiss, self._rig.close):
            try:
                end()
            except Exception as failure:
                if error is None:
                    raise
                error.add_note(str(failure))

    def finish(self) -> None:
        """Note that the session file was written."""
        if self.progress.state is State.FILE:
            self._done(Event.FILED)

    # --- the states -----------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Connect, and take the rig up where it was left, if it still is there."""
        self._take_up()
        self._interlock.contact = self.progress.contact  # whoever leaves from here on knows that there may be a load
        for line in self._rig.open():
            self._tell(State.CONNECT, line)
        self._connected = True
        self._attention.watch_moves()
        self._bench.guardian.start()
        self._rig.stage.read()  # a stage that does not know where it is says so before anything is begun
        self._take_up()  # connecting must not have changed anything
        self._watch.restart()
        if self.progress.contact is None:
            return
        self._bench.guardian.arm(True)
        expected = self.progress.load_mn
        load = self._interlock.check()
        self._take_up()  # nor looking
        self._interlock.forget_readings()
        self._watch.restart()
        moved = self.progress.state in (State.LOCK, State.TAP) and abs(load - expected) > self._largest_change(expected)
        if moved:
            self._tell(
                State.CONNECT, f"the load is {load:.0f} mN, not the {expected:.0f} mN it was left at; it is set anew"
            )
        if moved or self.progress.doubtful:
            self._take_apart(State.CONNECT)
            self._note(SAFE)

    def _take_up(self) -> None:
        """Give a simulated rig the state it had; a real one has kept its own."""
        if not self.progress.checkpoint:
            return
        try:
            self._rig.restore(self.progress.checkpoint)
        except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
            raise RecordingError(
                f"{self._folder.path}: the kept state of the simulated rig is damaged ({type(error).__name__}: {error})"
            ) from error

    def _connect(self) -> None:
        self._done(Event.CONNECTED)

    def _calibrate(self, when: str) -> None:
        points = calibrate(
            self._rig,
            self._config.calibration,
            self._bench.operator.say,
            lambda done, total: self._tell(self.progress.state, f"weight {done} of {total}"),
            lambda load, reading: self._bench.gauge.point(load, reading.voltage_mv),
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
            **({} if points.elapsed_s is None else {"elapsed_s": points.elapsed_s.tolist()}),
        )
        if when == "before":
            self._use_scale(points)

    def _approach(self) -> None:
        if self.progress.was_loaded:  # apart again between two loads: what the gauge reads now is its zero
            reading = read_empty(self._rig, self._config.calibration)
            self._note(ZERO, voltage_mv=reading.voltage_mv, time=self._rig.clock.utc())
        self._attention.watch_moves()  # by now it is known how long a reply takes, whatever was asked when connecting
        self._bench.guardian.arm(True)
        load = self._interlock.approach(lambda text: self._tell(State.APPROACH, text))
        contact = self._interlock.contact
        position = math.nan if contact is None else contact[0]
        self._done(Event.CONTACT, position_um=position if math.isfinite(position) else None, load_mn=load)

    def _zero_is_due(self) -> bool:
        """Whether the surfaces are to be taken apart before this load, to read the gauge without one."""
        every = self._config.calibration.zero_every_loads
        if every is None or self.progress.load_set == 0 or self.progress.load_set % every:
            return False
        return all(e["event"] != ZERO for e in self._events_of_this_load())

    def _set_load(self) -> None:
        if self._zero_is_due():
            self._take_apart(State.SET_LOAD)
            self._note(SAFE)
            return
        target = self._target()
        self._bench.gauge.aim(self.progress.load_set, target)
        load = self._interlock.set_load(
            target, self._config.mesotap.load_tolerance_mn, lambda text: self._tell(State.SET_LOAD, text)
        )
        self._interlock.lock()
        self._done(Event.LOADED, load_mn=load, truth=self._bench.annotate())
        self._bench.gauge.locked(load)

    def _lock_and_dwell(self) -> None:
        left = self._config.mesotap.dwell_s
        while left > 0:
            self._wait(min(DWELL_SLICE_S, left))
            left -= DWELL_SLICE_S
            self._tell(State.LOCK, f"resting, {max(left, 0.0):.0f} s left at {self.progress.load_mn:.0f} mN")
        load = self._interlock.check()
        moved = abs(load - self._target()) > self._largest_change(self._target())
        if moved:
            self._refuse_a_creeping_load(load)
        self._done(Event.LOAD_MOVED if moved else Event.SETTLED)

    def _tap(self) -> None:
        impacts = self._impacts_of_this_load()
        accepted = sum(bool(e["accepted"]) for e in impacts)
        wanted = self._config.mesotap.taps_per_load
        if accepted >= wanted:
            last = self.progress.load_set + 1 >= len(self._config.mesotap.load_plan_mn)
            self._done(Event.PLAN_DONE if last else Event.LOAD_DONE)
            return
        tries = self._tries_since_start(impacts)
        if tries >= self._config.mesotap.tries_per_load:
            raise RigError(
                f"load {self._target():.0f} mN: {tries} taps gave {accepted} good ones of {wanted}; "
                f"the last was not used: {impacts[-1]['reject_reason'] or 'accepted'}; see to that, then resume"
            )
        before = self._interlock.read_load()
        if abs(before[0] - self._target()) > 2 * self._largest_change(self._target()):
            self._refuse_a_creeping_load(before[0])
            self._done(Event.LOAD_MOVED)
            return
        self._tell(State.TAP, f"waiting for tap {accepted + 1} of {wanted} at {self._target():.0f} mN")
        impact = self._record(before, self._what_was_wrong())
        if impact is not None:
            self._bench.observer.impact(impact, accepted + impact.accepted, wanted)

    def _refuse_a_creeping_load(self, load_mn: float) -> None:
        """Give up on a load that has to be set anew time and again."""
        events = self._since_start(self._events_of_this_load())
        if sum(e["event"] == Event.LOADED.value for e in events) >= MOST_SETTINGS:
            raise RigError(
                f"load {self._target():.0f} mN: it was set {MOST_SETTINGS} times and is {load_mn:.0f} mN again; "
                "check the clamp, the specimen, and the amplifier's filter (settling_s)"
            )

    def _record(self, before: tuple[float, float], hint: str) -> Impact | None:
        """Have one tap made, judge it, and put it on the disk; None if none came."""
        self._watch.taps = True
        try:
            record = record_impact(
                self._rig.accelerometers,
                self._rig.impactor,
                self._rig.clock,
                self._config.daq.trigger,
                before[0],
                hint,
                self._attention.idle,
                self._attention.heed,
            )
        except NoTap as error:
            self._note(NO_TAP, reason=str(error))
            if self._missed_in_a_row() >= MISSES_IN_A_ROW:
                raise
            self._tell(State.TAP, str(error))
            return None
        finally:
            self._watch.taps = False
        place = (self._next_number(), self.progress.load_set, self._target())
        impact = judged_impact(
            record, before, self._interlock.read_load(), place, self._config, self._rig.accelerometers
        )
        checkpoint = self._rig.checkpoint()
        self._folder.write_impact(impact, checkpoint)
        self._note(IMPACT, checkpoint, **impact_entry(impact))
        return impact

    def _retract(self) -> None:
        self._take_apart(State.RETRACT)
        self._done(Event.APART)

    def _take_apart(self, state: State) -> None:
        doubted = self._interlock.retract(lambda text: self._tell(state, text))
        if doubted:
            raise RigError(f"retract: the gauge {doubted}; look whether the surfaces are apart, then resume")
        self._bench.guardian.arm(False)

    # --- the journal ----------------------------------------------------------------------------------------

    def _done(self, event: Event, **details: Any) -> None:
        """Journal the event that ends the present state, and move on."""
        self._note(event.value, **details)

    def _note(self, event: str, checkpoint: dict[str, Any] | None = None, **details: Any) -> None:
        state = self._rig.checkpoint() if checkpoint is None else checkpoint
        entry = {"event": event, "at": self._rig.clock.utc(), **details, "rig": state}
        self._folder.append(entry)
        self.progress.apply(entry)
        self._watch.restart()

    def _reconcile(self) -> None:
        """Journal an impact that reached the disk just before the program was killed."""
        events = self._folder.events()
        known = {e["number"] for e in events if e["event"] == IMPACT}
        there = set(self._folder.impact_numbers())
        if known - there:
            raise RecordingError(
                f"{self._folder.path}: the journal lists impact {min(known - there):05d}, but its file is gone; "
                "put it back before anything is written"
            )
        for number in sorted(there - known):
            impact, checkpoint = self._folder.read_impact(number)
            entry = {"event": IMPACT, "at": impact.time, **impact_entry(impact)}
            # a rig that was brought into its safe state since then is no longer where the impact left it
            later = next((e["event"] for e in reversed(events) if e["event"] not in NOTES), "") == SAFE
            self._folder.append(entry if later else {**entry, "rig": checkpoint})
        if progress_of(events).state is not State.DONE:
            self._folder.append({"event": STARTED})

    def _next_number(self) -> int:
        numbers = self._folder.impact_numbers()
        return numbers[-1] + 1 if numbers else 0

    def _events_of_this_load(self) -> list[dict[str, Any]]:
        """Entries since the present step of the load plan began."""
        events = self._folder.events()
        ends = [i for i, e in enumerate(events) if e["event"] == Event.LOAD_DONE.value]
        return events[ends[-1] + 1 :] if ends else events

    def _impacts_of_this_load(self) -> list[dict[str, Any]]:
        """Entries of the taps at the present step of the load plan, with the verdicts that count."""
        numbers = {e["number"] for e in self._events_of_this_load() if e["event"] == IMPACT}
        return [e for e in verdicts_in(self._folder.events()) if e["number"] in numbers]

    def _take_verdicts(self) -> None:
        """Journal what was decided by hand since the last look; a tap that is not there is passed over."""
        for verdict in self._bench.verdicts():
            if any(e["event"] == IMPACT and e["number"] == verdict.number for e in self._folder.events()):
                self._folder.append({"event": BY_HAND, "at": self._rig.clock.utc(), **verdict.entry()})

    def _what_was_wrong(self) -> str:
        """Why the last tap at this load was not used; empty if it was."""
        taps = [e for e in self._events_of_this_load() if e["event"] in (IMPACT, NO_TAP)]
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

    def _tries_since_start(self, impacts: list[dict[str, Any]]) -> int:
        """Taps at this load since the program was started last: who resumes may try again."""
        events = self._folder.events()
        start = max(i for i, e in enumerate(events) if e["event"] == STARTED)
        tried = {e["number"] for e in events[start:] if e["event"] == IMPACT}
        return sum(e["number"] in tried for e in impacts)

    def _since_start(self, entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Those of the entries that were written since the program was started last."""
        events = self._folder.events()
        start = max(i for i, e in enumerate(events) if e["event"] == STARTED)
        return [e for e in entries if e in events[start:]]

    # --- the rig --------------------------------------------------------------------------------------------

    def _target(self) -> float:
        return self._config.mesotap.load_plan_mn[self.progress.load_set]

    def _largest_change(self, load_mn: float) -> float:
        quality = self._config.daq.quality
        allowed = max(quality.largest_load_change_mn, quality.largest_load_change_percent / 100 * load_mn)
        return max(allowed, self._config.mesotap.load_tolerance_mn)

    def _use_scale(self, points: CalibrationPoints) -> None:
        self._interlock.scale = fit_line(points, self._config.calibration.typical_weight_error_mn(points.load_mn)).scale
        self._bench.guardian.scale(self._interlock.scale)

    def _wait(self, seconds: float) -> None:
        """Let time pass, a little at a time."""
        rest(self._rig.clock, seconds, self._attention.idle)

    def _tell(self, state: State, text: str) -> None:
        """Show what goes on, and heed a wish to interrupt."""
        self._bench.observer.progress(state, text)
        if state is not State.CONNECT:
            self._bench.control.check(self._attention.hold)
        self._bench.guardian.beat()

    def _leave_safely(self, error: BaseException) -> None:
        """Take the surfaces apart, say in the journal and with the error whether that worked."""
        if not self._connected and self._interlock.contact is None:
            safe = SafeState((NOTHING_MOVED,), 0.0)
        else:
            # also where not every device was connected: the load goes first, complaints come after it
            safe = self._interlock.make_safe()
        error.add_note(safe.sentence().replace(f": {error}", ""))  # what was said need not be said again
        if self._folder.path.is_dir():
            error.add_note(GOES_ON)
        if not safe.troubles:
            self._bench.guardian.arm(False)
        try:
            self._take_verdicts()
            self._note(SAFE, reason=str(error) or type(error).__name__, troubles=list(safe.troubles))
        except UnwrittenError as unwritten:
            alike = isinstance(error, UnwrittenError) and error.cause == unwritten.cause
            error.add_note(f"nor can {unwritten.path} be written" if alike else str(unwritten))
