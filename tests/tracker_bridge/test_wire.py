import contextlib
import math
import typing

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.events import (
    BlinkOffset,
    BlinkOnset,
    ClockEstimated,
    ClockJumped,
    Event,
    Heartbeat,
    PupilBack,
    PupilLost,
    SaccadeKind,
    SaccadeOffset,
    SaccadeOnset,
    SourceBack,
    SourceSilent,
    StreamEnded,
    StreamStarted,
    TaskKind,
    TaskOutcome,
    TrackerStatus,
    TrackerTask,
)
from entoptic.tracker_bridge.samples import Direction, Eye, EyeState, OneEyeState, Phase

times = st.integers(-(2**63), 2**63 - 1)
counts = st.integers(0, 2**62)
unit = st.floats(0, 1)
finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(0, 1e6)
words = st.text(max_size=50)
directions = st.builds(Direction, st.floats(-180, 180), st.floats(-90, 90), times)
one_eye = st.builds(
    OneEyeState,
    st.sampled_from(Phase),
    st.none() | st.floats(0.01, 20),
    st.none() | st.floats(-8000, 14000),
    unit,
    st.none() | unit,
    st.none() | directions,
    st.none() | times,
    st.booleans(),
)
states = st.builds(EyeState, counts, times, one_eye, one_eye, st.none() | directions, st.none() | counts, counts)
eyes = st.sampled_from(Eye)
EVENTS = (
    st.builds(BlinkOnset, times, eyes),
    st.builds(BlinkOffset, times, eyes, counts),
    st.builds(PupilLost, times, eyes),
    st.builds(PupilBack, times, eyes),
    st.builds(SaccadeOnset, times, times, finite, finite),
    st.builds(SaccadeOffset, times, times, times, st.sampled_from(SaccadeKind), positive, positive, finite, finite),
    st.builds(SourceSilent, times, words),
    st.builds(SourceBack, times),
    st.builds(ClockEstimated, times, times, finite, counts),
    st.builds(ClockJumped, times, times),
    st.builds(TrackerTask, times, st.sampled_from(TaskKind), st.sampled_from(TaskOutcome), words),
    st.builds(TrackerStatus, times, st.booleans(), words),
    st.builds(StreamStarted, times, st.none() | times, words),
    st.builds(StreamEnded, times, counts),
    st.builds(Heartbeat, times, counts, counts),
)
events = st.one_of(EVENTS)
numbered = st.builds(wire.NumberedEvent, counts, counts, st.integers(1, 65535), events)
answers = st.one_of(
    st.builds(wire.Replayed, st.lists(st.binary(max_size=40), max_size=5).map(tuple)),
    st.builds(wire.EventsGone, counts, st.binary(max_size=40)),
    st.builds(wire.BadRequest, words),
)
DECODERS = (wire.decode_state, wire.decode_sent_state, wire.decode_event, wire.decode_answer, wire.decode_request)
STATE = EyeState(
    3,
    5,
    OneEyeState(Phase.TRACKING, 4.0, 4.0, 1.0, None, None),
    OneEyeState(Phase.LOST, None, None, 0.0, None, None),
    Direction(1.0, 2.0, 5),
)


def encode(event: wire.NumberedEvent) -> bytes:
    return wire.encode_event(event.event, stream=event.stream, sequence=event.sequence, replay_port=event.replay_port)


def test_every_event_there_is_is_tried_here() -> None:
    assert len(EVENTS) == len(typing.get_args(Event))


@given(states)
def test_a_state_comes_back_as_it_went(state: EyeState) -> None:
    assert wire.decode_state(wire.encode_state(state)) == state


@given(states, st.none() | counts)
def test_a_live_state_says_when_it_was_sent(state: EyeState, sent_ns: int | None) -> None:
    message = wire.encode_state(state, sent_ns)
    assert wire.decode_sent_state(message) == (state, sent_ns)
    assert wire.decode_state(message) == state
    assert ("sent" in msgspec.msgpack.decode(message)) == (sent_ns is not None)


@given(numbered)
def test_an_event_comes_back_as_it_went_with_its_place(event: wire.NumberedEvent) -> None:
    back = wire.decode_event(encode(event))
    assert back == event
    assert type(back.event) is type(event.event)


