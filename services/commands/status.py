"""`entoptic status`: how running sessions are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from entoptic.services.command_line import options
from entoptic.services.config import ReaderKeys
from entoptic.services.terminal import console

if TYPE_CHECKING:
    from entoptic.services.ipc.status import HostStatus
    from entoptic.services.live.status import Found


@options
def status(
    addresses: Annotated[
        list[str],
        typer.Argument(
            metavar="[ADDRESS]...",
            help="What a bridge, worker or host logs as [b]control[/b]; your own running sessions unless given.",
        ),
    ] = [],  # noqa: B006 - typer copies it
    as_json: Annotated[bool, typer.Option("--json", help="All that is known, for programs.")] = False,
    keys: ReaderKeys = None,
) -> None:
    """Say how running sessions or processes are; exit status 0 if all is well, 1 if something is wrong."""
    from entoptic.services import keys as key_files
    from entoptic.services.live import status as statuses

    client = None if keys is None else key_files.load_client(Path(keys))
    found = [statuses.process(address, client) for address in addresses] if addresses else statuses.hosts()
    if as_json:
        print(msgspec.json.format(msgspec.json.encode(found), indent=2).decode())
    elif not found:
        console.print("nothing runs: start [b]entoptic console[/b], or [b]entoptic session --live[/b]")
    else:
        for one in found:
            _print(one)
    if not found or any(one.problems for one in found):
        raise typer.Exit(1)


def _print(found: Found) -> None:
    from entoptic.services.ipc.status import HostStatus

    table = Table(show_header=False, box=None, padding=(0, 1))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    status = found.status
    for name, value in _of_host(status, found) if isinstance(status, HostStatus) else _of_process(found):
        table.add_row(name, escape(value))
    for one in found.problems:
        table.add_row(one.severity, f"[red]{escape(str(one))}[/red]")
    console.print(table)


def _of_host(status: HostStatus, found: Found) -> Iterator[tuple[str, str]]:
    yield "host", f"process {status.pid}, {found.address}, {status.state}"
    if status.config is not None:
        yield "session", f"{status.config.eyes.source} viewing {status.config.view.scene}, since {status.started}"
    if status.bridge is not None and status.bridge.rate_hz is not None:
        yield "eyes", f"{status.bridge.rate_hz:.0f} Hz, {status.bridge.late_samples} late samples"
    if (shown := found.shown) is not None:
        latency = "" if shown.latency is None else f", {shown.latency.total:.0f} ms from eye to frame"
        yield "frames", f"{shown.reached_fps:.1f} of {shown.fps:g} a second, {shown.dropped} dropped{latency}"
    for name, one in status.processes.items():
        pid = "" if one.pid is None else f", process {one.pid}"
        yield name, f"{one.state}{pid}, started again {one.restarts} times"
    for name in ("recording", "finishing", "last_recording", "console_url", "log"):
        if (value := getattr(status, name)) is not None:
            yield name.replace("_", " "), str(value)


def _of_process(found: Found) -> Iterator[tuple[str, str]]:
    yield "address", found.address
    for name, value in ({} if found.status is None else msgspec.to_builtins(found.status)).items():
        if value is not None and not isinstance(value, dict | list):
            yield name.replace("_", " "), f"{value:.3g}" if isinstance(value, float) else str(value)
