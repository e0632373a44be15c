"""The session's end of the connection to the console: nothing that the console does, or fails to do, holds it up.

What is to be told is written by a thread of its own; where nobody reads, the oldest is dropped. What the console says
is read by another: STOP and an end of the connection are seen the moment they come, whatever the session waits for.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from collections import deque
from collections.abc import Callable

from mesotap.console.frames import FrameError, Message, frame, read_frame

MOST_WAITING = 2000
"""Frames that nobody has read yet; a tap is 0.1 MB, a load 50 bytes."""

LAST_WAIT_S = 5.0
SILENT_S = 5.0
"""In which the console says something: it does every second (`child.BEAT_S`). One that hangs passes on no STOP."""


class SessionLink:
    """One connection.

    Parameters
    ----------
    connection
        Connected socket, ours from now on.
    heard
        Called by the reading thread with each message; returns at once.
    lost
        Called by it once, when the other end has gone, or says nothing any more.
    silent_s
        For how long it may say nothing; None for as long as it likes.
    """

    def __init__(
        self,
        connection: socket.socket,
        heard: Callable[[Message], None],
        lost: Callable[[], None],
        silent_s: float | None = SILENT_S,
    ) -> None:
        self._socket = connection
        self._socket.settimeout(silent_s)
        self._heard, self._lost = heard, lost
        self._waiting: deque[bytes] = deque(maxlen=MOST_WAITING)
        self._news = threading.Condition()
        self._ending = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._writer = threading.Thread(target=self._write, daemon=True)

    def start(self) -> None:
        """Begin to listen and to tell."""
        self._reader.start()
        self._writer.start()

    def tell(self, message: Message, numbers: bytes = b"") -> None:
        """Tell something when the other end reads; returns at once."""
        whole = frame(message, numbers)
        with self._news:
            self._waiting.append(whole)
            self._news.notify()

    def end(self) -> None:
        """Wait a moment until all was told, then disconnect."""
        with self._news:
            self._ending = True
            self._news.notify()
        self._writer.join(LAST_WAIT_S)
        with contextlib.suppress(OSError):  # the other end has gone
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _write(self) -> None:
        while True:
            with self._news:
                while not self._waiting and not self._ending:
                    self._news.wait()
                if not self._waiting:
                    return
                whole = self._waiting.popleft()
            try:
                self._socket.sendall(whole)
            except OSError:  # the reading thread says so
                return

    def _read(self) -> None:
        with self._socket.makefile("rb") as stream:
            try:
                while (got := read_frame(stream.read)) is not None:
                    self._heard(got[0])
            except (OSError, FrameError):
                pass
        if not self._ending:
            self._lost()
