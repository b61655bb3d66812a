"""The console's page in a real browser, against a real console: its looks, its keys, its settings."""

import re

import chromium
import pytest
from console_browser import DESK, PATIENCE_MS, Console, complaints, opened, setting
from playwright.sync_api import Browser, Page, expect

pytestmark = [pytest.mark.slow, chromium.needs_chromium]
SIZES = (DESK, (820, 1180), (1180, 820))


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


def test_what_cannot_be_started_is_said(browser: Browser, console: Console) -> None:
    page = opened(browser, console)
    page.evaluate(
        "localStorage.setItem('entoptic-session', JSON.stringify({kind: 'of another version', 'view.fps': 12}))"
    )
    page.reload()
    expect(setting(page, "eyes.source").locator("select")).to_have_value("simulated")
    expect(setting(page, "view.fps").locator("input")).to_have_value("12")
    assert complaints(page) == []
    page.click("#tab-session")
    source = setting(page, "eyes.source")
    source.locator("select").select_option("another")
    source.locator("input").fill("/nowhere/recording")
    source.locator("input").press("Tab")
    page.locator("h1").click()
    page.keyboard.press("s")
    expect(page.locator("#said")).to_contain_text("nowhere")
    expect(page.locator("#panel-session")).to_be_visible()
    page.close()
