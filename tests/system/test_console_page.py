"""The console's page in a real browser, against a real console and, in the slow test, against a real session."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import chromium
import pytest
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

pytestmark = chromium.needs_chromium
PATIENCE_MS = 30_000
SIZES = ((1280, 800), (820, 1180), (1180, 820))


class Console:
    """`entoptic console` on a port of its own, with folders of its own."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = one.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        self.folder = folder
        self.environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
        command = [sys.executable, "-m", "services.cli", "console", "--port", str(self.port)]
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
        command = [sys.executable, "-m", "services.cli", "status", "--json"]
        said = subprocess.run(command, capture_output=True, env=self.environment, check=False, timeout=60).stdout
        (host,) = json.loads(said)
        return int(host["said"]["processes"][name]["pid"])

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


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    opened = Console(tmp_path_factory.mktemp("console"))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    flags = [flag for flag in chromium.FLAGS if flag != "--headless"]
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium.FOUND, args=flags)
        yield opened
        opened.close()


def opened(browser: Browser, console: Console, size: tuple[int, int] = SIZES[0], scheme: Any = "light") -> Page:
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


def test_it_says_what_to_do_and_fits_every_screen(browser: Browser, console: Console) -> None:
    for size in SIZES:
        page = opened(browser, console, size)
        expect(page.locator("#now-text")).to_contain_text("Choose eyes and a scene")
        expect(page.locator("#panel-session")).to_be_visible()
        fits = (
            "[document.documentElement.scrollWidth <= innerWidth, document.documentElement.scrollHeight <= innerHeight]"
        )
        assert page.evaluate(fits) == [True, True], size
        hidden = page.evaluate(
            "[...document.querySelectorAll('#bar button, #frames, #traces, #plan, #side')].filter(one => {"
            "const at = one.getBoundingClientRect();"
            "return at.left < 0 || at.top < 0 || at.right > innerWidth || at.bottom > innerHeight || at.height < 30})"
            ".map(one => one.id)"
        )
        assert hidden == [], size
        assert complaints(page) == []
        page.close()


def test_a_session_from_the_page(browser: Browser, console: Console) -> None:
    """Start, see a frame, stop; test_a_study_from_the_page does the rest."""
    page = opened(browser, console)
    page.evaluate(
        "window.said = []; const now = document.getElementById('now-text');"
        "new MutationObserver(() => window.said.push(now.textContent)).observe(now, {childList: true, subtree: true})"
    )
    page.click("#tab-session")
    for name, value in (("width", "90"), ("height", "100"), ("fps", "20")):
        page.fill(f"#session-{name}", value)
    page.click("#start")
    expect(page.locator("#perceived")).to_have_attribute("data-frame", re.compile(r"\d+"), timeout=120_000)
    assert not any("Ending" in said for said in page.evaluate("window.said"))
    expect(page.locator("#start-text")).to_have_text("Stop")
    page.click("#start")
    expect(page.locator("#now-text")).to_contain_text("Nothing runs", timeout=60_000)
    assert complaints(page) == []
    page.close()


