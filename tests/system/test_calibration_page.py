"""The calibration's page in a real browser, driven through the browser's own debugging protocol."""

import asyncio
import base64
import contextlib
import io
import itertools
import json
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import chromium
import matplotlib.image
import numpy as np
import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.routing import Mount
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from entoptic.services.calibration.display import READY_WORDS, Request, SocketDisplay
from entoptic.services.calibration.page import PageServer, Screens
from entoptic.services.calibration.pupil_calibration import PupilCalibration
from entoptic.services.calibration.run import CalibrationRun, Room
from entoptic.services.config import CalibrationProtocol, SourceConfig
from entoptic.services.eye_data import open_live_eyes
from entoptic.services.ipc.requests import CalibratePupils
from entoptic.tracker_bridge.calibration import Protocol, Screen, Stage, Statistic, Step
from entoptic.tracker_bridge.publisher import PortInUseError
from entoptic.tracker_bridge.sources.simulated.live import LiveEyes

QUICK = Protocol(
    "quick", (Step(Screen.WHITE, 1.5, 0.5), Step(Screen.BLACK, 1.5, 0.5)), Statistic.MEDIAN, must_settle=False
)
GIVE_UP_S = 30.0


class Browser:
    """One page of a Chromium without a window."""

    def __init__(self, folder: Path, url: str) -> None:
        assert chromium.FOUND is not None
        arguments = [*chromium.FLAGS, "--window-size=800,600"]
        arguments += ["--remote-debugging-port=0", f"--user-data-dir={folder}", url]
        self._process = subprocess.Popen(
            [chromium.FOUND, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._numbers = itertools.count(1)
        self._stack = contextlib.ExitStack()
        try:
            port_file = folder / "DevToolsActivePort"
            port = wait_for(lambda: port_file.exists() and port_file.read_text().split())[0]
            target = wait_for(lambda: page_at(url, f"http://127.0.0.1:{port}/json"))
            connection = connect(target["webSocketDebuggerUrl"], max_size=None)
            self._page: ClientConnection = self._stack.enter_context(connection)
        except BaseException:
            self._process.kill()
            raise

    def call(self, method: str, **parameters: Any) -> Any:
        number = next(self._numbers)
        self._page.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._page.recv(timeout=GIVE_UP_S))
            if message.get("id") == number:
                # Between two documents there is nothing to ask: that is no answer yet.
                return message.get("result", {"result": {}})

    def evaluate(self, expression: str) -> Any:
        called = self.call("Runtime.evaluate", expression=expression, userGesture=True, returnByValue=True)
        return called["result"].get("value")

    def screenshot(self) -> np.ndarray:
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return np.asarray(matplotlib.image.imread(io.BytesIO(data)))[..., :3]

    def close(self) -> None:
        self._stack.close()
        self._process.terminate()
        self._process.wait(20)


def get(url: str, **headers: str) -> str:
    request = urllib.request.Request(url, headers=headers)
    with urllib.request.urlopen(request, timeout=GIVE_UP_S) as answer:
        text: str = answer.read().decode()
        return text


def page_at(url: str, pages: str) -> dict[str, str] | None:
    """What a browser says of the page at this address; None while there is none, or no browser yet."""
    try:
        listed: list[dict[str, str]] = json.loads(get(pages))
    except OSError:
        return None
    return next((page for page in listed if page["url"].startswith(url)), None)


def wait_for(condition: Any) -> Any:
    give_up = time.monotonic() + GIVE_UP_S
    while time.monotonic() < give_up:
        if found := condition():
            return found
        time.sleep(0.02)
    pytest.fail("it did not come to that in half a minute")


def stepping(run: CalibrationRun) -> threading.Thread:
    """Steps a run by live eyes until it is over."""

    def step() -> None:
        for item in open_live_eyes(SourceConfig(), None).samples():
            run.step(item, time.monotonic_ns())
            if run.is_over:
                break

    thread = threading.Thread(target=step, daemon=True)
    thread.start()
    return thread


@pytest.fixture
def display() -> Iterator[SocketDisplay]:
    opened = SocketDisplay("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    yield opened
    opened.close()


@pytest.fixture
def server(display: SocketDisplay) -> Iterator[PageServer]:
    opened = PageServer(display.commands_address, display.answers_address, "127.0.0.1", 0)
    yield opened
    opened.close()


@pytest.fixture
def browser(tmp_path: Path, server: PageServer) -> Iterator[Browser]:
    opened = Browser(tmp_path / "profile", server.url)
    yield opened
    opened.close()


@pytest.mark.slow
@chromium.needs_chromium
def test_a_browser_shows_the_screens_and_says_when(
    display: SocketDisplay, server: PageServer, browser: Browser
) -> None:
    run = CalibrationRun(QUICK, Room(display))
    running = stepping(run)
    wait_for(lambda: browser.evaluate("!document.getElementById('start').disabled"))
    assert "Ready" in browser.evaluate("document.getElementById('message').textContent")
    browser.evaluate("document.getElementById('start').click()")
    seen = {}
    for screen in ("white", "black"):
        wait_for(lambda screen=screen: browser.evaluate("document.body.className") == screen)
        time.sleep(0.1)
        seen[screen] = browser.screenshot()
    running.join(GIVE_UP_S)
    recorded = run.recorded()
    assert recorded.stage is Stage.FINISHED
    # All of it, but for the small cross in the middle.
    assert (seen["white"] == 1.0).all(axis=-1).mean() > 0.9995
    assert (seen["black"] == 0.0).all(axis=-1).mean() > 0.9995
    assert display.uncertainty_ns is not None
    assert display.uncertainty_ns < 100_000_000
    white, black = recorded.screens
    assert black.t_ns >= white.window_ns[1]
    assert display.unreadable is None
    display.tell("No result: nothing.", again=False)
    wait_for(lambda: "No result" in browser.evaluate("document.getElementById('message').textContent"))
    server.close()
    wait_for(lambda: "can be closed" in browser.evaluate("document.getElementById('message').textContent"))
    assert browser.evaluate("document.body.className") == "grey"


@pytest.mark.slow
@chromium.needs_chromium
def test_a_page_that_goes_away_pauses_and_comes_back(display: SocketDisplay, browser: Browser) -> None:
    run = CalibrationRun(QUICK, Room(display))
    running = stepping(run)
    ready = "!document.getElementById('start').disabled"
    wait_for(lambda: browser.evaluate(ready))
    browser.evaluate("document.getElementById('start').click()")
    wait_for(lambda: browser.evaluate("document.body.className") == "white")
    browser.call("Page.reload")
    wait_for(lambda: run.stage is Stage.PAUSED)
    wait_for(lambda: browser.evaluate(ready))
    browser.evaluate("document.getElementById('start').click()")
    running.join(GIVE_UP_S)
    assert run.stage is Stage.FINISHED


class PrefixedServer:
    """A console's way: the page below a prefix, of a session that comes and goes, and an operator who may start."""

    def __init__(self) -> None:
        self.place: tuple[str, str] | None = None
        self.screens = Screens(lambda: self.place)
        app = Starlette(routes=[Mount("/screens", routes=self.screens.routes)])
        self._socket = socket.socket()
        self._socket.bind(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}/screens/"
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=1))
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        wait_for(lambda: self._server.started)

    def _run(self) -> None:
        self._loop.run_until_complete(self._server.serve([self._socket]))

    def start(self) -> bool:
        return asyncio.run_coroutine_threadsafe(self.screens.start(), self._loop).result(GIVE_UP_S)

    def close(self) -> None:
        self._server.should_exit = True
        self._thread.join(GIVE_UP_S)
        self._socket.close()
        self._loop.close()