@given(answers)
def test_an_answer_comes_back_as_it_went(answer: wire.Answer) -> None:
    assert wire.decode_answer(wire.encode_answer(answer)) == answer


@given(counts)
def test_a_request_comes_back_as_it_went(first: int) -> None:
    assert wire.decode_request(wire.encode_request(first)) == first


@pytest.mark.parametrize("length", range(len(wire.encode_state(STATE))))
def test_a_truncated_message_is_named_whatever_its_length(length: int) -> None:
    with pytest.raises(wire.TruncatedMessageError):
        wire.decode_state(wire.encode_state(STATE)[:length])


@pytest.mark.parametrize("foreign", [{}, {"topic": "pupil.0.3d"}, [1, 2], 7, "text", None])
@pytest.mark.parametrize("decode", [wire.decode_state, wire.decode_event, wire.decode_answer])
def test_foreign_msgpack_is_named(foreign: object, decode: typing.Callable[[bytes], object]) -> None:
    with pytest.raises(wire.ForeignMessageError):
        decode(msgspec.msgpack.encode(foreign))


@pytest.mark.parametrize("version", [wire.VERSION - 1, wire.VERSION + 1])
@pytest.mark.parametrize("decode", [wire.decode_state, wire.decode_event, wire.decode_answer])
def test_another_version_is_named_with_the_remedy(version: int, decode: typing.Callable[[bytes], object]) -> None:
    with pytest.raises(wire.WrongVersionError, match="same release"):
        decode(msgspec.msgpack.encode({"entoptic": version, "body": STATE}))


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


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"sequence": -1}, "sequence"),
        ({"stream": None}, "stream"),
        ({"replay": 70000}, "replay"),
        ({"body": {"type": "Sneeze", "t_ns": 0}}, "Sneeze"),
        ({"body": {"type": "SourceSilent", "t_ns": 0}}, "reason"),
        ({"body": {"type": "ClockEstimated", "t_ns": 0, "offset_ns": 0, "drift_ppm": math.inf, "uncertainty_ns": 0}},
         "drift_ppm"),
    ],
)  # fmt: skip
def test_a_wrong_envelope_or_event_is_named_with_its_path(change: dict[str, object], path: str) -> None:
    message = {"entoptic": wire.VERSION, "stream": 1, "sequence": 1, "replay": 5557}
    message["body"] = {"type": "SourceBack", "t_ns": 0}  # type: ignore[assignment]
    with pytest.raises(wire.InvalidMessageError, match=path):
        wire.decode_event(msgspec.msgpack.encode(message | change))


def test_an_event_on_the_state_socket_is_named() -> None:
    with pytest.raises(wire.InvalidMessageError):
        wire.decode_state(encode(wire.NumberedEvent(1, 1, 1, BlinkOnset(0, Eye.LEFT))))


@given(st.binary(max_size=300))
def test_any_bytes_give_a_named_error_or_a_record(message: bytes) -> None:
    for decode in DECODERS:
        with contextlib.suppress(wire.WireError):
            decode(message)


@given(
    st.one_of(
        states.map(wire.encode_state),
        numbered.map(encode),
        answers.map(wire.encode_answer),
        counts.map(wire.encode_request),
    ),
    st.data(),
)
def test_a_real_message_with_mutations_gives_a_named_error_or_a_record(real: bytes, data: st.DataObject) -> None:
    message = bytearray(real)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(message) - 1))
        match data.draw(st.sampled_from(("flip", "cut", "insert"))):
            case "flip":
                message[at] = data.draw(st.integers(0, 255))
            case "cut" if len(message) > 1:
                del message[at]
            case _:
                message[at:at] = data.draw(st.binary(min_size=1, max_size=3))
    for decode in DECODERS:
        with contextlib.suppress(wire.WireError):
            decode(bytes(message))


def test_a_reader_counts_what_it_refuses_and_lives_on() -> None:
    reader = wire.Reader(wire.decode_state)
    assert reader.read(b"") is None
    assert reader.read(b"\x80") is None
    assert reader.read(encode(wire.NumberedEvent(1, 1, 1, StreamEnded(0, 0)))) is None
    assert reader.read(wire.encode_state(STATE)) == STATE
    assert reader.refused == {"TruncatedMessageError": 1, "ForeignMessageError": 1, "InvalidMessageError": 1}
