"""What the stand-in publishes has the keys and types of what the real program published, topic by topic."""

import operator
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from functools import partial
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

import msgpack
import pytest

from entoptic.tracker_bridge.capture_twin.backbone import frames_of
from entoptic.tracker_bridge.capture_twin.blinks import BlinkFilter
from entoptic.tracker_bridge.capture_twin.playback import Moment, open_playback
from entoptic.tracker_bridge.capture_twin.published import Publisher, recorded_gaze, recorded_pupil, retimed
from entoptic.tracker_bridge.capture_twin.tasks import Calibration, Recording, command
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.pupil_core.datum import base_pupils, decode_gaze, gaze_samples
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings

Shared = Callable[[str], Path]
Map = dict[str, Any]

TRACE = "eye/pupil_core/network_trace.msgpack"

NOT_SENT = {
    "fixations": "the bridge finds its own; a client of fixations needs the real program",
    "frame.eye.0": "there are no cameras",
    "logging.error": "the stand-in's log goes to its own terminal",
    "notify.frame_publishing.set_format": "sent by the client that the trace was made with",
    "notify.frame_publishing.started": "there are no cameras",
    "notify.start_eye_plugin": "sent by the client that the trace was made with",
    "notify.start_plugin": "sent by the client that the trace was made with",
    "notify.calibration.add_ref_data": "sent by a client of an HMD calibration",
}
BY_CLIENT = {"notify.calibration.should_start", "notify.calibration.should_stop"}
"""Sent by the client of an HMD calibration with keys of its own; by Pupil Remote with the subject alone."""


def shape(value: object) -> object:
    """The keys and types of a message, whatever the order of its keys: a list is what its members are."""
    if isinstance(value, dict):
        return {key: shape(each) for key, each in sorted(value.items())}
    if isinstance(value, list):
        return [*{repr(shape(each)): shape(each) for each in value}.values()]
    return type(value).__name__


def shapes(messages: Iterable[tuple[str, Map]]) -> dict[str, set[str]]:
    """Of each topic, the forms in which it occurs."""
    found, seen = defaultdict(set), Counter[str]()
    for topic, datum in messages:
        seen[topic] += 1
        # Every message of a rare topic; of the others enough of them to meet blinks and lost pupils.
        if seen[topic] < 50 or seen[topic] % 20 == 0:
            found[topic].add(repr(shape(datum)))
    return found


def over_the_wire(data: Iterable[Map]) -> Iterable[tuple[str, Map]]:
    for datum in data:
        topic, packed = frames_of(datum["topic"], datum)
        yield topic.decode(), msgpack.unpackb(packed)


def everything(moments: Iterable[Moment], folder: Path) -> Iterable[Map]:
    """All that the stand-in sends of these moments, with a calibration and a recording."""
    blinks = BlinkFilter()
    for _, pupils, gazes in moments:
        yield from pupils
        yield from gazes
        if (blink := blinks.frame(pupil for pupil in pupils if pupil["topic"].endswith(".2d"))) is not None:
            yield blink
    calibration, recording = Calibration(fit_s=1.0), Recording(folder)
    for subject in ("calibration.should_start", "calibration.should_stop"):
        yield command(subject)
        yield from calibration.notified(subject, 0.0 if "start" in subject else 5.0)
    yield from calibration.tick(9.0, 12.0)
    for asked in (command("recording.should_start", session_name="a"), command("recording.should_stop")):
        yield asked
        yield from recording.notified(asked, 10.0)


def beginning(recording: Path, folder: Path) -> Path:
    """A recording of the first messages of another, its first gaze at once."""
    folder.mkdir()
    for name, count in (("pupil", 2000), ("gaze", 300)):
        with (recording / f"{name}.pldata").open("rb") as stream:
            messages = list(islice(msgpack.Unpacker(stream), count))
        data = [(topic, msgpack.unpackb(payload)) for topic, payload in messages]
        from_start = partial(operator.add, -data[0][1]["timestamp"])
        packed = [[topic, msgpack.packb(retimed(datum, from_start))] for topic, datum in data]
        (folder / f"{name}.pldata").write_bytes(b"".join(map(msgpack.packb, packed)))
    return folder


@pytest.fixture
def real(shared: Shared) -> dict[str, set[str]]:
    with shared(TRACE).open("rb") as stream:
        messages = [frames for _, frames in msgpack.Unpacker(stream, max_buffer_size=2**31 - 1)]
    return shapes((frames[0].decode(), msgpack.unpackb(frames[1])) for frames in messages)


@pytest.mark.shared_data
@pytest.mark.parametrize("spec", ["simulated", "a recording"])
def test_every_topic_has_the_keys_and_types_of_the_real_one(
    spec: str, real: dict[str, set[str]], shared: Shared, tmp_path: Path
) -> None:
    simulated = SimulatedSettings(blinks_per_minute=40.0, rate_hz=60.0)
    if spec == "a recording":
        spec = str(beginning(shared("eye/pupil_core/capture_3_6"), tmp_path / "beginning"))
    moments = takewhile(lambda moment: moment.at_s < 10.0, open_playback(spec, simulated=simulated).moments)
    ours = shapes(over_the_wire(everything(moments, tmp_path)))
    assert set(real) - set(ours) == set(NOT_SENT)
    assert set(ours) - set(real) == set()
    for topic in set(ours) - BY_CLIENT:
        assert ours[topic] == real[topic], topic


