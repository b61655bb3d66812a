"""`entoptic report`: finishes a recording whose host died, or draws the report of a finished one again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.process import prepare_jax
from entoptic.services.terminal import console


def report(
    folder: Annotated[Path, typer.Argument(help="Of a session; NAME.partial where it was not finished.")],
) -> None:
    """Finish a session that was cut off, and draw its report; also that of a finished one again."""
    prepare_jax(renders=False)
    from entoptic.services import recording
    from entoptic.services.live import status

    if (host := status.host_that_writes(folder)) is not None:
        raise recording.RecordingFolderError(f"{folder} is being recorded now, by process {host}: stop that first")
    finished = recording.finish(folder, replaces=False)
    if (problem := recording.draw_report(finished)) is not None:
        raise recording.RecordingFolderError(str(problem))
    console.print(f"look at: [b]{escape(str(finished / recording.REPORT))}[/b]", soft_wrap=True)
