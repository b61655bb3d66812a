"""The console as a server: routes, the WebSocket, start and end."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.metadata
import time
import traceback
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import structlog
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from entoptic.services.calibration.page import Screens
from entoptic.services.console import protocol, requests
from entoptic.services.console.actions import Actions, Folders
from entoptic.services.console.fields import fields, session_fields
from entoptic.services.console.listing import PUPIL_MAPS
from entoptic.services.console.live import Live, Places
from entoptic.services.console.protocol import Fields, Hello, Replied
from entoptic.services.console.requests import MAX_REQUEST_BYTES, RequestError
from entoptic.services.console.security import Gate, Rules
from entoptic.services.console.viewers import Page
from entoptic.services.results import session_file
from entoptic.services.web_server import WebServer, listen

PAGE = Path(__file__).parent / "page"
SCREENS_URL = "/screens/"
FULL = 1013
"""WebSocket's "try again later"."""
REQUEST_S = 0.02
"""From one request of a page to the next at least."""
MOST_CONNECTIONS = 400
LAST_WORDS_S = 0.15
"""For pages to be told that this is the end."""
_THREADS = 4


class Console:
    """All that pages share."""

    def __init__(self, places: Places, folders: Folders) -> None:
        self.pool = ThreadPoolExecutor(_THREADS, "console")
        self.live = Live(places, folders.root, self.pool)
        self.folders = folders
        self.screens = Screens(self._where, places.bridge_keys)
        self.actions = Actions(self.live, folders, self.pool, self.screens)
        self.loop: asyncio.AbstractEventLoop | None = None
        """That of the server, once it runs."""
        self.failure: str | None = None
        """What ended all that pages are fed by; it is logged, and the server ends."""

    def _where(self) -> tuple[str, str] | None:
        addresses = self.live.addresses
        return None if addresses is None else (addresses.screens, addresses.answers)

    async def run(self) -> None:
        """Feeds the pages until cancelled, or until something goes wrong."""
        self.loop = asyncio.get_running_loop()
        try:
            await self.live.run()
        except Exception as error:
            first = error
            while isinstance(first, ExceptionGroup):
                first = first.exceptions[0]
            self.failure = str(first) or type(first).__name__
            structlog.get_logger().error(
                "console broken", error=self.failure, traceback="".join(traceback.format_exception(error))
            )

    async def welcome(self, page: Page) -> None:
        """What a page is sent first."""
        program = importlib.metadata.version("entoptic")
        hello = Hello(protocol.VERSION, program, self.live.hosted, SCREENS_URL)
        first = [protocol.encode(one) for one in (hello, Fields(fields(), session_fields()))]
        first += [self.live.settings_message(None), protocol.encode(self.live.status())]
        page.queue([*first, *self.live.kept()])

    async def serve(self, socket: WebSocket, cut: Callable[[], None]) -> None:
        """One page, from its coming to its going; `cut` ends its connection at once."""
        page = Page(cut)
        await socket.accept()
        if not self.live.viewers.add(page):
            await socket.close(FULL, "Too many pages are open: close some.")
            return
        try:
            await self.welcome(page)
            sending = asyncio.create_task(page.send(socket.send_text, socket.send_bytes, self.live.viewers.pace_s))
            receiving = asyncio.create_task(self._receive(socket, page))
            _, others = await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
            for task in others:
                task.cancel()
            results = await asyncio.gather(sending, receiving, return_exceptions=True)
            if not receiving.cancelled() and isinstance(results[1], Exception):
                raise results[1]
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await socket.close()
        except WebSocketDisconnect:
            pass
        finally:
            self.live.viewers.remove(page)

    async def _receive(self, socket: WebSocket, page: Page) -> None:
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(message.get("code", 1005))
            try:
                text = message.get("text")
                replied = await self.actions.do(requests.decode_request(text or message.get("bytes") or b""), page)
            except RequestError as error:
                replied = Replied(error.re, False, str(error))
            try:
                encoded = protocol.encode(replied)
            except (TypeError, ValueError) as error:  # a file's name that is no text
                encoded = protocol.encode(Replied(replied.re, False, f"The answer cannot be told: {error}."))
            page.queue([encoded])
            await asyncio.sleep(REQUEST_S)


class _Sessions(StaticFiles):
    """What sessions left, and nothing else that may lie beside it."""

    def lookup_path(self, path: str) -> tuple[str, object]:  # type: ignore[override]
        parts = Path(path).parts
        assert self.directory is not None
        known = parts and (Path(self.directory) / parts[0] / session_file.FILE).exists()
        if not known or any(part.startswith(".") for part in parts):
            raise HTTPException(404)
        return super().lookup_path(path)


def app(
    console: Console, rules: Rules, cut: Callable[[tuple[str, int]], None], on_failure: Callable[[], None]
) -> Starlette:
    """The application, with its door; `on_failure` is called when nothing feeds the pages any more."""

    async def index(request: Request) -> Response:
        return FileResponse(PAGE / "index.html")

    async def health(request: Request) -> Response:
        ok = console.failure is None
        return JSONResponse({"ok": ok}, 200 if ok else 503)

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        running = asyncio.create_task(console.run())
        running.add_done_callback(lambda _: None if console.failure is None else on_failure())
        yield
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    async def live(socket: WebSocket) -> None:
        await console.serve(socket, lambda: cut(socket.scope["client"]))

    return Starlette(
        routes=[
            Route("/", index),
            Route("/health", health),
            WebSocketRoute("/live", live),
            Mount(SCREENS_URL.rstrip("/"), routes=console.screens.routes),
            Mount("/pupil-maps", StaticFiles(directory=console.folders.observers / PUPIL_MAPS, check_dir=False)),
            Mount("/sessions", _Sessions(directory=console.folders.root, check_dir=False)),
            Mount("/", StaticFiles(directory=PAGE)),
        ],
        middleware=[Middleware(Gate, rules=rules)],
        lifespan=lifespan,
    )


class Server:
    """Serves from a thread of its own until closed. Raises PortInUseError."""

    def __init__(self, console: Console, rules: Callable[[int], Rules], host: str, port: int) -> None:
        """`rules` of the port that it is."""
        self._console = console
        listening = listen(host, port, "the console")
        self.port = int(listening.getsockname()[1])
        self._server = WebServer(
            app(console, rules(self.port), listening.cut, lambda: self._server.stop()),
            listening,
            ws_max_size=MAX_REQUEST_BYTES,
            ws_per_message_deflate=False,  # pictures are compressed, and fifty pages' texts would cost a processor
            h11_max_incomplete_event_size=MAX_REQUEST_BYTES,
            limit_concurrency=MOST_CONNECTIONS,
        )

    @property
    def failure(self) -> str | None:
        """Why it ended by itself, where that is known."""
        return self._console.failure

    @property
    def lives(self) -> bool:
        """Whether it serves."""
        return self._server.lives

    def close(self) -> None:
        """Tells all pages, and ends."""
        if self._console.loop is not None and self.lives:
            with contextlib.suppress(RuntimeError):
                self._console.loop.call_soon_threadsafe(
                    lambda: self._console.live.viewers.end("The console ends.", again=True)
                )
            if self._console.live.viewers.pages:
                time.sleep(LAST_WORDS_S)
        self._server.close()
        self._console.pool.shutdown(wait=False, cancel_futures=True)
        self._console.live.close()
