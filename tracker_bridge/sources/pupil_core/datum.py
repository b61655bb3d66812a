"""One pupil or gaze datum of Pupil Core, from its msgpack bytes to samples: pure functions, no files, no sockets.

The same bytes lie in a recording and pass over the Network API, so both read them here. Fields that are not named in
`PupilDatum` and `GazeDatum` are skipped. Formats: Pupil Core's documentation, "Data Format" and "Network API".

Frames of reference. The scene camera has x to the wearer's right, y DOWN and z forward. An eye camera looks AT the
eye, so its x points to the wearer's left, its y down and its z into the eye; the camera of the RIGHT eye is mounted
upside down, which turns its x to the wearer's right and its y up. In a real recording that holds both a pupil's
normal in its eye camera and the same eye's normal in the scene camera, the least-squares map between them has exactly
these signs on its diagonal: (0.99, −0.93, −0.94) for the right eye and (−0.99, 0.88, −0.88) for the left.

The angles `theta` and `phi` say the same as `circle_3d.normal`, but "3d c++" means y = −cos θ and pye3d y = cos θ;
only the normal is read.
"""

from __future__ import annotations

import math
from typing import Any, Final, TypeVar

import msgspec

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample, direction_deg
from entoptic.tracker_bridge.source import SourceError

Vector = tuple[float, float, float]

SCENE_FOV_DEG: Final = (90.0, 52.0)
"""Field of view of the scene camera (horizontal, vertical), assumed where gaze comes as image positions only.

Measured: slope of direction against image position in an export of a real recording made with the default wide-angle
lens, 90.07° and 52.10° per image. Taken as linear, since that lens is nearer to equidistant than to a pinhole.
"""

_BASE_DATUM: Final = 13
"""The msgpack extension type in which Pupil wraps a whole datum inside `base_data`."""

TIME_LIMIT_S: Final = 9.2e9
"""Beyond it nanoseconds no longer fit into 64 bits: no time of any clock."""


class Circle3d(msgspec.Struct, frozen=True):
    """The pupil as a disc in space."""

    normal: Vector | None = None
    """Unit vector out of the eye, in its eye camera's frame; (0, 0, 0) where no pupil was found."""


class PupilDatum(msgspec.Struct, frozen=True):
    """What is read of one pupil datum; the field names are Pupil's own."""

    id: Eye
    timestamp: float
    """Seconds of Pupil's clock."""
    confidence: float
    diameter: float | None = None
    """Image px."""
    diameter_3d: float | None = None
    """mm; only 3-D detectors give it."""
    model_confidence: float | None = None
    circle_3d: Circle3d | None = None
    openness: float | None = None
    """0 … 1. Pupil itself never writes it, this program's own recordings of simulated eyes do."""


class GazeDatum(msgspec.Struct, frozen=True):
    """What is read of one gaze datum; the field names are Pupil's own."""

    timestamp: float
    """Seconds of Pupil's clock; for both eyes together the mean of the two pupils' times."""
    confidence: float
    topic: str = ""
    norm_pos: tuple[float, float] | None = None
    """Position in the scene image: (0, 0) lower left, (1, 1) upper right."""
    gaze_point_3d: Vector | None = None
    """mm in the scene camera's frame."""
    gaze_normal_3d: Vector | None = None
    """One eye's direction in the scene camera's frame; only in a datum of one eye."""
    gaze_normals_3d: dict[int | str, Vector] | None = None
    """Both eyes' directions, by eye: keys are 0 and 1 in old recordings, "0" and "1" in new ones."""
    base_data: list[Any] | None = None
    """The pupil datums it was made of, still packed (bytes) or as maps; `base_pupils` reads them."""


def _keep_packed(code: int, data: memoryview) -> bytes | None:
    return bytes(data) if code == _BASE_DATUM else None


_pupil_decoder = msgspec.msgpack.Decoder(PupilDatum)
_gaze_decoder = msgspec.msgpack.Decoder(GazeDatum, ext_hook=_keep_packed)

Datum = TypeVar("Datum", PupilDatum, GazeDatum)


def decode_pupil(payload: bytes) -> PupilDatum:
    """The pupil datum in one msgpack map. Raises SourceError that says which field is wrong."""
    return _decoded(_pupil_decoder, payload, "pupil")


def decode_gaze(payload: bytes) -> GazeDatum:
    """The gaze datum in one msgpack map. Raises SourceError that says which field is wrong."""
    return _decoded(_gaze_decoder, payload, "gaze")


def _decoded(decoder: msgspec.msgpack.Decoder[Datum], payload: bytes, kind: str) -> Datum:
    try:
        datum = decoder.decode(payload)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise SourceError(f"not a {kind} datum of Pupil Core: {error}") from None
    return _timed(datum, kind)


def _timed(datum: Datum, kind: str) -> Datum:
    if not abs(datum.timestamp) < TIME_LIMIT_S:
        raise SourceError(f"not a {kind} datum of Pupil Core: {datum.timestamp} is no time - at `$.timestamp`")
    return datum


def base_pupils(datum: GazeDatum) -> tuple[PupilDatum, ...]:
    """The pupil datums that a gaze datum was made of. Raises SourceError where one cannot be read."""
    return tuple(_base_pupil(base) for base in datum.base_data or ())


