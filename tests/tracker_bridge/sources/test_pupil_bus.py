from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from entoptic.tracker_bridge.events import TaskKind, TaskOutcome, TrackerStatus, TrackerTask
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.pupil_core import bus as pupil_bus
from entoptic.tracker_bridge.sources.pupil_core.bus import IMAGES_WITHOUT_3D, SUBSCRIPTIONS, PupilBus, Read

Shared = Callable[[str], Path]
Map = dict[str, Any]
TRACE = "eye/pupil_core/network_trace.msgpack"


def pupil_2d(t: float, eye: int = 0, **fields: object) -> Map:
    datum = {"id": eye, "topic": f"pupil.{eye}.2d", "timestamp": t, "confidence": 0.9, "diameter": 20.0}
    return datum | {"method": "2d c++", "norm_pos": [0.5, 0.5]} | fields


def pupil_3d(t: float, eye: int = 0, **fields: object) -> Map:
    datum = pupil_2d(t, eye) | {"topic": f"pupil.{eye}.3d", "method": "pye3d 0.3.2 real-time"}
    return datum | {"diameter_3d": 4.0, "model_confidence": 1.0} | fields


def message(datum: Map, topic: str | None = None) -> list[bytes]:
    return [(topic or datum["topic"]).encode(), msgpack.packb(datum)]


def notification(subject: str, **fields: object) -> list[bytes]:
    return message({"subject": subject, **fields}, f"notify.{subject}")


def read(bus: PupilBus, datum: Map, topic: str | None = None) -> Read:
    return bus.read(message(datum, topic), 7)


def times(reads: list[Read]) -> list[float]:
    return [sample.t_ns / 1e9 for each in reads for sample in each.samples]


def test_of_the_two_datums_of_an_image_the_3d_one_counts_at_once_in_either_order() -> None:
    bus = PupilBus()
    for t in range(1, 30):
        order = [pupil_2d(t), pupil_3d(t)] if t % 3 else [pupil_3d(t), pupil_2d(t)]
        became = [read(bus, datum) for datum in order]
        assert times(became) == [t]
        (sample,) = (sample for each in became for sample in each.samples)
        assert sample == PupilSample(t * 1_000_000_000, Eye.RIGHT, 4.0, 0.9, 1.0, 20.0)


def test_a_2d_detector_alone_is_read_after_a_few_images_and_then_at_once() -> None:
    bus = PupilBus()
    reads = [read(bus, pupil_2d(t, eye=1)) for t in range(30)]
    assert times(reads) == list(range(IMAGES_WITHOUT_3D, 30))
    assert all(sample.eye is Eye.LEFT for each in reads for sample in each.samples)


def test_an_eye_whose_3d_detector_is_switched_on_or_off_gives_one_sample_an_image() -> None:
    bus = PupilBus()
    reads = [read(bus, pupil_2d(t)) for t in range(20)]
    for t in range(20, 40):
        reads += [read(bus, pupil_2d(t)), read(bus, pupil_3d(t))]
    reads += [read(bus, pupil_2d(t)) for t in range(40, 60)]
    assert times(reads) == [*range(IMAGES_WITHOUT_3D, 40), *range(40 + IMAGES_WITHOUT_3D, 60)]


def test_the_eyes_have_their_own_detectors() -> None:
    bus = PupilBus()
    reads = [read(bus, datum) for t in range(30) for datum in (pupil_2d(t, 1), pupil_2d(t, 0), pupil_3d(t, 0))]
    eyes = Counter(sample.eye for each in reads for sample in each.samples)
    assert eyes == {Eye.RIGHT: 30, Eye.LEFT: 30 - IMAGES_WITHOUT_3D}


@pytest.mark.parametrize("datum", [pupil_2d(1.0, topic="pupil.0"), pupil_3d(1.0, topic="pupil.0", method="3d c++")])
def test_before_version_2_a_datum_is_the_only_one_of_its_image(datum: Map) -> None:
    bus = PupilBus()
    assert [read(bus, datum | {"timestamp": float(t)}).became for t in range(5)] == [pupil_bus.PUPIL] * 5


