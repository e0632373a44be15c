"""A wire between a page and the console that can go dead as radio does: neither end is told."""

from __future__ import annotations

import contextlib
import socket
import threading

ADDRESS = "127.0.0.2"
"""Under which the console is opened through the wire, on its own port: what a page sends then names the right host."""

FAR_OFF_S = 0.2


class SilentWire:
    """Passes bytes on to a port of this machine, until it is dead; what was open before it came back stays dead."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._age = 0
        self._dead = False
        self._all: list[socket.socket] = []
        self._listening = socket.create_server((ADDRESS, port))
        threading.Thread(target=self._accept, daemon=True).start()

    def die(self) -> None:
        """Pass nothing on from now on, and say nothing of it."""
        self._dead = True
        self._age += 1

    def come_back(self) -> None:
        """Let new connections through."""
        self._dead = False

    def close(self) -> None:
        """End it."""
        for one in (self._listening, *self._all):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                self._all.append(near)
                if self._dead:
                    continue  # it is answered by nobody
                far = socket.create_connection(("127.0.0.1", self._port))
                self._all.append(far)
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(one, other, self._age), daemon=True).start()

    def _pass_on(self, one: socket.socket, other: socket.socket, age: int) -> None:
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                if age == self._age:
                    other.sendall(data)
            if age == self._age:
                other.shutdown(socket.SHUT_WR)
