"""`entoptic keys`: lets readers on other machines hear a bridge, and nobody else."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from services.terminal import console


def keys(
    out: Annotated[Path, typer.Option(help="Folder for the keys of one bridge and of its readers.")],
    client: Annotated[str | None, typer.Option(metavar="NAME", help="Add a reader: letters, digits, - and _.")] = None,
) -> None:
    """Make the keys of a bridge that listens beyond this machine, or of one more reader of it."""
    from services import keys as key_files

    if client is None or not (out / key_files.BRIDGE).exists():
        folder = key_files.make_bridge(out)
        console.print(f"for the bridge: [b]--keys {escape(str(folder))}[/b]", soft_wrap=True)
    if client is None:
        console.print(f"next, for each reader: [b]entoptic keys --out {escape(str(out))} --client NAME[/b]")
        return
    folder = key_files.make_client(out, client)
    console.print(
        f"for the reader: copy [b]{escape(str(folder))}[/b] to its machine by a safe way, and give it --keys with that "
        "folder",
        soft_wrap=True,
    )
