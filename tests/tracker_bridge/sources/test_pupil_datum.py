import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.pupil_core.datum import (
    base_pupils,
    decode_gaze,
    decode_pupil,
    eye_axis,
    gaze_samples,
    needs_scene_fov,
    pupil_sample,
)

Shared = Callable[[str], Path]
Map = dict[str, Any]

PUPIL_3D: Map = {
    "id": 0,
    "topic": "pupil.0.3d",
    "method": "pye3d 0.3.2 real-time",
    "timestamp": 1536.488052581,
    "confidence": 0.99,
    "diameter": 19.87,
    "diameter_3d": 4.028,
    "model_confidence": 1.0,
    "circle_3d": {"center": [0.5, 0.0, 31.5], "normal": [0.6, 0.0, -0.8], "radius": 2.0},
    "norm_pos": [0.5, 0.5],
}
GAZE_BOTH: Map = {
    "topic": "gaze.3d.01.",
    "timestamp": 2.0,
    "confidence": 0.9,
    "norm_pos": [0.5, 0.5],
    "gaze_point_3d": [100.0, -100.0, 100.0],
    "gaze_normals_3d": {"0": [0.0, 0.0, 1.0], "1": [1.0, 0.0, 1.0]},
    "base_data": [PUPIL_3D | {"timestamp": 1.99}, PUPIL_3D | {"timestamp": 2.01, "id": 1, "confidence": 0.5}],
}


def pupil(**fields: object) -> PupilSample:
    return pupil_sample(decode_pupil(msgpack.packb({**PUPIL_3D, **fields})))


def gazes(datum: Map) -> tuple[GazeSample, ...]:
    decoded = decode_gaze(msgpack.packb(datum))
    return gaze_samples(decoded, base_pupils(decoded))


def without(datum: Map, *keys: str) -> Map:
    return {key: value for key, value in datum.items() if key not in keys}


def test_a_3d_datum() -> None:
    assert pupil() == PupilSample(1536488052581, Eye.RIGHT, 4.028, 0.99, 1.0, 19.87)


def test_a_2d_datum_has_no_millimetres() -> None:
    datum = without(PUPIL_3D, "diameter_3d", "model_confidence", "circle_3d") | {"method": "2d c++", "id": 1}
    sample = pupil_sample(decode_pupil(msgpack.packb(datum)))
    assert sample == PupilSample(1536488052581, Eye.LEFT, None, 0.99, None, 19.87)


def test_nonsense_diameters_are_passed_on_and_endless_ones_are_not() -> None:
    assert pupil(diameter_3d=-7580.0).pupil_diameter_mm == -7580.0
    assert pupil(diameter_3d=0).pupil_diameter_mm == 0.0
    assert pupil(diameter_3d=math.nan).pupil_diameter_mm is None
    assert pupil(diameter=math.inf).diameter_px is None


@pytest.mark.parametrize(("raw", "cut"), [(1.0000000000000004, 1.0), (-0.1, 0.0), (math.nan, 0.0), (1, 1.0)])
def test_confidence_is_cut_to_its_range(raw: float, cut: float) -> None:
    assert pupil(confidence=raw).confidence == cut


@pytest.mark.parametrize(
    ("fields", "path"),
    [
        ({"id": 2}, "id"),
        ({"id": "0"}, "id"),
        ({"timestamp": "now"}, "timestamp"),
        ({"timestamp": math.nan}, "timestamp"),
        ({"timestamp": 1e10}, "timestamp"),
        ({"confidence": None}, "confidence"),
        ({"circle_3d": {"normal": [1.0, 2.0]}}, "circle_3d.normal"),
    ],
)
def test_a_wrong_field_is_named(fields: Map, path: str) -> None:
    with pytest.raises(SourceError, match=path):
        pupil(**fields)


def test_a_missing_field_is_named() -> None:
    with pytest.raises(SourceError, match="confidence"):
        decode_pupil(msgpack.packb(without(PUPIL_3D, "confidence")))


