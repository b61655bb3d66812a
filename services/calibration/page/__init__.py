"""The screens of a pupil calibration as a page in a browser: no build step, three files and the way to a calibration.

The page speaks JSON over a WebSocket, the calibration msgpack over ZeroMQ, and both say the same messages: `Screens`
only passes them on, and is a display like any other to the calibration. `entoptic calibrate` serves it by a server of
its own; the console serves the same page under a prefix. One page at a time; when it goes away, the calibration is
paused.
"""

from __future__ import annotations

import asyncio
import contextlib
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
import zmq
import zmq.asyncio
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from entoptic.services.calibration.display import MAX_ANSWER_BYTES
from entoptic.services.web_server import WebServer, is_own_origin, listen
from entoptic.tracker_bridge.access import ClientKeys

_FOLDER = Path(__file__).parent
_FILES = {"/": "page.html", "/page.css": "page.css", "/page.js": "page.js"}
_HEADERS = {"Cache-Control": "no-store", "X-Frame-Options": "DENY"}
"""The next release's page must not be this one's; and nobody else's page must take the one place, in a frame."""
LOOPBACK = ("127.0.0.1", "localhost")
"""Hosts that no other machine reaches."""
_REFUSED, _LATER = 1008, 1013
"""WebSocket's "policy violation", after which the page stays away, and "try again later", which it does."""
_LAST_WORDS_S = 0.3
"""What the calibration said last is still on its way to the page. Engineering choice: a hundred round trips."""
_ENDS_WITHIN_S = 10.0
_PAUSE: Final = {"request": "pause"}
_START: Final = {"request": "start"}

Where = Callable[[], tuple[str, str] | None]
"""Where a calibration asks for screens and where it takes answers; None while there is none to connect to."""


class Screens:
    """The page and the way from it to a calibration's sockets; all its methods are for one event loop."""

    def __init__(self, where: Where, keys: ClientKeys | None = None) -> None:
        self._where = where
        self._keys = keys
        self._taken = asyncio.Lock()
        self._answers: zmq.asyncio.Socket | None = None

    @property
    def routes(self) -> list[BaseRoute]:
        """For the root of a server, or below a prefix that ends in /: all that the page asks for is relative."""
        return [*(Route(path, _file(name)) for path, name in _FILES.items()), WebSocketRoute("/display", self._display)]

    async def start(self) -> bool:
        """Starts the calibration that was begun, or goes on after a pause, as the page's button; not without a page."""
        if self._answers is None:
            return False
        await self._answers.send(msgspec.msgpack.encode(_START))
        return True

    async def _display(self, page: WebSocket) -> None:
        await page.accept()
        place = self._where()
        if not is_own_origin(page.headers):
            await page.close(_REFUSED, "Only the calibration's own page may connect.")
        elif place is None:
            await page.close(_LATER, "No session runs yet: start one in the console.")
        elif self._taken.locked():
            await page.close(_REFUSED, "Another page is open already: go on there, or close it and reload this one.")
        else:
            async with self._taken:
                await self._relay(page, *place)

    async def _relay(self, page: WebSocket, commands_address: str, answers_address: str) -> None:
        context = zmq.asyncio.Context()
        commands, answers = context.socket(zmq.SUB), context.socket(zmq.PUSH)
        for socket, address in ((commands, commands_address), (answers, answers_address)):
            if self._keys is not None:
                self._keys.use(socket)
            if socket is commands:
                socket.subscribe(b"")
            socket.connect(address)

        async def to_page() -> None:
            while True:
                message = msgspec.msgpack.decode(await commands.recv())
                await page.send_text(msgspec.json.encode(message).decode())

        sending = asyncio.create_task(to_page())
        self._answers = answers
        try:
            while True:
                await _pass_on(await page.receive_text(), answers)
        except (WebSocketDisconnect, KeyError):
            pass  # KeyError: what it said was no text
        finally:
            self._answers = None
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, RuntimeError, WebSocketDisconnect):
                await sending
            # However the page went away: nobody sees the screen any more.
            with contextlib.suppress(zmq.Again):  # where nobody has been listening for long
                await answers.send(msgspec.msgpack.encode(_PAUSE), zmq.DONTWAIT)
            context.destroy(linger=500)


def _file(name: str) -> Callable[[Request], FileResponse]:
    def answer(request: Request) -> FileResponse:
        return FileResponse(_FOLDER / name, headers=_HEADERS)

    return answer


async def _pass_on(text: str, answers: zmq.asyncio.Socket) -> None:
    """What is no JSON, nested endlessly, too long or holds a number of more than 64 bits is no message; what a message
    means is for the calibration to check.
    """
    with contextlib.suppress(msgspec.DecodeError, RecursionError, OverflowError, zmq.Again):
        message = msgspec.msgpack.encode(msgspec.json.decode(text))
        if len(message) <= MAX_ANSWER_BYTES:
            await answers.send(message, zmq.DONTWAIT)


def app(commands_address: str, answers_address: str, hosts: tuple[str, ...] = LOOPBACK) -> Starlette:
    """A server of the page alone. It answers under these host names alone."""
    return Starlette(
        routes=Screens(lambda: (commands_address, answers_address)).routes,
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=list(hosts))],
    )


class PageServer:
    """Serves the page from a thread until closed. Raises PortInUseError."""

    def __init__(self, commands_address: str, answers_address: str, host: str, port: int) -> None:
        listening = listen(host, port, "the page")
        self.port = int(listening.getsockname()[1])
        self.url = f"http://{host if host != '0.0.0.0' else platform.node()}:{self.port}/"
        hosts = LOOPBACK if host in LOOPBACK else ("*",)
        self._server = WebServer(app(commands_address, answers_address, hosts), listening, ws_max_size=65_536)

    def close(self) -> None:
        """Ends the connection to the page and the server."""
        time.sleep(_LAST_WORDS_S)
        self._server.close(_ENDS_WITHIN_S)
