"""HTTP connections with bounds: how many there are, and for how long one may say nothing that is a request."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 96
"""At a time; a page has up to seven. Beyond them, those that have asked nothing yet are closed, the oldest first."""

REQUEST_S = 5.0
"""In which a request has to be whole from its first byte on, and a new connection's first one from its beginning."""

LARGEST_HEADER = 16 * 1024


class BoundedConnection(H11Protocol):
    """A connection that is closed if no request comes in time."""

    _waiting: list[BoundedConnection] = []  # noqa: RUF012 - of all connections, in the order of their coming

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request."""
        super().connection_made(transport)
        self._waiting.append(self)
        self._expect()
        if len(self.connections) > MOST_CONNECTIONS:
            self._waiting[0]._close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._settled()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take in bytes; a request that is whole ends the waiting until the next begins."""
        before = self.cycle
        if self._deadline is None:
            self._expect()
        super().data_received(data)
        if self.cycle is not before or self.transport.get_protocol() is not self:  # a request, or now a WebSocket
            self._settled()

    def _expect(self) -> None:
        self._deadline = self.loop.call_later(REQUEST_S, self._close)

    def _settled(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        if self in self._waiting:
            self._waiting.remove(self)

    def _close(self) -> None:
        self._settled()
        if self.transport is not None:
            self.transport.abort()
