"""What the simulated USB tracker is made of: its report descriptor, and samples as its reports.

The report of tracking data, all numbers little-endian:

    byte  0       report ID 0x10
    byte  1–8     device's time, µs
    byte  9–16    gaze point of both eyes, x y, µm
    byte 17–28    left eye x y z, µm
    byte 29–40    right eye
    byte 41–52    head
    byte 53–64    the head's rotation about x, y, z: always 0
    byte 65–66    confidence of the gaze point, 1e-4
    byte 67–88    right eye: diameter, µm (4 bytes); diameter in the image, 0.01 px; confidence, model confidence and
                  openness, 1e-4 (2 each); gaze point x y, µm (4 each); its confidence (2)
    byte 89–110   left eye, the same

Bytes 0–64 are GazeHid's report. What is not known is a number outside the descriptor's limits.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.hid import usages
from entoptic.tracker_bridge.sources.hid.gaze import INTERPUPILLARY_MM, USUAL_DISTANCE_MM
from entoptic.tracker_bridge.sources.hid.usages import MODE_EYES, MODE_GAZE, READY

TRACKING_ID, CAPABILITIES_ID, CONFIGURATION_ID, STATUS_ID, MODE_ID = 0x10, 0x11, 0x12, 0x13, 0x14
"""GazeHid's."""

SCREEN_UM = (531_000, 299_000)
"""A display of 24 inches, 16:9."""

DISTANCES_UM = (500_000, round(USUAL_DISTANCE_MM * 1000), 900_000)
"""Nearest, optimum and farthest eye. Engineering choice: the range of remote trackers for the desk."""

