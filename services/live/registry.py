"""Which hosts of this user run: a small file each, held locked while the host lives.

So a host that was killed is known by its lock, which no other process can have by chance as it can a number.
"""

from __future__ import annotations

import contextlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import msgspec

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
        self._lock = self._path.with_suffix(".lock").open("wb")
        _try_lock(self._lock)
        self.update(host)

    def update(self, host: RunningHost) -> None:
        """Says something else from now on."""
        new = self._path.with_suffix(".new")
        new.write_bytes(msgspec.json.encode(host))
        new.replace(self._path)

    def close(self) -> None:
        """Nothing is left."""
        self._lock.close()
        _remove(self._path)


def running() -> Iterator[RunningHost]:
    """The hosts that live; what dead ones left is removed."""
    for path in sorted(_folder().glob("*.json")):
        if not _is_held(path.with_suffix(".lock")):
            _remove(path)
            continue
        with contextlib.suppress(OSError, msgspec.DecodeError):
            yield msgspec.json.decode(path.read_bytes(), type=RunningHost)


def _remove(path: Path) -> None:
    shutil.rmtree(path.with_suffix(".files"), ignore_errors=True)
    for each in (path, path.with_suffix(".lock"), path.with_suffix(".new")):
        with contextlib.suppress(OSError):
            each.unlink()


def _is_held(lock: Path) -> bool:
    try:
        with lock.open("rb+") as file:
            return not _try_lock(file)
    except FileNotFoundError:
        return False
    except OSError:
        return True


def _try_lock(file: IO[bytes]) -> bool:
    """Whether nobody else holds it; from then on this process does, until the file is closed."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
