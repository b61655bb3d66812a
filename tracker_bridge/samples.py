"""The records that flow from an eye tracker to a renderer, units in every field.

A source yields `PupilSample` and `GazeSample`; the bridge makes `EyeState` snapshots and events of them.

Time is integer nanoseconds of the bridge's clock. Angles are the person's own: azimuth to the right and elevation
upwards are positive, (0, 0) is straight ahead of the head. Missing data is None or a named phase, never a zero.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from typing import Annotated, Protocol

import msgspec

NS_PER_S = 1_000_000_000

Unit = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
AzimuthDeg = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
ElevationDeg = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
PositiveMm = Annotated[float, msgspec.Meta(gt=0.0, le=20.0)]
Count = Annotated[int, msgspec.Meta(ge=0)]


class SourceError(Exception):
    """A source cannot be read: the message names the thing and the remedy."""


class Eye(enum.IntEnum):
    """Which eye, numbered as Pupil Core numbers its eye cameras."""

    RIGHT = 0
    LEFT = 1


class Phase(enum.StrEnum):
    """What the tracker sees of one pupil at the moment."""

    TRACKING = "tracking"
    """The diameter is measured and trusted."""
    BLINK = "blink"
    """A lid covers the pupil: the tracker says so, or the pupil shrank faster than any iris moves."""
    DROPOUT = "dropout"
    """No trusted sample for less than 500 ms, and no sign of a lid."""
    LOST = "lost"
    """No trusted sample for 500 ms or more, or none yet."""


class PupilSample(msgspec.Struct, frozen=True):
    """One measurement of one pupil, as a source gave it: untrusted, unfiltered."""

    t_ns: int
    """When the eye image was taken."""
    eye: Eye
    diameter_mm: float | None
    """As measured, nonsense included (a lost 3-D model reports −7580 mm); None where the source has no millimetres."""
    confidence: Unit
    """How sure the detector is of the pupil's outline."""
    model_confidence: Unit | None = None
    """How sure the detector is of its 3-D eye model; None for detectors without one."""
    diameter_px: float | None = None
    """Diameter in the eye camera's image, px; no measure of the pupil without a calibration."""
    openness: Unit | None = None
    """0 lid closed … 1 lid as open as this person has it; None where the source does not give it."""


class GazeSample(msgspec.Struct, frozen=True):
    """One direction of gaze."""

    t_ns: int
    eye: Eye | None
    """The eye that looks there; None for the direction of both together."""
    azimuth_deg: AzimuthDeg
    elevation_deg: ElevationDeg
    confidence: Unit


class Direction(msgspec.Struct, frozen=True):
    """Where an eye, or both, look."""

    azimuth_deg: AzimuthDeg
    elevation_deg: ElevationDeg
    t_ns: int
    """When it was measured."""


class OneEyeState(msgspec.Struct, frozen=True):
    """One eye as a renderer may use it."""

    phase: Phase
    diameter_mm: PositiveMm | None
    """The last trusted diameter, held while the phase is not `tracking`; None until there was one."""
    measured_mm: float | None
    """The newest diameter as the source gave it, nonsense included, for plots; None where it gave none."""
    confidence: Unit
    openness: Unit | None
    gaze: Direction | None
    """This eye's own direction of gaze; None where the source gives only both eyes' together."""


class EyeState(msgspec.Struct, frozen=True):
    """A whole snapshot of a person's eyes."""

    sequence: Count
    """Counts up by one a snapshot: a gap shows a subscriber what it missed."""
    t_ns: int
    """The time of the newest sample in it; never goes backwards."""
    right: OneEyeState
    left: OneEyeState
    gaze: Direction | None
    """Where both eyes together look; None until the source gave a direction."""

    def of(self, eye: Eye) -> OneEyeState:
        """The state of one eye."""
        return self.right if eye is Eye.RIGHT else self.left


class BlinkOnset(msgspec.Struct, frozen=True, tag=True):
    """A lid starts to cover the pupil."""

    t_ns: int
    eye: Eye


class BlinkOffset(msgspec.Struct, frozen=True, tag=True):
    """The pupil is trusted again after a blink."""

    t_ns: int
    eye: Eye
    duration_ns: Count


class PupilLost(msgspec.Struct, frozen=True, tag=True):
    """No trusted sample of this pupil for 500 ms."""

    t_ns: int
    eye: Eye


class PupilBack(msgspec.Struct, frozen=True, tag=True):
    """A lost pupil is tracked again."""

    t_ns: int
    eye: Eye


class StreamStarted(msgspec.Struct, frozen=True, tag=True):
    """The first message of a stream."""

    t_ns: int
    """Time of the source's first sample."""
    t_end_ns: int | None
    """Time of the last one, where the source knows."""
    source: str
    """What the samples come from, for a person."""


class StreamEnded(msgspec.Struct, frozen=True, tag=True):
    """The last message of a stream."""

    t_ns: int
    state_count: Count
    """How many states were published in all."""


Event = BlinkOnset | BlinkOffset | PupilLost | PupilBack | StreamStarted | StreamEnded


class SourceInfo(msgspec.Struct, frozen=True):
    """What a source is, found out by opening it."""

    name: str
    """For a person: "Pupil recording capture_3_6"."""
    t_start_ns: int
    t_end_ns: int | None
    """None for a source that goes on until it is stopped."""
    notes: tuple[str, ...] = ()
    """What had to be repaired or assumed on reading, a sentence each."""


class Source(Protocol):
    """Where samples come from."""

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        ...

    def samples(self) -> Iterator[PupilSample | GazeSample]:
        """All samples in the order of their time, each time and eye once. May be called again: the same samples."""
        ...


def direction_deg(right: float, up: float, forward: float) -> tuple[float, float]:
    """Azimuth and elevation of a vector in the head's frame, of any length but zero."""
    return math.degrees(math.atan2(right, forward)), math.degrees(math.atan2(up, math.hypot(right, forward)))