@pytest.mark.slow
@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium here")
def test_a_page_below_a_prefix_waits_for_a_session_and_its_operator_starts_it(tmp_path: Path) -> None:
    server = PrefixedServer()
    message = "document.getElementById('message')?.textContent"
    (tmp_path / "out").mkdir()
    wish = CalibratePupils(
        str(tmp_path / "out" / "p.toml"), protocol=CalibrationProtocol.LUIDOLT, white_s=2.0, black_s=2.0
    )
    eyes = open_live_eyes(SourceConfig(seed=1), None)
    assert isinstance(eyes, LiveEyes)
    with contextlib.ExitStack() as stack:
        stack.callback(server.close)
        browser = Browser(tmp_path / "profile", server.url)
        stack.callback(browser.close)
        wait_for(lambda: "No session runs yet" in (browser.evaluate(message) or ""))
        assert not server.start()
        display = SocketDisplay("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
        calibration = PupilCalibration(Room(display, eyes), "eyes")
        over = threading.Event()

        def bridge() -> None:
            for item in eyes.samples():
                calibration.step(item)
                if over.is_set():
                    break

        server.place = display.commands_address, display.answers_address
        # It comes by itself: nobody has to reload it.
        wait_for(lambda: "begun from the console" in (browser.evaluate(message) or ""))
        start = "document.getElementById('start').disabled"
        assert browser.evaluate(start) is True
        assert calibration.begin(wish).done
        wait_for(lambda: "Press Start when you sit well" in (browser.evaluate(message) or ""))
        assert browser.evaluate(start) is False
        thread = threading.Thread(target=bridge, daemon=True)
        thread.start()
        assert server.start()
        for colour in ("black", "white"):
            wait_for(lambda colour=colour: browser.evaluate("document.body.className") == colour)
        assert browser.evaluate("document.fullscreenElement === null") is True  # nobody had to touch that window
        wait_for(lambda: "Working it out" in (browser.evaluate(message) or ""))
        wait_for(lambda: "Done, thank you" in (browser.evaluate(message) or ""))
        result = calibration.result()
        assert result is not None
        assert result["ok"], result
        over.set()
        thread.join(GIVE_UP_S)
        calibration.close()
        # A bridge that is gone leaves nobody before a white screen, and a page that waits for the next one.
        wait_for(lambda: "Nothing is heard" in (browser.evaluate(message) or ""))
        assert browser.evaluate("document.body.className") == "grey"


def test_only_its_own_page_may_connect_and_only_one(server: PageServer) -> None:
    with urllib.request.urlopen(server.url, timeout=GIVE_UP_S) as answer:
        assert (answer.headers["cache-control"], answer.headers["x-frame-options"]) == ("no-store", "DENY")
    assert "Pupil calibration" in get(server.url)
    assert "requestAnimationFrame" in get(f"{server.url}page.js")
    assert "body.white" in get(f"{server.url}page.css")
    with pytest.raises(urllib.error.HTTPError, match="400"):
        get(server.url, host="elsewhere.example")
    url, own = f"ws://127.0.0.1:{server.port}/display", f"http://127.0.0.1:{server.port}"

    def refused(origin: str | None) -> str:
        with connect(url, origin=origin) as page, pytest.raises(ConnectionClosed) as closed:
            page.recv(timeout=GIVE_UP_S)
        assert closed.value.rcvd is not None
        return closed.value.rcvd.reason

    assert "own page" in refused("http://elsewhere.example")
    assert "own page" in refused(None)
    with connect(url, origin=own) as page:
        told = (json.loads(page.recv(timeout=GIVE_UP_S)) for _ in range(9))
        assert next(one for one in told if "ask" not in one) == {"message": READY_WORDS, "again": True}
        assert "Another page" in refused(own)
        page.send("no JSON")
        page.send("{}")
        page.send(json.dumps({"request": "start", "more": "x" * 2000}))
        assert "ask" in json.loads(page.recv(timeout=GIVE_UP_S))


def test_a_page_that_says_what_no_message_can_hold_is_heard_on_and_one_that_breaks_off_pauses(
    display: SocketDisplay, server: PageServer
) -> None:
    url, own = f"ws://127.0.0.1:{server.port}/display", f"http://127.0.0.1:{server.port}"
    with connect(url, origin=own) as page:
        page.send("[" * 60_000)
        page.send(f'{{"shown": 1{"0" * 30}}}')
        page.send('{"request": "start"}')
        assert wait_for(lambda: display.answers(0)) == [Request.START]
        page.send(b"no text")
        # The page's way says it, and that nobody follows the screens any more.
        assert set(wait_for(lambda: display.answers(0))) == {Request.PAUSE}


def test_a_port_that_is_taken_is_named(server: PageServer) -> None:
    with pytest.raises(PortInUseError, match="choose another --port"):
        PageServer("tcp://127.0.0.1:9", "tcp://127.0.0.1:9", "127.0.0.1", server.port)