def _base_pupil(base: object) -> PupilDatum:
    if isinstance(base, bytes):
        return decode_pupil(base)
    try:
        return _timed(msgspec.convert(base, PupilDatum), "pupil")
    except msgspec.ValidationError as error:
        raise SourceError(f"not a gaze datum of Pupil Core: {error} - in `$.base_data[…]`") from None


def nanoseconds(timestamp_s: float) -> int:
    """Pupil's clock in whole nanoseconds."""
    return round(timestamp_s * NS_PER_S)


def pupil_sample(datum: PupilDatum) -> PupilSample:
    """One measurement of one pupil.

    Confidences are cut to 0 … 1 (real files hold 1.0000000000000004) and are 0 where they are not a number; a
    diameter that is not finite is None. Anything else that a detector reports is passed on, nonsense included.
    """
    return PupilSample(
        t_ns=nanoseconds(datum.timestamp),
        eye=datum.id,
        pupil_diameter_mm=_finite(datum.diameter_3d),
        confidence=_unit(datum.confidence),
        model_confidence=None if datum.model_confidence is None else _unit(datum.model_confidence),
        diameter_px=_finite(datum.diameter),
        openness=None if datum.openness is None else _unit(datum.openness),
    )


def gaze_samples(datum: GazeDatum, base: tuple[PupilDatum, ...]) -> tuple[GazeSample, ...]:
    """The directions in one gaze datum, `base` being the pupil datums it was made of.

    A datum of both eyes gives their common direction (eye None), then each eye's own at the time of its own image.
    A datum of one eye gives that eye's. Empty where the datum holds no direction at all.

    The common direction is that of `gaze_point_3d`; where the eyes' lines meet behind the head, the mean of the two
    normals; in a datum without 3-D, the image position under SCENE_FOV_DEG.
    """
    eye = _only_eye(datum, base)
    confidence = _unit(datum.confidence)
    t_ns = nanoseconds(datum.timestamp)
    normals = {Eye(int(key)): v for key, v in (datum.gaze_normals_3d or {}).items() if str(key) in ("0", "1")}
    if eye is None:
        vectors = [datum.gaze_point_3d, _mean(list(normals.values()))]
    else:
        vectors = [datum.gaze_normal_3d, normals.pop(eye, None), datum.gaze_point_3d]
    angles = next((scene_direction_deg(v) for v in vectors if v is not None and _is_ahead(v)), None)
    if datum.norm_pos is not None and needs_scene_fov(datum) and all(map(math.isfinite, datum.norm_pos)):
        angles = _image_direction_deg(datum.norm_pos)
    samples = [] if angles is None else [GazeSample(t_ns, eye, *angles, confidence)]
    images = {pupil.id: (nanoseconds(pupil.timestamp), _unit(pupil.confidence)) for pupil in base}
    for own, normal in sorted(normals.items()):
        if _is_ahead(normal):
            own_t_ns, own_confidence = images.get(own, (t_ns, confidence))
            samples.append(GazeSample(own_t_ns, own, *scene_direction_deg(normal), own_confidence))
    return tuple(samples)


def needs_scene_fov(datum: GazeDatum) -> bool:
    """Whether the datum has no direction in space, so that only the assumed field of view can give one."""
    return not (datum.gaze_point_3d or datum.gaze_normal_3d or datum.gaze_normals_3d)


def eye_axis(datum: PupilDatum) -> Vector | None:
    """Where the eye points, a unit vector (right, up, forward) of its wearer's, but for its camera's unknown attitude.

    None where the datum has no 3-D pupil. For the signs see the head of this file.
    """
    normal = None if datum.circle_3d is None else datum.circle_3d.normal
    if normal is None:
        return None
    length = math.hypot(*normal)
    if not math.isfinite(length) or length == 0.0:
        return None
    x, y, z = (component / length for component in normal)
    return (x, y, -z) if datum.id is Eye.RIGHT else (-x, -y, -z)


def scene_direction_deg(vector: Vector) -> tuple[float, float]:
    """Azimuth and elevation of a vector in the scene camera's frame, of any length but zero."""
    x, y, z = vector
    return direction_deg(x, -y, z)


def _image_direction_deg(norm_pos: tuple[float, float]) -> tuple[float, float]:
    azimuth, elevation = ((at - 0.5) * fov for at, fov in zip(norm_pos, SCENE_FOV_DEG, strict=True))
    # Gaze may fall outside the image, far outside when the mapping extrapolates.
    return min(max(azimuth, -180.0), 180.0), min(max(elevation, -90.0), 90.0)


def _only_eye(datum: GazeDatum, base: tuple[PupilDatum, ...]) -> Eye | None:
    eyes = {pupil.id for pupil in base}
    if not eyes:
        # `gaze.3d.0.` and `gaze.2d.1.` name their eye in the third place, `gaze.3d.01.` names both.
        eyes = {Eye(int(digit)) for digit in "".join(datum.topic.split(".")[2:3]) if digit in "01"}
    return next(iter(eyes)) if len(eyes) == 1 else None


def _mean(vectors: list[Vector]) -> Vector | None:
    if not vectors:
        return None
    x, y, z = (sum(axis) / len(vectors) for axis in zip(*vectors, strict=True))
    return x, y, z


def _is_ahead(vector: Vector) -> bool:
    return all(map(math.isfinite, vector)) and vector[2] > 0.0


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _unit(value: float) -> float:
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0
