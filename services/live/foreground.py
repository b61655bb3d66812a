"""A host in the foreground of a terminal: one live session, or whatever the console asks for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import zmq
from rich.console import Console
from rich.markup import escape

from entoptic.services.ipc.messages import Shown
from entoptic.services.ipc.shown_reader import ShownReader
from entoptic.services.live.host import Host
from entoptic.services.live.on_terminal import OnTerminal
from entoptic.services.live.web import Web
from entoptic.services.process import INTERRUPTED, Stop, leave
from entoptic.services.recording import PARTIAL, REPORT, refuse
from entoptic.services.session_config import OpenedSession


def session(opened: OpenedSession, final: Path, web: Web | None, stop: Stop, console: Console) -> int:
    """Runs a live session to its end, recorded from its first frame on; the exit status.

    Raises RecordingFolderError and ResultsFolderError where that cannot be kept, before anything is started.
    """
    refuse(final)
    with _host(final.parent, web, console) as host:
        kept = host.begin(opened, record_to=final)
        console.print("[dim]Ctrl-C ends it[/dim]")
        _serve(host, stop, console, lambda: host.session is kept)
        if kept.last_folder is not None:
            console.print(f"results: [b]{escape(str(kept.last_folder))}[/b]", soft_wrap=True)
            if (kept.last_folder / REPORT).exists():
                console.print(f"look at: [b]{escape(str(kept.last_folder / REPORT))}[/b]", soft_wrap=True)
        for one in kept.problems:
            console.print(f"[yellow]![/yellow] {escape(str(one))}", soft_wrap=True)
        unfinished = final.resolve().with_name(final.name + PARTIAL)
        for folder in (unfinished, kept.last_folder):
            if folder is not None and folder.exists() and not (folder / REPORT).exists():
                console.print(f"its report is still to be drawn: [b]entoptic report {escape(str(folder))}[/b]")
        _leave_at_once_if_busy(host, INTERRUPTED)
        failed = kept.last_folder is None or any(one.state == "failed" for one in kept.processes)
        return INTERRUPTED if stop() else 1 if failed else 0


def idle(web: Web, stop: Stop, console: Console) -> None:
    """Runs whatever the console asks for, until asked to stop."""
    with _host(Path(web.folders.root), web, console) as host:
        _serve(host, stop, console, lambda: True)
        _leave_at_once_if_busy(host, 0)


@contextlib.contextmanager
def _host(root: Path, web: Web | None, console: Console) -> Iterator[Host]:
    settled = None if web is None else web.settled()
    with Host(root, settled) as host:
        if settled is not None:
            query = (
                ""
                if settled.page.token is None or web is None or web.page.token is not None
                else f"?token={settled.page.token}"
            )
            console.print(f"open [b]{settled.url}{query}[/b]", soft_wrap=True)
        yield host


def _serve(host: Host, stop: Stop, console: Console, goes_on: object) -> None:
    assert callable(goes_on)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    watching: tuple[str, ShownReader] | None = None
    with contextlib.ExitStack() as opened:
        opened.callback(context.destroy, linger=0)
        line = opened.enter_context(OnTerminal(console, host))

        def on_turn() -> bool:
            nonlocal watching
            frames = None if host.session is None else host.session.addresses.frames
            shown: Shown | None = None
            if watching is not None and watching[0] != frames:
                watching[1].close()
                watching = None
            # Nobody looks at figures that no terminal shows.
            if watching is None and frames is not None and console.is_terminal:
                watching = (frames, ShownReader(context, frames))
            if watching is not None:
                shown = watching[1].newest()
            line.show(shown)
            return bool(goes_on())

        host.run(stop, on_turn)


def _leave_at_once_if_busy(host: Host, status: int) -> None:
    """A thread that draws a long report cannot be ended, and would hold this process up."""
    if host.is_busy:
        host.__exit__(None, None, None)
        leave(status)
