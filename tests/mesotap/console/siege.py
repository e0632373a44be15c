"""A console with a session in it that is held at a load, hostile bytes sent to it, and whether they did any harm."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import time
from pathlib import Path

from tests.mesotap.console.consoles import Client, ConsoleProcess
from tests.mesotap.console.plain_page import PlainPage

SPECIMEN = """<script>alert(1)</script>"'&{{7*7}}"""
OPERATOR, TITLE = "../../../etc/passwd", "</title><img src=x onerror=alert(1)>"
PATIENCE_S = 120.0
LOADED_MN = 200.0
"""The session is held at 300 mN; with the surfaces apart the gauge reads a few."""

HEADERS = {
    "Host": "{host}",
    "Cookie": "{cookie}",
    "Origin": "http://{host}",
    "X-Mesotap": "1",
    "X-Mesotap-Page": "{driver}",
    "Content-Type": "application/json",
}
HANDSHAKE = {
    "Host": "{host}",
    "Cookie": "{cookie}",
    "Origin": "http://{host}",
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


def request(line: str = "POST /api/stop HTTP/1.1", body: str = "{}", more: str = "", **changed: str | None) -> str:
    """Return what would stop the session, but for what was changed: headers by name, None for none of that name."""
    headers: dict[str, str | None] = {**HEADERS, "Content-Length": str(len(body))}
    headers |= {name.replace("_", "-"): value for name, value in changed.items()}
    return _text(line, headers, more) + body


def handshake(line: str = "GET /ws?page={fresh} HTTP/1.1", more: str = "", **changed: str | None) -> str:
    """Return a handshake of the WebSocket that would be accepted, but for what was changed."""
    return _text(line, HANDSHAKE | {name.replace("_", "-"): value for name, value in changed.items()}, more)


def _text(line: str, headers: dict[str, str | None], more: str) -> str:
    lines = [line, *(f"{name}: {value}" for name, value in headers.items() if value is not None)]
    return "\r\n".join(lines) + "\r\n" + more + "\r\n"


def ws_frame(opcode: int, data: bytes, *, end: bool = True, masked: bool = True, reserved: int = 0) -> bytes:
    """Return a frame as a page sends it, masked with zeros; its length in the shortest form (RFC 6455, 5.2)."""
    head = bytes([(0x80 if end else 0) | reserved | opcode])
    mask = 0x80 if masked else 0
    if len(data) < 126:
        head += bytes([mask | len(data)])
    else:
        head += bytes([mask | 126]) + struct.pack(">H", len(data))
    return head + (bytes(4) if masked else b"") + data


class Siege:
    """A console, the page that drives, one that watches, and a session that is paused with its load locked."""

    def __init__(self, console: ConsoleProcess) -> None:
        self.console = console
        self.client = Client(console)
        self.driver, self.watcher = PlainPage(console, self.client), PlainPage(console, self.client)
        names = {"specimen": SPECIMEN, "operator": OPERATOR, "title": TITLE}
        assert self.driver.post("run", names) == (200, {"started": True})
        self.driver.reach("LOCK")
        assert self.driver.post("pause")[0] == 200
        self.driver.until(lambda: self.driver.state["paused"])
        self._journal, self._at = self.journal(), self.driver.state["state"]
        assert self._at == "LOCK"
        self._fresh = 0

    def journal(self) -> bytes:
        """Return the session's journal."""
        return (self.folder / "journal.jsonl").read_bytes()

    @property
    def folder(self) -> Path:
        """Of the session."""
        (folder,) = [path for path in self.console.sessions.iterdir() if path.is_dir()]
        return folder

    def filled(self, text: str) -> bytes:
        """Return a request with this console's host, cookie and keys in it."""
        self._fresh += 1
        values = {
            "host": f"127.0.0.1:{self.console.port}",
            "port": str(self.console.port),
            "cookie": self.client.cookie,
            "cut": self.client.cookie[:-1],
            "secret": self.client.cookie.partition("=")[2],
            "driver": self.driver.key,
            "watcher": self.watcher.key,
            "fresh": f"{self._fresh:032x}",
            "used": self.console.path.partition("=")[2],
        }
        for name, value in values.items():
            text = text.replace(f"{{{name}}}", value)
        return text.encode("utf-8", "surrogateescape")

    def connect(self) -> socket.socket:
        """Return a connection."""
        return socket.create_connection(("127.0.0.1", self.console.port), timeout=PATIENCE_S)

    def sent(self, data: bytes, half_close: bool = False) -> bytes:
        """Send bytes as they are; return all that came until the console disconnected."""
        with self.connect() as connection:
            with contextlib.suppress(OSError):  # it need not read to the end
                connection.sendall(data)
                if half_close:
                    connection.shutdown(socket.SHUT_WR)
            return all_of(connection)

    def closed_with(self, *frames: bytes, line: str = "GET /ws?page={fresh} HTTP/1.1") -> int:
        """Open a WebSocket, send frames, and return the code with which it was closed; 0 if it was only cut off."""
        with self.connect() as connection:
            connection.sendall(self.filled(handshake(line)))
            stream = connection.makefile("rb")
            assert b" 101 " in stream.readline()
            while (line := stream.readline()) not in (b"\r\n", b""):
                assert b"extensions" not in line.lower()
            with contextlib.suppress(OSError):
                for data in frames:
                    connection.sendall(data)
            with contextlib.suppress(ConnectionError):
                while len(head := stream.read(2)) == 2:
                    length = head[1]
                    if length >= 126:
                        length = int.from_bytes(stream.read({126: 2, 127: 8}[length]))
                    data = stream.read(length)
                    if head[0] & 15 == 8:
                        return int.from_bytes(data[:2])
            return 0

    def unharmed(self) -> None:
        """Hold that the session is where it was, its load on the rig, the page in control, and pages are served."""
        state = self.driver.state
        assert (state["running"], state["ended"], state["paused"]) == (True, None, True)
        assert state["state"] == self._at
        assert self.journal() == self._journal
        assert self.driver.parts["load"]["mn"] > LOADED_MN
        assert self.driver.drives
        assert self.client.request("GET", "/")[0] == 200
        assert "Exception in ASGI application" not in self.console.errors()

    def end(self) -> None:
        """Close the pages."""
        for page in (self.driver, self.watcher):
            page.close()


def all_of(connection: socket.socket) -> bytes:
    """Return what comes until the other end closes; it must close."""
    came = b""
    with contextlib.suppress(ConnectionError):
        while data := connection.recv(65536):
            came += data
    return came


def statuses(answer: bytes) -> list[int]:
    """Return the status of each response in what came."""
    return [int(part[:3]) for part in answer.split(b"HTTP/1.1 ")[1:]]


def closed_in_time(connections: list[socket.socket], trickled: bytes = b"", longest_s: float = PATIENCE_S) -> None:
    """Wait until the console has closed all; meanwhile send each the next byte of something four times a second."""
    waiting, begun, at = set(connections), time.monotonic(), 0
    for connection in waiting:
        connection.settimeout(0.01)
    while waiting:
        assert time.monotonic() < begun + longest_s, f"{len(waiting)} connections are open still"
        for connection in sorted(waiting, key=id):
            try:
                if trickled:
                    connection.sendall(trickled[at % len(trickled) :][:1])
                if connection.recv(65536) == b"":
                    waiting.discard(connection)
            except TimeoutError:
                continue
            except OSError:
                waiting.discard(connection)
        at += 1
        time.sleep(0.25)


def sessions_listed(client: Client) -> list[dict[str, object]]:
    """Return the sessions that the console lists."""
    return json.loads(client.request("GET", "/api/sessions")[2])["sessions"]
