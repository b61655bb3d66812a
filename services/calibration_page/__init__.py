"""The screens of a pupil calibration as a page in a browser: no build step, three files and this server.

The page speaks JSON over a WebSocket, the calibration msgpack over ZeroMQ, and both say the same messages: this server
only passes them on, and is a display like any other to the calibration. One page at a time; when it goes away, the
calibration is paused.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket as sockets
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import uvicorn
import zmq
import zmq.asyncio
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from tracker_bridge.publisher import PortInUseError

_FOLDER = Path(__file__).parent
_FILES = {"/": "page.html", "/page.css": "page.css", "/page.js": "page.js"}
_HEADERS = {"Cache-Control": "no-store", "X-Frame-Options": "DENY"}
"""The next release's page must not be this one's; and nobody else's page must take the one place, in a frame."""
LOOPBACK = ("127.0.0.1", "localhost")
"""Hosts that no other machine reaches."""
_REFUSED = 1008
"""WebSocket's "policy violation"."""
_LAST_WORDS_S = 0.3
"""What the calibration said last is still on its way to the page. Engineering choice: a hundred round trips."""
_ENDS_WITHIN_S = 10.0


def app(commands_address: str, answers_address: str, hosts: tuple[str, ...] = LOOPBACK) -> Starlette:
    """The page, and the way from it to a calibration's sockets. It answers under these host names alone."""
    taken = asyncio.Lock()

    async def file(request: Request) -> FileResponse:
        return FileResponse(_FOLDER / _FILES[request.url.path], headers=_HEADERS)

    async def display(page: WebSocket) -> None:
        await page.accept()
        # A browser lets any page connect to this machine, but tells from where.
        if urlsplit(page.headers.get("origin", "")).netloc != page.headers.get("host"):
            await page.close(_REFUSED, "Only the calibration's own page may connect.")
        elif taken.locked():
            await page.close(_REFUSED, "Another page is open already: go on there, or close it and reload this one.")
        else:
            async with taken:
                await _relay(page, commands_address, answers_address)

    return Starlette(
        routes=[*(Route(path, file) for path in _FILES), WebSocketRoute("/display", display)],
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=list(hosts))],
    )


async def _relay(page: WebSocket, commands_address: str, answers_address: str) -> None:
    context = zmq.asyncio.Context()
    commands, answers = context.socket(zmq.SUB), context.socket(zmq.PUSH)
    commands.subscribe(b"")
    commands.connect(commands_address)
    answers.connect(answers_address)

    async def to_page() -> None:
        while True:
            message = msgspec.msgpack.decode(await commands.recv())
            await page.send_text(msgspec.json.encode(message).decode())

    sending = asyncio.create_task(to_page())
    try:
        while True:
            said = await page.receive_text()
            # What is no JSON, is nested endlessly or holds a number of more than 64 bits is no message; what a message
            # means is for the calibration to check.
            with contextlib.suppress(msgspec.DecodeError, RecursionError, OverflowError):
                await answers.send(msgspec.msgpack.encode(msgspec.json.decode(said)))
    except (WebSocketDisconnect, KeyError):
        pass  # KeyError: what it said was no text
    finally:
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError, RuntimeError, WebSocketDisconnect):
            await sending
        # However the page went away: nobody sees the screen any more.
        await answers.send(msgspec.msgpack.encode({"request": "pause"}))
        context.destroy(linger=500)


class PageServer:
    """Serves the page from a thread until closed. Raises PortInUseError."""

    def __init__(self, commands_address: str, answers_address: str, host: str, port: int) -> None:
        self._socket = sockets.socket(sockets.AF_INET, sockets.SOCK_STREAM)
        self._socket.setsockopt(sockets.SOL_SOCKET, sockets.SO_REUSEADDR, 1)
        try:
            self._socket.bind((host, port))
            # From here on a browser that is too early waits and is not refused.
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise PortInUseError(
                f"cannot serve the page on {host}:{port}: {error.strerror}; choose another --port, or 0 for any"
            ) from None
        self.port = int(self._socket.getsockname()[1])
        self.url = f"http://{host if host != '0.0.0.0' else sockets.gethostname()}:{self.port}/"
        hosts = LOOPBACK if host in LOOPBACK else ("*",)
        config = uvicorn.Config(
            app(commands_address, answers_address, hosts),
            log_level="warning",
            timeout_graceful_shutdown=1,
            ws_max_size=65_536,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._socket]}, name="calibration-page", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Ends the connection to the page and the server."""
        time.sleep(_LAST_WORDS_S)
        self._server.should_exit = True
        self._thread.join(_ENDS_WITHIN_S)
        self._socket.close()
