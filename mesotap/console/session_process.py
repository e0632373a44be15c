"""The process in which a session runs while the console serves its pages: no load on those starves the load watch.

``python -m mesotap.console.session_process DESCRIPTOR``: a connected socket, over which the first message says what to
do. It ends with the session; if the console goes first, it takes the surfaces apart and ends.
"""

from __future__ import annotations

import os
import queue
import socket
import sys
from pathlib import Path
from typing import Any

from mesotap.console.frames import Message
from mesotap.console.session_link import SessionLink
from mesotap.console.session_people import PagePeople
from rig.errors import MesotapError

ORDER_S = 30.0


def main(descriptor: int) -> None:
    """Run what the console orders, and tell it how that ended."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    orders: queue.Queue[Message] = queue.Queue()
    link: SessionLink

    def tell(message: Message, numbers: bytes = b"") -> None:
        link.tell(message, numbers)

    people = PagePeople(tell)

    def heard(message: Message) -> None:
        if message.get("do") in ("run", "resume"):
            orders.put(message)
        else:
            people.heard(message)

    link = SessionLink(socket.socket(fileno=descriptor), heard, people.lost)
    link.start()
    try:
        carry_out(orders.get(timeout=ORDER_S), people)
        link.tell({"kind": "ended", "how": "filed", "text": "the session is complete"})
    except BaseException as error:
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
    from mesotap.session.order import RigChoice

    path, wire = Path(str(order["path"])), WireOptions(log=bool(order["log_wire"]))
    if order["do"] == "resume":
        go_on(path, people.people, wire=wire, speed=float(order["speed"]))
        return
    config = parse_config(str(order["config"]), str(order["name"]), order["changes"])
    choice = RigChoice(**order["choice"])
    begin(config, choice, path, people.people, wire=wire)


if __name__ == "__main__":
    main(int(sys.argv[1]))
