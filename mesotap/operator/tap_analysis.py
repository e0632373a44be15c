"""What each tap came to, while the session runs: worked out by a process of its own, so that nobody waits for it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

from daq.records import Impact
from mesotap.console.frames import Message
from mesotap.console.session_link import SessionLink
from mesotap.console.session_people import tap_message

ANALYST = "mesotap.console.analyst_process"
ANSWERED = ("theory", "results", "unanalysed")
"""Kinds of the last message that it says when a session begins, and of each tap."""

NICENESS = 5
"""By how much it gives way to the session, whose load watch comes first."""


class TapAnalysis:
    """The analysis of a session that runs at the terminal; where taps come faster than it works, of the latest.

    Parameters
    ----------
    begun
        What the session is: ``config`` as text, ``created``, ``simulated``.
    found
        Called by a thread with the number of a tap and its modes: ``f2_hz``, ``zeta2`` and ``k_c``, each a mapping with
        ``value``.
    """

    def __init__(self, begun: Message, found: Callable[[int, dict[str, Any]], None]) -> None:
        self._found = found
        self._news = threading.Condition()
        self._waiting: list[Impact] = []
        self._begun = self._at_work = self._gone = False
        ours, theirs = socket.socketpair()
        command = ["nice", "-n", str(NICENESS), sys.executable, "-m", ANALYST, str(theirs.fileno())]
        nowhere = subprocess.DEVNULL
        try:
            self._process = subprocess.Popen(
                command,
                stdin=nowhere,
                stdout=nowhere,
                stderr=nowhere,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C at the terminal is for the session
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        finally:
            theirs.close()
        self._link = SessionLink(ours, self._heard, self._lost, silent_s=None)
        self._link.start()
        self._link.tell({"kind": "begun", **begun})

    def tap(self, impact: Impact) -> None:
        """Have a tap analysed, unless a later one comes before it is its turn; returns at once."""
        with self._news:
            self._waiting.append(impact)
            if self._begun and not self._at_work:
                self._go_on()

    def settle(self, longest_s: float) -> None:
        """Wait until the latest tap is analysed, or so long; for a session whose surfaces are apart for good."""
        with self._news:
            self._news.wait_for(lambda: self._gone or not (self._waiting or self._at_work), longest_s)

    def end(self) -> None:
        """End it, whatever it is at."""
        self._process.kill()
        self._process.wait()
        self._link.end()

    def _heard(self, message: Message) -> None:
        if message.get("kind") == "modes":
            self._found(message["number"], message["modes"])
        elif message.get("kind") in ANSWERED:
            with self._news:
                self._begun = True
                self._go_on()
                self._news.notify_all()

    def _lost(self) -> None:
        with self._news:
            self._gone = True
            self._news.notify_all()

    def _go_on(self) -> None:
        """Tell of the taps that wait, of which the last is analysed by itself."""
        waiting, self._waiting = self._waiting, []
        self._at_work = bool(waiting)
        for impact in waiting:
            message, numbers = tap_message(impact)
            self._link.tell(message | {"old": impact is not waiting[-1]}, numbers)
