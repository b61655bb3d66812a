"""`entoptic console-server`: the console's page, for a host or for a bridge and a worker that run by themselves."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.options import Child, ConsoleNames, ConsoleToken
from entoptic.services.process import process
from entoptic.services.terminal import console as terminal

NICE = 10
"""A session's frames come before its pages."""
_LOOP_S = 0.02

Address = Annotated[str | None, typer.Option(metavar="ADDRESS")]


def console_server(
    host: Annotated[str, typer.Option(help="Where to listen; beyond 127.0.0.1 a token is needed.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 for a free one.")] = 8080,
    host_control: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Control of the program that runs sessions.")
    ] = None,
    states: Address = None,
    events: Address = None,
    bridge: Address = None,
    screens: Address = None,
    answers: Address = None,
    frames: Address = None,
    worker: Address = None,
    keys: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="This reader's keys, where bridge and worker have some.")
    ] = None,
    worker_keys: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Those for the worker, where they are others.")
    ] = None,
    root: Annotated[Path, typer.Option(help="Folder of the sessions.")] = Path("sessions"),
    observers: Annotated[Path, typer.Option(help="Folder where settings are saved.")] = Path("observers"),
    inputs: Annotated[Path | None, typer.Option(help="Folder of scenes and recordings to choose from.")] = None,
    token: ConsoleToken = None,
    no_token: Annotated[
        bool, typer.Option("--no-token", help="Ask for none: where the port is reached from this machine alone.")
    ] = False,
    allow_host: ConsoleNames = [],  # noqa: B006 - typer copies it
    child: Child = False,
) -> None:
    """Serve the console."""
    with process(child) as (stop, log):
        if hasattr(os, "nice"):
            with contextlib.suppress(OSError):
                os.nice(NICE)
        from entoptic.services import keys as key_files
        from entoptic.services.console.access import ConsoleError, places, rules_for
        from entoptic.services.console.actions import Folders
        from entoptic.services.console.server import Console, Server

        bridge_keys = None if keys is None else key_files.load_client(keys)
        given = {
            "states": states,
            "events": events,
            "bridge": bridge,
            "screens": screens,
            "answers": answers,
            "frames": frames,
            "worker": worker,
        }
        where = places(
            host_control, given, bridge_keys, bridge_keys if worker_keys is None else key_files.load_client(worker_keys)
        )
        rules, made = rules_for(host, token, allow_host, no_token=no_token, may_make=not child)
        server = Server(Console(where, Folders(root, observers, inputs)), rules, host, port)
        url = f"http://{f'[{host}]' if ':' in host else host}:{server.port}/"
        log.info("ready", url=url, port=server.port)
        if made is not None:
            terminal.print(f"open: [b]{escape(url)}?token={escape(made)}[/b]", soft_wrap=True)
        try:
            while server.lives and not stop():
                time.sleep(_LOOP_S)
        finally:
            server.close()
        if not stop():
            raise ConsoleError(f"the console's server ended by itself: {server.trouble or 'see the log above'}")
        log.info("ended")
        if child:
            # All is closed; to take the interpreter apart, with all that it has loaded, may take longer than a second.
            sys.stderr.flush()
            os._exit(0)
