"""Who may come in, and what browsers are told to keep to.

Theory of operation: a browser lets any page in the world connect to this machine, and a name in the world's DNS may be
made to mean this machine. So a request must name a host that is ours (against DNS rebinding), and a WebSocket must come
from a page of that very host (against foreign pages); nothing is changed by anything but a WebSocket. Beyond loopback a
token is needed too: it is given once in the address, kept in a cookie that scripts cannot read and other sites cannot
send, and compared in constant time.
"""

from __future__ import annotations

import ipaddress
import secrets
from typing import Final
from urllib.parse import parse_qsl, urlencode, urlsplit

import msgspec
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from entoptic.services.web_server import is_own_origin

LOOPBACK_NAMES: Final = ("localhost",)
MAX_BODY_BYTES: Final = 65_536
REFUSED: Final = 1008
"""WebSocket's "policy violation"."""
COOKIE: Final = "entoptic_console"
OPEN_PATHS: Final = ("/health",)
"""They tell nothing, and change nothing."""
_PAGE_POLICY: Final = (
    "default-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; object-src 'none'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
_FILES_POLICY: Final = (
    "default-src 'none'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; media-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Of what sessions left: reports have their styles in themselves, and no scripts."""
HEADERS: Final = {
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Rules(msgspec.Struct, frozen=True):
    """Who may come in."""

    token: str | None
    """None where nobody but this machine reaches the port."""
    hosts: tuple[str, ...] = ()
    """Names by which the server may be called, beside those of loopback; without ports."""
    port: int = 0
    """Two consoles of one machine share their cookies but for it."""

    @property
    def cookie(self) -> str:
        """Its name."""
        return f"{COOKIE}_{self.port}"

    def knows(self, host: str | None) -> bool:
        """Whether a Host header names this server."""
        name = _name_of(host)
        if name is None:
            return False
        if name in LOOPBACK_NAMES or name in self.hosts:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        # No DNS can make a number mean something else; but without a token it has to be this machine's.
        return address.is_loopback or self.token is not None

    def admits(self, given: str | None) -> bool:
        """Whether a token is the right one."""
        if self.token is None:
            return True
        return given is not None and secrets.compare_digest(given.encode(), self.token.encode())


def new_token() -> str:
    """256 bits by lot."""
    return secrets.token_urlsafe(32)


class Gate:
    """Stands before the application (ASGI middleware)."""

    def __init__(self, app: ASGIApp, rules: Rules) -> None:
        self._app, self._rules = app, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes on what may come in, and refuses the rest."""
        if scope["type"] == "websocket":
            headers = Headers(scope=scope)
            if self._rules.knows(headers.get("host")) and is_own_origin(headers) and self._has_token(headers):
                await self._app(scope, receive, send)
            else:
                await WebSocketClose(REFUSED, "Only this console's own page may connect.")(scope, receive, send)
        elif scope["type"] == "http":
            await self._http(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(HEADERS)
                policy = _FILES_POLICY if scope["path"].startswith("/sessions/") else _PAGE_POLICY
                headers["Content-Security-Policy"] = policy
            await send(message)

        answer: ASGIApp = self._refusal(scope) or self._app
        await answer(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> ASGIApp | None:
        headers = Headers(scope=scope)
        if not self._rules.knows(headers.get("host")):
            return PlainTextResponse("This console is not known by that name; see --allow-host.", 421)
        if "origin" in headers and not is_own_origin(headers):
            return PlainTextResponse("Only this console's own page may ask.", 403)
        if scope["method"] not in ("GET", "HEAD"):
            return PlainTextResponse("Nothing is changed this way.", 405, headers={"Allow": "GET, HEAD"})
        length = headers.get("content-length", "0")
        if "transfer-encoding" in headers or not length.isdecimal() or int(length[:10]) > MAX_BODY_BYTES:
            return PlainTextResponse("Too long.", 413, headers={"Connection": "close"})
        if scope["path"] in OPEN_PATHS:
            return None
        return self._token_refusal(scope, headers)

    def _token_refusal(self, scope: Scope, headers: Headers) -> ASGIApp | None:
        query = parse_qsl(scope["query_string"].decode("latin-1"))
        given = [value for name, value in query if name == "token"]
        if given and self._rules.token is not None:
            if not self._rules.admits(given[0]):
                return PlainTextResponse("This token is not the console's: take the address that it printed.", 401)
            # Without the token in the address: it would stay in the history, and be seen by who looks on.
            rest = urlencode([(name, value) for name, value in query if name != "token"])
            path = "/" + scope["path"].lstrip("/")  # never //other.host
            response = RedirectResponse(path + (f"?{rest}" if rest else ""), 303)
            response.set_cookie(
                self._rules.cookie, given[0], httponly=True, samesite="strict", secure=scope["scheme"] == "https"
            )
            return response
        if not self._has_token(headers):
            return PlainTextResponse("A token is needed: open the address that the console printed at its start.", 401)
        return None

    def _has_token(self, headers: Headers) -> bool:
        return self._rules.admits(cookie_parser(headers.get("cookie", "")).get(self._rules.cookie))


def _name_of(host: str | None) -> str | None:
    """A Host header's name or number, without the port."""
    if not host:
        return None
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
