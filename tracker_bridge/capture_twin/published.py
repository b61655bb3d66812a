"""Recorded datums and samples as Capture 3.6.14 publishes them: its topics, its keys, its types, for every source.

What a source does not say is filled in as a simulated camera would have it: an eye whose direction is unknown looks
straight ahead, a model of unknown confidence is a good one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

import msgpack  # type: ignore[import-untyped]  # ships no types

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.loaded import Sample
from entoptic.tracker_bridge.sources.pupil_core.datum import decode_pupil, pupil_sample
from entoptic.tracker_bridge.sources.pupil_core.form import Map, both_eyes, image_pair, is_writable, one_eye

_METHODS: Final = {"2d": "2d c++", "3d": "pye3d 0.3.2 real-time"}
_SURE: Final = 0.6
"""Capture joins two eyes into one gaze datum when both pupils are at least this confident, else each stands alone. In
a recording of it the least confidence in 2838 joint datums is 0.99, in 152 single ones mostly below 0.6."""

_GAZE_KEYS: Final = (
    "eye_centers_3d",
    "eye_center_3d",
    "gaze_normals_3d",
    "gaze_normal_3d",
    "gaze_point_3d",
    "norm_pos",
    "topic",
    "confidence",
    "timestamp",
    "base_data",
)


class Publisher:
    """Makes the messages of a source's samples; it remembers each eye's newest direction and pupil."""

    def __init__(self) -> None:
        self._gazes: dict[Eye, GazeSample] = {}
        self._pupils: dict[Eye, Map] = {}

    def of_one_time(self, samples: Iterable[Sample]) -> list[Map]:
        """The messages of all samples of one time, pupils first."""
        of_it = [sample for sample in samples if is_writable(sample)]
        gazes = {sample.eye: sample for sample in of_it if isinstance(sample, GazeSample)}
        common = gazes.get(None)
        self._gazes |= {eye: gaze for eye in Eye if (gaze := gazes.get(eye, common)) is not None}
        messages = []
        for sample in of_it:
            if isinstance(sample, PupilSample):
                flat, solid = image_pair(sample, self._gazes.get(sample.eye))
                pair = [_named(datum) for datum in (flat, solid) if datum is not None]
                self._pupils[sample.eye] = pair[-1]
                messages += pair
        return [*messages, *self._gaze(gazes)]

    def _gaze(self, gazes: dict[Eye | None, GazeSample]) -> list[Map]:
        common = gazes.get(None)
        own = {eye: gaze for eye in Eye if (gaze := gazes.get(eye, common)) is not None}
        base = {eye: self._pupils.get(eye) or _unseen(gaze, eye) for eye, gaze in own.items()}
        if common is not None and all(datum["confidence"] >= _SURE for datum in base.values()):
            return [both_eyes(common, own, list(base.values()))]
        return [one_eye(eye, gaze, base[eye]) for eye, gaze in own.items()]


def _unseen(gaze: GazeSample, eye: Eye) -> Map:
    """The pupil datum behind a direction whose pupil the source does not give."""
    return _named(image_pair(PupilSample(gaze.t_ns, eye, None, gaze.confidence), gaze)[0])


def _named(datum: Map) -> Map:
    return datum | {"method": _METHODS[datum["topic"].rpartition(".")[2]]}


def recorded_pupil(payload: bytes) -> tuple[Map, Map | None]:
    """The 2-D and the 3-D message of one recorded pupil datum, of any version; its own fields wherever it has them.

    The 3-D message is None for a datum of a 2-D detector.
    """
    datum = decode_pupil(payload)
    flat, solid = image_pair(pupil_sample(datum), None)
    raw = _unpacked(payload)
    own = {key: value for key, value in raw.items() if key != "topic"}
    if solid is not None:
        if "ellipse" in own and "location" not in own:
            own["location"] = own["ellipse"].get("center")
        solid = _like(solid, own)
    return _like(flat, own), solid


def recorded_gaze(payload: bytes) -> Map:
    """The message of one recorded gaze datum, of any version."""
    raw = _unpacked(payload)
    datum: Map = {key: _floats(raw[key]) for key in _GAZE_KEYS if key in raw}
    base = []
    for each in raw.get("base_data") or ():
        flat, solid = recorded_pupil(each if isinstance(each, bytes) else msgpack.packb(each))
        base.append(flat if solid is None else solid)
    eyes = "".join(sorted({str(each["id"]) for each in base}))
    if raw.get("topic", "gaze").count(".") < 2 and eyes:  # before 2.0 all were just `gaze`
        datum["topic"] = f"gaze.{'3d' if 'gaze_point_3d' in raw else '2d'}.{eyes}."
    return datum | {"base_data": base}


def retimed(datum: Map, time: Callable[[float], float]) -> Map:
    """The datum, and those it was made of, with other times."""
    again = datum | {"timestamp": time(datum["timestamp"])}
    if "base_data" in datum:
        again["base_data"] = [retimed(base, time) for base in datum["base_data"]]
    return again


def _unpacked(payload: bytes) -> Map:
    unpacked: Map = msgpack.unpackb(payload, strict_map_key=False, ext_hook=lambda _, wrapped: bytes(wrapped))
    return unpacked


def _like(form: Any, value: Any) -> Any:
    """The value in the form's keys and types; what it lacks or has in another type, it takes from the form."""
    if isinstance(form, dict):
        return {key: _like(own, value.get(key)) for key, own in form.items()} if isinstance(value, dict) else form
    if isinstance(form, list):
        # All lists of a pupil datum are of numbers.
        fits = isinstance(value, list) and len(value) == len(form) and all(type(each) in (float, int) for each in value)
        return [float(each) for each in value] if fits else form
    if type(value) is int and type(form) is float:
        return float(value)
    return value if type(value) is type(form) else form


def _floats(value: Any) -> Any:
    """Numbers as Capture writes them now, and map keys as text."""
    if isinstance(value, dict):
        return {str(key): _floats(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_floats(each) for each in value]
    return float(value) if isinstance(value, int) else value
