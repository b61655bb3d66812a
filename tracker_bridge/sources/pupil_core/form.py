"""Samples as Pupil Core's datums, the other way round from datum.py: pure functions, no files, no sockets.

`data_of` makes what a recording needs of a sample, and nothing that the sample does not say. `image_pair` makes what
Pupil Capture publishes of an eye image, with every key that it publishes. For the frames of reference see
datum.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.loaded import Sample
from entoptic.tracker_bridge.sources.pupil_core.datum import SCENE_FOV_DEG, Vector
from entoptic.tracker_bridge.sources.simulated.tracker import PX_PER_MM

Map = dict[str, Any]

_GAZE_POINT_MM: Final = 1000.0
"""Distance of `gaze_point_3d`: samples hold a direction only. Engineering choice."""

_SPHERE_MM: Final = (0.0, 0.0, 41.88)
_SPHERE_RADIUS_MM: Final = 10.392304845413264
"""The eye in its camera's frame, and the radius on which its pupil turns, as pye3d 0.3.2 reports them."""

_IMAGE_PX: Final = 192
_EYE_X_MM: Final = {Eye.RIGHT: 31.5, Eye.LEFT: -31.5}
"""The eyes' centres in the scene camera's frame: half of the mean distance of 63 mm between adults' pupils. Written
with the eyes' sides as Pupil Core calibrates them for its own headset."""

_NO_ELLIPSE: Final[Map] = {"center": [0.0, 0.0], "axes": [0.0, 0.0]}
_NO_PLACE: Final = [0.0, 1.0]
"""Of a lost pupil, as Capture 3.6.14 publishes it: the image's upper left corner, from below."""

_KEYS_2D: Final = ("id", "topic", "method", "norm_pos", "diameter", "confidence", "timestamp", "ellipse")
_KEYS_3D: Final = (
    *_KEYS_2D[:-1],
    "sphere",
    "projected_sphere",
    "circle_3d",
    "diameter_3d",
    "ellipse",
    "location",
    "model_confidence",
    "theta",
    "phi",
)
"""The keys that Capture 3.6.14 publishes, no more and no fewer."""


def is_writable(sample: Sample) -> bool:
    """Whether a datum can say it: a scene camera sees less than 90° to each side."""
    return isinstance(sample, PupilSample) or max(abs(sample.azimuth_deg), abs(sample.elevation_deg)) < 90.0


def data_of(samples: Iterable[Sample]) -> tuple[list[Map], list[Map]]:
    """The pupil datums and the gaze datums of all (writable) samples of one time, each kind and eye at most once.

    Pupils with mm become 3-D datums, those without 2-D ones; a 3-D datum holds the eye in space where the eye's own
    direction is known. The direction of both eyes becomes a `gaze.3d.01.` datum, which takes in the two eyes' own;
    one eye's direction alone becomes a datum of that eye.
    """
    of_one_time = list(samples)
    gazes = {sample.eye: sample for sample in of_one_time if isinstance(sample, GazeSample)}
    pupils = {s.eye: pupil_datum(s, gazes.get(s.eye)) for s in of_one_time if isinstance(s, PupilSample)}
    own = {eye: gazes[eye] for eye in Eye if eye in gazes}
    directions = []
    if None in gazes:
        # One eye's own direction would make the datum one of that eye.
        taken_in = own if len(own) == len(Eye) else {}
        directions.append(_both_eyes(gazes[None], taken_in, pupils))
        own = {} if taken_in else own
    directions += [one_eye(eye, gaze, _base(gaze, eye, pupils)) for eye, gaze in own.items()]
    return list(pupils.values()), directions


def pupil_datum(sample: PupilSample, gaze: GazeSample | None) -> Map:
    """A pupil datum; `gaze`, where known, is where the eye looks at that time."""
    dimensions = "2d" if sample.pupil_diameter_mm is None else "3d"
    datum: Map = {
        "id": int(sample.eye),
        "topic": f"pupil.{int(sample.eye)}.{dimensions}",
        "method": f"entoptic {dimensions}",
        "timestamp": sample.t_ns / NS_PER_S,
        "confidence": sample.confidence,
        "norm_pos": [0.5, 0.5],
    }
    px = sample.diameter_px
    if sample.pupil_diameter_mm is not None:
        datum["diameter_3d"] = sample.pupil_diameter_mm
        px = max(sample.pupil_diameter_mm, 0.0) * PX_PER_MM if px is None else px
    if px is not None:
        datum["diameter"] = px
    if sample.model_confidence is not None:
        datum["model_confidence"] = sample.model_confidence
    if sample.openness is not None:
        datum["openness"] = sample.openness
    if gaze is not None and sample.pupil_diameter_mm is not None and px is not None:
        datum |= _eye_model(gaze, sample.eye, sample.pupil_diameter_mm, px)
    return datum


