"""The people of a session that the console runs: what a terminal shows and asks goes over the link instead."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from daq.journal import SessionFolder
from daq.records import Impact
from mesotap.configuration.config import Config
from mesotap.console.frames import Message
from mesotap.operator.console import ABORT_KEY, PAUSE_KEY, Keyboard, KeyControl
from mesotap.operator.people import Filing, People
from mesotap.operator.terminal import SafeConsole
from mesotap.session.entries import progress_in
from mesotap.session.hand_verdicts import HandVerdict, verdicts_in
from mesotap.session.runner import Observer
from mesotap.session.states import State
from mesotap.session.watching import GaugeWatch
from rig import Operator, RigError
from rig.attention import Hold

LOAD_PERIOD_S = 0.04
"""Between two loads that are told: 25 a second are as many as an eye follows."""

MOST_SAMPLES = 2**18
"""Of a record that is told, each channel: a page draws no more."""

LOOK_S = 0.02
LEFT_OUT = (Filing.DIAGNOSIS,)
"""What STOP ends once a session is filed."""

MADE_AGAIN = (Filing.REPORT, Filing.DIAGNOSIS)
"""What ends with the console; whoever resumes the session has it made."""

CONSOLE_WIDTH = 160

Tell = Callable[..., None]


class PageKeys(Keyboard):
    """Keys pressed in a page; whoever waits for one is woken when it comes."""

    def __init__(self) -> None:
        super().__init__()
        self._came = threading.Condition()

    @property
    def there(self) -> bool:
        """Whether somebody can press keys: a page may be opened at any time."""
        return True

    def press(self, key: str) -> None:
        """Press a key; called by the thread that hears it."""
        with self._came:
            self._pressed.append(key)
            self._came.notify_all()

    def pressed(self, keys: str, wait_s: float = 0.0) -> str:
        """Return the first of ``keys`` that was pressed and not yet asked for, waiting at most so long; or nothing."""
        with self._came:
            self._came.wait_for(lambda: any(key in keys for key in self._pressed), wait_s)
            for i, key in enumerate(self._pressed):
                if key in keys:
                    return self._pressed.pop(i)
        return ""


class PageControl(KeyControl):
    """Pause and STOP from a page, signals as at a terminal; a console that has gone ends the session."""

    def __init__(self, console: Console, keys: PageKeys, tell: Tell) -> None:
        super().__init__(console, keys)
        self._tell = tell

    def end(self, by: str) -> None:
        """Have the session end where it next looks; called by the thread that hears it."""
        if not self._ended:
            self._ended = by

    def _pause(self, hold: Hold) -> None:
        self._tell({"kind": "paused", "on": True, "watched": hold()})
        try:
            super()._pause(hold)
        finally:
            self._tell({"kind": "paused", "on": False})


class PageOperator(Operator):
    """The person at the bench, asked in a page.

    Parameters
    ----------
    tell
        Sends a message.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._asked = 0
        self._answered = threading.Condition()
        self._answer = 0
        self._gone = False

    def answer(self, number: int) -> None:
        """Hear that what was asked is done; called by the thread that hears it."""
        with self._answered:
            self._answer = number
            self._answered.notify_all()

    def lost(self) -> None:
        """Hear that the console has gone, and everybody who could be asked with it."""
        with self._answered:
            self._gone = True
            self._answered.notify_all()

    def say(self, text: str) -> None:
        """Show one sentence."""
        self._tell({"kind": "said", "text": text})

    def wait_ready(self, text: str) -> None:
        """Show what to do, and wait until somebody says that it is done."""
        with self._asking(text, "do") as number:
            while not self._done(number):
                self.idle()

    def turn(self, text: str, step_um: float, live: Callable[[], tuple[str, bool]]) -> None:
        """Show what to turn, and the load meanwhile, until somebody says that it is done."""
        with self._asking(text, "turn") as number:
            while True:
                shown, stop = live()
                self._tell({"kind": "live", "id": number, "text": shown, "stop": stop})
                if self._done(number):
                    return
                self.idle()

    @contextlib.contextmanager
    def _asking(self, text: str, how: str) -> Iterator[int]:
        self._asked += 1
        self._tell({"kind": "ask", "id": self._asked, "text": text, "how": how})
        try:
            yield self._asked
        finally:
            self._tell({"kind": "asked", "id": self._asked})

    def _done(self, number: int) -> bool:
        with self._answered:
            if self._answer != number and not self._gone:
                self._answered.wait(LOOK_S)
            if self._gone:
                raise RigError("operator: the console has gone, so nobody can be asked to do it")
            return self._answer == number


class PageGauge(GaugeWatch):
    """Tells what the gauge reads, not more often than anybody sees."""

    def __init__(self, tell: Tell, now: Callable[[], float] = time.monotonic) -> None:
        self._tell, self._now = tell, now
        self._told_s = -np.inf

    def load(self, load_mn: float) -> None:
        """Tell the load."""
        now = self._now()
        if now - self._told_s >= LOAD_PERIOD_S:
            self._told_s = now
            self._tell({"kind": "load", "mn": load_mn})

    def point(self, load_mn: float, voltage_mv: float) -> None:
        """Tell one point of a calibration."""
        self._tell({"kind": "point", "weight_mn": load_mn, "voltage_mv": voltage_mv})

    def locked(self, load_mn: float) -> None:
        """Tell the load at which the stage was clamped."""
        self._tell({"kind": "locked", "mn": load_mn})

    def aim(self, load_set: int, target_mn: float) -> None:
        """Tell which step of the load plan is set."""
        self._tell({"kind": "aim", "load_set": load_set})