def test_gaze_of_both_eyes_comes_with_each_eyes_own_at_the_time_of_its_own_image() -> None:
    both, right, left = gazes(GAZE_BOTH)
    assert (both.t_ns, both.eye, both.azimuth_deg, both.confidence) == (2_000_000_000, None, 45.0, 0.9)
    assert both.elevation_deg == pytest.approx(math.degrees(math.atan(1 / math.sqrt(2))))  # y points down
    assert right == GazeSample(1_990_000_000, Eye.RIGHT, 0.0, 0.0, 0.99)
    assert left == GazeSample(2_010_000_000, Eye.LEFT, 45.0, 0.0, 0.5)


def test_old_recordings_number_eyes_and_pack_the_pupils() -> None:
    packed = [msgpack.ExtType(13, msgpack.packb(base)) for base in GAZE_BOTH["base_data"]]
    normals = {int(eye): normal for eye, normal in GAZE_BOTH["gaze_normals_3d"].items()}
    assert gazes(GAZE_BOTH | {"base_data": packed, "gaze_normals_3d": normals}) == gazes(GAZE_BOTH)


def test_gaze_of_one_eye() -> None:
    datum = without(GAZE_BOTH, "gaze_normals_3d") | {
        "topic": "gaze.3d.1.",
        "gaze_normal_3d": [-1.0, 0.0, 1.0],
        "base_data": GAZE_BOTH["base_data"][1:],
    }
    expected = (GazeSample(2_000_000_000, Eye.LEFT, -45.0, 0.0, 0.9),)
    assert gazes(datum) == expected
    assert gazes(datum | {"base_data": []}) == expected  # the topic names the eye
    assert gazes(without(datum, "base_data")) == expected


def test_eyes_whose_lines_meet_behind_the_head_look_along_the_mean_of_their_lines() -> None:
    both = gazes(GAZE_BOTH | {"gaze_point_3d": [0.0, 0.0, -50.0]})[0]
    assert both.azimuth_deg == pytest.approx(math.degrees(math.atan(0.5)))
    lost = GAZE_BOTH | {"gaze_point_3d": [0.0, 0.0, -50.0], "gaze_normals_3d": {"0": [0.0] * 3, "1": [0.0] * 3}}
    assert gazes(lost) == ()


@pytest.mark.parametrize("time", [math.inf, math.nan, -1e11])
def test_a_wrong_time_among_the_base_data_is_named(time: float) -> None:
    base = PUPIL_3D | {"timestamp": time}
    for wrapped in (base, msgpack.ExtType(13, msgpack.packb(base)), msgpack.ExtType(7, b""), 3, b"\xc1"):
        with pytest.raises(SourceError):
            gazes(GAZE_BOTH | {"base_data": [wrapped]})


def test_gaze_without_3d_rests_on_the_assumed_field_of_view() -> None:
    datum = {"topic": "gaze.2d.01.", "timestamp": 1.0, "confidence": 1.0, "norm_pos": [1.0, 0.0]}
    assert gazes(datum) == (GazeSample(1_000_000_000, None, 45.0, -26.0, 1.0),)
    assert needs_scene_fov(decode_gaze(msgpack.packb(datum)))
    assert not needs_scene_fov(decode_gaze(msgpack.packb(GAZE_BOTH)))
    assert gazes(datum | {"norm_pos": [1e9, math.nan]}) == ()
    assert gazes(datum | {"norm_pos": [1e9, -1e9]})[0].azimuth_deg == 180.0


def test_each_eye_camera_has_its_own_frame() -> None:
    right = decode_pupil(msgpack.packb(PUPIL_3D | {"circle_3d": {"normal": [0.3, 0.4, -1.2]}}))
    left = decode_pupil(msgpack.packb(PUPIL_3D | {"circle_3d": {"normal": [-0.3, -0.4, -1.2]}, "id": 1}))
    assert eye_axis(right) == eye_axis(left) == pytest.approx((3 / 13, 4 / 13, 12 / 13))
    assert eye_axis(decode_pupil(msgpack.packb(PUPIL_3D | {"circle_3d": {"normal": [0.0, -0.0, 0.0]}}))) is None


