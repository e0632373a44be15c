"""The WebSockets of the pages: what is shown goes out, and every second it is heard whether a page is still there.

A connection that is lost without a word (radio gone, laptop asleep) ends for neither side by itself: what was written
is sent again for a quarter of an hour. So a page answers every second; one that says nothing for `LOST_S` has gone.
"""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass, field

from starlette.websockets import WebSocket, WebSocketDisconnect

from mesotap import __version__
from mesotap.console.at_work import AtWork
from mesotap.console.audience import Audience, Outbox, Page
from mesotap.console.board import Board
from mesotap.console.frames import frame

LONGEST_KEY = 64
ALIVE_S = 1.0
"""Between two questions whether a page is there."""

LOST_S = 6.0
"""In which a page has to say something."""

ANSWER_S = 1.5
"""In which it answers when another connection comes with its key."""

MOST_PAGES = 16
"""Open at a time."""

AGAIN, FULL, LATER = 4001, 4002, 4003
"""Codes with which a page is told that it is a copy of one that is open; that too many are; to try again soon."""

ALIVE = frame({"part": "alive"})


@dataclass
class _Open:
    """A page's connection."""

    page: Page
    patience: asyncio.Timeout
    heard: asyncio.Event = field(default_factory=asyncio.Event)
    listening: bool = True

    def give_up(self) -> None:
        """Have it count as lost."""
        if self.listening and not self.patience.expired():
            self.patience.reschedule(asyncio.get_running_loop().time())


class PageSockets:
    """All of them.

    Parameters
    ----------
    work
        The session that runs.
    audience
        Who drives and who watches.
    board
        What is shown.
    """

    def __init__(self, work: AtWork, audience: Audience, board: Board) -> None:
        self._work, self._audience, self._board = work, audience, board
        self._open: dict[str, _Open] = {}
        self._coming: set[str] = set()

    async def meet(self, socket: WebSocket) -> None:
        """Show a page what there is, until it closes or is lost."""
        key = socket.query_params.get("page", "")
        if not 16 <= len(key) <= LONGEST_KEY or not key.isalnum():
            await socket.close(1008)
            return
        await socket.accept()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
            refused = await self._refused(key)
            if refused:
                await socket.close(refused)
            else:
                await self._serve(socket, key)

    async def _refused(self, key: str) -> int:
        """Return the code by which a page with this key is refused; 0 if it may come."""
        if key in self._coming:
            return LATER
        self._coming.add(key)
        try:
            given_up: _Open | None = None
            while (before := self._open.get(key)) is not None and before is not given_up:
                if await self._answers(before):
                    return AGAIN
                given_up = before
            return FULL if before is None and len(self._open) >= MOST_PAGES else 0
        finally:
            self._coming.discard(key)

    async def _answers(self, before: _Open) -> bool:
        """Whether the page that has this key is still there; its connection is given up if not."""
        before.heard.clear()
        before.page.outbox.put("alive", ALIVE)
        try:
            async with asyncio.timeout(ANSWER_S):
                await before.heard.wait()
        except TimeoutError:
            before.give_up()
            return False
        return True

    async def _serve(self, socket: WebSocket, key: str) -> None:
        async with contextlib.AsyncExitStack() as until:
            page = self._audience.enter(key)
            mine = self._open[key] = _Open(page, asyncio.timeout(LOST_S))
            until.callback(self._leave, key, mine)
            await socket.send_bytes(frame({"part": "you", "number": page.number, "version": __version__}))
            for part in self._board.parts():
                page.outbox.put(part, self._board.frame_of(part))
            if (last := self._board.last_record()) is not None:
                page.outbox.put_record(last)
            sending = asyncio.create_task(self._send(socket, page.outbox))
            try:
                async with mine.patience:
                    await self._listen(socket, mine)
            except TimeoutError:
                await socket.close(1001)
            finally:
                sending.cancel()
                with contextlib.suppress(asyncio.CancelledError, Exception):
                    await sending

    async def _listen(self, socket: WebSocket, mine: _Open) -> None:
        try:
            while True:
                await self._hear(socket)
                mine.heard.set()
                mine.patience.reschedule(asyncio.get_running_loop().time() + LOST_S)
        finally:
            mine.listening = False

    def _leave(self, key: str, mine: _Open) -> None:
        if self._open.get(key) is mine:
            del self._open[key]
        self._audience.leave(mine.page)

    async def _hear(self, socket: WebSocket) -> None:
        """Hear one message: STOP is taken here too, over a connection that is open already."""
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1000))
        text = message.get("text")
        if text == "stop":
            self._work.stop()
        elif text != "here":
            await socket.close(1008)
            raise WebSocketDisconnect(1008)

    async def _send(self, socket: WebSocket, outbox: Outbox) -> None:
        """Send what there is to be shown, and a question now and then; a page that is slow holds up itself alone."""
        now = asyncio.get_running_loop().time
        due = now() + ALIVE_S
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
            while True:
                if now() >= due:
                    outbox.put("alive", ALIVE)
                    due = now() + ALIVE_S
                try:
                    async with asyncio.timeout_at(due):
                        data = await outbox.take()
                except TimeoutError:
                    continue
                await socket.send_bytes(data)