MIDDLE_UM = (SCREEN_UM[0] // 2, SCREEN_UM[1] // 2, DISTANCES_UM[1])
"""Between the eyes, which stay where they are: the recorded samples have directions but no positions."""

EYES_UM = {
    Eye.RIGHT: (MIDDLE_UM[0] + round(INTERPUPILLARY_MM * 500), *MIDDLE_UM[1:]),
    Eye.LEFT: (MIDDLE_UM[0] - round(INTERPUPILLARY_MM * 500), *MIDDLE_UM[1:]),
}

MAX_POSITION_UM = 2_000_000
"""GazeHid's limits: gaze more than 71° aside at 650 mm lies beyond."""

NO_LENGTH, NO_SHARE = -(2**31), 0xFFFF
"""Outside the limits."""

MAX_DIAMETER_UM = 2**31 - 1
"""Detectors report nonsense of metres for a lost pupil, and nonsense must come through."""

SHARE_COUNTS, IMAGE_COUNTS_PER_PX = 10_000, 100

_HEAD, _EYE = struct.Struct("<BQ2i3i3i3i3iH"), struct.Struct("<iHHHHiiH")

_INPUT, _FEATURE = 0x81, 0xB1
_DATA, _CONSTANT, _NULL = 0x02, 0x03, 0x42
"""Flags of fields: data; constant, as GazeHid flags positions; and data that may be null (HID 1.11, 6.2.2.5)."""
_PHYSICAL, _APPLICATION, _LOGICAL = 0, 1, 2
_END, _PUSH, _POP = b"\xc0", b"\xa4", b"\xb4"
_CM, _PER_S, _S = 0x11, 0xF001, 0x1001
"""Units (HID 1.11, 6.2.2.7)."""


def _item(prefix: int, value: int) -> bytes:
    """A short item in as few bytes as hold the value with its sign."""
    for code, size in ((1, 1), (2, 2), (3, 4)):
        if -(1 << 8 * size - 1) <= value < 1 << 8 * size - 1:
            return bytes([prefix & ~3 | code]) + value.to_bytes(size, "little", signed=True)
    return bytes([prefix | 3]) + value.to_bytes(4, "little")


def _usage(usage: int) -> bytes:
    """A usage with its page."""
    return b"\x0b" + usage.to_bytes(4, "little")


def _collection(usage: int, kind: int, *parts: bytes) -> bytes:
    return b"".join((_usage(usage), _item(0xA1, kind), *parts, _END))


def _limits(lower: int, upper: int, size_bits: int, unit: int = 0, exponent: int = 0) -> bytes:
    return b"".join(
        (
            _item(0x15, lower),
            _item(0x25, upper),
            _item(0x75, size_bits),
            _item(0x65, unit),
            _item(0x55, exponent & 0xF),
        )
    )


def _fields(main: int, flags: int, *own: int) -> bytes:
    return b"".join((_item(0x95, len(own)), *(_usage(usage) for usage in own), _item(main, flags)))


def _point(usage: int, flags: int, *axes: int) -> bytes:
    return _collection(usage, _PHYSICAL, _fields(_INPUT, flags, *axes))


def _report(usage: int, report_id: int, *parts: bytes) -> bytes:
    return _collection(usage, _LOGICAL, _item(0x85, report_id), *parts)


def _vendor_part() -> bytes:
    share = _limits(0, SHARE_COUNTS, 16, exponent=-4)
    position = _limits(-MAX_POSITION_UM, MAX_POSITION_UM, 32, _CM, -4)
    eyes = [
        _collection(
            own,
            _LOGICAL,
            _limits(-MAX_DIAMETER_UM, MAX_DIAMETER_UM, 32, _CM, -4),
            _fields(_INPUT, _NULL, usages.DIAMETER),
            _limits(0, 0xFFFE, 16, exponent=-2),
            _fields(_INPUT, _NULL, usages.IMAGE_DIAMETER),
            share,
            _fields(_INPUT, _NULL, usages.CONFIDENCE, usages.MODEL_CONFIDENCE, usages.OPENNESS),
            position,
            _point(usages.GAZE_POINT, _NULL, usages.POSITION_X, usages.POSITION_Y),
            share,
            _fields(_INPUT, _NULL, usages.GAZE_CONFIDENCE),
        )
        for own in (usages.RIGHT_EYE, usages.LEFT_EYE)
    ]
    both = _collection(usages.BOTH_EYES, _LOGICAL, share, _fields(_INPUT, _NULL, usages.GAZE_CONFIDENCE))
    return _PUSH + _collection(usages.PUPIL_DATA, _LOGICAL, both, *eyes) + _POP


def _descriptor() -> bytes:
    page = usages.PAGE
    axes = (usages.POSITION_X, usages.POSITION_Y, usages.POSITION_Z)
    position = _limits(-MAX_POSITION_UM, MAX_POSITION_UM, 32, _CM, -4)
    length = _limits(0, 2**31 - 1, 32, _CM, -4)
    word, double = _limits(0, 0xFFFF, 16), _limits(0, 2**31 - 1, 32)
    status = [
        part
        for main in (_FEATURE, _INPUT)
        for part in (
            _limits(0, 4, 8),
            _fields(main, _DATA, usages.CONFIGURATION_STATUS),
            _limits(0, 0xFFFF, 16, _PER_S),
            _fields(main, _DATA, usages.SAMPLING_FREQUENCY),
        )
    ]
    return _item(0x05, page >> 16) + _collection(
        usages.EYE_TRACKER,
        _APPLICATION,
        _report(
            page | 0x10,
            TRACKING_ID,
            _limits(0, 0xFF, 8, _S, -6),
            _usage(usages.TIMESTAMP) + _item(0x95, 8) + _item(_INPUT, _DATA),
            position,
            _point(usages.GAZE_POINT, _CONSTANT, *axes[:2]),
            _point(usages.LEFT_EYE_POSITION, _CONSTANT, *axes),
            _point(usages.RIGHT_EYE_POSITION, _CONSTANT, *axes),
            _point(page | 0x27, _CONSTANT, *axes),
            _point(page | 0x28, _CONSTANT, page | 0x29, page | 0x2A, page | 0x2B),
            _vendor_part(),
        ),
        _report(
            page | 0x11,
            CAPABILITIES_ID,
            _limits(0, 1, 8),
            _fields(_FEATURE, _CONSTANT, page | 0x100),
            position,
            _fields(_FEATURE, _CONSTANT, *(page | usage for usage in range(0x101, 0x106))),
        ),
        _report(
            page | 0x12,
            CONFIGURATION_ID,
            word,
            _fields(_FEATURE, _CONSTANT, page | 0x200, page | 0x201),
            double,
            _fields(_FEATURE, _CONSTANT, page | 0x202),
            word,
            _fields(_FEATURE, _CONSTANT, page | 0x203),
            length,
            _fields(_FEATURE, _CONSTANT, usages.SCREEN_WIDTH, usages.SCREEN_HEIGHT),
        ),
        _report(page | 0x13, STATUS_ID, *status),
        _report(page | 0x14, MODE_ID, _limits(0, 7, 8), _fields(_FEATURE, _DATA, usages.MODE_REQUEST)),
    )


DESCRIPTOR = _descriptor()
"""GazeHid's reports, the first of them longer by the vendor page."""


def feature_report(report_id: int, mode: int) -> bytes | None:
    """What the tracker answers when it is asked for a feature; None where it has none of this ID."""
    reports = {
        CAPABILITIES_ID: struct.pack("<BB5i", CAPABILITIES_ID, 1, *DISTANCES_UM, *SCREEN_UM),
        CONFIGURATION_ID: struct.pack("<BHHIHII", CONFIGURATION_ID, 0, 0, 0, 0, *SCREEN_UM),
        STATUS_ID: status_report(),
        MODE_ID: bytes([MODE_ID, mode]),
    }
    return reports.get(report_id)


def status_report() -> bytes:
    """Ready, at a rate that is not told: that of what is played is not known before its end."""
    return struct.pack("<BBH", STATUS_ID, READY, 0)


def tracking_report(samples: Iterable[PupilSample | GazeSample], device_us: int, mode: int) -> bytes:
    """The samples of one moment as a report, at this time of the device's clock, as far as the mode asks for them."""
    pupils = {sample.eye: sample for sample in samples if isinstance(sample, PupilSample)}
    gazes = {sample.eye: sample for sample in samples if isinstance(sample, GazeSample) and mode & MODE_GAZE}
    eyes_um = [EYES_UM[eye] if mode & MODE_EYES else (0, 0, 0) for eye in (Eye.LEFT, Eye.RIGHT)]
    head_um = MIDDLE_UM if mode & MODE_EYES else (0, 0, 0)
    x_um, y_um, confidence = _gaze_point(gazes.get(None), MIDDLE_UM)
    head = _HEAD.pack(TRACKING_ID, device_us, x_um, y_um, *eyes_um[0], *eyes_um[1], *head_um, 0, 0, 0, confidence)
    return head + b"".join(_eye_part(pupils.get(eye), gazes.get(eye), eye) for eye in (Eye.RIGHT, Eye.LEFT))


def _eye_part(pupil: PupilSample | None, gaze: GazeSample | None, eye: Eye) -> bytes:
    own = (NO_LENGTH, NO_SHARE, NO_SHARE, NO_SHARE, NO_SHARE)
    if pupil is not None:
        own = (
            _limited_um(pupil.pupil_diameter_mm),
            _image_counts(pupil.diameter_px),
            _share(pupil.confidence),
            _share(pupil.model_confidence),
            _share(pupil.openness),
        )
    return _EYE.pack(*own, *_gaze_point(gaze, EYES_UM[eye]))


def _limited_um(pupil_diameter_mm: float | None) -> int:
    um = math.nan if pupil_diameter_mm is None else pupil_diameter_mm * 1000
    return round(um) if abs(um) <= MAX_DIAMETER_UM else NO_LENGTH


def _image_counts(diameter_px: float | None) -> int:
    return NO_SHARE if diameter_px is None else min(max(round(diameter_px * IMAGE_COUNTS_PER_PX), 0), NO_SHARE)


def _share(value: float | None) -> int:
    return NO_SHARE if value is None else round(value * SHARE_COUNTS)


def _gaze_point(gaze: GazeSample | None, from_um: tuple[int, ...]) -> tuple[int, int, int]:
    """Where this direction from this eye meets the display, and its confidence; nothing where it does not."""
    if gaze is not None and abs(gaze.azimuth_deg) < 90.0 and abs(gaze.elevation_deg) < 90.0:
        right_um = from_um[2] * math.tan(math.radians(gaze.azimuth_deg))
        up_um = math.hypot(right_um, from_um[2]) * math.tan(math.radians(gaze.elevation_deg))
        x_um, y_um = from_um[0] + right_um, from_um[1] - up_um
        if max(abs(x_um), abs(y_um)) <= MAX_POSITION_UM:
            return round(x_um), round(y_um), _share(gaze.confidence)
    return NO_LENGTH, NO_LENGTH, NO_SHARE
