"""The frames of an earlier session once more, from what they were rendered from."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from entoptic.atomic_file import write_json
from entoptic.services.live import takes
from entoptic.services.live.children import Child
from entoptic.services.options import Save
from entoptic.services.process import Stop
from entoptic.services.results import session_file
from entoptic.services.results.folder import BRIDGE, results_folder
from entoptic.services.results.moments import FILE as MOMENTS
from entoptic.services.session.offline import SessionError, StoppedError, end

TABLES = ("states.csv", "events.csv", BRIDGE, session_file.FILE, "settings.toml")
"""What the frames change nothing in."""


def run(before: Path, out: Path, save: Sequence[Save], stop: Stop, console: Console) -> None:
    """Renders the session in a folder again into another one, with a report of its own.

    Raises SessionError, StoppedError, SessionFileError or ResultsFolderError; then no folder is left.
    """
    session = session_file.read(before)
    if not (before / MOMENTS).exists():
        raise SessionError(f"{before} holds no {MOMENTS}: nothing was kept from which frames could be rendered again")
    if out.resolve() == before.resolve():
        raise SessionError(f"{out} is that session itself: choose another --out")
    with results_folder(out) as folder:
        for name in TABLES:
            with contextlib.suppress(FileNotFoundError):
                shutil.copyfile(before / name, folder / name)
        if (before / session_file.INPUTS).is_dir():
            shutil.copytree(before / session_file.INPUTS, folder / session_file.INPUTS)
        arguments = ["worker", "--again", str(before), "--out", str(folder)]
        for form in save:
            arguments += ["--save", form.value]
        different = _watch(Child("worker", arguments), stop, console).get("first_different")
        words = "all frames are the same" if different is None else f"frames differ from frame {different} on"
        console.print(words)
        from entoptic.services.results.finish import finish

        # Gaps and trouble are those of what was rendered then.
        write_json(folder / takes.SUMMARY, takes.told(session, takes.notes_of(before), finish(folder)))
        if (trouble := takes.draw_report(folder)) is not None:
            console.print(f"[yellow]![/yellow] {escape(trouble)}", soft_wrap=True)


def _watch(worker: Child, stop: Stop, console: Console) -> dict[str, Any]:
    """What it said when it ended."""
    said: str | None = None
    ended: dict[str, Any] = {}
    with Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=console
    ) as progress:
        task = progress.add_task("compiling", total=None)
        try:
            while True:
                code = worker.code()
                for message in worker.drain():
                    said = message.get("error", said)
                    ended = message if message["event"] == "ended" else ended
                    if message["event"] == "progress":
                        progress.update(
                            task, description="rendering", completed=message["frame"], total=message["frames"]
                        )
                if stop():
                    raise StoppedError("stopped: nothing was written")
                if code == 0:
                    return ended
                if code is not None:
                    raise SessionError(f"the worker failed {worker.ending(said)}")
                time.sleep(0.02)
        finally:
            end(worker, stop)
