"""Where the processes' logs go: a file of the host, always, and a recording's while one runs. JSON, a line each."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any, Final

import msgspec

from entoptic.services.ipc.status import Problem, problem
from entoptic.services.process import state_folder

MOST_BYTES: Final = 2_000_000
"""Of a host's own file, after which it begins again; the one before is kept. Engineering choice: a day of trouble."""
KEPT_FILES: Final = 20
"""Hosts' own files that are kept; older ones go."""
FREQUENT: Final = ("progress",)
"""What a process says at every frame; it stands in plan.csv."""


class _Lines(RotatingFileHandler):
    """Of `logging` the file and its turns alone: what cannot be written is an OSError."""

    def handleError(self, record: logging.LogRecord) -> None:
        raise


class Journal:
    """Both files. A full disk ends what cannot be written and is said in `problem`; nothing is raised."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder` is the state folder's unless given."""
        self.problem: Problem | None = None
        self.path = (folder or state_folder() / "log") / f"host-{os.getpid()}.jsonl"
        self._files: dict[Path, _Lines] = {}
        self._recording = Path()
        with self._reported(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            _forget_old(self.path.parent)
            self._files[self.path] = _Lines(self.path, maxBytes=MOST_BYTES, backupCount=1, encoding="utf-8")

    def begin_recording(self, folder: Path) -> None:
        """From now on all is in the recording's log.jsonl too."""
        self._recording = folder / "log.jsonl"
        with self._reported(self._recording):
            self._files[self._recording] = _Lines(self._recording, encoding="utf-8")

    def end_recording(self) -> None:
        """Its file is whole."""
        self._end(self._recording)

    def say(self, event: str, **more: Any) -> None:
        """A word of the host's own."""
        now = datetime.now(UTC).isoformat().replace("+00:00", "Z")
        self.add({"process": "host", "pid": os.getpid(), **more, "event": event, "timestamp": now})

    def add(self, message: dict[str, Any]) -> None:
        """A message of some process's log."""
        if message.get("event") in FREQUENT:
            return
        record = logging.makeLogRecord({"msg": msgspec.json.encode(message).decode()})
        for path, file in list(self._files.items()):
            with self._reported(path):
                file.handle(record)

    def close(self) -> None:
        """Ends both."""
        for path in list(self._files):
            self._end(path)

    def _end(self, path: Path) -> None:
        if (file := self._files.pop(path, None)) is not None:
            with contextlib.suppress(OSError):  # what did not fit on the disk was reported
                file.close()

    @contextlib.contextmanager
    def _reported(self, path: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.problem = problem(
                "no log",
                "warning",
                f"The log {path} cannot be written: {error.strerror}",
                "Make room, or look at its permissions",
            )
            self._end(path)


def _forget_old(folder: Path) -> None:
    files = sorted(folder.glob("host-*.jsonl*"), key=lambda path: path.stat().st_mtime)
    for path in files[: -KEPT_FILES or None]:
        with contextlib.suppress(OSError):
            path.unlink()
