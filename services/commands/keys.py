"""`entoptic keys`: lets readers on other machines hear a bridge, and nobody else."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from entoptic.services.terminal import console


def keys(
    out: Annotated[Path, typer.Option(help="Folder for the keys of one bridge and of its readers.")],
    client: Annotated[
        list[str],
        typer.Option(metavar="NAME", help="Add a reader: letters, digits, - and _. May be given more than once."),
    ] = [],  # noqa: B006 - typer copies it
) -> None:
    """Make the keys of a bridge that listens beyond this machine, or of more readers of it."""
    from entoptic.services import keys as key_files

    if client and all(key_files.has_client(out, name) for name in client):
        console.print(f"all of these keys are in [b]{escape(str(out))}[/b] already: nothing is made", soft_wrap=True)
        return
    if not client or not (out / key_files.BRIDGE).exists():
        folder = key_files.make_bridge(out)
        console.print(f"for the bridge: [b]--keys {escape(str(folder))}[/b]", soft_wrap=True)
    if not client:
        console.print(f"next, for each reader: [b]entoptic keys --out {escape(str(out))} --client NAME[/b]")
    for name in client:
        folder = key_files.make_client(out, name)
        console.print(
            f"for the reader: copy [b]{escape(str(folder))}[/b] to its machine by a safe way, and give it --keys with "
            "that folder",
            soft_wrap=True,
        )
