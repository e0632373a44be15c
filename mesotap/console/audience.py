"""The open pages: one holds control, the others watch; nobody waits for one that is slow."""

from __future__ import annotations

import asyncio
import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

RECORDS_WAITING = 4
"""Records of taps kept for a page that does not keep up; older ones it does not get."""

KEPT_FOR_S = 10.0
"""For which control stays with a page whose connection was lost."""

NUMBERS_KEPT = 64
"""Pages that keep their number when they come back; of those that are closed, the oldest are forgotten first."""


class Sender(Protocol):
    """The WebSocket of a page."""

    async def send_bytes(self, data: bytes) -> None:
        """Send, waiting until there is room."""


@dataclass
class Outbox:
    """What a page has not been sent yet: of each part the last, and the last few records.

    Attributes
    ----------
    dropped
        Frames that were replaced or left out because the page was slow.
    """

    parts: dict[str, bytes] = field(default_factory=dict)
    records: deque[bytes] = field(default_factory=lambda: deque(maxlen=RECORDS_WAITING))
    news: asyncio.Event = field(default_factory=asyncio.Event)
    dropped: int = 0

    def put(self, part: str, frame: bytes) -> None:
        """Add the newest frame of a part."""
        self.dropped += part in self.parts
        self.parts[part] = frame
        self.news.set()

    def put_record(self, frame: bytes) -> None:
        """Add a record."""
        self.dropped += len(self.records) == RECORDS_WAITING
        self.records.append(frame)
        self.news.set()

    async def take(self) -> bytes:
        """Return the next frame, waiting for one: what is small first."""
        while not self.parts and not self.records:
            self.news.clear()
            await self.news.wait()
        if self.parts:
            return self.parts.pop(next(iter(self.parts)))
        return self.records.popleft()


@dataclass
class Page:
    """An open page. ``key`` is known to it alone, ``number`` to all."""

    key: str
    number: int
    outbox: Outbox = field(default_factory=Outbox)


class Audience:
    """All open pages.

    Parameters
    ----------
    changed
        Called when who holds control, or who watches, has changed.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._pages: dict[str, Page] = {}
        self._numbers: dict[str, int] = {}
        self._count = itertools.count(1)
        self._holder = ""  # key of the page that holds control; empty for nobody
        self._release: asyncio.TimerHandle | None = None
        self._asking: set[int] = set()

    @property
    def pages(self) -> list[Page]:
        """The open pages."""
        return list(self._pages.values())

    def enter(self, key: str) -> Page:
        """Let a page in; the first one holds control, one that comes back has what it had."""
        number = self._numbers[key] if key in self._numbers else next(self._count)
        self._numbers[key] = number
        page = self._pages[key] = Page(key, number)
        self._forget_numbers()
        if not self._holder and len(self._pages) == 1:
            self._holder = key
        if self._holder == key and self._release is not None:
            self._release.cancel()
            self._release = None
        self._changed()
        return page

    def leave(self, page: Page) -> None:
        """See a page go; control stays with it for a while, in case it comes back."""
        if self._pages.get(page.key) is not page:
            return  # it is open again already
        del self._pages[page.key]
        self._asking.discard(page.number)
        if self._holder == page.key:
            self._release = asyncio.get_running_loop().call_later(KEPT_FOR_S, self._free)
        self._changed()

    def holds_control(self, key: str) -> bool:
        """Whether this is the key of the page that holds control."""
        return bool(key) and key == self._holder

    def take(self, key: str) -> bool:
        """Take control, which only an open page can, and only if nobody holds it."""
        if key not in self._pages or (self._holder and self._holder != key):
            return False
        self._give_to(key)
        return True

    def ask(self, key: str) -> bool:
        """Ask whoever holds control for it."""
        page = self._pages.get(key)
        if page is None or key == self._holder:
            return False
        self._asking.add(page.number)
        self._changed()
        return True

    def give(self, key: str, number: int) -> bool:
        """Hand control over to the page of this number."""
        to = next((page.key for page in self._pages.values() if page.number == number), None)
        if not self.holds_control(key) or to is None:
            return False
        self._give_to(to)
        return True

    def as_seen(self) -> dict[str, object]:
        """What all pages may know."""
        return {
            "holder": self._numbers.get(self._holder),
            "holder_open": self._holder in self._pages,
            "pages": sorted(page.number for page in self._pages.values()),
            "asking": sorted(self._asking),
        }

    def tell(self, part: str, frame: bytes) -> None:
        """Have every page shown a part."""
        for page in self._pages.values():
            page.outbox.put(part, frame)

    def tell_record(self, frame: bytes) -> None:
        """Have every page shown a record."""
        for page in self._pages.values():
            page.outbox.put_record(frame)

    def _give_to(self, key: str) -> None:
        self._holder = key
        self._asking.discard(self._numbers[key])
        if self._release is not None:
            self._release.cancel()
            self._release = None
        self._changed()

    def _forget_numbers(self) -> None:
        closed = [key for key in self._numbers if key not in self._pages and key != self._holder]
        for key in closed[: max(0, len(self._numbers) - NUMBERS_KEPT)]:
            del self._numbers[key]

    def _free(self) -> None:
        self._holder, self._release = "", None
        self._changed()