CONTRASTS = """() => {
  // Any colour notation as sRGB, by painting it.
  const paint = Object.assign(document.createElement("canvas"), {width: 1, height: 1}).getContext("2d");
  const rgba = (colour) => {
    paint.clearRect(0, 0, 1, 1); paint.fillStyle = colour; paint.fillRect(0, 0, 1, 1);
    return [...paint.getImageData(0, 0, 1, 1).data];
  };
  const linear = (value) => value <= 10.31475 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4;
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const ground = (element) => {
    for (; element; element = element.parentElement) {
      const colour = rgba(getComputedStyle(element).backgroundColor);
      if (colour[3] > 250) return colour;
    }
    return [255, 255, 255];
  };
  const low = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if ((!own && !element.matches("input, select")) || !element.getClientRects().length) continue;
    const both = [luminance(rgba(getComputedStyle(element).color)), luminance(ground(element))];
    const [one, two] = both.sort((a, b) => b - a);
    if ((one + 0.05) / (two + 0.05) < 4.5) low.push([element.outerHTML.slice(0, 80), (one + 0.05) / (two + 0.05)]);
  }
  return low;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_all_text_can_be_read(browser: Browser, console: Console, scheme: str) -> None:
    page = opened(browser, console, scheme=scheme)
    for tab in ("facts", "session", "settings", "calibration"):
        page.click(f"#tab-{tab}")
        page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
        # A button changes its ground slowly.
        page.evaluate("Promise.all(document.getAnimations().map(one => one.finished))")
        assert page.evaluate(CONTRASTS) == []
    page.close()


def test_everything_has_a_name_and_can_be_reached_by_keyboard(browser: Browser, console: Console) -> None:
    page = opened(browser, console)
    for name in ("facts", "session", "settings", "calibration"):
        page.click(f"#tab-{name}")
        nameless = page.evaluate(
            "[...document.querySelectorAll('button, input, select, a, canvas, [role=tabpanel]')].filter(one =>"
            " one.checkVisibility() && !(one.labels?.length || one.ariaLabel || one.textContent.trim()"
            " || one.getAttribute('aria-labelledby'))).map(one => one.outerHTML)"
        )
        assert nameless == []
    page.click("#tab-facts")
    page.locator("h1").click()
    order = []
    for _ in range(7):
        page.keyboard.press("Tab")
        focused = page.evaluate("[document.activeElement.id, getComputedStyle(document.activeElement).outlineStyle]")
        order.append(focused[0])
        assert focused[1] == "solid", focused
    assert order == ["start", "help-open", "marks", "pause", "whole", "tab-facts", "panel-facts"]
    page.focus("#tab-facts")
    page.keyboard.press("c")
    expect(page.locator("#panel-facts")).to_be_visible()
    for wanted in ("session", "settings", "calibration", "facts"):
        page.keyboard.press("ArrowRight")
        expect(page.locator(f"#panel-{wanted}")).to_be_visible()
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    for key in ("s", "r", "c", "Space", "?"):
        expect(page.locator("#help-keys kbd", has_text=re.compile(f"^{re.escape(key)}$"))).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#help")).not_to_be_visible()
    page.locator("h1").click()
    page.keyboard.press("Space")
    expect(page.locator("#pause")).to_have_attribute("aria-pressed", "true")
    page.click("#tab-settings")
    page.locator("#observer-name").press_sequentially("src ?")
    expect(page.locator("#observer-name")).to_have_value("src ?")
    expect(page.locator("#help")).not_to_be_visible()
    assert complaints(page) == []
    page.close()


def setting(page: Page, path: str) -> Locator:
    return page.locator(f'[data-path="{path}"]')


def told_while_it_moves(page: Page, console: Console, path: str) -> int:
    """How often the server is told of a slider that does not come to rest."""
    asked = page.evaluate(
        """(path) => {
          const send = WebSocket.prototype.send;
          window.told = 0;
          WebSocket.prototype.send = function (said) { window.told += said.includes(path); send.call(this, said); };
          const slider = document.querySelector(`[data-path="${path}"] input[type=range]`);
          window.moving = setInterval(() => {
            slider.value = (Number(slider.value) + 7) % 1000;
            slider.dispatchEvent(new Event("input", {bubbles: true}));
          }, 40);
          return window.told;
        }""",
        path,
    )
    console.wait_for(lambda: page.evaluate("window.told") >= 3, "a slider that moves to be told of", PATIENCE_MS / 1000)
    page.evaluate("clearInterval(window.moving)")
    return int(page.evaluate("window.told")) - int(asked)


def test_settings_are_moved_kept_and_taken_again_and_all_pages_see_them(browser: Browser, console: Console) -> None:
    page, other = opened(browser, console), opened(browser, console)
    for one in (page, other):
        one.click("#tab-settings")
    age = setting(page, "observer.age_years")
    age.locator("input[type=number]").fill("64")
    age.locator("input[type=number]").press("Enter")
    there = setting(other, "observer.age_years").locator("input[type=number]")
    expect(there).to_have_value("64")
    slider = setting(page, "observer.particles").locator("input[type=range]")
    slider.focus()
    for _ in range(5):
        slider.press("ArrowRight")
    moved = setting(page, "observer.particles").locator("input[type=number]").input_value()
    assert moved != "1000"
    expect(setting(other, "observer.particles").locator("input[type=number]")).to_have_value(moved)
    assert told_while_it_moves(page, console, "observer.particles") >= 3
    page.fill("#observer-name", "participant-07")
    page.click("#observer-save")
    expect(page.locator("#said")).to_contain_text("participant-07")
    expect(page.locator("#observer-now")).to_contain_text("settings of participant-07")
    kept = console.folder / "observers" / "participant-07.toml"
    assert "age_years = 64" in kept.read_text()
    page.click("#defaults")
    expect(there).to_have_value("30")
    expect(page.locator("#observer-now")).not_to_contain_text("participant-07")
    page.click("#observer-load")
    expect(there).to_have_value("64")
    too_old = age.locator("input[type=number]")
    too_old.fill("500")
    too_old.press("Enter")
    expect(age.locator(".wrong")).to_contain_text("120")
    expect(there).to_have_value("64")
    assert complaints(page) == complaints(other) == []
    page.close()
    other.close()


@pytest.mark.slow
def test_a_lost_server_is_said_and_found_again(browser: Browser, console: Console) -> None:
    page, stale = opened(browser, console), opened(browser, console)
    # As a console that was started anew, with another token, answers a page of the one before.
    stale.route(console.url, lambda route: route.fulfill(status=401))
    page.click("#tab-settings")
    fold = page.locator("#panel-settings details").last
    fold.locator("summary").click()
    os.kill(console.pid_of("web"), signal.SIGKILL)
    problem = page.locator('[data-name="connection lost"]')
    expect(problem).to_contain_text("No connection to the console's server")
    expect(page.get_by_role("alert")).to_contain_text("No connection to the console's server")
    expect(page.locator("#start")).to_be_disabled()
    expect(problem).to_have_count(0, timeout=PATIENCE_MS)
    expect(page.locator("#start")).to_be_enabled(timeout=PATIENCE_MS)
    # Whoever was in the middle of something is left there.
    expect(page.locator("#panel-settings")).to_be_visible()
    assert fold.get_attribute("open") is not None
    expect(stale.locator('[data-name="connection lost"]')).to_contain_text("with its token")
    expect(stale.locator("#now-text")).to_have_text("Not connected")
    page.close()
    stale.close()


def test_what_cannot_be_started_is_said(browser: Browser, console: Console) -> None:
    page = opened(browser, console)
    page.evaluate("localStorage.setItem('entoptic-session', JSON.stringify({kind: 'of another version', fps: '12'}))")
    page.reload()
    expect(page.locator("#session-kind")).to_have_value("simulated")
    expect(page.locator("#session-fps")).to_have_value("12")
    assert complaints(page) == []
    page.click("#tab-session")
    # What nobody sees any more keeps nothing from starting.
    page.fill("#session-seed", "-3")
    page.select_option("#session-kind", "recording")
    page.fill("#session-recording", "/nowhere/recording")
    page.locator("h1").click()
    page.keyboard.press("s")
    expect(page.locator("#said")).to_contain_text("nowhere")
    expect(page.locator("#panel-session")).to_be_visible()
    page.close()


def newest(page: Page) -> tuple[int, float]:
    """The number of the newest perceived frame, and the time of the newest eye state."""
    frame, t_s = page.evaluate(
        "[document.getElementById('perceived').dataset.frame, document.getElementById('traces-canvas').dataset.newest]"
    )
    return int(frame or -1), float(t_s or -1)


def moves_on(page: Page) -> Callable[[], bool]:
    """Whether both frames and traces are newer than now."""
    frame, t_s = newest(page)
    return lambda: newest(page)[0] > frame and newest(page)[1] > t_s


def painted(page: Page, canvas: str) -> int:
    """How many different colours there are on a canvas, of 3 bits a channel."""
    colours: int = page.evaluate(
        """(id) => {
          const canvas = document.getElementById(id);
          const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          const seen = new Set();
          for (let at = 0; at < data.length; at += 4) {
            seen.add((data[at] >> 5) * 64 + (data[at + 1] >> 5) * 8 + (data[at + 2] >> 5));
          }
          return seen.size;
        }""",
        canvas,
    )
    return colours


@pytest.mark.slow
def test_a_study_from_the_page(browser: Browser, tmp_path: Path) -> None:
    """Start, look, keep, calibrate, break, tune, stop, find the files."""
    console = Console(tmp_path)
    page = opened(browser, console)
    page.click("#tab-session")
    for name, value in (("width", "120"), ("height", "120"), ("fov", "60"), ("fps", "8")):
        page.fill(f"#session-{name}", value)
    page.click("#start")
    expect(page.locator("#perceived")).to_have_attribute("data-frame", re.compile(r"\d+"), timeout=120_000)
    console.wait_for(moves_on(page), "frames and traces to move")
    assert min(painted(page, name) for name in ("perceived", "displayed", "traces-canvas")) > 5
    expect(page.locator("#right-phase")).not_to_have_text("no data")
    expect(page.locator("[data-effect=tone] .level")).to_have_text("on: aces")

    page.locator("h1").click()
    page.keyboard.press("r")
    expect(page.locator("#record")).to_have_attribute("aria-pressed", "true", timeout=PATIENCE_MS)

    page.keyboard.press("c")
    page.select_option("#calibration-protocol", "luidolt")
    page.fill("#calibration-name", "participant-07")
    with page.expect_popup() as popup:
        page.click("#calibration-begin")
    screens = popup.value
    screens.locator("#start").click(timeout=PATIENCE_MS)
    expect(page.locator("#calibration-stage")).to_contain_text("Screen", timeout=PATIENCE_MS)
    expect(page.locator("#calibration-result h3")).to_be_visible(timeout=60_000)
    expect(page.locator("#calibration-result tbody tr")).to_have_count(2)
    plot = page.locator("#calibration-result img")
    console.wait_for(lambda: plot.evaluate("one => one.naturalWidth") > 0, "the plot of the calibration")
    screens.close()

    os.kill(console.pid_of("bridge"), signal.SIGKILL)
    expect(page.locator("#problems")).to_contain_text(re.compile("bridge"), timeout=PATIENCE_MS)
    expect(page.locator("#problems")).not_to_contain_text(re.compile("bridge"), timeout=60_000)
    console.wait_for(moves_on(page), "frames and traces to move again")

    page.click("#tab-settings")
    age = setting(page, "observer.age_years").locator("input[type=number]")
    age.fill("70")
    age.press("Enter")
    page.fill("#observer-name", "participant-07")
    page.click("#observer-save")
    expect(page.locator("#observer-now")).to_contain_text("participant-07")
    assert "age_years = 70" in (tmp_path / "observers" / "participant-07.toml").read_text()

    page.locator("h1").click()
    page.keyboard.press("s")
    expect(page.locator("#said")).to_contain_text("once more")
    expect(page.locator("#record")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("s")
    expect(page.locator("#now-text")).to_contain_text("Nothing runs", timeout=60_000)
    expect(page.locator("#report")).to_be_visible(timeout=60_000)
    folder = Path(page.inner_text("#folder"))
    assert {"perceived.mp4", "states.csv", "plan.csv", "summary.json", "report.html"} <= set(os.listdir(folder))
    with page.expect_popup() as popup:
        page.click("#report")
    expect(popup.value.locator("h1")).to_be_visible()
    assert [said for said in complaints(page) if "WebSocket" not in said] == []
    assert console.close() == 0


@pytest.mark.slow
def test_a_tracker_that_is_not_there_is_said_with_what_to_do(browser: Browser, tmp_path: Path) -> None:
    console = Console(tmp_path)
    page = opened(browser, console)
    page.click("#tab-session")
    page.select_option("#session-kind", "capture")
    page.fill("#session-remote", "tcp://127.0.0.1:1")
    for name in ("width", "height"):
        page.fill(f"#session-{name}", "120")
    page.click("#start")
    problem = page.locator('[data-name="no tracker"]')
    expect(problem).to_contain_text("plugged in", timeout=120_000)
    expect(page.locator("#now-mark")).to_have_attribute("data-state", "bad", timeout=120_000)
    page.close()
    assert console.close() == 0
