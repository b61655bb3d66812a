import asyncio
import socket
import threading
import time

import pytest
from starlette.types import Receive, Scope, Send

from entoptic.services.web_server import WebServer, listen

HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: here\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def test_a_page_that_takes_nothing_is_cut_though_much_is_on_its_way() -> None:
    listening, ended = listen("127.0.0.1", 0, "a page"), threading.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "websocket.accept"})
        try:
            async with asyncio.timeout(0.5):
                while True:
                    await send({"type": "websocket.send", "bytes": bytes(1_000_000)})
        except TimeoutError:
            listening.cut(scope["client"])
            # It would wait for ever where its other end takes nothing.
            await send({"type": "websocket.close"})
        finally:
            ended.set()

    server = WebServer(app, listening, lifespan="off")
    port = listening.getsockname()[1]
    try:
        with socket.create_connection(("127.0.0.1", port), 10.0) as page:
            page.sendall(HANDSHAKE)
            assert ended.wait(10.0)
            give_up_s = time.monotonic() + 10.0
            while server._server.server_state.connections:
                assert time.monotonic() < give_up_s
                time.sleep(0.01)
    finally:
        server.close()


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(Exception, match=f"a page on 127.0.0.1:{port}.*another --port"):
            listen("127.0.0.1", port, "a page")
