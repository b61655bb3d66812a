"""The msgpack form of states, events and replays: what crosses from the bridge to any other process.

Theory of operation: every message is one ZeroMQ part (so that a slow reader may use CONFLATE) and one msgpack map with
`entoptic`, the version, and `body`, a record with its field names as keys; a record that may be one of several says
its class under `type`. States and events have a socket each. A state counts itself; a live one's envelope says when it
was sent. An event has its number in the
envelope, from 1 on, beside the stream's own number and the port where lost events are to be had again; a heartbeat has
the number of the last event, so that a gap shows without a new one. A reader checks in this order: is it msgpack, is
it ours, is it our version, does it have our types and ranges, is every number finite. Each failure has its own error.
docs/wire-format.md says it for other languages.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Callable
from typing import Annotated, Any, Final, Generic, TypeVar

import msgspec

from entoptic.tracker_bridge.events import (
    BlinkOffset,
    BlinkOnset,
    ClockJumped,
    Event,
    Heartbeat,
    PupilBack,
    PupilLost,
    SaccadeKind,
    SaccadeOffset,
    SourceBack,
    SourceSilent,
    StreamEnded,
    StreamStarted,
    TaskKind,
    TaskOutcome,
    TrackerStatus,
    TrackerTask,
)
from entoptic.tracker_bridge.samples import NS_PER_S, Count, Direction, Eye, EyeState, OneEyeState, Phase

__all__ = [
    "NS_PER_S",
    "VERSION",
    "Answer",
    "BadRequest",
    "BlinkOffset",
    "BlinkOnset",
    "ClockJumped",
    "Direction",
    "Event",
    "EventsGone",
    "Eye",
    "EyeState",
    "ForeignMessageError",
    "Heartbeat",
    "InvalidMessageError",
    "NumberedEvent",
    "OneEyeState",
    "Phase",
    "PupilBack",
    "PupilLost",
    "Reader",
    "Replayed",
    "SaccadeKind",
    "SaccadeOffset",
    "SourceBack",
    "SourceSilent",
    "StreamEnded",
    "StreamStarted",
    "TaskKind",
    "TaskOutcome",
    "TrackerStatus",
    "TrackerTask",
    "TruncatedMessageError",
    "WireError",
    "WrongVersionError",
    "decode_answer",
    "decode_event",
    "decode_request",
    "decode_sent_state",
    "decode_state",
    "encode_answer",
    "encode_event",
    "encode_request",
    "encode_state",
]

VERSION: Final = 2

Port = Annotated[int, msgspec.Meta(ge=1, le=65535)]

Record = TypeVar("Record")


class WireError(Exception):
    """A message cannot be read."""


class TruncatedMessageError(WireError):
    """The bytes end in the middle of the message, or are no msgpack at all."""


class ForeignMessageError(WireError):
    """Well-formed msgpack of somebody else."""


class WrongVersionError(WireError):
    """A message of another version of this program."""


class InvalidMessageError(WireError):
    """Ours, but a field is missing, of a wrong type, out of its range or not finite."""


class NumberedEvent(msgspec.Struct, frozen=True, rename={"replay_port": "replay", "event": "body"}):
    """An event and its place in the stream."""

    stream: Count
    """Drawn by lot when the bridge starts: another one means another bridge, whose events are numbered again."""
    sequence: Count
    """Of this event, from 1 on; of a heartbeat, that of the last event, or 0 before the first."""
    replay_port: Port
    """Where lost events are to be had again, at the host that this message came from."""
    event: Event


class Replayed(msgspec.Struct, frozen=True, tag=True):
    """The answer to a request for events that are still there."""

    messages: tuple[bytes, ...]
    """As they were published, from the number asked for on, without a gap: a first helping if they are many; none if
    the number has not been reached."""


class EventsGone(msgspec.Struct, frozen=True, tag=True):
    """The answer to a request for events that the bridge no longer keeps."""

    oldest: Count
    """The number of the oldest event that it still has, save for the first: ask from there."""
    first: bytes
    """The stream's first event as it was published, which is kept for ever."""


class BadRequest(msgspec.Struct, frozen=True, tag=True):
    """The answer to a request that cannot be read."""

    reason: str


Answer = Replayed | EventsGone | BadRequest


