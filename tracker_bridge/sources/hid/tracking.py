"""What a report of tracking data says: which of its numbers mean what. Pure.

Vendor pages are nobody's, so the numbers of page 0xFF12 count only inside its own collection `PUPIL_DATA`, and only
with the units and limits that it asks for; what is left out is noted.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from entoptic.tracker_bridge.samples import Eye
from entoptic.tracker_bridge.sources.hid.report import (
    Field,
    HidReportError,
    ReportLayout,
    Scale,
    count_ns,
    joined,
    length_mm,
    plain,
)
from entoptic.tracker_bridge.sources.hid.usages import (
    BOTH_EYES,
    CONFIDENCE,
    DIAMETER,
    GAZE_CONFIDENCE,
    GAZE_POINT,
    IMAGE_DIAMETER,
    LEFT_EYE,
    LEFT_EYE_POSITION,
    MODEL_CONFIDENCE,
    OPENNESS,
    POSITION_X,
    POSITION_Y,
    POSITION_Z,
    PUPIL_DATA,
    RIGHT_EYE,
    RIGHT_EYE_POSITION,
    TIMESTAMP,
)

MICROMETRE = Scale(0.001, 0.0)
"""Positions without a unit are taken to be in µm, as GazeHid declares them."""

MICROSECOND_NS = 1000

MAX_TIME_NS = 2**63 - 1
"""Of a device's clock, 292 years: what is later is no time but a broken report."""

Point = tuple[float, float]
Position = tuple[float, float, float]


class EyeReading(msgspec.Struct, frozen=True):
    """What one report says of one eye; None for what it does not say."""

    position_mm: Position | None = None
    """In the display's frame; see gaze.py."""
    gaze_mm: Point | None = None
    """Where this eye looks on the display."""
    gaze_confidence: float | None = None
    has_pupil: bool = False
    """Whether the report speaks of this pupil at all, if only to say that it is lost."""
    pupil_diameter_mm: float | None = None
    image_diameter_px: float | None = None
    confidence: float | None = None
    model_confidence: float | None = None
    openness: float | None = None


class Tracking(msgspec.Struct, frozen=True):
    """One report of tracking data."""

    time_ns: int | None
    """On the device's clock."""
    gaze_mm: Point | None
    """Where both eyes look on the display."""
    gaze_confidence: float | None
    eyes: dict[Eye, EyeReading]


Bound = tuple[Field, Scale]


