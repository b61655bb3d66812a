"""What serves pages: a port, the connections that it let in, and a thread of its own.

Theory of operation: closing a connection politely waits until its other end has taken what is on its way, which may be
for ever; and uvicorn keeps one that never asks for anything, one of those that there are. So the listening socket
remembers what it accepted, by the other end's address, under which ASGI names it too.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import weakref
from typing import Any
from urllib.parse import urlsplit

import uvicorn
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from entoptic.tracker_bridge.publisher import PortInUseError

ENDS_WITHIN_S = 0.5
"""Connections that are still open then are cut."""
FIRST_REQUEST_S = 10.0
"""From a connection to what it asks for. Engineering choice: a slow network's, tenfold."""

Client = tuple[str, int]


class Connections(socket.socket):
    """A listening socket. All methods are for the event loop."""

    def __init__(self, family: socket.AddressFamily) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self._open: weakref.WeakValueDictionary[Client, socket.socket] = weakref.WeakValueDictionary()
        self._silent: set[Client] = set()

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        """The next one; it is cut if it asks for nothing. On Windows asyncio accepts another way: none is cut there."""
        connection, address = super().accept()
        client = address[:2]
        self._open[client] = connection
        self._silent.add(client)
        asyncio.get_running_loop().call_later(FIRST_REQUEST_S, self._cut_if_silent, client)
        return connection, address

    def _cut_if_silent(self, client: Client) -> None:
        if client in self._silent:
            self.cut(client)

    def cut(self, client: Client) -> None:
        """Ends a connection at once."""
        self._silent.discard(client)
        if (connection := self._open.get(client)) is not None:
            with contextlib.suppress(OSError):  # it is gone already
                connection.shutdown(socket.SHUT_RDWR)

    def watch(self, app: ASGIApp) -> ASGIApp:
        """ASGI middleware that sees who asks."""

        async def watched(scope: Scope, receive: Receive, send: Send) -> None:
            self._silent.discard(tuple(scope.get("client") or ()))
            await app(scope, receive, send)

        return watched


def is_own_origin(headers: Headers) -> bool:
    """Whether a request comes from a page of the host that it asks: a browser lets any page connect, and says whose it
    is."""
    try:
        parts = urlsplit(headers.get("origin", ""))
    except ValueError:  # no address at all
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == headers.get("host", "").lower()


def listen(host: str, port: int, served: str) -> Connections:
    """Listens there, on any free port for 0; `served` is what, for a person. Raises PortInUseError."""
    listening = Connections(socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        # From here on a browser that is too early waits and is not refused.
        listening.listen(128)
    except OSError as error:
        listening.close()
        raise PortInUseError(
            f"cannot serve {served} on {host}:{port}: {error.strerror}; choose another --port, or 0 for any"
        ) from None
    return listening


class WebServer:
    """Serves an application from a thread of its own until closed."""

    def __init__(self, app: ASGIApp, port: Connections, **options: Any) -> None:
        """`options` are uvicorn's."""
        self._port = port
        config = uvicorn.Config(
            port.watch(app),
            http="h11",
            ws="websockets-sansio",
            timeout_graceful_shutdown=1,
            server_header=False,
            access_log=False,
            log_config=None,
            log_level="critical",
            **options,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, args=([port],), name="web-server", daemon=True)
        self._thread.start()

    @property
    def started(self) -> bool:
        """Whether it takes requests."""
        return bool(self._server.started)

    @property
    def lives(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """It is to end; for any thread."""
        self._server.should_exit = True

    def close(self, within_s: float = ENDS_WITHIN_S) -> None:
        """Ends it."""
        self.stop()
        self._thread.join(within_s)
        self._server.force_exit = True
        self._thread.join(within_s)
        self._port.close()
