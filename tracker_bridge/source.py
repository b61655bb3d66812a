"""Where samples come from: what every source in sources/ offers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import msgspec

from entoptic.errors import EntopticError
from entoptic.tracker_bridge.events import SourceEvent
from entoptic.tracker_bridge.samples import GazeSample, PupilSample


class SourceError(EntopticError):
    """A source cannot be read: the message names the thing and the remedy."""


class Tick(msgspec.Struct, frozen=True):
    """Time has passed and nothing was measured: what lets a pupil be lost when its source is silent."""

    t_ns: int


class SourceInfo(msgspec.Struct, frozen=True):
    """What a source is, found out by opening it."""

    name: str
    """For a person: "Pupil recording capture_3_6"."""
    t_start_ns: int
    t_end_ns: int | None
    """None for a source that goes on until it is stopped."""
    notes: tuple[str, ...] = ()
    """What had to be repaired or assumed on reading, a sentence each."""
    live: bool = False
    """Samples come when they are measured, on this machine's monotonic clock, in the order in which they arrive."""


Item = PupilSample | GazeSample | Tick | SourceEvent


class Source(Protocol):
    """Where samples come from.

    A recording's samples are in the order of their time, each time and eye once, and the same each time they are asked
    for. A live source's come as they arrive: late, twice and backwards if that is how they arrive; it yields a `Tick`
    at least every 100 ms, so that whoever reads it never waits for longer; its events say what became of the source.
    Closing the iterator frees what it holds.
    """

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        ...

    def samples(self) -> Iterator[Item]:
        """What the source yields."""
        ...


class RecordedSource(Source, Protocol):
    """A source that holds samples alone."""

    def samples(self) -> Iterator[PupilSample | GazeSample]:
        """All samples, in the order of their time."""
        ...