class _Envelope(msgspec.Struct, frozen=True):
    entoptic: int
    body: msgspec.Raw
    sent: int | None = None


class _Request(msgspec.Struct, frozen=True, rename={"first": "from"}):
    first: Count


_encoder = msgspec.msgpack.Encoder()
_envelope = msgspec.msgpack.Decoder(_Envelope)
_state = msgspec.msgpack.Decoder(EyeState)
_event = msgspec.msgpack.Decoder(NumberedEvent)
_answer: msgspec.msgpack.Decoder[Answer] = msgspec.msgpack.Decoder(Answer)
_request = msgspec.msgpack.Decoder(_Request)


def encode_state(state: EyeState, sent_ns: int | None = None) -> bytes:
    """One message, one part; `sent_ns`: now, on the bridge's clock, where the states are live."""
    if sent_ns is None:
        return _encoder.encode({"entoptic": VERSION, "body": state})
    return _encoder.encode({"entoptic": VERSION, "sent": sent_ns, "body": state})


def encode_event(event: Event, *, stream: int, sequence: int, replay_port: int) -> bytes:
    """One message, one part; see NumberedEvent for the numbers."""
    return _encoder.encode(
        {"entoptic": VERSION, "stream": stream, "sequence": sequence, "replay": replay_port, "body": event}
    )


def encode_answer(answer: Answer) -> bytes:
    """What the bridge says to somebody who asked for events."""
    return _encoder.encode({"entoptic": VERSION, "body": answer})


def encode_request(first: int) -> bytes:
    """Asks for all events from this number on."""
    return _encoder.encode({"from": first})


def decode_state(message: bytes) -> EyeState:
    """The state in a message. Raises a WireError that says what is wrong."""
    return decode_sent_state(message)[0]


def decode_sent_state(message: bytes) -> tuple[EyeState, int | None]:
    """The state in a message, and when the bridge sent it, ns of its clock, where it says so. Raises a WireError."""
    envelope = _open(message)
    state = _decode(envelope.body, _state)
    _refuse_unless_finite(state, "$")
    return state, envelope.sent


def decode_event(message: bytes) -> NumberedEvent:
    """The event in a message, with its place. Raises a WireError that says what is wrong."""
    _open(message)
    numbered = _decode(message, _event)
    _refuse_unless_finite(numbered.event, "$")
    return numbered


def decode_answer(message: bytes) -> Answer:
    """The answer in a message. Raises a WireError that says what is wrong."""
    return _decode(_open(message).body, _answer)


def decode_request(message: bytes) -> int:
    """The number of the first event asked for. Raises a WireError that says what is wrong."""
    return _decode(message, _request).first


class Reader(Generic[Record]):
    """Reads messages of one socket and lives on: a bad message is counted by the name of its error, never raised."""

    def __init__(self, decode: Callable[[bytes], Record]) -> None:
        self._decode = decode
        self.refused: collections.Counter[str] = collections.Counter()
        """How many messages were refused, by the error's name."""

    def read(self, message: bytes) -> Record | None:
        """The record in a message, or None for one that was refused."""
        try:
            return self._decode(message)
        except WireError as error:
            self.refused[type(error).__name__] += 1
            return None


def _open(message: bytes) -> _Envelope:
    """A message of this program and version."""
    try:
        envelope = _envelope.decode(message)
    except msgspec.ValidationError as error:
        raise ForeignMessageError(f"not a message of this program: {error}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise TruncatedMessageError(f"{len(message)} bytes that are no whole message: {error}") from None
    if envelope.entoptic != VERSION:
        raise WrongVersionError(
            f"message of version {envelope.entoptic}, this program reads version {VERSION}: "
            "run the bridge and its reader from the same release"
        )
    return envelope


def _decode(message: bytes | msgspec.Raw, decoder: msgspec.msgpack.Decoder[Record]) -> Record:
    try:
        return decoder.decode(message)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InvalidMessageError(str(error)) from None


def _refuse_unless_finite(value: Any, path: str) -> None:
    """Bounds let NaN through, since it compares false to everything."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InvalidMessageError(f"{value} is no finite number - at `{path}`")
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            _refuse_unless_finite(getattr(value, field), f"{path}.{field}")
