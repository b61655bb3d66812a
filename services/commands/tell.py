"""`entoptic tell`: has a running bridge's tracker record or calibrate."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.markup import escape

from services.control import Task
from services.options import ClientKeysFolder
from services.terminal import console


def tell(
    address: Annotated[str, typer.Argument(help="What the bridge logs as [b]control[/b].")],
    task: Annotated[Task, typer.Argument(help="What the tracker is to do.")],
    name: Annotated[str, typer.Option(help="What a recording is to be called.")] = "",
    keys: ClientKeysFolder = None,
) -> None:
    """Have a bridge's tracker start or stop a recording, or its own gaze calibration."""
    from services import control
    from services import keys as key_files

    client = None if keys is None else key_files.load_client(keys)
    console.print(escape(control.tell(address, control.Request(task, name), client)))