def image_pair(sample: PupilSample, gaze: GazeSample | None) -> tuple[Map, Map | None]:
    """The 2-D and the 3-D datum of one eye image, with exactly the keys that Capture 3.6.14 publishes.

    The 3-D one is None where the sample has no millimetres. An eye whose direction is not known looks straight ahead.
    """
    ahead = GazeSample(sample.t_ns, sample.eye, 0.0, 0.0, sample.confidence)
    solid = pupil_datum(sample, gaze if gaze is not None and is_writable(gaze) else ahead)
    px = solid.setdefault("diameter", 0.0)
    solid.setdefault("model_confidence", 1.0)
    solid.setdefault("ellipse", {"center": [_IMAGE_PX / 2] * 2, "axes": [px, px], "angle": 0.0})
    flat: Map = {key: solid[key] for key in _KEYS_2D} | {"topic": f"pupil.{int(sample.eye)}.2d"}
    if px <= 0.0:
        solid |= {"norm_pos": [*_NO_PLACE], "ellipse": _NO_ELLIPSE | {"angle": 0.0}, "location": [0.0, 0.0]}
        flat |= {"norm_pos": [*_NO_PLACE], "ellipse": _NO_ELLIPSE | {"angle": -90.0}}
    if sample.pupil_diameter_mm is None:
        return flat, None
    return flat, {key: solid[key] for key in _KEYS_3D}


def _eye_model(gaze: GazeSample, eye: Eye, pupil_diameter_mm: float, px: float) -> Map:
    """The 3-D part of a datum, in the eye camera's frame (see datum.py for its axes)."""
    right, up, forward = _vector(gaze)
    x, y, z = normal = (right, up, -forward) if eye is Eye.RIGHT else (-right, -up, -forward)
    centre = [at + _SPHERE_RADIUS_MM * along for at, along in zip(_SPHERE_MM, normal, strict=True)]
    focal_px = PX_PER_MM * (_SPHERE_MM[2] - _SPHERE_RADIUS_MM)
    middle_px = [_IMAGE_PX / 2 + focal_px * along / centre[2] for along in centre[:2]]
    sphere_px = 2 * _SPHERE_RADIUS_MM * focal_px / _SPHERE_MM[2]
    return {
        "circle_3d": {"center": centre, "normal": list(normal), "radius": pupil_diameter_mm / 2},
        "sphere": {"center": list(_SPHERE_MM), "radius": _SPHERE_RADIUS_MM},
        "projected_sphere": {"center": [_IMAGE_PX / 2] * 2, "axes": [sphere_px] * 2, "angle": 0.0},
        "ellipse": {"center": middle_px, "axes": [px * abs(z), px], "angle": math.degrees(math.atan2(y, x))},
        "location": middle_px,
        "norm_pos": [middle_px[0] / _IMAGE_PX, 1.0 - middle_px[1] / _IMAGE_PX],
        "theta": math.acos(y),
        "phi": math.atan2(z, x),
    }


def both_eyes(common: GazeSample, own: dict[Eye, GazeSample], base: list[Map]) -> Map:
    """A `gaze.3d.01.` datum; `own` holds both eyes' own directions or none, `base` the pupil datums behind them."""
    datum = _direction(common, "gaze.3d.01.") | {"base_data": base}
    if own:
        datum["eye_centers_3d"] = {str(int(eye)): [x_mm, 0.0, 0.0] for eye, x_mm in _EYE_X_MM.items()}
        datum["gaze_normals_3d"] = {str(int(eye)): list(_in_scene(each)) for eye, each in own.items()}
    return datum


def one_eye(eye: Eye, gaze: GazeSample, base: Map) -> Map:
    """A datum of one eye's direction; `base` is the pupil datum behind it."""
    return _direction(gaze, f"gaze.3d.{int(eye)}.") | {
        "base_data": [base],
        "eye_center_3d": [_EYE_X_MM[eye], 0.0, 0.0],
        "gaze_normal_3d": list(_in_scene(gaze)),
    }


def _both_eyes(common: GazeSample, own: dict[Eye, GazeSample], pupils: dict[Eye, Map]) -> Map:
    return both_eyes(common, own, [_base(gaze, eye, pupils) for eye, gaze in own.items()])


def _base(gaze: GazeSample, eye: Eye, pupils: dict[Eye, Map]) -> Map:
    """The pupil datum behind one eye's direction; a reader takes the direction's confidence from it."""
    unseen = {"id": int(eye), "topic": f"pupil.{int(eye)}.2d", "timestamp": gaze.t_ns / NS_PER_S}
    return pupils.get(eye, unseen) | {"confidence": gaze.confidence}


def _direction(gaze: GazeSample, topic: str) -> Map:
    """What every gaze datum has. Its place in the image is that under the field of view that a reader would assume."""
    angles = (gaze.azimuth_deg, gaze.elevation_deg)
    return {
        "topic": topic,
        "timestamp": gaze.t_ns / NS_PER_S,
        "confidence": gaze.confidence,
        "norm_pos": [0.5 + angle / fov for angle, fov in zip(angles, SCENE_FOV_DEG, strict=True)],
        "gaze_point_3d": [_GAZE_POINT_MM * along for along in _in_scene(gaze)],
    }


def _vector(gaze: GazeSample) -> Vector:
    """The unit vector (right, up, forward) of a direction."""
    azimuth, elevation = math.radians(gaze.azimuth_deg), math.radians(gaze.elevation_deg)
    level = math.cos(elevation)
    return level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)


def _in_scene(gaze: GazeSample) -> Vector:
    right, up, forward = _vector(gaze)
    return right, -up, forward
