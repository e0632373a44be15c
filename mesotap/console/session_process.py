"""The process in which a session, or the live view, runs while the console serves its pages: no load on those starves
the load watch.

``python -m mesotap.console.session_process DESCRIPTOR``: a connected socket, over which the first message says what to
do. It ends with the session; if the console goes first, it takes the surfaces apart and ends.
"""

from __future__ import annotations

import os
import queue
import socket
import sys
from collections import deque
from pathlib import Path
from typing import Any

from mesotap.console.frames import Message
from mesotap.console.session_link import SessionLink
from mesotap.console.session_people import PagePeople, Tell
from mesotap.session.order import RigChoice
from rig.errors import MesotapError

ORDER_S = 30.0
ORDERS = ("run", "resume", "view")
MOST_WISHES = 100


def main(descriptor: int) -> None:
    """Run what the console orders, and tell it how that ended."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    orders: queue.Queue[Message] = queue.Queue()
    link: SessionLink

    def tell(message: Message, numbers: bytes = b"") -> None:
        link.tell(message, numbers)

    people = PagePeople(tell)
    wishes: deque[Message] = deque(maxlen=MOST_WISHES)

    def heard(message: Message) -> None:
        if message.get("do") in ORDERS:
            orders.put(message)
        elif message.get("do") == "wish":
            wishes.append(message["wish"])
        else:
            people.heard(message)

    link = SessionLink(socket.socket(fileno=descriptor), heard, people.lost)
    link.start()
    try:
        order = orders.get(timeout=ORDER_S)
        if order["do"] == "view":
            view_live(order, people, wishes, tell)
            link.tell({"kind": "ended", "how": "over", "text": ""})
        else:
            carry_out(order, people)
            link.tell({"kind": "ended", "how": "filed", "text": "the session is complete"})
    except BaseException as error:
        if people.filed and isinstance(error, KeyboardInterrupt):
            link.tell({"kind": "ended", "how": "filed", "text": "the session is complete; its diagnosis was ended"})
            return
        link.tell({"kind": "ended", **told(error)})
        if not isinstance(error, MesotapError | KeyboardInterrupt):
            raise
    finally:
        link.end()


def told(error: BaseException) -> dict[str, Any]:
    """Return how a session that was not filed ended: by somebody's wish or by a fault, and the sentence for it."""
    by_wish = type(error).__name__ in ("SessionAborted", "KeyboardInterrupt")
    notes = getattr(error, "__notes__", ())
    return {"how": "stopped" if by_wish else "failed", "text": "; ".join([str(error) or type(error).__name__, *notes])}


def carry_out(order: Message, people: PagePeople) -> None:
    """Run or resume a session."""
    from mesotap.commands.session import begin, go_on
    from mesotap.commands.wire_options import WireOptions
    from mesotap.configuration.config import parse_config

    path, wire = Path(str(order["path"])), WireOptions(log=bool(order["log_wire"]))
    if order["do"] == "resume":
        go_on(path, people.people, wire=wire, speed=float(order["speed"]))
        return
    config = parse_config(str(order["config"]), str(order["name"]), order["changes"])
    choice = RigChoice(**order["choice"])
    begin(config, choice, path, people.people, wire=wire)


def view_live(order: Message, people: PagePeople, wishes: deque[Message], tell: Tell) -> None:
    """Show both accelerometers and the load until somebody ends it."""
    from mesotap.configuration.config import parse_config
    from mesotap.session.bench import build_rig
    from mesotap.session.emulated_devices import SeparateRig
    from mesotap.session.guardian_link import guardian_for
    from mesotap.session.live_view import LiveView, ViewBench, for_setting_up

    choice = RigChoice(**order["choice"])
    config = parse_config(str(order["config"]), str(order["name"]), order["changes"])
    simulated = choice.simulate or choice.emulate
    if simulated:
        config = for_setting_up(config)
    operator, people.control.ends = people.operator, "live view"
    rig = build_rig(config, choice.simulate, operator, choice.seed, choice.realtime, choice.emulate, speed=choice.speed)
    try:
        with people.control.listening():
            guardian = guardian_for(rig, config)
            bench = ViewBench(rig, operator, people.control, tell, guardian, people.people.gauge, wishes, simulated)
            LiveView(config, bench).run()
    finally:
        if isinstance(rig, SeparateRig):
            rig.end_devices()


if __name__ == "__main__":
    main(int(sys.argv[1]))
