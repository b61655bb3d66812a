"""What a live worker takes along, kept on disk so that one that is started again goes on where the last one was.

Written about once a second, in one step, so that there is always a whole one. What a worker cannot use, it ignores:
a file of another scene or view, of another version or from before the machine was started, or a broken one.
"""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import structlog

from entoptic.atomic_file import write_bytes
from entoptic.pipeline import RenderState
from entoptic.pipeline.budget import CostModel
from entoptic.pipeline.scenes import Head
from entoptic.services.config import ViewConfig
from entoptic.services.results import kept
from entoptic.services.settings import Settings

VERSION = 1
EVERY_S = 1.0
"""Engineering choice: what the eyes forget by a crash is then less than they do in a blink or two."""


class Checkpoint(msgspec.Struct, frozen=True, kw_only=True):
    """All that a worker takes along from one frame to the next."""

    entoptic: int = VERSION
    written_ns: int
    """On the machine's monotonic clock, as all times."""
    view: ViewConfig
    """With its size: a checkpoint of another one is of no use."""
    zero_ns: int
    """When frame 0 was due."""
    frame: int
    """The last one."""
    t_s: float
    """Its time."""
    dropped: int
    head: Head
    perception: Settings
    costs: CostModel
    state: RenderState | None


class Keeper:
    """Writes checkpoints into one file; reads the one that is there."""

    def __init__(self, path: Path, log: structlog.typing.FilteringBoundLogger) -> None:
        self._path, self._log = path, log
        self._due_s = time.monotonic() + EVERY_S
        self._failed = False

    def hurry(self) -> None:
        """The next one is due at once: something changed that nobody would tell again."""
        self._due_s = 0.0

    @property
    def due(self) -> bool:
        """Whether it is time for another one."""
        return time.monotonic() >= self._due_s

    def write(self, checkpoint: Checkpoint) -> None:
        """Replaces the file; a disk that is full is logged once, and does not matter until a crash."""
        self._due_s = time.monotonic() + EVERY_S
        try:
            write_bytes(self._path, kept.encode(checkpoint))
            self._failed = False
        except OSError as error:
            if not self._failed:
                self._log.warning("checkpoint not written", file=str(self._path), error=error.strerror)
            self._failed = True

    def read(self, view: ViewConfig) -> Checkpoint | None:
        """What is there to go on from, if anything; what is of no use is logged."""
        try:
            data = self._path.read_bytes()
            checkpoint = _decoder.decode(data)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError, ValueError, TypeError, AttributeError) as error:
            why: str | None = f"it cannot be read: {error}"
        else:
            why = _useless(checkpoint, view)
        if why is not None:
            self._log.warning("checkpoint ignored", file=str(self._path), why=why)
            return None
        return checkpoint


def _useless(checkpoint: Checkpoint, view: ViewConfig) -> str | None:
    """Why it is, if it is."""
    if checkpoint.entoptic != VERSION:
        return f"it is of form {checkpoint.entoptic}, this program reads {VERSION}"
    if checkpoint.view != view:
        return "it is of another scene or view"
    if not checkpoint.zero_ns <= checkpoint.written_ns <= time.monotonic_ns():
        return "it is from before this machine was started"
    return None


_decoder: msgspec.msgpack.Decoder[Checkpoint] = kept.decoder(Checkpoint)
