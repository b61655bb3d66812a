import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.capture_twin.blinks import BlinkFilter, filter_response

Map = dict[str, Any]


def datum(t_s: float, confidence: float) -> Map:
    return {"timestamp": t_s, "confidence": confidence}


def eyes_closed(start_s: float, end_s: float, *, to_s: float = 3.0) -> list[Map]:
    times = [at / 200 for at in range(round(to_s * 200))]
    return [datum(t_s, 0.0 if start_s <= t_s < end_s else 1.0) for t_s in times for _ in range(2)]


def blinks(data: list[Map]) -> list[tuple[float, Map]]:
    """The events of a stream, each with the time of the frame that gave it."""
    detector, events = BlinkFilter(), []
    for start in range(0, len(data), 12):
        frame = data[start : start + 12]
        if (event := detector.frame(frame)) is not None:
            events.append((frame[-1]["timestamp"], event))
    return events


def test_a_blink_is_an_onset_and_an_offset_repeated_every_frame() -> None:
    events = blinks(eyes_closed(1.0, 1.15))
    kinds = [event["type"] for _, event in events]
    assert kinds == sorted(kinds, reverse=True)
    assert kinds.count("onset") > 1
    assert kinds.count("offset") > 1
    assert all(0.5 < event["confidence"] <= 1.0 for _, event in events)


def test_latency_is_half_the_window() -> None:
    for now_s, event in blinks(eyes_closed(1.0, 1.15)):
        assert now_s - event["timestamp"] == pytest.approx(0.1, abs=0.005)


def test_an_eye_held_closed_gives_no_event_until_it_opens() -> None:
    events = blinks(eyes_closed(1.0, 2.5))
    assert not [now_s for now_s, _ in events if 1.3 < now_s < 2.5]
    assert next(event["type"] for now_s, event in events if now_s >= 2.5) == "offset"


def test_a_clock_set_back_starts_over() -> None:
    detector = BlinkFilter()
    assert detector.frame(eyes_closed(1.0, 1.15)) is None
    assert detector.frame([datum(0.0, 1.0)]) is None
    assert detector.frame([datum(0.1, 1.0)]) is None
    assert detector.frame([datum(0.32, 0.0)]) is not None


def test_a_clock_set_to_no_number_keeps_nothing_and_is_forgotten() -> None:
    detector = BlinkFilter()
    for _ in range(1000):
        assert detector.frame([datum(float("nan"), 1.0)] * 12) is None
    assert len(detector._window) == 0
    assert detector.frame([datum(0.0, 1.0), datum(0.1, 1.0)]) is None
    assert detector.frame([datum(0.22, 0.0)]) is not None


def test_nothing_comes_of_nothing() -> None:
    assert BlinkFilter().frame([]) is None
    assert BlinkFilter().frame([datum(0.0, 1.0)]) is None
    assert BlinkFilter().frame([datum(float("nan"), 1.0)]) is None


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=80))
def test_the_response_is_odd_in_time(confidences: list[float]) -> None:
    assert filter_response(confidences) == pytest.approx(-filter_response(confidences[::-1]), abs=1e-12)


@pytest.mark.shared_data
def test_the_same_events_as_capture(shared: Callable[[str], Path]) -> None:
    """Each recorded event says which pupils it was made of: the detector, fed with them, says the same."""
    with shared("eye/pupil_core/network_trace.msgpack").open("rb") as stream:
        messages = [frames for _, frames in msgpack.Unpacker(stream, max_buffer_size=2**31 - 1)]
    theirs = [msgpack.unpackb(frames[1]) for frames in messages if frames[0] == b"blinks"]
    assert len(theirs) == 12
    for event in theirs:
        ours = BlinkFilter().frame(event["base_data"])
        assert ours is not None
        assert ours["confidence"] == pytest.approx(event["confidence"], abs=1e-12)
        assert {**ours, "confidence": 0.0} == {**event, "confidence": 0.0}
        assert list(ours) == list(event)
    # And the window moves on as theirs does, where no frame is missing between two events.
    for before, after in itertools.pairwise(theirs[4:9]):
        detector = BlinkFilter()
        detector.frame(before["base_data"])
        came = [datum for datum in after["base_data"] if datum not in before["base_data"]]
        assert detector.frame(came) is not None
        assert list(detector._window) == after["base_data"]
