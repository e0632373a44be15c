"""What the pages show of the running session, part by part; each part is whole, so that a page may miss any number.

Parts: ``state`` (where the session is, what to do), ``load``, ``calibration``, ``taps`` (verdict and modes of each),
``loads`` (what each load came to), ``response`` (what a hammer showed so far), and the record of the tap that was
made last.
"""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mesotap.console.frames import Message, frame
from mesotap.console.last_words import APART, last_safe
from mesotap.console.records import record_frame
from mesotap.console.what_to_do import AFTERWARDS, BY_ITSELF, FILING, FOLDER_GONE, IDLE, VIEW_IDLE, WHAT_TO_DO
from mesotap.session.guardian import DIED, GOES_ON, SAYS

REPORT, DIAGNOSIS = "report.html", "diagnosis.html"
RECORDS_KEPT = 64
LINES_KEPT = 30

Show = Callable[[str, bytes], None]


def session_id(folder: Path) -> str:
    """Return by what a page names a session: nothing that a page sends is ever part of a path."""
    return hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:20]


class Board:
    """The running session, or the last one.

    Parameters
    ----------
    show
        Called with a part's name and its frame whenever it has changed.
    show_record
        Called with the frame of a tap's record.
    """

    def __init__(self, show: Show, show_record: Callable[[bytes], None]) -> None:
        self._show, self._show_record = show, show_record
        self.folder: Path | None = None
        self.state: dict[str, Any] = {}
        self.load: dict[str, Any] = {}
        self.calibration: dict[str, Any] = {}
        self.taps: dict[int, dict[str, Any]] = {}
        self.loads: dict[str, Any] = {}
        self.response: dict[str, Any] = {}
        self.records: dict[int, bytes] = {}
        self._kept: deque[int] = deque()
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self.folder = None
        self.state = {
            "running": False, "state": "", "words": "no session", "text": "", "next": IDLE, "ask": None,
            "paused": False, "watched": False, "said": [], "ended": None, "plan_mn": [], "load_set": 0, "wanted": 0,
            "accepted": 0, "used": 0,
            "limit_mn": None, "force_limit": None, "locked_mn": None, "simulated": False, "session": None, "name": "",
            "reported": False, "diagnosed": False, "viewing": False, "viewed": False, "alarm": "",
            "stopping": False,
        }  # fmt: skip
        self.load = {"mn": None, "at": None}
        self.calibration = {"before": [], "after": [], "compared": None}
        self.taps, self.loads, self.records = {}, {"loads": [], "theory": [], "why": ""}, {}
        self.response = {}
        self._kept.clear()

    def parts(self) -> dict[str, dict[str, Any]]:
        """Every part as it is now."""
        return {
            "state": self.state,
            "load": self.load,
            "calibration": self.calibration,
            "taps": {"taps": list(self.taps.values())},
            "loads": self.loads,
            "response": self.response,
        }

    def frame_of(self, part: str) -> bytes:
        """Return the frame of a part."""
        return frame({"part": part, **self.parts()[part]})

    def show(self, *parts: str) -> None:
        """Have parts shown as they are now."""
        for part in parts:
            self._show(part, self.frame_of(part))

    def calibrating(self) -> str:
        """Whether readings under weights are now those before or after the test."""
        return "after" if self.state["state"] in ("RETRACT", "POST_CALIBRATION") else "before"

    def last_record(self) -> bytes | None:
        """Return the record of the last tap."""
        return self.records[max(self.records)] if self.records else None

    # --- what the session tells -----------------------------------------------------------------------------

    def hear(self, message: Message, numbers: bytes) -> None:
        """Take in what the session tells."""
        handler = getattr(self, f"_hear_{message.get('kind')}", None)
        if handler is not None:
            handler(message, numbers)

    def _hear_begun(self, message: Message, numbers: bytes) -> None:
        self.folder = Path(message["folder"])
        self.state.update(
            {k: message[k] for k in ("plan_mn", "wanted", "limit_mn", "force_limit", "simulated", "load_set")},
            used=message.get("used", message["wanted"]),
            running=True,
            ended=None,
            session=session_id(self.folder),
            name=self.folder.name,
        )
        self.show("state")

    def _hear_state(self, message: Message, numbers: bytes) -> None:
        changed = message["state"] != self.state["state"]
        text = "" if message["text"] == message["words"] else message["text"]
        self.state.update(state=message["state"], words=message["words"], text=text)
        if changed:
            self.state["next"] = self._what_to_do()
            if message["state"] in ("APPROACH", "SET_LOAD"):
                self.state["locked_mn"] = None
        self.show("state")

    def _what_to_do(self) -> str:
        name = self.state["state"]
        by_itself = BY_ITSELF if self.state["simulated"] else {}
        return by_itself.get(name) or WHAT_TO_DO.get(name, "")

    def _hear_load(self, message: Message, numbers: bytes) -> None:
        self.load = {"mn": message["mn"], "at": time.time()}
        self.show("load")

    def _hear_locked(self, message: Message, numbers: bytes) -> None:
        self.state["locked_mn"] = message["mn"]
        self.show("state")

    def _hear_aim(self, message: Message, numbers: bytes) -> None:
        self.state.update(load_set=message["load_set"], accepted=0)
        self.show("state")

    def _hear_point(self, message: Message, numbers: bytes) -> None:
        self.calibration[self.calibrating()].append([message["weight_mn"], message["voltage_mv"]])
        self.show("calibration")

    def _hear_points(self, message: Message, numbers: bytes) -> None:
        self.calibration["before" if message["state"] == "PRE_CALIBRATION" else "after"] = message["points"]
        self.show("calibration")

    def _hear_count(self, message: Message, numbers: bytes) -> None:
        self.state.update(accepted=message["accepted"], load_set=message["load_set"])
        self.show("state")

    def _hear_tap(self, message: Message, numbers: bytes) -> None:
        number = message["number"]
        self.taps[number] = {k: v for k, v in message.items() if k != "kind"}
        record = record_frame(message, numbers)
        self.records[number] = record
        self._kept.append(number)
        if len(self._kept) > RECORDS_KEPT:
            self.records.pop(self._kept.popleft(), None)
        self.show("taps")
        if not message.get("old"):
            self._show_record(record)

    def _hear_judged(self, message: Message, numbers: bytes) -> None:
        tap = self.taps.get(message["number"])
        if tap is not None:
            reason = "" if message["accepted"] else f"by hand: {message['reason']}"
            if message["accepted"] and tap["reason"]:
                tap["overruled"] = tap["reason"]
            tap.update(accepted=message["accepted"], reason=reason, by_hand=message["reason"])
            self.show("taps")

    # --- what the live view tells -----------------------------------------------------------------------------

    def _hear_picture(self, message: Message, numbers: bytes) -> None:
        if message["next"] != self.state["next"] or self.state["words"] != "live view":
            self.state.update(next=message["next"], words="live view")
            self.show("state")
        told = {k: v for k, v in message.items() if k not in ("kind", "next")}
        self._show("picture", frame({"part": "picture", **told}, numbers))

    def _hear_alarm(self, message: Message, numbers: bytes) -> None:
        said = message["text"].removesuffix("; the surfaces are taken apart")
        self.state.update(alarm=f"{said}; the surfaces are being taken apart", words="alarm")
        self.state["next"] = "Keep off the rig: the surfaces are being taken apart."
        self.show("state")

    # --- what the analysis tells ----------------------------------------------------------------------------

    def _hear_modes(self, message: Message, numbers: bytes) -> None:
        tap = self.taps.get(message["number"])
        if tap is not None:
            tap["modes"] = message["modes"]
            self.show("taps")

    def _hear_chosen(self, message: Message, numbers: bytes) -> None:
        for number in message["taps"]:
            if number in self.taps:
                self.taps[number]["left_out"] = message["left_out"].get(str(number), "")
        self.show("taps")

    def _hear_hammer(self, message: Message, numbers: bytes) -> None:
        tap = self.taps.get(message["number"])
        if tap is not None:
            tap["hammer"] = message["words"]
            self.show("taps")

    def _hear_response(self, message: Message, numbers: bytes) -> None:
        self.response = {k: v for k, v in message.items() if k != "kind"}
        self.show("response")

    def _hear_results(self, message: Message, numbers: bytes) -> None:
        self.loads = {**self.loads, "loads": message["loads"], "why": ""}
        self.show("loads")

    def _hear_theory(self, message: Message, numbers: bytes) -> None:
        self.loads = {**self.loads, "theory": message["curves"]}
        self.show("loads")

    def _hear_compared(self, message: Message, numbers: bytes) -> None:
        self.calibration["compared"] = {"drifted": message["drifted"], "statement": message["statement"]}
        self.show("calibration")

    def _hear_unanalysed(self, message: Message, numbers: bytes) -> None:
        self.loads = {**self.loads, "why": message["why"]}
        self.show("loads")

    # --- what is said and asked -----------------------------------------------------------------------------

    def _hear_said(self, message: Message, numbers: bytes) -> None:
        self.state["said"] = [*self.state["said"], message["text"]][-LINES_KEPT:]
        if self.state["state"] == "TAP" and not self.state["simulated"]:
            self.state["next"] = message["text"]
        self.show("state")

    def _hear_ask(self, message: Message, numbers: bytes) -> None:
        self.state["ask"] = {
            "id": message["id"],
            "text": message["text"],
            "how": message["how"],
            "live": "",
            "stop": False,
        }
        self.show("state")

    def _hear_live(self, message: Message, numbers: bytes) -> None:
        ask = self.state["ask"]
        if ask is not None and ask["id"] == message["id"]:
            ask.update(live=message["text"], stop=message["stop"])
            self.show("state")

    def _hear_asked(self, message: Message, numbers: bytes) -> None:
        self.state["ask"] = None
        self.show("state")

    def _hear_paused(self, message: Message, numbers: bytes) -> None:
        self.state.update(paused=message["on"], watched=message.get("watched", False))
        self.show("state")

    def _hear_filing(self, message: Message, numbers: bytes) -> None:
        self.state.update(state="FILE", words=message["words"], text=message["text"], next=FILING[message["step"]])
        self._see_documents()
        self.show("state")

    def _hear_ended(self, message: Message, numbers: bytes) -> None:
        how = {"how": message["how"], "text": message["text"]}
        self.state.update(ended=how, ask=None, paused=False, alarm="", text="", stopping=False)
        self._see_documents()
        if self.state["viewed"]:
            self.state.update(next=VIEW_IDLE, words="ended" if message["text"] else "no view")
        elif message["how"] == "filed":
            self.state.update(state="DONE", words="done", text="", next=WHAT_TO_DO["DONE"])
        else:
            gone = self.folder is not None and not self.folder.is_dir()
            self.state.update(next=FOLDER_GONE if gone else AFTERWARDS[message["how"]], words="ended")
        self.show("state")

    def _see_documents(self) -> None:
        """See what there is to read of the session: a diagnosis is made where its configuration asks for one."""
        if self.folder is not None:
            self.state["reported"] = (self.folder / REPORT).is_file()
            self.state["diagnosed"] = (self.folder / DIAGNOSIS).is_file()

    def stopping(self) -> None:
        """See STOP passed on."""
        if self.state["ended"] is None:
            self.state["stopping"] = True
            self.show("state")

    def gone(self, code: int, guarded: bool) -> None:
        """See the process of the session, or of the view, gone.

        Parameters
        ----------
        code
            Its exit code; negative if a signal ended it, which leaves the load to others.
        guarded
            Whether there is a guardian: a rig that is simulated within the process ends with it.
        """
        self.state.update(running=False, viewing=False, stopping=False)
        process = self._process()
        if self.state["ended"] is not None:
            pass
        elif code >= 0:
            how = last_safe(self.folder) or "session.log says how"
            look = "" if how.endswith(APART) else "Look at the rig"
            self._cut_off(f"the {process} ended while the console heard nothing of it: {how}", look)
        elif guarded:
            guardian = "if the surfaces touched, the guardian takes them apart and says so here"
            self._cut_off(f"the {process}'s process was killed; {guardian}", "Look whether the surfaces are apart")
        else:
            self._cut_off(f"the {process}'s process was killed, and the simulated rig with it", "")
        self.show("state")

    def said(self, line: str) -> None:
        """Hear a line of the process, or of the guardian after it: what came of the load."""
        if not line.startswith(SAYS):
            return
        told = line.removeprefix(SAYS).removesuffix(f"; {GOES_ON}").removeprefix(f"{DIED}; ")
        look = "" if told.endswith(APART) else "Look at the rig"
        self._cut_off(f"the {self._process()}'s process was killed; the guardian took over: {told}", look)
        self.show("state")

    def _process(self) -> str:
        return "view" if self.state["viewed"] else "session"

    def _cut_off(self, text: str, look: str) -> None:
        """Show that the process ended without a word, and what is known of the load since."""
        then = "begin the view again" if self.state["viewed"] else "resume the session"
        self.load = {"mn": None, "at": None}
        self.show("load")
        self.state.update(ended={"how": "failed", "text": text}, ask=None, paused=False, words="ended", text="")
        self.state["next"] = f"{look}, then {then}." if look else f"{then.capitalize()}."
