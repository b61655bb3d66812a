"""The records that flow from an eye tracker to a renderer, units in every field.

A source yields `PupilSample` and `GazeSample`; the bridge makes `EyeState` snapshots of them, and events (events.py).

Time is integer nanoseconds of the bridge's clock. Angles are the person's own: azimuth to the right and elevation
upwards are positive, (0, 0) is straight ahead of the head. Missing data is None or a named phase, never a zero.
"""

from __future__ import annotations

import enum
import math
from typing import Annotated

import msgspec

NS_PER_S = 1_000_000_000

Unit = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
AzimuthDeg = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
ElevationDeg = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
Count = Annotated[int, msgspec.Meta(ge=0)]
PositiveMm = Annotated[float, msgspec.Meta(gt=0.0, le=20.0)]


class Eye(enum.IntEnum):
    """Which eye, numbered as Pupil Core numbers its eye cameras."""

    RIGHT = 0
    LEFT = 1


class Phase(enum.StrEnum):
    """What the tracker sees of one pupil at the moment."""

    TRACKING = "tracking"
    """The diameter is measured and trusted."""
    CLOSING = "closing"
    """A lid comes down: it covers part of the pupil, whose outline is still found."""
    BLINK = "blink"
    """A lid covers the pupil."""
    OPENING = "opening"
    """The lid goes up: the pupil's outline is found again, but is not yet trusted."""
    DROPOUT = "dropout"
    """No trusted sample for less than 500 ms, and no sign of a lid."""
    LOST = "lost"
    """No trusted sample for 500 ms or more, or none yet; an eye held closed ends here too."""


class PupilSample(msgspec.Struct, frozen=True):
    """One measurement of one pupil, as a source gave it: untrusted, unfiltered."""

    t_ns: int
    """When the eye image was taken."""
    eye: Eye
    pupil_diameter_mm: float | None
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
    pupil_diameter_mm: PositiveMm | None
    """The last trusted diameter; while the phase is not `tracking` it goes on as it went, ever more slowly. None until
    there was one."""
    measured_mm: float | None
    """The newest diameter as the source gave it, nonsense included, for plots; None where it gave none."""
    confidence: Unit
    openness: Unit | None
    """0 lid closed … 1 as open as this person has it: as the source gave it, or else estimated from the pupil; None
    where neither can be."""
    gaze: Direction | None
    """This eye's own direction of gaze; None where the source gives only both eyes' together."""
    t_ns: int | None = None
    """When this eye's newest sample was taken: how far apart the two eyes of one state are. None before the first."""
    borrowed: bool = False
    """The diameter is the other eye's, with the usual difference between the two, since this eye is lost."""


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
    clock_uncertainty_ns: Count | None = None
    """How far the source's times may lie off the bridge's clock; None while nobody knows."""
    lag_ns: Count = 0
    """How long after its time a state is made: 0 in the live mode, a fixed lag in the recording mode."""

    def of(self, eye: Eye) -> OneEyeState:
        """The state of one eye."""
        return self.right if eye is Eye.RIGHT else self.left


def direction_deg(right: float, up: float, forward: float) -> tuple[float, float]:
    """Azimuth and elevation of a vector in the head's frame, of any length but zero."""
    return math.degrees(math.atan2(right, forward)), math.degrees(math.atan2(up, math.hypot(right, forward)))
