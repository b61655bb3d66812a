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
        told = [{**msgspec.to_builtins(one), "wrong": one.wrong} for one in found]
        print(msgspec.json.format(msgspec.json.encode(told), indent=2).decode())
    elif not found:
        console.print("nothing runs: start [b]entoptic console[/b], or [b]entoptic session --live[/b]")
    else:
        for one in found:
            _print(one)
    if not found or any(one.wrong for one in found):
        raise typer.Exit(1)


def _print(found: Found) -> None:
    table = Table(show_header=False, box=None, padding=(0, 1))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in _of_host(found) if "processes" in found.said else _of_process(found):
        table.add_row(name, escape(value))
    for wrong in found.wrong:
        table.add_row("wrong", f"[red]{escape(wrong)}[/red]")
    console.print(table)


def _of_host(found: Found) -> Iterator[tuple[str, str]]:
    said, shown = found.said, found.shown
    yield "host", f"process {said['pid']}, {found.address}, {said.get('state', 'silent')}"
    if (config := said.get("config")) is not None:
        yield "session", f"{config['eyes']['source']} viewing {config['view']['scene']}, since {said['started']}"
    bridge = said.get("figures", {}).get("bridge", {})
    if bridge.get("rate_hz") is not None:
        yield "eyes", f"{bridge['rate_hz']:.0f} Hz, {bridge.get('late_samples', 0)} late samples"
    if shown is not None:
        latency = "" if shown.latency is None else f", {shown.latency.total:.0f} ms from eye to frame"
        yield "frames", f"{shown.reached_fps:.1f} of {shown.fps:g} a second, {shown.dropped} dropped{latency}"
    for name, one in said["processes"].items():
        pid = "" if one["pid"] is None else f", process {one['pid']}"
        yield name, f"{one['state']}{pid}, started anew {one['restarts']} times"
    for name in ("folder", "finishing", "last_folder", "console_url", "log"):
        if said.get(name) is not None:
            yield name.replace("_", " "), str(said[name])


def _of_process(found: Found) -> Iterator[tuple[str, str]]:
    yield "address", found.address
    for name, value in found.said.items():
        if value is not None and name != "trouble" and not isinstance(value, dict | list):
            yield name.replace("_", " "), f"{value:.3g}" if isinstance(value, float) else str(value)
