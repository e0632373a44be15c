"""Who may ask the console for what: nothing passes to a route that has not passed here.

A page of somebody else in the same browser can send requests to this address, so an address alone proves nothing:

- the Host must be one under which the console was opened, or the address at which the request came, else a foreign
  name that is made to point here would do;
- every request but the one-time link carries the cookie, which a foreign page does not send (SameSite=Strict);
- a request that changes something is a POST with a header that a foreign page cannot set without being asked
  (X-Mesotap), and the Origin, where there is one, is the console's own;
- the WebSocket's handshake has exactly that Origin: browsers let any page open one;
- whoever is refused is disconnected, and a body has to be whole in time: nobody without the cookie holds a connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import secrets
from http.cookies import CookieError, SimpleCookie

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mesotap.console.connections import LARGEST_HEADER

OPEN_PATH = "/open"
"""Path of the one-time link, the only one that needs no cookie."""

LARGEST_BODY = 256 * 1024
"""Bytes of a POST: a configuration has at most 100 kB."""

BODY_S = 5.0
"""In which the body of a POST has to be whole."""

LONGEST_PATH = 512
MOST_LINKS = 16
HEADER = b"x-mesotap"
METHODS = ("GET", "HEAD", "POST")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; "
    "connect-src 'self'; frame-src 'self'; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'"
)
"""Of a report within the page: it is shown, and nothing in it runs."""


class Keys:
    """The console's secrets: what the cookie has to be, and one-time links that set it.

    Parameters
    ----------
    cookie_name
        Differs between consoles on one host, which share cookies whatever their ports.
    """

    def __init__(self, cookie_name: str) -> None:
        self.cookie_name = cookie_name
        self.cookie = secrets.token_urlsafe(32)
        self._links: list[str] = []

    def new_link(self) -> str:
        """Return the token of a new one-time link; of too many, the oldest is no longer good."""
        token = secrets.token_urlsafe(32)
        self._links = [*self._links, token][-MOST_LINKS:]
        return token

    def use_link(self, token: str) -> bool:
        """Whether this is a link that was not used yet; it is used now."""
        found = [known for known in self._links if hmac.compare_digest(known.encode(), token.encode())]
        self._links = [known for known in self._links if known not in found]
        return bool(found)

    def admits(self, cookies: str) -> bool:
        """Whether the text of a Cookie header has the cookie."""
        try:
            morsel = SimpleCookie(cookies).get(self.cookie_name)
        except CookieError:
            return False
        return morsel is not None and hmac.compare_digest(morsel.value.encode(), self.cookie.encode())


class Gate:
    """ASGI application around another one.

    Parameters
    ----------
    app
        What is reached by those who may.
    keys
        The secrets.
    hosts
        Allowed values of Host, with the port.
    scheme
        ``http`` or ``https``.
    """

    def __init__(self, app: ASGIApp, keys: Keys, hosts: frozenset[str], scheme: str) -> None:
        self._app = app
        self._keys = keys
        self._hosts = hosts
        self._scheme = scheme

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if scope["type"] == "websocket":
            if refusal is not None:
                await receive()
                await send({"type": "websocket.close", "code": 1008})
                return
            await self._app(scope, receive, send)
        elif refusal is not None:
            await _refuse(refusal, scope, receive, send)
        elif scope["method"] == "POST":
            body = await _body(receive)
            if body is None:
                await _refuse((408, "the request was not whole in time"), scope, receive, send)
                return
            await self._app(scope, _after(body, receive), _with_headers(send))
        else:
            await self._app(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers: dict[bytes, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name, []).append(value.decode("latin-1"))
        lengths = headers.get(b"content-length", ["0"])
        hosts, origins = headers.get(b"host", []), headers.get(b"origin", [])
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts | {_reached(scope)}:
            return 421, "this console is not served under that name; allow it with --name"
        own = f"{self._scheme}://{hosts[0].lower()}"
        if sum(len(name) + len(value) + 4 for name, value in scope["headers"]) > LARGEST_HEADER:
            return 431, "the headers are too long"
        if len(scope["path"]) > LONGEST_PATH:
            return 414, "the address is too long"
        if b"transfer-encoding" in headers:
            return 411, "a body says how long it is"
        if scope["type"] == "websocket":
            if origins != [own]:
                return 403, "a page of another origin"
        elif scope["method"] not in METHODS:
            return 405, f"only {', '.join(METHODS)}"
        elif any(origin != own for origin in origins):
            return 403, "a page of another origin"
        elif scope["method"] == "POST":
            if headers.get(HEADER) != ["1"]:
                return 403, "the header X-Mesotap is missing"
            kinds = [kind.partition(";")[0].strip().lower() for kind in headers.get(b"content-type", [])]
            if kinds != ["application/json"]:
                return 415, "JSON is expected"
            if len(lengths) != 1 or not lengths[0].isdigit() or int(lengths[0]) > LARGEST_BODY:
                return 413, f"more than {LARGEST_BODY // 1024} kB"
        elif lengths != ["0"]:
            return 400, "only a POST has a body"
        if scope["type"] == "http" and scope["path"] == OPEN_PATH:
            return None
        if not any(self._keys.admits(text) for text in headers.get(b"cookie", [])):
            return 401, "open the link that 'mesotap console' printed"
        return None


def _reached(scope: Scope) -> str:
    """Return the address of this machine at which a request came, as its Host would say it."""
    host, port = scope.get("server") or ("", 0)
    with contextlib.suppress(ValueError):
        address = ipaddress.ip_address(host)
        if address.version == 6:
            host = str(address.ipv4_mapped or f"[{address}]")
    return f"{host}:{port}"


async def _refuse(refusal: tuple[int, str], scope: Scope, receive: Receive, send: Send) -> None:
    """Say why in one line, and disconnect."""
    status, why = refusal
    headers = {"Cache-Control": "no-store", "Connection": "close"}
    await PlainTextResponse(f"mesotap: {why}\n", status, headers)(scope, receive, _with_headers(send))


async def _body(receive: Receive) -> bytes | None:
    """Return the whole body, which is as long as its length says; None if it does not come in time."""
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            while True:
                message = await receive()
                if message["type"] != "http.request":
                    return None
                body += message.get("body", b"")
                if not message.get("more_body", False):
                    return body
    except TimeoutError:
        return None


def _after(body: bytes, receive: Receive) -> Receive:
    """Pass on a body that was received, then what comes after it."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def passing() -> Message:
        return waiting.pop() if waiting else await receive()

    return passing


def _with_headers(send: Send) -> Send:
    """Add to every answer what tells a browser not to do with it."""

    async def adding(message: Message) -> None:
        if message["type"] == "http.response.start":
            names = {name for name, _ in message["headers"]}
            more = {
                b"content-security-policy": POLICY.encode(),
                b"x-content-type-options": b"nosniff",
                b"x-frame-options": b"SAMEORIGIN",
                b"referrer-policy": b"no-referrer",
                b"cross-origin-opener-policy": b"same-origin",
                b"cross-origin-resource-policy": b"same-origin",
            }
            message["headers"] = [*message["headers"], *((n, v) for n, v in more.items() if n not in names)]
        await send(message)

    return adding
