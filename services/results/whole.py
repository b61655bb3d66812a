"""Files that are there whole or not at all, and the names of those that more than one process knows."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

BRIDGE: Final = "bridge.json"
"""A bridge's last word on a take; missing while it keeps one, and where it was ended by force."""
WORKER: Final = "worker.json"
"""A worker's."""


def write_whole(path: Path, data: bytes) -> None:
    """Writes a file beside its place, then moves it there in one step. Raises OSError; the old one stays then."""
    new = path.with_name(f".{path.name}.new")
    new.write_bytes(data)
    new.replace(path)


def write_json(path: Path, told: object) -> None:
    """The same of something as JSON, for a person to read. Raises OSError."""
    write_whole(path, msgspec.json.format(msgspec.json.encode(told), indent=2) + b"\n")