numbers = st.floats() | st.integers(-(2**63), 2**64 - 1)
junk = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5) | st.integers(0, 9), inner, max_size=4)
    ),
    max_leaves=8,
)
vectors = st.lists(st.floats(), min_size=3, max_size=3)
mutations = st.dictionaries(
    st.sampled_from(sorted({*PUPIL_3D, *GAZE_BOTH, "gaze_normal_3d"})),
    junk | vectors | st.dictionaries(st.sampled_from([0, 1, "0", "1", 2]), vectors),
    max_size=4,
)


def read_all(payload: bytes) -> None:
    for read in (lambda: [pupil_sample(decode_pupil(payload))], lambda: read_gaze(payload)):
        try:
            samples = read()
        except SourceError:
            continue
        for sample in samples:
            assert 0.0 <= sample.confidence <= 1.0
            if isinstance(sample, GazeSample):
                assert abs(sample.azimuth_deg) <= 180.0
                assert abs(sample.elevation_deg) <= 90.0


def read_gaze(payload: bytes) -> list[PupilSample | GazeSample]:
    datum = decode_gaze(payload)
    base = base_pupils(datum)
    for each in base:
        eye_axis(each)
    return [*gaze_samples(datum, base)]


@given(st.binary(max_size=200))
def test_any_bytes_give_samples_or_a_source_error(payload: bytes) -> None:
    read_all(payload)


@given(mutations)
def test_any_field_values_give_samples_or_a_source_error(fields: Map) -> None:
    read_all(msgpack.packb(PUPIL_3D | fields))
    read_all(msgpack.packb(GAZE_BOTH | fields))


@pytest.mark.parametrize("nest", [b"\x91", b"\x81\xa1a", b"\x81\xaebase_data_____"])
def test_deep_nesting_is_a_source_error(nest: bytes) -> None:
    for payload in (nest * 100_000, b"\x81\xa9base_data" + nest * 100_000):
        with pytest.raises(SourceError):
            decode_gaze(payload)


@pytest.mark.shared_data
def test_the_frames_of_real_eye_cameras(shared: Shared) -> None:
    """Calibrated directions and those of the eye cameras turn the same way, in both eyes and on both axes."""
    pairs: dict[Eye, list[tuple[float, ...]]] = {eye: [] for eye in Eye}
    with shared("eye/pupil_core/binocular_only_gaze.pldata").open("rb") as stream:
        for _, payload in msgpack.Unpacker(stream, strict_map_key=False):
            datum = decode_gaze(payload)
            for base in base_pupils(datum):
                axis, scene = eye_axis(base), (datum.gaze_normals_3d or {})[int(base.id)]
                if base.confidence > 0.8 and axis is not None:
                    pairs[base.id].append((*axis, scene[0], -scene[1], scene[2]))
    for of_eye in pairs.values():
        table = np.array(of_eye)
        turn = np.linalg.lstsq(table[:, :3], table[:, 3:], rcond=None)[0]
        assert (np.diag(turn) > 0.85).all()


@pytest.mark.shared_data
def test_live_messages_are_read_by_the_same_functions(shared: Shared) -> None:
    counts: Counter[str] = Counter()
    with shared("eye/pupil_core/network_trace.msgpack").open("rb") as stream:
        for _, frames in msgpack.Unpacker(stream, strict_map_key=False):
            topic = frames[0].decode()
            if topic.startswith("pupil."):
                assert decode_pupil(frames[1]).id == int(topic[6])
                counts[topic] += 1
            elif topic.startswith("gaze."):
                datum = decode_gaze(frames[1])
                eyes = [sample.eye for sample in gaze_samples(datum, base_pupils(datum))]
                assert eyes == ([None, Eye.RIGHT, Eye.LEFT] if topic == "gaze.3d.01." else [Eye(int(topic[8]))])
                counts[topic] += 1
    assert counts == {
        "pupil.0.2d": 97,
        "pupil.0.3d": 97,
        "pupil.1.2d": 91,
        "pupil.1.3d": 91,
        "gaze.3d.01.": 250,
        "gaze.3d.0.": 12,
        "gaze.3d.1.": 12,
    }
