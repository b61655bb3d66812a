import contextlib
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tracker_bridge import wire
from tracker_bridge.samples import (
    BlinkOffset,
    BlinkOnset,
    Direction,
    Eye,
    EyeState,
    OneEyeState,
    Phase,
    PupilBack,
    PupilLost,
    StreamEnded,
    StreamStarted,
)

times = st.integers(-(2**63), 2**63 - 1)
unit = st.floats(0, 1)
directions = st.builds(Direction, st.floats(-180, 180), st.floats(-90, 90), times)
one_eye = st.builds(
    OneEyeState,
    st.sampled_from(Phase),
    st.none() | st.floats(0.01, 20),
    st.none() | st.floats(-8000, 14000),
    unit,
    st.none() | unit,
    st.none() | directions,
)
states = st.builds(EyeState, st.integers(0, 2**62), times, one_eye, one_eye, st.none() | directions)
eyes = st.sampled_from(Eye)
events = st.one_of(
    st.builds(BlinkOnset, times, eyes),
    st.builds(BlinkOffset, times, eyes, st.integers(0, 2**62)),
    st.builds(PupilLost, times, eyes),
    st.builds(PupilBack, times, eyes),
    st.builds(StreamStarted, times, st.none() | times, st.text(max_size=50)),
    st.builds(StreamEnded, times, st.integers(0, 2**62)),
)
STATE = EyeState(
    3,
    5,
    OneEyeState(Phase.TRACKING, 4.0, 4.0, 1.0, None, None),
    OneEyeState(Phase.LOST, None, None, 0.0, None, None),
    Direction(1.0, 2.0, 5),
)


@given(states)
def test_a_state_comes_back_as_it_went(state: EyeState) -> None:
    assert wire.decode_state(wire.encode(state)) == state


@given(events)
def test_an_event_comes_back_as_it_went(event: wire.Event) -> None:
    back = wire.decode_event(wire.encode(event))
    assert back == event
    assert type(back) is type(event)


@pytest.mark.parametrize("length", range(len(wire.encode(STATE))))
def test_a_truncated_message_is_named_whatever_its_length(length: int) -> None:
    with pytest.raises(wire.TruncatedMessageError):
        wire.decode_state(wire.encode(STATE)[:length])


@pytest.mark.parametrize("foreign", [{}, {"topic": "pupil.0.3d"}, [1, 2], 7, "text", None])
def test_foreign_msgpack_is_named(foreign: object) -> None:
    with pytest.raises(wire.ForeignMessageError):
        wire.decode_state(msgspec.msgpack.encode(foreign))


def test_another_version_is_named_with_the_remedy() -> None:
    message = msgspec.msgpack.encode({"entoptic": wire.VERSION + 1, "body": STATE})
    with pytest.raises(wire.WrongVersionError, match="same release"):
        wire.decode_state(message)


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"sequence": -1}, "sequence"),
        ({"t_ns": 1.5}, "t_ns"),
        ({"right": None}, "right"),
        ({"gaze": {"azimuth_deg": 181.0, "elevation_deg": 0.0, "t_ns": 0}}, "gaze.azimuth_deg"),
        ({"gaze": {"azimuth_deg": math.nan, "elevation_deg": 0.0, "t_ns": 0}}, "gaze.azimuth_deg"),
        ({"gaze": {"azimuth_deg": 0.0, "elevation_deg": -math.inf, "t_ns": 0}}, "gaze.elevation_deg"),
    ],
)
def test_a_wrong_field_is_named_with_its_path(change: dict[str, object], path: str) -> None:
    body = msgspec.to_builtins(STATE) | change
    with pytest.raises(wire.InvalidMessageError, match=path):
        wire.decode_state(msgspec.msgpack.encode({"entoptic": wire.VERSION, "body": body}))


def test_an_event_on_the_state_socket_is_named() -> None:
    with pytest.raises(wire.InvalidMessageError):
        wire.decode_state(wire.encode(BlinkOnset(0, Eye.LEFT)))


@given(st.binary(max_size=300))
def test_any_bytes_give_a_named_error_or_a_record(message: bytes) -> None:
    for decode in (wire.decode_state, wire.decode_event):
        try:
            decode(message)
        except wire.WireError:
            continue


@given(states, st.data())
def test_a_message_with_flipped_bytes_gives_a_named_error_or_a_record(state: EyeState, data: st.DataObject) -> None:
    message = bytearray(wire.encode(state))
    for _ in range(data.draw(st.integers(1, 4))):
        message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(wire.WireError):
        wire.decode_state(bytes(message))


def test_a_reader_counts_what_it_refuses_and_lives_on() -> None:
    reader = wire.Reader(wire.decode_state)
    assert reader.read(b"") is None
    assert reader.read(b"\x80") is None
    assert reader.read(wire.encode(StreamEnded(0, 0))) is None
    assert reader.read(wire.encode(STATE)) == STATE
    assert reader.refused == {"TruncatedMessageError": 1, "ForeignMessageError": 1, "InvalidMessageError": 1}