class PageObserver(Observer):
    """Tells what goes on."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell

    def progress(self, state: State, text: str) -> None:
        """Tell where the session is."""
        self._tell({"kind": "state", "state": state.name, "words": state.value, "text": text})

    def impact(self, impact: Impact, accepted: int, wanted: int) -> None:
        """Tell of a tap, with its record."""
        self._tell({"kind": "count", "accepted": accepted, "wanted": wanted, "load_set": impact.load_set})
        self._tell(*tap_message(impact))


def tap_message(impact: Impact) -> tuple[Message, bytes]:
    """Return what a page and the analysis need of a tap: numbers are A, B and the hammer's force if any, float64."""
    rows = [impact.acceleration] if impact.force is None else [impact.acceleration, impact.force[None]]
    shown = np.ascontiguousarray(np.concatenate(rows)[:, :MOST_SAMPLES], dtype=np.float64)
    message: Message = {
        "kind": "tap",
        "told_at": time.time(),
        "number": impact.number,
        "load_set": impact.load_set,
        "target_mn": impact.target_load_mn,
        "before_mn": impact.load_before_mn,
        "after_mn": impact.load_after_mn,
        "before_mv": impact.voltage_before_mv,
        "after_mv": impact.voltage_after_mv,
        "time": impact.time,
        "rate_hz": impact.sample_rate_hz,
        "pretrigger": impact.pretrigger,
        "samples": shown.shape[1],
        "peak_force_n": None if impact.force is None else peak_force(impact.force),
        "accepted": impact.accepted,
        "reason": impact.reject_reason,
        "judged": {k: v for k, v in impact.extra.items() if isinstance(v, int | float | str) or v is None},
    }
    return message, shown.tobytes()


def peak_force(force: NDArray[np.float64]) -> float:
    """Return the largest departure of a force (n,) from what it is at rest, N."""
    return float(np.max(np.abs(force - np.median(force))))


class PagePeople:
    """All of them, and what the console says to them.

    Parameters
    ----------
    tell
        Sends a message, with its numbers.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self.keys = PageKeys()
        console = SafeConsole(file=io.StringIO(), width=CONSOLE_WIDTH, force_terminal=False)
        self.control = PageControl(console, self.keys, tell)
        self.operator = PageOperator(tell)
        self._verdicts: list[HandVerdict] = []
        self._step: Filing | None = None
        self.people = People(
            self.operator, self.control, self._watching, console, PageGauge(tell), self._take_verdicts, self._filing
        )

    def heard(self, message: Message) -> None:
        """Hear one message of the console; called by the thread that reads."""
        what = message.get("do")
        if what == "stop":
            self._end("STOP in the console", LEFT_OUT)
        elif what == "pause":
            self.keys.press(PAUSE_KEY)
        elif what == "answer":
            self.operator.answer(int(message["id"]))
        elif what == "judge":
            self._verdicts.append(
                HandVerdict(int(message["number"]), bool(message["accepted"]), str(message["reason"]))
            )

    def lost(self) -> None:
        """Hear that the console has gone, or hangs."""
        self.operator.lost()
        self._end("the console, which has gone or hangs", MADE_AGAIN)

    @property
    def filed(self) -> bool:
        """Whether the session is complete, and only what is worked out from it may be missing."""
        return self._step in MADE_AGAIN

    def _end(self, by: str, interrupted: tuple[Filing, ...]) -> None:
        self.control.end(by)
        self.keys.press(ABORT_KEY)  # wakes whoever waits
        if self._step in interrupted:  # nobody looks any more whether it is to end
            os.kill(os.getpid(), signal.SIGINT)

    def _filing(self, step: Filing, text: str) -> None:
        self._step = step
        self._tell({"kind": "filing", "step": step.name, "words": step.value, "text": text})

    def _take_verdicts(self) -> list[HandVerdict]:
        taken, self._verdicts = self._verdicts, []
        for verdict in taken:
            self._tell({"kind": "judged", **verdict.entry()})
        return taken

    @contextlib.contextmanager
    def _watching(self, folder: SessionFolder, config: Config) -> Iterator[Observer]:
        progress = progress_in(folder, len(config.mesotap.load_plan_mn))
        self._tell(
            {
                "kind": "begun",
                "folder": str(folder.path.resolve()),
                "created": folder.header["created"],
                "config": folder.header["config"],
                "state": progress.state.name,
                "load_set": progress.load_set,
                "plan_mn": config.mesotap.load_plan_mn,
                "wanted": config.mesotap.taps_per_load,
                "used": config.mesotap.impacts_per_load,
                "limit_mn": config.rig.limits.load_mn,
                "force_limit": config.daq.quality.largest_force_ratio,
                "simulated": bool(folder.header.get("simulated")),
            }
        )
        for when, points in (("PRE_CALIBRATION", progress.pre), ("POST_CALIBRATION", progress.post)):
            if points is not None:
                rows = [list(pair) for pair in zip(points.load_mn.tolist(), points.voltage_mv.tolist(), strict=True)]
                self._tell({"kind": "points", "state": when, "time": points.time, "points": rows})
        by_hand = {e["number"]: e for e in verdicts_in(folder.events())}
        for impact in folder.impacts():  # taps of an earlier run
            message, numbers = tap_message(impact)
            counts = by_hand[impact.number]
            self._tell(
                {**message, "accepted": counts["accepted"], "reason": counts["reject_reason"], "old": True}, numbers
            )
        self._tell({"kind": "told"})
        yield PageObserver(self._tell)
