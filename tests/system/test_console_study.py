"""Sessions from the console's page in a real browser, with real processes behind it."""

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import chromium
import pytest
from console_browser import PATIENCE_MS, Console, complaints, opened, setting
from playwright.sync_api import Browser, Page, expect

pytestmark = chromium.needs_chromium


def fill(page: Page, **view: int) -> None:
    """Numbers of the session's form."""
    for name, value in view.items():
        box = setting(page, f"view.{name}").locator("input")
        box.fill(str(value))
        box.press("Tab")


def test_a_session_from_the_page(browser: Browser, console: Console) -> None:
    """Start, see a frame, stop; test_a_study_from_the_page does the rest."""
    page = opened(browser, console)
    page.evaluate(
        "window.said = []; const now = document.getElementById('now-text');"
        "new MutationObserver(() => window.said.push(now.textContent)).observe(now, {childList: true, subtree: true})"
    )
    page.click("#tab-session")
    fill(page, width_px=90, height_px=100, fps=20)
    page.click("#start")
    expect(page.locator("#perceived")).to_have_attribute("data-frame", re.compile(r"\d+"), timeout=120_000)
    assert not any("Ending" in said for said in page.evaluate("window.said"))
    expect(page.locator("#start-text")).to_have_text("Stop")
    page.click("#start")
    expect(page.locator("#now-text")).to_contain_text("Nothing runs", timeout=60_000)
    assert complaints(page) == []
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
def test_a_lost_server_is_said_and_found_again(browser: Browser, console: Console) -> None:
    page, stale = opened(browser, console), opened(browser, console)
    # As a console that was started anew, with another token, answers a page of the one before.
    stale.route(console.url, lambda route: route.fulfill(status=401))
    page.click("#tab-settings")
    fold = page.locator("#panel-settings details").last
    fold.locator("summary").click()
    os.kill(console.pid_of("web"), signal.SIGKILL)
    problem = page.locator('[data-code="connection lost"]')
    expect(problem).to_contain_text("No connection to the console's server")
    expect(page.get_by_role("alert")).to_contain_text("No connection to the console's server")
    expect(page.locator("#start")).to_be_disabled()
    expect(problem).to_have_count(0, timeout=PATIENCE_MS)
    expect(page.locator("#start")).to_be_enabled(timeout=PATIENCE_MS)
    # Whoever was in the middle of something is left there.
    expect(page.locator("#panel-settings")).to_be_visible()
    assert fold.get_attribute("open") is not None
    expect(stale.locator('[data-code="connection lost"]')).to_contain_text("with its token")
    expect(stale.locator("#now-text")).to_have_text("Not connected")
    page.close()
    stale.close()


@pytest.mark.slow
def test_a_study_from_the_page(browser: Browser, tmp_path: Path) -> None:
    """Start, look, keep, calibrate, break, tune, stop, find the files."""
    console = Console(tmp_path)
    page = opened(browser, console)
    page.click("#tab-session")
    fill(page, width_px=120, height_px=120, fov_deg=60, fps=8)
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
    setting(page, "eyes.source").locator("select").select_option("capture")
    page.locator("#session-form summary").click()
    setting(page, "eyes.remote").locator("input").fill("tcp://127.0.0.1:1")
    fill(page, width_px=120, height_px=120)
    page.click("#start")
    problem = page.locator('[data-code="no tracker"]')
    expect(problem).to_contain_text("plugged in", timeout=120_000)
    expect(page.locator("#now-mark")).to_have_attribute("data-state", "bad", timeout=120_000)
    page.close()
    assert console.close() == 0
