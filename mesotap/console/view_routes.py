"""What pages ask of the live view, each request held to what a page can send."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from typing import Any

from mesotap.console.at_work import AtWork, Refused
from mesotap.session.view_order import LARGEST_LEVEL_M_S2, MOST_AVERAGES, SIDES, SPANS_MS

Answer = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


class ViewRoutes:
    """Acts on the live view; each needs control.

    Parameters
    ----------
    work
        What runs.
    """

    def __init__(self, work: AtWork) -> None:
        self._work = work

    def acts(self) -> dict[str, tuple[Answer, bool]]:
        """Return each by its name, with whether it needs control."""
        return {
            "view/begin": (self._begin, True),
            "view/show": (self._show, True),
            "view/reset": (self._reset, True),
            "view/drop": (self._drop, True),
            "view/check": (self._check, True),
            "view/tap": (self._tap, True),
            "view/end": (self._end, True),
        }

    async def _begin(self, content: dict[str, Any]) -> dict[str, Any]:
        await self._work.view()
        return {"started": True}

    async def _show(self, content: dict[str, Any]) -> dict[str, Any]:
        averages, span_ms, level = int(content["averages"]), float(content["span_ms"]), float(content["level"])
        triggered = content["triggered"]
        if not 1 <= averages <= MOST_AVERAGES:
            raise Refused(f"averages: give a whole number from 1 to {MOST_AVERAGES}")
        if span_ms not in SPANS_MS:
            raise Refused(f"time: one of {', '.join(map(str, SPANS_MS))} ms")
        if not (math.isfinite(level) and 0 < level <= LARGEST_LEVEL_M_S2):
            raise Refused(f"level: give more than 0 and at most {LARGEST_LEVEL_M_S2:g} m/s2")
        if not isinstance(triggered, bool):
            raise Refused("triggered: true or false")
        return self._told({"averages": averages, "span_ms": span_ms, "level": level, "triggered": triggered}, "view")

    async def _reset(self, content: dict[str, Any]) -> dict[str, Any]:
        return self._told({}, "reset")

    async def _drop(self, content: dict[str, Any]) -> dict[str, Any]:
        return self._told({}, "drop")

    async def _check(self, content: dict[str, Any]) -> dict[str, Any]:
        if content["side"] not in SIDES:
            raise Refused(f"side: one of {', '.join(SIDES)}")
        return self._told({"side": content["side"]}, "check")

    async def _tap(self, content: dict[str, Any]) -> dict[str, Any]:
        return self._told({}, "tap")

    async def _end(self, content: dict[str, Any]) -> dict[str, Any]:
        return self._told({}, "end")

    def _told(self, wish: dict[str, Any], what: str) -> dict[str, Any]:
        if not self._work.wish({**wish, "do": what}):
            raise Refused("no live view runs: begin it first")
        return {"told": True}
