"""A console and a browser for the tests of a module."""

from collections.abc import Iterator

import chromium
import pytest
from console_browser import Console
from playwright.sync_api import Browser, sync_playwright


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
