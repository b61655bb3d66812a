"""Where the processes' logs go: a file of the host's own, always, and the take's while one runs. JSON, a line each."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Final

import msgspec

from entoptic.services.process import state_folder

MOST_BYTES: Final = 2_000_000
"""Of a host's own file, after which it begins anew; the one before is kept. Engineering choice: a day of trouble."""
KEPT_FILES: Final = 20
"""Hosts' own files that are kept; older ones go."""
FREQUENT: Final = ("progress",)
"""What a process says at every frame; it stands in plan.csv."""


class Journal:
    """Both files. A full disk ends what cannot be written and is said in `trouble`; nothing is raised."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder` is the state folder's unless given."""
        self.trouble: str | None = None
        self.path = (folder or state_folder() / "log") / f"host-{os.getpid()}.jsonl"
        self._own: IO[bytes] | None = None
        self._take: IO[bytes] | None = None
        with self._named(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            _forget_old(self.path.parent)
            self._own = self.path.open("wb", buffering=0)

    def begin_take(self, folder: Path) -> None:
        """From now on all is in the take's log.jsonl too."""
        with self._named(folder / "log.jsonl"):
            self._take = (folder / "log.jsonl").open("ab", buffering=0)

    def end_take(self) -> None:
        """Its file is whole."""
        if self._take is not None:
            self._take.close()
        self._take = None

    def say(self, event: str, **more: Any) -> None:
        """A word of the host's own."""
        now = datetime.now(UTC).isoformat().replace("+00:00", "Z")
        self.add({"process": "host", "pid": os.getpid(), **more, "event": event, "timestamp": now})

    def add(self, message: dict[str, Any]) -> None:
        """A message of some process's log."""
        if message.get("event") in FREQUENT:
            return
        line = msgspec.json.encode(message) + b"\n"
        if self._take is not None:
            try:
                self._take.write(line)
            except OSError as error:
                self.trouble = f"the take's log.jsonl cannot be written any more: {error.strerror}; make room"
                self.end_take()
        if self._own is not None:
            with self._named(self.path):
                self._own.write(line)
                if self._own.tell() > MOST_BYTES:
                    self._own.close()
                    self.path.replace(self.path.with_suffix(".old.jsonl"))
                    self._own = self.path.open("wb", buffering=0)

    def close(self) -> None:
        """Ends both."""
        self.end_take()
        if self._own is not None:
            self._own.close()
        self._own = None

    @contextlib.contextmanager
    def _named(self, path: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.trouble = f"the log {path} cannot be written: {error.strerror}; make room, or look at its permissions"
            if path == self.path:
                self._own = None


def _forget_old(folder: Path) -> None:
    files = sorted(folder.glob("host-*.jsonl"), key=lambda path: path.stat().st_mtime)
    for path in files[: -KEPT_FILES or None]:
        with contextlib.suppress(OSError):
            path.unlink()
