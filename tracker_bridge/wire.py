"""The msgpack form of states and events: what crosses from the bridge to any other process.

Theory of operation: every message is one ZeroMQ part (so that a slow reader may use CONFLATE) and one msgpack map
`{"entoptic": VERSION, "body": …}`. States and events have a socket each. The body is the record of samples.py with its
field names as keys; an event also says its class under "type". A reader checks in this order: is it msgpack, is it
ours, is it our version, does it have our types and ranges, is every number finite. Each failure has its own error.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Callable
from typing import Final, Generic, TypeVar

import msgspec

from tracker_bridge.samples import (
    NS_PER_S,
    BlinkOffset,
    BlinkOnset,
    Direction,
    Event,
    Eye,
    EyeState,
    OneEyeState,
    Phase,
    PupilBack,
    PupilLost,
    StreamEnded,
    StreamStarted,
)

__all__ = [
    "NS_PER_S",
    "VERSION",
    "BlinkOffset",
    "BlinkOnset",
    "Direction",
    "Event",
    "Eye",
    "EyeState",
    "ForeignMessageError",
    "InvalidMessageError",
    "OneEyeState",
    "Phase",
    "PupilBack",
    "PupilLost",
    "Reader",
    "StreamEnded",
    "StreamStarted",
    "TruncatedMessageError",
    "WireError",
    "WrongVersionError",
    "decode_event",
    "decode_state",
    "encode",
]

VERSION: Final = 1

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


class _Envelope(msgspec.Struct, frozen=True):
    entoptic: int
    body: msgspec.Raw


_encoder = msgspec.msgpack.Encoder()
_envelope = msgspec.msgpack.Decoder(_Envelope)
_state = msgspec.msgpack.Decoder(EyeState)
_event: msgspec.msgpack.Decoder[Event] = msgspec.msgpack.Decoder(Event)


def encode(record: EyeState | Event) -> bytes:
    """One message, one part."""
    return _encoder.encode({"entoptic": VERSION, "body": record})


def decode_state(message: bytes) -> EyeState:
    """The state in a message. Raises a WireError that says what is wrong."""
    return _decode_body(message, _state)


def decode_event(message: bytes) -> Event:
    """The event in a message. Raises a WireError that says what is wrong."""
    return _decode_body(message, _event)


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


def _decode_body(message: bytes, decoder: msgspec.msgpack.Decoder[Record]) -> Record:
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
    try:
        record = decoder.decode(envelope.body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InvalidMessageError(str(error)) from None
    _refuse_unless_finite(record, "$")
    return record


def _refuse_unless_finite(value: object, path: str) -> None:
    """Bounds let NaN through, since it compares false to everything."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InvalidMessageError(f"{value} is no finite number - at `{path}`")
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            _refuse_unless_finite(getattr(value, field), f"{path}.{field}")
