"""Writes samples as a recording folder of Pupil Core, which recording.py reads back.

What comes back is the same but for this:
- Times are seconds in 64-bit floats: exact to the nanosecond up to 11 days of clock, to 1 µs for 100 years and more.
- Directions come back within 1e-9°; they must lie less than 90° from straight ahead, as a scene camera's do.
- A sample without px gets px of its mm, at the scale of a simulated camera.
- Pupil Core knows no openness; it is written under a key of its own, which other programs skip.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
import tempfile
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np

from tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample, Source, SourceError
from tracker_bridge.sources.loaded import Sample, sort_key
from tracker_bridge.sources.pupil_datum import SCENE_FOV_DEG, Vector
from tracker_bridge.sources.simulated_tracker import PX_PER_MM

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


def write_recording(source: Source, folder: Path) -> None:
    """Writes all samples of a source, which must end, as a new recording folder of Pupil Core.

    In it are pupil.pldata, gaze.pldata, the timestamps of both and info.player.json.
    The folder appears whole or not at all. Pupils with mm become 3-D datums, those without 2-D ones. A direction of
    both eyes becomes a `gaze.3d.01.` datum, which takes in the two eyes' own directions of the same time; one eye's
    direction alone becomes a datum of that eye.

    Raises SourceError where the folder exists, there are no samples, or a direction lies 90° or more to a side.
    """
    ordered = sorted(source.samples(), key=sort_key)
    if not ordered:
        raise SourceError(f"{folder}: there are no samples to write")
    if folder.exists():
        raise SourceError(f"{folder} exists already: choose another name, or remove it first")
    gazes = {sort_key(sample): sample for sample in ordered if isinstance(sample, GazeSample)}
    pupils = [_pupil(sample, gazes) for sample in ordered if isinstance(sample, PupilSample)]
    directions = _gaze_data(gazes, {(pupil["timestamp"], pupil["id"]): pupil for pupil in pupils})
    info = _info(folder.name, ordered)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
            whole = Path(scratch) / folder.name
            whole.mkdir()
            _write_stream(whole, "pupil", pupils)
            _write_stream(whole, "gaze", directions)
            (whole / "info.player.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
            whole.rename(folder)
    except OSError as error:
        raise SourceError(f"{folder} cannot be written: {error.strerror}. Choose another place") from None


def _write_stream(folder: Path, name: str, data: Sequence[Map]) -> None:
    if not data:
        return
    with (folder / f"{name}.pldata").open("wb") as stream:
        for datum in data:
            stream.write(msgpack.packb([datum["topic"], msgpack.packb(datum)]))
    np.save(folder / f"{name}_timestamps.npy", np.array([datum["timestamp"] for datum in data]))


def _pupil(sample: PupilSample, gazes: dict[tuple[int, bool, int], GazeSample]) -> Map:
    """A pupil datum; its eye in space stands as the eye looks at that time, and is left out where that is not known."""
    dimensions = "2d" if sample.diameter_mm is None else "3d"
    datum: Map = {
        "id": int(sample.eye),
        "topic": f"pupil.{int(sample.eye)}.{dimensions}",
        "method": f"entoptic {dimensions}",
        "timestamp": sample.t_ns / NS_PER_S,
        "confidence": sample.confidence,
        "norm_pos": [0.5, 0.5],
    }
    px = sample.diameter_px
    if sample.diameter_mm is not None:
        datum["diameter_3d"] = sample.diameter_mm
        px = max(sample.diameter_mm, 0.0) * PX_PER_MM if px is None else px
    if px is not None:
        datum["diameter"] = px
    if sample.model_confidence is not None:
        datum["model_confidence"] = sample.model_confidence
    if sample.openness is not None:
        datum["openness"] = sample.openness
    gaze = gazes.get((sample.t_ns, True, int(sample.eye)))
    if gaze is not None and sample.diameter_mm is not None and px is not None:
        datum |= _eye_model(gaze, sample.eye, sample.diameter_mm, px)
    return datum


def _eye_model(gaze: GazeSample, eye: Eye, diameter_mm: float, px: float) -> Map:
    """The 3-D part of a datum, in the eye camera's frame (see pupil_datum.py for its axes)."""
    right, up, forward = _vector(gaze)
    x, y, z = normal = (right, up, -forward) if eye is Eye.RIGHT else (-right, -up, -forward)
    centre = [at + _SPHERE_RADIUS_MM * along for at, along in zip(_SPHERE_MM, normal, strict=True)]
    focal_px = PX_PER_MM * (_SPHERE_MM[2] - _SPHERE_RADIUS_MM)
    middle_px = [_IMAGE_PX / 2 + focal_px * along / centre[2] for along in centre[:2]]
    sphere_px = 2 * _SPHERE_RADIUS_MM * focal_px / _SPHERE_MM[2]
    return {
        "circle_3d": {"center": centre, "normal": list(normal), "radius": diameter_mm / 2},
        "sphere": {"center": list(_SPHERE_MM), "radius": _SPHERE_RADIUS_MM},
        "projected_sphere": {"center": [_IMAGE_PX / 2] * 2, "axes": [sphere_px] * 2, "angle": 0.0},
        "ellipse": {"center": middle_px, "axes": [px * abs(z), px], "angle": math.degrees(math.atan2(y, x))},
        "location": middle_px,
        "norm_pos": [middle_px[0] / _IMAGE_PX, 1.0 - middle_px[1] / _IMAGE_PX],
        "theta": math.acos(y),
        "phi": math.atan2(z, x),
    }


