"""What a person sees of a live session on a terminal: one line that changes, and what matters once."""

from __future__ import annotations

import time

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.text import Text

from entoptic.services.ipc.messages import Shown
from entoptic.services.ipc.status import Problem
from entoptic.services.live.host import Host

EVERY_S = 0.5


class OnTerminal:
    """A context; `show` it at every turn."""

    def __init__(self, console: Console, host: Host) -> None:
        self._console, self._host = console, host
        self._line = Live(console=console, auto_refresh=False, transient=True)
        self._shown: Shown | None = None
        self._due_s = 0.0
        self._printed: tuple[Problem, ...] = ()

    def __enter__(self) -> OnTerminal:
        if self._console.is_terminal:
            self._line.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._line.__exit__(None, None, None)

    def show(self, shown: Shown | None) -> None:
        """`shown` is of the newest frame, if one came."""
        self._shown = shown or self._shown
        if time.monotonic() < self._due_s:
            return
        self._due_s = time.monotonic() + EVERY_S
        problems = self._host.all_problems()
        printed = {one.code for one in self._printed}
        for one in problems:
            if one.code not in printed:  # else figures in its sentence have changed
                self._console.print(f"[yellow]![/yellow] {escape(str(one))}", soft_wrap=True)
        self._printed = problems
        if self._console.is_terminal:
            self._line.update(Text(self._words()), refresh=True)

    def _words(self) -> str:
        session = self._host.session
        if session is None:
            return "no session"
        words = [session.state if session.state != "starting" else "starting: compiling, connecting"]
        if self._shown is not None:
            words.append(
                f"{self._shown.reached_fps:.1f} of {self._shown.fps:g} frames/s, {self._shown.dropped} dropped"
            )
            if self._shown.latency is not None:
                words.append(f"{self._shown.latency.total:.0f} ms from eye to frame")
        restarts = sum(one.restarts_count for one in session.processes)
        if restarts:
            words.append(f"{restarts} restarts")
        if session.folder is not None:
            words.append(f"recording {session.folder.name}")
        return "  ·  ".join(words)
