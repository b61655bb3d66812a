"""`entoptic console`: a page in a browser from which sessions are started, watched and recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from entoptic.services.options import ConsoleHost, ConsoleNames, ConsolePort, ConsoleToken
from entoptic.services.process import Stop, prepare_jax
from entoptic.services.terminal import console as terminal


def console(
    host: ConsoleHost = "127.0.0.1",
    port: ConsolePort = 8080,
    token: ConsoleToken = None,
    allow_host: ConsoleNames = [],  # noqa: B006 - typer copies it
    root: Annotated[Path, typer.Option(help="Folder for what is recorded.")] = Path("sessions"),
    observers: Annotated[Path, typer.Option(help="Folder where settings are saved.")] = Path("observers"),
    inputs: Annotated[Path | None, typer.Option(help="Folder of scenes and recordings to choose from.")] = None,
) -> None:
    """Serve a page from which sessions are started, watched, calibrated and recorded, until Ctrl-C."""
    stop = Stop().on_signals()
    prepare_jax(renders=False)
    from entoptic.services.live import attended
    from entoptic.services.live.web import Web

    attended.idle(root, Web(host, port, token, observers, inputs, tuple(allow_host)), stop, terminal)
