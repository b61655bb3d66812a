"""What happened, as opposed to how things stand: the records that must not be lost on their way to a reader.

Time is integer nanoseconds of the bridge's clock, as in samples.py.
"""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

from entoptic.tracker_bridge.samples import Count, Eye

NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class BlinkOnset(msgspec.Struct, frozen=True, tag=True):
    """A lid starts to cover the pupil."""

    t_ns: int
    eye: Eye


class BlinkOffset(msgspec.Struct, frozen=True, tag=True):
    """The pupil is whole again after a blink, or after an eye was held closed."""

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


class SaccadeKind(enum.StrEnum):
    """Saccades apart from microsaccades, by their amplitude."""

    MICROSACCADE = "microsaccade"
    """Up to 1°."""
    SACCADE = "saccade"


class SaccadeOnset(msgspec.Struct, frozen=True, tag=True):
    """A fast movement of both eyes has begun; its kind is known only when it has ended."""

    t_ns: int
    """When it was found out: the time of the sample that showed it."""
    onset_ns: int
    """When it began, walked back along the velocity and interpolated between samples."""
    azimuth_velocity_deg_s: float
    elevation_velocity_deg_s: float


class SaccadeOffset(msgspec.Struct, frozen=True, tag=True):
    """A fast movement of both eyes has ended."""

    t_ns: int
    """When it was found out."""
    onset_ns: int
    offset_ns: int
    kind: SaccadeKind
    amplitude_deg: NonNegative
    """Of the vector from where the eyes were at onset to where they were at offset, mean of the eyes seen."""
    peak_velocity_deg_s: NonNegative
    azimuth_deg: float
    """The movement to the right; with `elevation_deg`, its direction."""
    elevation_deg: float
    """The movement upwards."""


class SourceSilent(msgspec.Struct, frozen=True, tag=True):
    """Nothing comes from the tracker any more."""

    t_ns: int
    reason: str
    """For a person: what is missing and what to do."""


class SourceBack(msgspec.Struct, frozen=True, tag=True):
    """The tracker's samples come, at first or again."""

    t_ns: int


class ClockEstimated(msgspec.Struct, frozen=True, tag=True):
    """How the source's clock stands to the bridge's, about once a second."""

    t_ns: int
    offset_ns: int
    """The bridge's clock less the source's, now."""
    drift_ppm: float
    """How much faster the bridge's clock runs than the source's, parts per million; 0 until it can be told."""
    uncertainty_ns: Count
    """The offset lies within ± this."""


class ClockJumped(msgspec.Struct, frozen=True, tag=True):
    """The source's clock was set: its times now mean something else. Published times go on without a step back."""

    t_ns: int
    jump_ns: int
    """How far the source's clock went forwards."""


class TaskKind(enum.StrEnum):
    """Something that a tracker does on its own."""

    GAZE_CALIBRATION = "gaze calibration"
    RECORDING = "recording"


class TaskOutcome(enum.StrEnum):
    """What became of it."""

    STARTED = "started"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"


class TrackerTask(msgspec.Struct, frozen=True, tag=True):
    """The tracker says that a calibration or a recording of its own started or ended."""

    t_ns: int
    kind: TaskKind
    outcome: TaskOutcome
    detail: str
    """The tracker's words: a reason, or where the recording lies; may be empty."""


class TrackerStatus(msgspec.Struct, frozen=True, tag=True):
    """The tracker says how it is, or what it noticed."""

    t_ns: int
    ready: bool
    detail: str
    """For a person."""


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


class Heartbeat(msgspec.Struct, frozen=True, tag=True):
    """Once a second: the bridge is there. No event, so it takes no number of its own; see wire.py."""

    t_ns: int
    state_count: Count
    """How many states were published so far."""
    late_samples: Count
    """Samples that came too late, twice, backwards or from the future, and were left out."""


SourceEvent = SourceSilent | SourceBack | ClockEstimated | ClockJumped | TrackerTask | TrackerStatus
"""What a source itself reports."""

Event = (
    BlinkOnset
    | BlinkOffset
    | PupilLost
    | PupilBack
    | SaccadeOnset
    | SaccadeOffset
    | SourceSilent
    | SourceBack
    | ClockEstimated
    | ClockJumped
    | TrackerTask
    | TrackerStatus
    | StreamStarted
    | StreamEnded
    | Heartbeat
)
