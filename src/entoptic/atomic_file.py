"""Files that are there whole or not at all: written beside their place, then moved there in one step."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from entoptic.errors import OutputError


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """A context that gives the path to write to; the file takes its place at the end, and vanishes on an error.

    It keeps the suffix, by which writers know the format. Raises OSError if it cannot be moved; the old file stays.
    """
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise


def write_bytes(path: Path, data: bytes, *, durable: bool = False) -> None:
    """Writes a file, or leaves the old one. A `durable` one outlives a power cut. Raises OSError."""
    with atomic_file(path) as partial, partial.open("wb") as stream:
        stream.write(data)
        if durable:
            stream.flush()
            os.fsync(stream.fileno())


def write_json(path: Path, record: object) -> None:
    """The same of a record as JSON, indented for a person to read. Raises OSError."""
    write_bytes(path, msgspec.json.format(msgspec.json.encode(record), indent=2) + b"\n")


@contextlib.contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """A context in which OSErrors, and what PyAV raises beside them, become an OutputError that names the file."""
    try:
        yield
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).strip().split("\n")[0]
        raise OutputError(f"{path} cannot be written ({reason}); check its folder and the space on the disk") from None
