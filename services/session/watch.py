"""Work that takes long: a thread does it, and another one shows how far it is and hears Ctrl-C.

Theory of operation: Python handles a signal in the main thread alone, and not in the middle of a compilation. So
whatever renders does so in a thread of its own; it looks at `stop` between frames.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from entoptic.errors import EntopticError
from entoptic.services.process import Stop

LOOKS_UP_S = 0.05
Result = TypeVar("Result")


class SessionError(EntopticError):
    """A session cannot be rendered: the message says why, and what to do."""


class StoppedError(SessionError):
    """A person stopped a session before there was anything to be kept."""


@dataclasses.dataclass
class Work:
    """What the thread that works says of itself."""

    stage: str = "starting"
    frame: int = 0
    frames: int | None = None
    keeps: bool = False
    """From now on what there is will be kept if somebody stops it."""


def watch(work: Callable[[Work], Result], stop: Stop, console: Console, nothing: str) -> Result:
    """What `work` gives. Raises what it raises, and StoppedError saying `nothing` where a stop leaves nothing."""
    state = Work()
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(work(state))
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name="rendering", daemon=True).start()
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(TextColumn("{task.description}"), *columns, console=console) as progress:
        task = progress.add_task(state.stage, total=None)
        done = False
        while not done:
            done = bool(wait([future], LOOKS_UP_S).done)
            if stop() and not state.keeps:
                raise StoppedError(nothing)
            stage = "stopping" if stop() else state.stage
            progress.update(task, description=stage, completed=state.frame, total=state.frames)
    return future.result()
