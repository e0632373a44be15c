"""Who may ask the console for what: nothing passes to a route that has not passed here.

A page of somebody else in the same browser can send requests to this address, so an address alone proves nothing:

- the Host must be one under which the console was opened, else a foreign name that is made to point here would do;
- every request but the one-time link carries the cookie, which a foreign page does not send (SameSite=Strict);
- a request that changes something is a POST with a header that a foreign page cannot set without being asked
  (X-Mesotap), and the Origin, where there is one, is the console's own;
- the WebSocket's handshake has exactly that Origin: browsers let any page open one.
"""

from __future__ import annotations

import hmac
import secrets
from http.cookies import CookieError, SimpleCookie

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

OPEN_PATH = "/open"
"""Path of the one-time link, the only one that needs no cookie."""

LARGEST_BODY = 256 * 1024
"""Bytes of a POST: a configuration has at most 100 kB."""

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
        self._origins = frozenset(f"{scheme}://{host}" for host in hosts)

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
            status, why = refusal
            response = PlainTextResponse(f"mesotap: {why}\n", status, {"Cache-Control": "no-store"})
            await response(scope, receive, _with_headers(send))
        else:
            await self._app(scope, _limited(receive), _with_headers(send))

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers: dict[bytes, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name, []).append(value.decode("latin-1"))
        hosts, origins = headers.get(b"host", []), headers.get(b"origin", [])
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return 421, "this console is not served under that name"
        if len(scope["path"]) > LONGEST_PATH:
            return 414, "the address is too long"
        if scope["type"] == "websocket":
            if len(origins) != 1 or origins[0] not in self._origins:
                return 403, "a page of another origin"
        elif scope["method"] not in METHODS:
            return 405, f"only {', '.join(METHODS)}"
        elif any(origin not in self._origins for origin in origins):
            return 403, "a page of another origin"
        elif scope["method"] == "POST":
            if headers.get(HEADER) != ["1"]:
                return 403, "the header X-Mesotap is missing"
            kinds = [kind.partition(";")[0].strip().lower() for kind in headers.get(b"content-type", [])]
            if kinds != ["application/json"]:
                return 415, "JSON is expected"
            lengths = headers.get(b"content-length", ["0"])
            if len(lengths) != 1 or not lengths[0].isdigit() or int(lengths[0]) > LARGEST_BODY:
                return 413, f"more than {LARGEST_BODY // 1024} kB"
        if scope["type"] == "http" and scope["path"] == OPEN_PATH:
            return None
        if not any(self._keys.admits(text) for text in headers.get(b"cookie", [])):
            return 401, "open the link that 'mesotap console' printed"
        return None


def _limited(receive: Receive) -> Receive:
    """Pass on a body up to its limit, also one that does not say how long it is."""
    taken = 0

    async def limited() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > LARGEST_BODY:
            return {"type": "http.disconnect"}
        return message

    return limited


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
