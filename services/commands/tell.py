"""`entoptic tell`: has a running bridge's tracker record or calibrate."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.command_line import options
from entoptic.services.config import ReaderKeys
from entoptic.services.terminal import console


class Task(enum.StrEnum):
    """What a tracker can be asked to do."""

    START_RECORDING = "start tracker recording"
    STOP_RECORDING = "stop tracker recording"
    START_CALIBRATION = "start calibration"
    STOP_CALIBRATION = "stop calibration"


@options
def tell(
    address: Annotated[str, typer.Argument(help="What the bridge logs as [b]control[/b].")],
    task: Annotated[Task, typer.Argument(help="What the tracker is to do.")],
    name: Annotated[str, typer.Option(help="What a recording is to be called.")] = "",
    keys: ReaderKeys = None,
) -> None:
    """Have a bridge's tracker start or stop a recording, or its own gaze calibration."""
    import msgspec

    from entoptic.services import keys as key_files
    from entoptic.services.ipc import client as control
    from entoptic.services.ipc.requests import TrackerRequest

    if name and task is not Task.START_RECORDING:
        raise typer.BadParameter("only a recording that starts is given a name", param_hint="--name")
    fields = {"do": task.value} | ({"name": name} if name else {})
    request = msgspec.convert(fields, TrackerRequest)
    client = None if keys is None else key_files.load_client(Path(keys))
    console.print(escape(control.tell(address, request, client).reply))
