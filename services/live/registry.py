"""Which hosts of this user run: a small file each, held locked while the host lives.

So a host that was killed is known by its lock, which no other process can have by chance as it can a number.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import msgspec
from filelock import FileLock

from entoptic.atomic_file import write_json
from entoptic.services.process import state_folder


class RunningHost(msgspec.Struct, frozen=True):
    """Where a host is to be reached."""

    pid: int
    control: str
    started: str
    """ISO 8601."""
    console_url: str | None = None


def _folder() -> Path:
    return state_folder() / "hosts"


class Registration:
    """This process's own file, and a folder beside it for what a session needs while it runs. Raises OSError."""

    def __init__(self, host: RunningHost) -> None:
        folder = _folder()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._path = folder / f"{host.pid}.json"
        self.scratch = folder / f"{host.pid}.files"
        """Its own folder, gone when it ends."""
        shutil.rmtree(self.scratch, ignore_errors=True)
        self.scratch.mkdir(mode=0o700)
        self._lock = _lock_of(self._path)
        self._lock.acquire()
        self.update(host)

    def update(self, host: RunningHost) -> None:
        """Says something else from now on."""
        write_json(self._path, host)

    def close(self) -> None:
        """Nothing is left."""
        self._lock.release()
        _remove(self._path)


def running() -> Iterator[RunningHost]:
    """The hosts that live; what dead ones left is removed."""
    for path in sorted(_folder().glob("[0-9]*.json")):
        if not _is_held(path):
            _remove(path)
            continue
        with contextlib.suppress(OSError, msgspec.DecodeError):
            yield msgspec.json.decode(path.read_bytes(), type=RunningHost)


def _remove(path: Path) -> None:
    shutil.rmtree(path.with_suffix(".files"), ignore_errors=True)
    for each in (path, path.with_suffix(".lock")):
        with contextlib.suppress(OSError):
            each.unlink()


def _is_held(path: Path) -> bool:
    try:
        with _lock_of(path):
            return False
    except OSError:
        return True


def _lock_of(path: Path) -> FileLock:
    return FileLock(path.with_suffix(".lock"), blocking=False, thread_local=False)
