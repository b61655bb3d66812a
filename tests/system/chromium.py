"""The browser that tests drive: one that is installed, never one that a test brings along."""

from __future__ import annotations

import os
import shutil

import pytest

FOUND = os.environ.get("CHROMIUM") or next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
"""Its path; None where there is none."""
FLAGS = (
    "--headless",
    "--no-sandbox",  # as root, in a container, it starts with none
    "--disable-gpu",
    "--no-first-run",
    "--disable-quic",
    # It is to speak to the page alone.
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
needs_chromium = pytest.mark.skipif(
    FOUND is None,
    reason="no Chromium here, so no page is tried in a real browser: install Debian's `chromium`, or say where one is "
    "in CHROMIUM",
)