def _gaze_data(gazes: dict[tuple[int, bool, int], GazeSample], pupils: dict[tuple[float, int], Map]) -> list[Map]:
    """The gaze datums, in order of time."""
    data = []
    alone = {(sample.t_ns, sample.eye): sample for sample in gazes.values() if sample.eye is not None}
    for sample in gazes.values():
        if sample.eye is None:
            own = {eye: alone[sample.t_ns, eye] for eye in Eye if (sample.t_ns, eye) in alone}
            # One eye alone would make the datum one of that eye.
            own = own if len(own) == len(Eye) else {}
            for eye in own:
                del alone[sample.t_ns, eye]
            data.append(_both_eyes(sample, own, pupils))
    data += [_one_eye(eye, sample, pupils) for (_, eye), sample in alone.items()]
    return sorted(data, key=lambda datum: float(datum["timestamp"]))


def _both_eyes(sample: GazeSample, own: dict[Eye, GazeSample], pupils: dict[tuple[float, int], Map]) -> Map:
    datum = _direction(sample, "gaze.3d.01.") | {"base_data": [_base(eye, each, pupils) for eye, each in own.items()]}
    if own:
        datum["eye_centers_3d"] = {str(int(eye)): [x_mm, 0.0, 0.0] for eye, x_mm in _EYE_X_MM.items()}
        datum["gaze_normals_3d"] = {str(int(eye)): list(_in_scene(each)) for eye, each in own.items()}
    return datum


def _one_eye(eye: Eye, sample: GazeSample, pupils: dict[tuple[float, int], Map]) -> Map:
    return _direction(sample, f"gaze.3d.{int(eye)}.") | {
        "base_data": [_base(eye, sample, pupils)],
        "eye_center_3d": [_EYE_X_MM[eye], 0.0, 0.0],
        "gaze_normal_3d": list(_in_scene(sample)),
    }


def _base(eye: Eye, sample: GazeSample, pupils: dict[tuple[float, int], Map]) -> Map:
    """The pupil datum behind one eye's direction; a reader takes the direction's confidence from it."""
    time_s = sample.t_ns / NS_PER_S
    unseen = {"id": int(eye), "topic": f"pupil.{int(eye)}.2d", "timestamp": time_s}
    return pupils.get((time_s, eye), unseen) | {"confidence": sample.confidence}


def _direction(sample: GazeSample, topic: str) -> Map:
    """What every gaze datum has. Its place in the image is that under the field of view that a reader would assume."""
    angles = (sample.azimuth_deg, sample.elevation_deg)
    if max(map(abs, angles)) >= 90.0:
        raise SourceError(f"a direction of {angles}° cannot be written: a scene camera sees less than 90° to each side")
    return {
        "topic": topic,
        "timestamp": sample.t_ns / NS_PER_S,
        "confidence": sample.confidence,
        "norm_pos": [0.5 + angle / fov for angle, fov in zip(angles, SCENE_FOV_DEG, strict=True)],
        "gaze_point_3d": [_GAZE_POINT_MM * along for along in _in_scene(sample)],
    }


def _vector(sample: GazeSample) -> Vector:
    """The unit vector (right, up, forward) of a direction."""
    azimuth, elevation = math.radians(sample.azimuth_deg), math.radians(sample.elevation_deg)
    level = math.cos(elevation)
    return level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)


def _in_scene(sample: GazeSample) -> Vector:
    right, up, forward = _vector(sample)
    return right, -up, forward


def _info(name: str, ordered: Sequence[Sample]) -> Map:
    """The contents of info.player.json. Nobody knows what time it was: both clocks start together."""
    start_s, end_s = ordered[0].t_ns / NS_PER_S, ordered[-1].t_ns / NS_PER_S
    return {
        "duration_s": end_s - start_s,
        "meta_version": "2.3",
        "min_player_version": "2.0",
        "recording_name": name,
        "recording_software_name": "Entoptic",
        "recording_software_version": importlib.metadata.version("entoptic"),
        "recording_uuid": str(uuid.uuid5(uuid.NAMESPACE_OID, f"{name} {start_s} {end_s} {len(ordered)}")),
        "start_time_synced_s": start_s,
        "start_time_system_s": start_s,
        "system_info": "",
    }
