"""What each frame was rendered from, so that it can be rendered again to the bit: render_log.msgpack.

Theory of operation: a frame is a function of the scene, of settings, of what the eyes remember from the frame before,
and of what came from outside: the time, the head, what the bridge said, and, where the cost model follows the machine,
how long each part took. The file begins with the first three and then has what came from outside, a msgpack map a
frame. It only ever grows, one write a record, so that a worker that is killed loses the frame in hand and no more; what
it had written of that one is left out on reading. A worker that was started again says what it remembered.
"""

from __future__ import annotations

import mmap
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgpack  # type: ignore[import-untyped]  # ships no types
import msgspec

from entoptic import __version__
from entoptic.errors import EntopticError
from entoptic.pipeline import RenderState
from entoptic.pipeline.budget import CostModel, Timing
from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse
from entoptic.pipeline.scenes import Head
from entoptic.services.config import ViewConfig
from entoptic.services.rendering import Rendering
from entoptic.services.results import kept
from entoptic.services.results.machine import machine
from entoptic.services.session_config import EYES
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.wire import Eye, EyeState

FILE = "render_log.msgpack"
VERSION = 1
"""Of the file's form."""


class RenderLogError(EntopticError):
    """Frames cannot be rendered again: the message names the file and the remedy."""


class Begun(msgspec.Struct, frozen=True, kw_only=True, tag_field="is", tag="begun"):
    """The first record."""

    entoptic: Annotated[int, msgspec.Meta(ge=0)] = VERSION
    program: str
    """Which version wrote it."""
    machine: str = ""
    """What rendered its first frame; empty where that was not kept."""
    view: ViewConfig
    """With its size as it is."""
    live: bool
    zero_s: float
    """Zero of the tables' times, as a frame's `t_s`."""
    perception: Settings
    costs: CostModel
    state: RenderState | None
    """What the eyes remembered before the first frame here."""

    @property
    def eyes(self) -> tuple[Eye, ...]:
        """Those that are rendered, from left to right."""
        return EYES[self.view.eyes]


class FrameRecord(msgspec.Struct, frozen=True, tag_field="is", tag="frame"):
    """What one frame was rendered from."""

    frame: int
    t_s: float
    """Since the worker's first frame."""
    dt_s: float
    """Since the frame before."""
    head: Head
    state: EyeState | None
    saccade_impulses: tuple[SaccadeImpulse, ...]
    """The eyes' turns that were told since the frame before."""
    dropped: int
    """Frames left out so far."""
    timings: tuple[Timing, ...] = ()
    """What the costs were corrected by after it; none where they are not."""
    sha256: bytes = b""
    """Of all perceived frames' code values up to this one, as WorkerSummary's."""


class Perceive(msgspec.Struct, frozen=True, tag_field="is", tag="perceive"):
    """Other settings, from the next frame on."""

    perception: Settings


class Resumed(msgspec.Struct, frozen=True, tag_field="is", tag="resumed"):
    """A worker was started again, and remembered this much."""

    zero_s: float
    """As of Begun: a worker that remembered nothing counts its own time."""
    perception: Settings
    costs: CostModel
    state: RenderState | None


Record = Begun | FrameRecord | Perceive | Resumed


def begin(view: ViewConfig, rendering: Rendering, *, live: bool, zero_s: float = 0.0) -> Begun:
    """What a render log begins with."""
    return Begun(
        program=__version__,
        machine=machine(),
        view=view,
        live=live,
        zero_s=zero_s,
        perception=rendering.perception,
        costs=rendering.costs,
        state=rendering.kept_memory,
    )


class RenderLog:
    """A render log, read. Raises RenderLogError where it is none, or is broken in its middle."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._decoder: msgspec.msgpack.Decoder[Record] = kept.decoder(Record)
        self.whole_bytes = 0
        """How much of it is read; after the last record, how much of it is whole."""
        self.note: str | None = None
        """After the last record: what was left out."""
        first = next(self._records(), None)
        if not isinstance(first, Begun):
            raise RenderLogError(f"{path} is empty or begins in mid-session: nothing can be rendered again")
        self.begun = first

    def __iter__(self) -> Iterator[FrameRecord | Perceive | Resumed]:
        """All records after the first."""
        for record in self._records():
            if not isinstance(record, Begun):
                yield record

    def last(self) -> FrameRecord | None:
        """The last frame; reads the file to its end."""
        last = deque((record for record in self if isinstance(record, FrameRecord)), maxlen=1)
        return last[0] if last else None

    def _records(self) -> Iterator[Record]:
        number = start = 0
        try:
            with self._path.open("rb") as file:
                size = self._path.stat().st_size
                if not size:
                    return
                unpacker = msgpack.Unpacker(file, max_buffer_size=max(size, 1), strict_map_key=False)
                with self._path.open("rb") as again, mmap.mmap(again.fileno(), size, access=mmap.ACCESS_READ) as data:
                    while start < size:
                        number += 1
                        try:
                            unpacker.skip()
                        except msgpack.OutOfData:
                            self.note = f"The last frame in {FILE} is not whole and was left out."
                            return
                        end = unpacker.tell()
                        record = self._decoder.decode(data[start:end])
                        if isinstance(record, Begun) and (number > 1 or record.entoptic != VERSION):
                            what = f"of form {record.entoptic}, this program reads {VERSION}"
                            raise RenderLogError(f"{self._path} is " + ("two files in one" if number > 1 else what))
                        yield record
                        self.whole_bytes = start = end
        except OSError as error:
            raise RenderLogError(
                f"{self._path} cannot be read: {error.strerror}; name the folder of a session with its {FILE}"
            ) from None
        except (msgspec.DecodeError, msgpack.UnpackException, ValueError, TypeError, AttributeError) as error:
            raise RenderLogError(
                f"{self._path} is broken, or not of this program, at record {number}: {error}"
            ) from None
