"""A file is there when it is whole, and not before."""

from __future__ import annotations

import contextlib
from pathlib import Path

from entoptic.pipeline.frame import FrameError


class WholeFile:
    """A file on its way: written beside its place under another name, then moved there in one step."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        """Where to write. It keeps the suffix, by which writers know the format."""

    def keep(self) -> None:
        """Gives the file its name, in place of what had it. Raises FrameError if that fails, then nothing is left."""
        try:
            self.partial.replace(self._path)
        except OSError as error:
            raise self.failed(str(error)) from None

    def drop(self) -> None:
        """Leaves nothing behind."""
        with contextlib.suppress(OSError):
            self.partial.unlink()

    def failed(self, reason: str) -> FrameError:
        """Drops the file, and the error to raise."""
        self.drop()
        reason = reason.strip().split("\n")[0]
        return FrameError(f"{self._path} cannot be written ({reason}); check its folder and the space on the disk")
