"""A page without a browser: what the console shows it, and what it asks for."""

from __future__ import annotations

import contextlib
import secrets
import threading
import time
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

from mesotap.console.frames import taken
from tests.mesotap.console.consoles import Client, ConsoleProcess

LONGEST_S = 120.0
LOOK_S = 0.01


class PlainPage:
    """An open page.

    Attributes
    ----------
    parts
        The newest of each part; ``seen`` how many frames of it came.
    silent
        Whether it does not answer, as one whose connection was lost.
    """

    def __init__(self, console: ConsoleProcess, client: Client, key: str = "") -> None:
        self.client, self.key = client, key or secrets.token_hex(16)
        self.parts: dict[str, dict[str, Any]] = {}
        self.seen: dict[str, int] = {}
        self.states: list[str] = []
        self.silent = False
        address = f"ws://127.0.0.1:{console.port}/ws?page={self.key}"
        headers = {"Cookie": client.cookie}
        self._open = contextlib.ExitStack()
        origin = f"http://127.0.0.1:{console.port}"
        self._socket = self._open.enter_context(
            connect(address, additional_headers=headers, origin=Origin(origin), max_size=2**26)
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self.until(lambda: {"you", "state", "audience"} <= set(self.parts))

    def post(self, what: str, content: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        """Ask for something."""
        return self.client.post(what, content or {}, **{"X-Mesotap-Page": self.key})

    def until(self, there: Any, longest_s: float = LONGEST_S) -> None:
        """Wait for what the console shows."""
        begun = time.monotonic()
        while not there():
            assert time.monotonic() < begun + longest_s, self.parts.get("state")
            time.sleep(LOOK_S)

    def reach(self, *states: str) -> None:
        """Wait until the session is, or has been, in one of these states since the page was opened."""
        self.until(lambda: bool(set(states) & set(self.states)))

    @property
    def state(self) -> dict[str, Any]:
        """The part ``state``."""
        return self.parts["state"]

    @property
    def drives(self) -> bool:
        """Whether this page holds control."""
        return self.parts["audience"]["holder"] == self.parts["you"]["number"]

    def close(self) -> None:
        """Close it."""
        self._open.close()
        self._thread.join(10)

    def _read(self) -> None:
        try:
            for data in self._socket:
                message, _ = taken(data if isinstance(data, bytes) else data.encode())
                part = message["part"]
                if part == "alive" and not self.silent:
                    self._socket.send("here")
                self.parts[part] = message
                self.seen[part] = self.seen.get(part, 0) + 1
                if part == "state" and message["state"] not in self.states[-1:]:
                    self.states.append(message["state"])
        except ConnectionClosed:
            return
