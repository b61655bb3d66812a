"""The console's page in a real browser: a console of a test's own, and pages that are connected to it."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator, Page, expect

PATIENCE_MS = 30_000
DESK = (1280, 800)


class Console:
    """`entoptic console` on a port of its own, with folders of its own."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = one.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        self.folder = folder
        self.environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
        command = [sys.executable, "-m", "entoptic", "console", "--port", str(self.port)]
        command += ["--root", str(folder / "sessions"), "--observers", str(folder / "observers")]
        self.log = folder / "console.log"
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                command, stdout=log, stderr=subprocess.STDOUT, cwd=Path(__file__).parents[2], env=self.environment
            )
        try:
            self.wait_for(self.answers, "the console to answer")
        except BaseException:
            self.close()
            raise

    def answers(self) -> bool:
        with contextlib.suppress(OSError), urllib.request.urlopen(self.url + "health", timeout=5) as answer:
            return bool(json.load(answer)["ok"])
        return False

    def pid_of(self, name: str) -> int:
        """Of one of its processes."""
        command = [sys.executable, "-m", "entoptic", "status", "--json"]
        said = subprocess.run(command, capture_output=True, env=self.environment, check=False, timeout=60).stdout
        (host,) = json.loads(said)
        return int(host["status"]["processes"][name]["pid"])

    def wait_for(self, condition: Callable[[], Any], what: str, patience_s: float = 120.0) -> None:
        deadline = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain for {what}: {self.log.read_text(errors='replace')}"
            time.sleep(0.05)

    def close(self) -> int:
        self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(30)
        finally:
            self._process.kill()


def opened(browser: Browser, console: Console, size: tuple[int, int] = DESK, scheme: Any = "light") -> Page:
    """A page that is connected; what it complains of is in its `complaints`."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    page.set_default_timeout(PATIENCE_MS)
    # What a browser says of content that the page's policy forbids comes as an error of its console.
    page.on("console", lambda message: complaints(page).append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints(page).append(str(error)))
    page.goto(console.url)
    expect(page.locator("#start")).to_be_enabled(timeout=PATIENCE_MS)
    return page


def complaints(page: Page) -> list[str]:
    return page.__dict__.setdefault("complaints", [])


def setting(page: Page, path: str) -> Locator:
    return page.locator(f'[data-path="{path}"]')