def test_both_datums_of_an_image_say_the_same() -> None:
    gaze = GazeSample(5, Eye.LEFT, 10.0, -5.0, 0.9)
    flat, solid = Publisher().of_one_time([PupilSample(5, Eye.LEFT, 4.0, 0.9, 0.8, 20.0), gaze])[:2]
    assert (flat["topic"], solid["topic"]) == ("pupil.1.2d", "pupil.1.3d")
    assert (flat["method"], solid["method"]) == ("2d c++", "pye3d 0.3.2 real-time")
    for key in ("id", "norm_pos", "diameter", "confidence", "timestamp", "ellipse"):
        assert flat[key] == solid[key]
    assert (solid["diameter_3d"], solid["model_confidence"]) == (4.0, 0.8)


def test_a_lost_pupil_looks_as_the_real_one() -> None:
    flat, solid = Publisher().of_one_time([PupilSample(0, Eye.RIGHT, -0.0635, 0.0, 0.1)])
    assert flat["norm_pos"] == solid["norm_pos"] == [0.0, 1.0]
    assert flat["diameter"] == solid["diameter"] == 0.0
    assert flat["ellipse"] == {"center": [0.0, 0.0], "axes": [0.0, 0.0], "angle": -90.0}
    assert solid["ellipse"] == {"center": [0.0, 0.0], "axes": [0.0, 0.0], "angle": 0.0}
    assert solid["location"] == [0.0, 0.0]
    assert solid["diameter_3d"] == -0.0635
    assert solid["circle_3d"]["radius"] == -0.03175


def both(confidence: float) -> list[Map]:
    pupils = [PupilSample(0, eye, 4.0, confidence, 1.0) for eye in Eye]
    gazes = [GazeSample(0, eye, 3.0, 2.0, confidence) for eye in (*Eye, None)]
    return [datum for datum in Publisher().of_one_time([*pupils, *gazes]) if datum["topic"].startswith("gaze")]


def test_two_sure_eyes_make_one_gaze_datum_and_others_each_their_own() -> None:
    (joint,) = both(0.6)
    assert joint["topic"] == "gaze.3d.01."
    assert [datum["topic"] for datum in joint["base_data"]] == ["pupil.0.3d", "pupil.1.3d"]
    assert [datum["topic"] for datum in both(0.59)] == ["gaze.3d.0.", "gaze.3d.1."]


def test_a_published_gaze_is_read_as_it_was_measured() -> None:
    (joint,) = both(0.9)
    datum = decode_gaze(msgpack.packb(joint))
    samples = gaze_samples(datum, base_pupils(datum))
    assert [sample.eye for sample in samples] == [None, Eye.RIGHT, Eye.LEFT]
    for sample in samples:
        assert (sample.azimuth_deg, sample.elevation_deg) == (pytest.approx(3.0), pytest.approx(2.0))


def test_gaze_without_pupils_and_pupils_without_millimetres_have_what_they_have() -> None:
    gaze = Publisher().of_one_time([GazeSample(7, None, 1.0, 1.0, 1.0)])
    assert [datum["topic"] for datum in gaze] == ["gaze.3d.01."]
    assert [base["topic"] for base in gaze[0]["base_data"]] == ["pupil.0.2d", "pupil.1.2d"]
    flat = Publisher().of_one_time([PupilSample(7, Eye.LEFT, None, 1.0, None, 20.0)])
    assert [datum["topic"] for datum in flat] == ["pupil.1.2d"]
    assert Publisher().of_one_time([GazeSample(7, None, 91.0, 1.0, 1.0)]) == []


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["recording_000/pupil.pldata", "capture_3_6/pupil.pldata"])
def test_recorded_pupils_keep_their_values_in_the_form_of_today(name: str, shared: Shared) -> None:
    with shared(f"eye/pupil_core/{name}").open("rb") as stream:
        recorded = [payload for _, payload in msgpack.Unpacker(stream)][:500]
    for payload in recorded:
        theirs = msgpack.unpackb(payload)
        flat, solid = recorded_pupil(payload)
        assert all(flat[key] == theirs[key] for key in set(flat) - {"topic"})
        if "diameter_3d" in theirs:
            assert solid is not None
            assert all(solid[key] == theirs[key] for key in set(solid) & set(theirs) - {"topic"})
            assert solid["topic"] == f"pupil.{theirs['id']}.3d"


@pytest.mark.shared_data
def test_gaze_of_an_old_recording_gets_the_form_of_today(shared: Shared, real: dict[str, set[str]]) -> None:
    with shared("eye/pupil_core/binocular_only_gaze.pldata").open("rb") as stream:
        recorded = [recorded_gaze(payload) for _, payload in msgpack.Unpacker(stream)]
    assert len(recorded) == 665
    assert shapes((datum["topic"], datum) for datum in recorded) == {"gaze.3d.01.": real["gaze.3d.01."]}


def test_times_are_changed_down_to_the_base() -> None:
    datum = {"timestamp": 1.0, "base_data": [{"timestamp": 2.0, "id": 0}]}
    assert retimed(datum, lambda t_s: t_s + 10.0) == {"timestamp": 11.0, "base_data": [{"timestamp": 12.0, "id": 0}]}
    assert datum["timestamp"] == 1.0