GAZE_3D: Map = {
    "topic": "gaze.3d.01.",
    "timestamp": 1.5,
    "confidence": 0.9,
    "gaze_point_3d": [0.0, 0.0, 100.0],
    "gaze_normals_3d": {"0": [0.0, 0.0, 1.0], "1": [0.0, 0.0, 1.0]},
    "base_data": [pupil_3d(1.0), pupil_3d(2.0, 1)],
}


def test_an_eye_image_that_went_into_two_gaze_datums_gives_its_direction_once() -> None:
    bus = PupilBus()
    first = read(bus, GAZE_3D)
    second = read(bus, GAZE_3D | {"timestamp": 2.5, "base_data": [pupil_3d(3.0), pupil_3d(2.0, 1)]})
    assert [(sample.eye, sample.t_ns // 10**8) for sample in first.samples] == [
        (None, 15),
        (Eye.RIGHT, 10),
        (Eye.LEFT, 20),
    ]
    assert [(sample.eye, sample.t_ns // 10**8) for sample in second.samples] == [(None, 25), (Eye.RIGHT, 30)]


def test_numbered_keys_are_read_like_names() -> None:
    numbered = GAZE_3D | {
        "gaze_normals_3d": {0: [0.0, 0.0, 1.0], 1: [0.0, 0.0, 1.0]},
        "eye_centers_3d": {0: [1.0, 2.0, 3.0], 1: [4.0, 5.0, 6.0]},
    }
    assert read(PupilBus(), numbered) == read(PupilBus(), GAZE_3D)


@pytest.mark.parametrize("topic", ["gaze", "gaze.2d.0", "gaze.2d.0."])
def test_gaze_of_old_versions_has_other_topics(topic: str) -> None:
    bus = PupilBus()
    datum = {"topic": topic, "timestamp": 1.0, "confidence": 0.5, "norm_pos": [0.5, 0.5], "base_data": [pupil_2d(1.0)]}
    first = read(bus, datum)
    assert first.samples == (GazeSample(1_000_000_000, Eye.RIGHT, 0.0, 0.0, 0.5),)
    assert isinstance(first.event, TrackerStatus)
    assert "field of view" in first.event.detail
    assert read(bus, datum).event is None  # said once


def test_gaze_without_any_direction_is_counted() -> None:
    bus = PupilBus()
    assert read(bus, {"topic": "gaze.3d.0.", "timestamp": 1.0, "confidence": 0.0}).became == pupil_bus.NO_DIRECTION


K, O = TaskKind, TaskOutcome  # noqa: E741


@pytest.mark.parametrize(
    ("subject", "fields", "kind", "outcome", "detail"),
    [
        ("calibration.started", {}, K.GAZE_CALIBRATION, O.STARTED, ""),
        ("calibration.stopped", {}, K.GAZE_CALIBRATION, O.STOPPED, ""),
        ("calibration.successful", {"record": True}, K.GAZE_CALIBRATION, O.SUCCEEDED, ""),
        ("calibration.failed", {"reason": "NotEnoughData"}, K.GAZE_CALIBRATION, O.FAILED, "NotEnoughData"),
        ("calibration_failed", {"reason": "Too few."}, K.GAZE_CALIBRATION, O.FAILED, "Too few."),
        ("recording.started", {"rec_path": "/r/000"}, K.RECORDING, O.STARTED, "/r/000"),
        ("recording.stopped", {"rec_path": "/r/000"}, K.RECORDING, O.STOPPED, "/r/000"),
    ],
)
def test_notifications_of_calibrations_and_recordings(
    subject: str, fields: Map, kind: TaskKind, outcome: TaskOutcome, detail: str
) -> None:
    frames = notification(subject, **fields)
    assert PupilBus().read(frames, 7).event == TrackerTask(7, kind, outcome, detail)
    assert any(frames[0].startswith(topic) for topic in SUBSCRIPTIONS)


def test_an_eye_camera_that_is_switched_off_is_a_status() -> None:
    bus = PupilBus()
    off = bus.read(notification("eye_process.stopped", eye_id=1), 7).event
    assert isinstance(off, TrackerStatus)
    assert (off.ready, "left" in off.detail) == (False, True)
    on = bus.read(notification("eye_process.started", eye_id=0), 8).event
    assert isinstance(on, TrackerStatus)
    assert (on.ready, "right" in on.detail) == (True, True)


@pytest.mark.parametrize("topic", ["notify.calibration.setup.v2", "notify.calibration.add_ref_data", "frame.world"])
def test_what_is_large_is_not_subscribed_to(topic: str) -> None:
    assert not any(topic.encode().startswith(subscribed) for subscribed in SUBSCRIPTIONS)


def test_pupils_own_blinks_are_counted_and_make_nothing() -> None:
    bus = PupilBus()
    blink = {"topic": "blinks", "type": "onset", "confidence": 0.8, "timestamp": 1.0, "base_data": []}
    assert read(bus, blink) == Read(pupil_bus.BLINK)


@pytest.mark.parametrize(
    ("frames", "error"),
    [
        ([], "FramesError"),
        ([b"pupil.0.3d"], "FramesError"),
        ([*message(pupil_3d(1.0)), b"image"], "FramesError"),
        ([b"\xff\xfe", b"\x80"], "TopicError"),
        ([b"gaze.3d.01.", b"\x81\xa1a" + b"\xc4\xff" * 600_000], "TooLargeError"),
        ([b"pupil.0.3d", b""], "DatumError"),
        ([b"pupil.0.3d", b"\xc1"], "DatumError"),
        (message(pupil_3d(1.0), "pupil.1.3d"), "DatumError"),
        (message(pupil_3d(1.0), "pupil"), "DatumError"),
        (message(pupil_3d(math.nan)), "DatumError"),
        (message(GAZE_3D | {"base_data": [3]}), "DatumError"),
        (message({"topic": "blinks"}), "DatumError"),
        (message({}, "notify.calibration.started"), "NotificationError"),
        (message({"subject": "recording.started"}, "notify.calibration.started"), "NotificationError"),
        (notification("calibration.failed", reason=3), "NotificationError"),
        (notification("eye_process.stopped"), "NotificationError"),
        (message({"name": "recorder"}, "logging.error"), "NotificationError"),
    ],
)
def test_what_cannot_be_read_is_counted_by_the_errors_name(frames: list[bytes], error: str) -> None:
    bus = PupilBus()
    assert bus.read(frames, 7) == Read(error)
    assert bus.counts == {error: 1}
    assert error in pupil_bus.ERRORS


@pytest.mark.shared_data
def test_every_message_of_a_real_session_becomes_something(shared: Shared) -> None:
    bus = PupilBus()
    became: dict[str, Counter[str]] = {}
    events, remarks = [], []
    with shared(TRACE).open("rb") as stream:
        for received_s, frames in msgpack.Unpacker(stream, strict_map_key=False):
            one = bus.read(frames, round(received_s * 1e9))
            became.setdefault(frames[0].decode(), Counter())[one.became] += 1
            events += [one.event] if one.event else []
            remarks += [one.remark] if one.remark else []
    assert became == {
        "pupil.0.2d": {"second datum of an image": 97},
        "pupil.0.3d": {"pupil": 97},
        "pupil.1.2d": {"second datum of an image": 91},
        "pupil.1.3d": {"pupil": 91},
        "gaze.3d.01.": {"gaze": 250},
        "gaze.3d.0.": {"gaze": 12},
        "gaze.3d.1.": {"gaze": 12},
        "blinks": {"Pupil's own blink": 12},
        "logging.error": {"remark": 2},
        "notify.recording.started": {"calibration or recording": 1},
        "notify.recording.stopped": {"calibration or recording": 1},
        "notify.calibration.started": {"calibration or recording": 1},
        "notify.calibration.stopped": {"calibration or recording": 1},
        "notify.calibration.successful": {"calibration or recording": 1},
        "fixations": {"not ours": 5},
        "frame.eye.0": {"not ours": 1},
        "notify.calibration.add_ref_data": {"not ours": 1},
        "notify.calibration.result.v2": {"not ours": 1},
        "notify.calibration.should_start": {"not ours": 1},
        "notify.calibration.should_stop": {"not ours": 1},
        "notify.frame_publishing.set_format": {"not ours": 1},
        "notify.frame_publishing.started": {"not ours": 1},
        "notify.recording.should_start": {"not ours": 1},
        "notify.recording.should_stop": {"not ours": 1},
        "notify.start_eye_plugin": {"not ours": 2},
        "notify.start_plugin": {"not ours": 1},
    }
    assert sum(bus.counts.values()) == 686
    assert [(event.kind, event.outcome) for event in events if isinstance(event, TrackerTask)] == [
        (K.RECORDING, O.STARTED),
        (K.GAZE_CALIBRATION, O.STARTED),
        (K.GAZE_CALIBRATION, O.STOPPED),
        (K.GAZE_CALIBRATION, O.SUCCEEDED),
        (K.RECORDING, O.STOPPED),
    ]
    assert remarks == ["recorder: Notification without timestamp will not be saved."] * 2


@cache
def real_messages(path: Path) -> dict[str, list[bytes]]:
    with path.open("rb") as stream:
        return {frames[0].decode(): frames for _, frames in msgpack.Unpacker(stream, strict_map_key=False)}


def check(bus: PupilBus, frames: list[bytes]) -> None:
    one = bus.read(frames, 7)
    assert one.became in pupil_bus.ERRORS or one.became in {
        pupil_bus.PUPIL,
        pupil_bus.SECOND_OF_IMAGE,
        pupil_bus.GAZE,
        pupil_bus.NO_DIRECTION,
        pupil_bus.BLINK,
        pupil_bus.TASK,
        pupil_bus.STATUS,
        pupil_bus.REMARK,
        pupil_bus.NOT_OURS,
    }
    for sample in one.samples:
        assert 0.0 <= sample.confidence <= 1.0
        assert isinstance(sample.t_ns, int)


changes = st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(max_size=4), st.integers(0, 4)), max_size=6)
"""Where, what is put in, and how many bytes it replaces."""


def mutate(frames: list[bytes], which: int, mutations: list[tuple[float, bytes, int]], cut: float) -> list[bytes]:
    data = frames[which]
    for place, inserted, replaced in mutations:
        at = round(place * len(data))
        data = data[:at] + inserted + data[at + replaced :]
    return [*frames[:which], data[: round(cut * len(data))], *frames[which + 1 :]]


@pytest.mark.shared_data
# The fixture only finds a file: nothing of it needs a reset.
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data(), st.integers(0, 9), changes, st.floats(0.0, 1.0) | st.just(1.0))
def test_spoiled_real_messages_raise_nothing(
    shared: Shared, data: st.DataObject, which: int, mutations: list[tuple[float, bytes, int]], cut: float
) -> None:
    messages = real_messages(shared(TRACE))
    frames = messages[data.draw(st.sampled_from(sorted(messages)))]
    check(PupilBus(), mutate(frames, 0 if which == 0 else 1, mutations, cut))


@given(st.sampled_from(SUBSCRIPTIONS), st.binary(max_size=20), st.lists(st.binary(max_size=100), max_size=3))
def test_any_bytes_under_any_topic_raise_nothing(topic: bytes, rest: bytes, frames: list[bytes]) -> None:
    check(PupilBus(), [topic + rest, *frames])
    check(PupilBus(), frames)


@pytest.mark.parametrize("huge", [b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff"])
def test_a_promise_of_four_billion_items_is_refused(huge: bytes) -> None:
    for topic in (b"pupil.0.3d", b"gaze.3d.01.", b"blinks", b"notify.calibration.failed"):
        assert PupilBus().read([topic, huge], 7).became in pupil_bus.ERRORS
        assert PupilBus().read([topic, b"\x81\xa9base_data" + huge], 7).became in pupil_bus.ERRORS