class TrackingReader:
    """The numbers of an input report that are known, found once."""

    def __init__(self, layout: ReportLayout, note: Callable[[str], None]) -> None:
        fields = {_role(field): field for field in reversed(layout.fields)}
        """Of two fields of one role the first counts."""
        self._time = [field for field in layout.fields if field.usage == TIMESTAMP]
        self._count_ns = (count_ns(self._time[0]) or MICROSECOND_NS) if self._time else 0

        def lengths(eye: int | None, group: int, *usages: int) -> tuple[Bound, ...] | None:
            found = [fields.get((eye, group, usage)) for usage in usages]
            bound = [(field, _position_scale(field, note)) for field in found if field is not None]
            whole = tuple((field, scale) for field, scale in bound if scale is not None)
            return whole if len(whole) == len(usages) else None

        def share(eye: int, usage: int) -> Bound | None:
            field = fields.get((eye, None, usage))
            if field is None:
                return None
            scale = plain(field)
            if not all(-1e-9 <= scale(limit) <= 1 + 1e-9 for limit in (field.item.logical_min, field.item.logical_max)):
                note(f"The tracker's {usage:#010x} does not go from 0 to 1; it is left out.")
                return None
            return field, scale

        def diameter(eye: int) -> Bound | None:
            field = fields.get((eye, None, DIAMETER))
            scale = None if field is None else length_mm(field)
            if field is not None and scale is None:
                note("The tracker gives pupil diameters in no unit of length; they are left out.")
            return None if field is None or scale is None else (field, scale)

        self._gaze = lengths(None, GAZE_POINT, POSITION_X, POSITION_Y)
        self._gaze_confidence = share(BOTH_EYES, GAZE_CONFIDENCE)
        self._positions = {
            Eye.RIGHT: lengths(None, RIGHT_EYE_POSITION, POSITION_X, POSITION_Y, POSITION_Z),
            Eye.LEFT: lengths(None, LEFT_EYE_POSITION, POSITION_X, POSITION_Y, POSITION_Z),
        }
        collections = {Eye.RIGHT: RIGHT_EYE, Eye.LEFT: LEFT_EYE}
        self._gazes = {eye: lengths(own, GAZE_POINT, POSITION_X, POSITION_Y) for eye, own in collections.items()}
        self._diameters = {eye: diameter(own) for eye, own in collections.items()}
        self._images = {
            eye: None if (field := fields.get((own, None, IMAGE_DIAMETER))) is None else (field, plain(field))
            for eye, own in collections.items()
        }
        self._shares = {
            eye: {usage: share(own, usage) for usage in (CONFIDENCE, MODEL_CONFIDENCE, OPENNESS, GAZE_CONFIDENCE)}
            for eye, own in collections.items()
        }
        self.has_time = bool(self._time)
        """Whether the report is dated."""
        self.has_pupils = any(self._diameters.values())
        """Whether it has a pupil's diameter."""
        self._has_anything = (
            self._gaze is not None or self.has_pupils or any(self._positions.values()) or any(self._gazes.values())
        )

    def read(self, bits: int) -> Tracking | None:
        """What these bits say; None where nothing is known. Raises HidReportError for an impossible time."""
        if not self._has_anything:
            return None
        time_ns = None
        if self._time:
            time_ns = joined(self._time, bits) * self._count_ns
            if time_ns > MAX_TIME_NS:
                raise HidReportError("a report of an impossible time came, more than 292 years on the tracker's clock")
        gaze = _read_all(self._gaze, bits)
        return Tracking(
            time_ns=time_ns,
            gaze_mm=None if gaze is None else (gaze[0], gaze[1]),
            gaze_confidence=_share_of(self._gaze_confidence, bits),
            eyes={eye: self._eye(eye, bits) for eye in Eye},
        )

    def _eye(self, eye: Eye, bits: int) -> EyeReading:
        position, gaze = _read_all(self._positions[eye], bits), _read_all(self._gazes[eye], bits)
        pupil_diameter_mm, shares = read_one(self._diameters[eye], bits), self._shares[eye]
        confidence = _share_of(shares[CONFIDENCE], bits)
        if shares[CONFIDENCE] is None:
            # A tracker without confidence is sure of what it reports, and of nothing where it reports nothing.
            has_pupil = self._diameters[eye] is not None or shares[OPENNESS] is not None
            confidence = 1.0 if pupil_diameter_mm is not None else 0.0
        else:
            has_pupil = confidence is not None
        return EyeReading(
            # On or behind the display nobody looks at it: a tracker that sees no eye sends zeros.
            position_mm=None if position is None or position[2] <= 0.0 else (position[0], position[1], position[2]),
            gaze_mm=None if gaze is None else (gaze[0], gaze[1]),
            gaze_confidence=_share_of(shares[GAZE_CONFIDENCE], bits),
            has_pupil=has_pupil,
            pupil_diameter_mm=pupil_diameter_mm,
            image_diameter_px=read_one(self._images[eye], bits),
            confidence=confidence,
            model_confidence=_share_of(shares[MODEL_CONFIDENCE], bits),
            openness=_share_of(shares[OPENNESS], bits),
        )


def _role(field: Field) -> tuple[int | None, int | None, int]:
    """What tells fields of the same usage apart: whose eye's they are, and which point's."""
    own = field.collections
    eye = next((usage for usage in own if usage in (RIGHT_EYE, LEFT_EYE, BOTH_EYES)), None)
    if eye is not None and PUPIL_DATA not in own[: own.index(eye)]:
        return None, None, 0  # somebody else's page of the same number
    points = (GAZE_POINT, RIGHT_EYE_POSITION, LEFT_EYE_POSITION)
    return eye, next((usage for usage in own if usage in points), None), field.usage


def _position_scale(field: Field, note: Callable[[str], None]) -> Scale | None:
    scale = MICROMETRE if field.item.unit == 0 else length_mm(field)
    if scale is None:
        note(f"The tracker gives {field.usage:#010x} in no unit of length; it is left out.")
    return scale


def read_one(bound: Bound | None, bits: int) -> float | None:
    """A quantity; None where there is no such field, or where its number says nothing."""
    if bound is None:
        return None
    field, scale = bound
    value = field.value(bits)
    return None if value is None else scale(value)


def _share_of(bound: Bound | None, bits: int) -> float | None:
    value = read_one(bound, bits)
    return None if value is None else min(max(value, 0.0), 1.0)


def _read_all(bounds: tuple[Bound, ...] | None, bits: int) -> tuple[float, ...] | None:
    """All or nothing: a point that lacks a coordinate is none."""
    values = [] if bounds is None else [value for bound in bounds if (value := read_one(bound, bits)) is not None]
    return tuple(values) if bounds is not None and len(values) == len(bounds) else None
