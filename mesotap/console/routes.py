"""What the pages ask for and how they are answered."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.templating import Jinja2Templates

from mesotap import __version__
from mesotap.console.at_work import AtWork, Refused
from mesotap.console.audience import Audience
from mesotap.console.board import DIAGNOSIS, REPORT, Board
from mesotap.console.gate import OPEN_PATH, REPORT_POLICY, Keys
from mesotap.console.page_sockets import PageSockets
from mesotap.console.past import MOST_COMPARED, comparison_of, results_of, session_of, sessions_in
from mesotap.console.view_routes import ViewRoutes
from mesotap.session.hand_verdicts import LONGEST_REASON
from rig.errors import MesotapError

HERE = Path(__file__).parent
PAGE_KEY = "X-Mesotap-Page"
SO_FAR = "so-far"

NO_REQUEST = (ValueError, TypeError, KeyError, OverflowError)
"""What comes of reading a request that has other contents than a page sends."""

LONGEST_NAME = 200

Answer = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


class Routes:
    """The console as the pages see it.

    Parameters
    ----------
    work
        The session that runs.
    keys
        The console's secrets.
    secure
        Whether pages come over TLS.
    """

    def __init__(self, work: AtWork, keys: Keys, audience: Audience, board: Board, secure: bool) -> None:
        self._work, self._keys, self._audience, self._board, self._secure = work, keys, audience, board, secure
        self._templates = Jinja2Templates(HERE / "templates")
        self._sockets = PageSockets(work, audience, board)

    def routes(self) -> list[BaseRoute]:
        """All of them."""
        acts: dict[str, tuple[Answer, bool]] = {
            "stop": (self._stop, False),
            "pause": (self._pause, True),
            "answer": (self._answer, True),
            "run": (self._run, True),
            "resume": (self._resume, True),
            "judge": (self._judge, True),
            "link": (self._link, True),
            "diagnose": (self._diagnose, True),
            "settings": (self._save_settings, True),
            "settings/check": (self._check_settings, False),
            **ViewRoutes(self._work).acts(),
        }
        return [
            Route(OPEN_PATH, self._open, methods=["GET"]),
            Route("/", self._page, methods=["GET"]),
            Mount("/static", StaticFiles(directory=HERE / "static"), name="static"),
            *(Route(f"/api/{name}", self._act(*act), methods=["POST"]) for name, act in acts.items()),
            Route("/api/control", self._control, methods=["POST"]),
            Route("/api/settings", self._settings_form, methods=["GET"]),
            Route("/api/sessions", self._sessions, methods=["GET"]),
            Route("/api/sessions/{id:str}", self._results, methods=["GET"]),
            Route("/api/compare", self._compare, methods=["GET"]),
            Route("/api/taps/{number:int}", self._tap, methods=["GET"]),
            Route("/sessions/{id:str}/{what:str}", self._document, methods=["GET"]),
            WebSocketRoute("/ws", self._sockets.meet),
        ]

    # --- pages ----------------------------------------------------------------------------------------------

    async def _open(self, request: Request) -> Response:
        """Trade the token of a one-time link for the cookie; what only looks whether it is there leaves it good."""
        if request.method != "GET":
            return PlainTextResponse("mesotap: only GET\n", 405, {"Allow": "GET", "Cache-Control": "no-store"})
        if not self._keys.use_link(request.query_params.get("token", "")):
            text = "mesotap: this link was used, or is not one; restart 'mesotap console', or ask its page for a link\n"
            return PlainTextResponse(text, 403, {"Cache-Control": "no-store", "Connection": "close"})
        response = RedirectResponse("/", 303, {"Cache-Control": "no-store"})
        response.set_cookie(
            self._keys.cookie_name, self._keys.cookie, httponly=True, samesite="strict", secure=self._secure, path="/"
        )
        return response

    async def _page(self, request: Request) -> Response:
        return self._templates.TemplateResponse(
            request,
            "console.html",
            {"version": __version__, "scope": self._work.bench.scope},
            headers={"Cache-Control": "no-store"},
        )

    async def _sessions(self, request: Request) -> Response:
        found = await asyncio.to_thread(sessions_in, self._work.bench.root)
        return JSONResponse({"sessions": [s.summary for s in found]}, headers={"Cache-Control": "no-store"})

    async def _results(self, request: Request) -> Response:
        """What a past session came to, to be held against others."""
        session = await asyncio.to_thread(session_of, self._work.bench.root, request.path_params["id"])
        if session is None:
            return JSONResponse({"error": "there is no such session"}, 404)
        try:
            loads = await asyncio.to_thread(results_of, session)
        except MesotapError as error:
            return JSONResponse({"error": str(error)}, 400)
        told = {"name": session.summary["name"], "drifted": session.summary["drifted"], "loads": loads}
        return JSONResponse(told, headers={"Cache-Control": "no-store"})

    async def _compare(self, request: Request) -> Response:
        """Past sessions against each other, as `mesotap compare` tells it."""
        wanted = request.query_params.get("ids", "").split(",")[:MOST_COMPARED]
        found = [await asyncio.to_thread(session_of, self._work.bench.root, name) for name in dict.fromkeys(wanted)]
        sessions = [session for session in found if session is not None]
        try:
            told = await asyncio.to_thread(comparison_of, sessions)
        except MesotapError as error:
            return JSONResponse({"error": str(error)}, 400)
        return JSONResponse(told, headers={"Cache-Control": "no-store"})

    async def _tap(self, request: Request) -> Response:
        record = self._board.records.get(request.path_params["number"])
        return Response(status_code=404) if record is None else Response(record, media_type="application/octet-stream")

    async def _document(self, request: Request) -> Response:
        """A report or a diagnosis, in which nothing runs."""
        if request.path_params["id"] == SO_FAR:
            return _shown(self._work.so_far.page)
        name = {"report": REPORT, "diagnosis": DIAGNOSIS}.get(request.path_params["what"])
        session = await asyncio.to_thread(session_of, self._work.bench.root, request.path_params["id"])
        return _shown(None if session is None or name is None else session.path / name)

    # --- what changes something ------------------------------------------------------------------------------

    def _act(self, answer: Answer, needs_control: bool) -> Callable[[Request], Awaitable[Response]]:
        """Return the endpoint of an act: one sentence for what is refused."""

        async def endpoint(request: Request) -> Response:
            if needs_control and not self._audience.holds_control(request.headers.get(PAGE_KEY, "")):
                return JSONResponse({"error": "this page only watches: take control first"}, 403)
            try:
                return JSONResponse(await answer(await _content(request)))
            except (MesotapError, *NO_REQUEST) as error:
                told = str(error) if isinstance(error, MesotapError) else f"this is no such request ({error})"
                return JSONResponse({"error": told}, 400)

        return endpoint

    async def _stop(self, content: dict[str, Any]) -> dict[str, Any]:
        return {"stopped": self._work.stop()}

    async def _pause(self, content: dict[str, Any]) -> dict[str, Any]:
        if self._board.state["viewing"]:
            raise Refused("the live view does not pause; 'Hold' holds its picture")
        return {"told": self._work.tell({"do": "pause"})}

    async def _answer(self, content: dict[str, Any]) -> dict[str, Any]:
        number, asked = int(content["id"]), self._board.state["ask"]
        if asked is None or asked["id"] != number:
            raise Refused("this is not asked now")
        return {"told": self._work.tell({"do": "answer", "id": number})}

    async def _judge(self, content: dict[str, Any]) -> dict[str, Any]:
        number, accepted, reason = int(content["number"]), content["accepted"], str(content["reason"]).strip()
        if not isinstance(accepted, bool) or number not in self._board.taps:
            raise Refused("there is no such tap in this session")
        if not reason or len(reason) > LONGEST_REASON or not reason.isprintable():
            raise Refused(f"give a reason of 1 to {LONGEST_REASON} characters on one line; it is kept with the tap")
        if self._board.state["state"] == "FILE":
            raise Refused("the session is being filed: the verdicts on its taps stay as they are")
        if self._work.running and self._board.taps[number]["accepted"] is accepted:  # a second press: nothing is new
            return {"told": False}
        told = self._work.tell({"do": "judge", "number": number, "accepted": accepted, "reason": reason})
        if not told:
            raise Refused("no session runs: the verdicts of a finished session stay as they are")
        self._board.hear({"kind": "judged", "number": number, "accepted": accepted, "reason": reason}, b"")
        return {"told": told}

    async def _run(self, content: dict[str, Any]) -> dict[str, Any]:
        names = {key: content[key] for key in ("operator", "specimen", "title") if content.get(key)}
        for key, name in names.items():
            if not isinstance(name, str) or len(name) > LONGEST_NAME or not name.isprintable():
                raise Refused(f"{key}: give at most {LONGEST_NAME} characters on one line, none of them invisible")
        changes = [f"mesotap.{key}={json.dumps(name, ensure_ascii=False)}" for key, name in names.items()]
        await self._work.run(changes)
        return {"started": True}

    async def _resume(self, content: dict[str, Any]) -> dict[str, Any]:
        session = await asyncio.to_thread(session_of, self._work.bench.root, str(content["id"]))
        if session is None:
            raise Refused("there is no such session")
        await self._work.resume(session.path)
        return {"started": True}

    async def _diagnose(self, content: dict[str, Any]) -> dict[str, Any]:
        if not self._work.so_far.begin():
            raise Refused("a diagnosis runs already")
        return {"started": True}

    async def _settings_form(self, request: Request) -> Response:
        try:
            shown = await asyncio.to_thread(self._work.bench.settings().form)
        except MesotapError as error:
            shown = {"error": str(error), "fields": [], "state": ""}
        return JSONResponse(shown, headers={"Cache-Control": "no-store"})

    async def _check_settings(self, content: dict[str, Any]) -> dict[str, Any]:
        return await asyncio.to_thread(self._work.bench.settings().changed, dict(content["changes"]), content["state"])

    async def _save_settings(self, content: dict[str, Any]) -> dict[str, Any]:
        return await asyncio.to_thread(self._work.bench.settings().save, dict(content["changes"]), content["state"])

    async def _link(self, content: dict[str, Any]) -> dict[str, Any]:
        return {"path": f"{OPEN_PATH}?token={self._keys.new_link()}"}

    async def _control(self, request: Request) -> Response:
        """Take, ask for, or hand over control."""
        key = request.headers.get(PAGE_KEY, "")
        try:
            content = await _content(request)
            acts: dict[str, Callable[[], bool]] = {
                "take": lambda: self._audience.take(key),
                "ask": lambda: self._audience.ask(key),
                "give": lambda: self._audience.give(key, int(content["to"])),
            }
            done = acts[content["do"]]()
        except NO_REQUEST:
            return JSONResponse({"error": "this is no such request"}, 400)
        if not done:
            return JSONResponse({"error": "control is held by another page, or this one is not open"}, 403)
        return JSONResponse({"done": True})


def _shown(path: Path | None) -> Response:
    """Return a page that was written by this program, in which nothing runs."""
    if path is None or path.is_symlink() or not path.is_file():
        return PlainTextResponse("mesotap: there is no such page\n", 404)
    headers = {"Content-Security-Policy": REPORT_POLICY, "Cache-Control": "no-store"}
    return FileResponse(path, media_type="text/html; charset=utf-8", headers=headers)


async def _content(request: Request) -> dict[str, Any]:
    """Return the object that a page sent."""
    try:
        content = json.loads(await request.body() or b"{}")
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(content, dict):
        raise ValueError("an object is expected")
    return content
