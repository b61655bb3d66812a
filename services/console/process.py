"""The process that serves the console's page, for a host or for a bridge and a worker that run by themselves."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

import structlog
from rich.markup import escape

from entoptic.services import keys as key_files
from entoptic.services.console.access import ConsoleError, places, rules_for
from entoptic.services.console.actions import Folders
from entoptic.services.console.live import Places
from entoptic.services.console.server import Console, Server
from entoptic.services.process import Stop
from entoptic.services.process_config import PageLinks, ServerConfig
from entoptic.services.terminal import console as terminal

NICE = 10
"""A session's frames come before its pages."""
_LOOP_S = 0.02
_PLACES = ("states", "events", "bridge", "screens", "answers", "frames", "worker")


def run(
    config: ServerConfig, stop: Stop, log: structlog.typing.FilteringBoundLogger, *, may_make_token: bool = True
) -> None:
    """Serves the page until asked to stop. Raises ConsoleError or PortInUseError."""
    if hasattr(os, "nice"):
        with contextlib.suppress(OSError):
            os.nice(NICE)
    page, folders = config.page, config.folders
    where = _places(config.links)
    rules, made = rules_for(page.host, page.token, page.names, no_token=config.links.no_token, may_make=may_make_token)
    inputs = None if folders.inputs is None else Path(folders.inputs)
    server = Server(
        Console(where, Folders(Path(folders.root), Path(folders.observers), inputs)), rules, page.host, page.port
    )
    url = f"http://{f'[{page.host}]' if ':' in page.host else page.host}:{server.port}/"
    log.info("ready", url=url, port=server.port)
    if made is not None:
        terminal.print(f"open: [b]{escape(url)}?token={escape(made)}[/b]", soft_wrap=True)
    try:
        while server.lives and not stop():
            time.sleep(_LOOP_S)
    finally:
        server.close()
    if not stop():
        raise ConsoleError(f"the console's server ended by itself: {server.failure or 'see the log above'}")
    log.info("ended")


def _places(links: PageLinks) -> Places:
    keys = None if links.keys is None else key_files.load_client(Path(links.keys))
    worker_keys = keys if links.worker_keys is None else key_files.load_client(Path(links.worker_keys))
    return places(links.host_control, {name: getattr(links, name) for name in _PLACES}, keys, worker_keys)
