"""From positions before a display to directions of gaze. Pure.

The display's frame, in mm: origin at the upper left corner of the display, x to the right, y down, z out of it towards
the person. The origin is where GazeHid's driver for Tobii trackers puts it: its gaze point is the share of the
calibrated width and height, from the upper left. Eyes are taken in the same frame.

A direction is relative to the head, and straight ahead is the display's normal: the head is taken as upright and facing
the display. Page 0x12 has the head's rotation too, but not in a unit that the known devices fill. So, of an eye at E
and a point G on the display,

    azimuth = atan2(Gx − Ex, Ez)        elevation = atan2(Ey − Gy, √((Gx − Ex)² + Ez²)).

An eye whose position is not reported is taken before the middle of the calibrated screen, half an interpupillary
distance aside, at the tracker's own optimum distance, or else at 650 mm; both eyes together look from the middle
between them. Without the screen's size there is then no direction at all, rather than a wrong one. At 650 mm an error
of 100 mm in the distance makes 1.5° in a gaze 10° aside.
"""

from __future__ import annotations

import msgspec

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample, direction_deg
from entoptic.tracker_bridge.sources.hid.eye_tracker import Configuration
from entoptic.tracker_bridge.sources.hid.tracking import EyeReading, Point, Position, Tracking

USUAL_DISTANCE_MM = 650.0
"""Viewing distance that makers of remote trackers recommend (Tobii: 65 cm)."""

INTERPUPILLARY_MM = 63.0
"""Mean of adults: 63.4 mm (Dodgson 2004, Proc. SPIE 5291, 36)."""


class Viewing(msgspec.Struct, frozen=True):
    """Where eyes are taken to be that are not reported."""

    middle_mm: Position | None
    """Between the eyes; None where the screen's size is not known."""
    notes: tuple[str, ...]
    """What was assumed, a sentence each."""

    def eye_mm(self, eye: Eye) -> Position | None:
        """One eye. The person faces the display, so that their right is the display's right."""
        return None if self.middle_mm is None else _aside(self.middle_mm, _half_mm(eye))


def viewing(configuration: Configuration) -> Viewing:
    """What a tracker's own settings leave to assume."""
    screen, distance = configuration.screen_mm, configuration.optimum_distance_mm
    if screen is None:
        return Viewing(
            None,
            (
                "The tracker does not know its screen's size: gaze has no direction while it does not report where the "
                "eyes are. Set up the screen with the maker's program.",
            ),
        )
    whose = "the tracker's optimum distance" if distance is not None else "the usual distance"
    middle = (screen[0] / 2, screen[1] / 2, distance if distance is not None else USUAL_DISTANCE_MM)
    text = f"Eyes that the tracker does not place are taken {middle[2]:g} mm before the screen's middle, {whose}."
    return Viewing(middle, (text,))


def samples_of(tracking: Tracking, assumed: Viewing, t_ns: int) -> list[PupilSample | GazeSample]:
    """What a report says, at this time: pupils, then gaze, right, left and both; what it does not say is left out.

    Gaze without a confidence of its own counts as certain: such a tracker reports no gaze that it does not trust.
    """
    samples: list[PupilSample | GazeSample] = [
        sample for eye in Eye if (sample := _pupil(eye, tracking.eyes[eye], t_ns)) is not None
    ]
    for eye in Eye:
        reading = tracking.eyes[eye]
        from_mm = reading.position_mm or assumed.eye_mm(eye)
        if reading.gaze_mm is not None and from_mm is not None:
            samples.append(_gaze(eye, from_mm, reading.gaze_mm, reading.gaze_confidence, t_ns))
    from_mm = middle_mm(tracking) or assumed.middle_mm
    if tracking.gaze_mm is not None and from_mm is not None:
        samples.append(_gaze(None, from_mm, tracking.gaze_mm, tracking.gaze_confidence, t_ns))
    return samples


def middle_mm(tracking: Tracking) -> Position | None:
    """Between the eyes. Of one eye alone it is taken half an interpupillary distance towards the nose: gaze must not
    jump by 3° when an eye is lost."""
    right, left = (tracking.eyes[eye].position_mm for eye in Eye)
    if right is not None and left is not None:
        return (right[0] + left[0]) / 2, (right[1] + left[1]) / 2, (right[2] + left[2]) / 2
    if right is not None:
        return _aside(right, -_half_mm(Eye.RIGHT))
    return None if left is None else _aside(left, -_half_mm(Eye.LEFT))


def _half_mm(eye: Eye) -> float:
    return INTERPUPILLARY_MM / 2 if eye is Eye.RIGHT else -INTERPUPILLARY_MM / 2


def _aside(position: Position, right_mm: float) -> Position:
    return position[0] + right_mm, position[1], position[2]


def _pupil(eye: Eye, reading: EyeReading, t_ns: int) -> PupilSample | None:
    if not reading.has_pupil or reading.confidence is None:
        return None
    return PupilSample(
        t_ns=t_ns,
        eye=eye,
        pupil_diameter_mm=reading.pupil_diameter_mm,
        confidence=reading.confidence,
        model_confidence=reading.model_confidence,
        diameter_px=reading.image_diameter_px,
        openness=reading.openness,
    )


def _gaze(eye: Eye | None, from_mm: Position, to_mm: Point, confidence: float | None, t_ns: int) -> GazeSample:
    azimuth, elevation = direction_deg(right=to_mm[0] - from_mm[0], up=from_mm[1] - to_mm[1], forward=from_mm[2])
    return GazeSample(t_ns, eye, azimuth, elevation, 1.0 if confidence is None else confidence)
