"""``mesotap console``: the server of the pages."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import re
import socket
import ssl
import webbrowser
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from starlette.applications import Starlette

from mesotap.console.at_work import AtWork, Bench
from mesotap.console.audience import Audience
from mesotap.console.board import Board
from mesotap.console.connections import LARGEST_HEADER, BoundedConnection
from mesotap.console.frames import frame
from mesotap.console.gate import OPEN_PATH, Gate, Keys
from mesotap.console.routes import Routes
from rig.errors import MesotapError

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
EVERY_ADDRESS = ("0.0.0.0", "::")
LARGEST_SOCKET_FRAME = 1024
"""Bytes that a page may send over the WebSocket: it only ever says "stop"."""

PING_S = 5.0
BACKLOG = 256
LAST_REQUESTS_S = 1


class ConsoleError(MesotapError, OSError):
    """The console cannot be served; one sentence."""


HOST_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,252}")


@dataclass(frozen=True, slots=True)
class Address:
    """Where the pages are served.

    Attributes
    ----------
    host, port
        Of this machine; port 0 is any that is free.
    certificate, key
        Files of the certificate and its key for TLS; None for none.
    names
        Further names under which the console may be opened.
    """

    host: str = "127.0.0.1"
    port: int = 0
    certificate: Path | None = None
    key: Path | None = None
    names: tuple[str, ...] = ()

    @property
    def loopback(self) -> bool:
        """Whether only this machine can open it."""
        return self.host in ("127.0.0.1", "::1", "localhost")

    @property
    def scheme(self) -> str:
        """``https`` where there is a certificate."""
        return "http" if self.certificate is None else "https"

    @property
    def linked(self) -> str:
        """Name under which the link has it."""
        if self.names:
            return self.names[0]
        if self.host in EVERY_ADDRESS:
            return socket.gethostname()
        return f"[{self.host}]" if ":" in self.host else self.host

    def hosts(self, port: int) -> frozenset[str]:
        """Return what the header Host may say, beside the address at which a request comes."""
        named = {*LOOPBACK, *self.names, self.linked}
        standard = {"http": 80, "https": 443}[self.scheme]
        return frozenset({f"{name.lower()}:{port}" for name in named} | (named if port == standard else set()))


class ConsoleServer:
    """One console.

    Parameters
    ----------
    bench
        What sessions are run with.
    address
        Where it is served.
    said
        Prints a line.
    """

    def __init__(self, bench: Bench, address: Address, said: Callable[[str], None]) -> None:
        if address.key is not None and address.certificate is None:
            raise ConsoleError("--keyfile: a key is of no use without its certificate; give --certfile too")
        if address.certificate is not None and address.key is None:
            raise ConsoleError("--certfile: TLS needs the key of the certificate too; give --keyfile")
        for name in address.names:
            if not HOST_NAME.fullmatch(name):
                raise ConsoleError(f"--name {name}: is not the name of a machine, such as bench.example")
        self._address, self._said = address, said
        self._listening = _bound(address)
        self.port: int = self._listening.getsockname()[1]
        self.keys = Keys(f"mesotap-{self.port}")
        self.audience = Audience(self._show_audience)
        self.board = Board(self.audience.tell, self.audience.tell_record)
        self.work = AtWork(bench, self.board)
        secure = address.scheme == "https"
        routes = Routes(self.work, self.keys, self.audience, self.board, secure)
        app = Starlette(routes=routes.routes(), lifespan=self._lifespan)
        self.app = Gate(app, self.keys, address.hosts(self.port), address.scheme)

    def link(self) -> str:
        """Return a new one-time link."""
        return f"{self._address.scheme}://{self._address.linked}:{self.port}{OPEN_PATH}?token={self.keys.new_link()}"

    def run(self, browser: bool, began: Callable[[str], None] = lambda link: None) -> None:
        """Serve until a signal ends it; a session that runs then has its surfaces taken apart.

        ``began`` is told the link that opens it before anything is served.
        """
        config = uvicorn.Config(
            self.app,
            http=BoundedConnection,
            ws="websockets-sansio",
            ws_max_size=LARGEST_SOCKET_FRAME,
            ws_ping_interval=PING_S,
            ws_ping_timeout=PING_S,
            ws_per_message_deflate=False,
            h11_max_incomplete_event_size=LARGEST_HEADER,
            timeout_graceful_shutdown=LAST_REQUESTS_S,
            timeout_keep_alive=30,
            ssl_certfile=None if self._address.certificate is None else str(self._address.certificate),
            ssl_keyfile=None if self._address.key is None else str(self._address.key),
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            loop="asyncio",
        )
        try:
            config.load()
        except (OSError, ssl.SSLError) as error:
            files = f"{self._address.certificate}, {self._address.key}"
            raise ConsoleError(f"{files}: no certificate with its key ({error})") from error
        logging.getLogger("uvicorn.error").addFilter(_worth_telling)
        link = self.link()
        self._said(f"console: {link}")
        self._said("         (opens once; Ctrl-C ends the console, and a session with the surfaces apart)")
        began(link)
        if browser:
            webbrowser.open(link)
        uvicorn.Server(config).run(sockets=[self._listening])

    def _show_audience(self) -> None:
        self.audience.tell("audience", frame({"part": "audience", **self.audience.as_seen()}))

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        try:
            await self.work.ready()
            yield
        finally:
            if self.work.running:
                self._said("ending the session: the surfaces are taken apart ...")
            await self.work.end()


def _worth_telling(record: logging.LogRecord) -> bool:
    """Whether the person at the console needs to know.

    A page that sends what is no text was disconnected already; one that asks at the very end gets no answer.
    """
    return record.exc_info is None or not isinstance(record.exc_info[1], UnicodeDecodeError | asyncio.CancelledError)


def _bound(address: Address) -> socket.socket:
    """Return a socket that listens, or one sentence why not."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((address.host, address.port))
        listening.listen(BACKLOG)  # who comes before it is served waits
    except OSError as error:
        listening.close()
        other = "--port" if error.errno in (errno.EADDRINUSE, errno.EACCES) else "--host"
        where = f"{address.host}:{address.port}"
        raise ConsoleError(
            f"{where}: the console cannot be served there ({error.strerror}); name another {other}"
        ) from error
    listening.setblocking(False)
    return listening
