"""What a person, or a program, may ask a running bridge to do with its tracker.

One request, one reply, each a msgpack map of one part: `{"do": "start recording", "name": "…"}` is answered by
`{"done": true, "reply": "…"}` as soon as the tracker was told. What became of it comes as a TrackerTask event.
"""

from __future__ import annotations

import enum
from typing import Protocol, runtime_checkable

import msgspec
import zmq

from tracker_bridge.access import ClientKeys, ServerKeys, refuse_open
from tracker_bridge.publisher import MAX_REQUEST_BYTES, PortInUseError, bind
from tracker_bridge.source import SourceError

PATIENCE_MS = 2000
"""A bridge answers between two samples."""


class Task(enum.StrEnum):
    """What a tracker can be asked to do."""

    START_RECORDING = "start recording"
    STOP_RECORDING = "stop recording"
    START_CALIBRATION = "start calibration"
    STOP_CALIBRATION = "stop calibration"


class Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One wish."""

    do: Task
    name: str = ""
    """What a recording is to be called."""


class Reply(msgspec.Struct, frozen=True):
    """Whether the tracker was told."""

    done: bool
    reply: str
    """For a person."""


@runtime_checkable
class TaskedTracker(Protocol):
    """A source whose tracker records and calibrates by itself."""

    def start_recording(self, name: str = "") -> None:
        """Has it record."""

    def stop_recording(self) -> None:
        """Has it end its recording."""

    def start_calibration(self) -> None:
        """Has it calibrate gaze."""

    def stop_calibration(self) -> None:
        """Has it end its calibration."""


class ControlError(Exception):
    """A bridge cannot be told: the message names it and the remedy."""


class Control:
    """The bridge's ear for requests; `attend` it now and then from the bridge's own thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(self, address: str, source: object, keys: ServerKeys | None, context: zmq.Context[zmq.Socket[bytes]]):
        if keys is None:
            refuse_open((address,))
        self._source = source
        self._socket = context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
        if keys is not None:
            keys.use(self._socket)
        try:
            bind(self._socket, address)
        except PortInUseError:
            self._socket.close()
            raise

    @property
    def address(self) -> str:
        """Where requests are to be sent."""
        return self._socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def attend(self) -> None:
        """Answers one request that has come: whoever asks without end holds nothing up. Where none has: 9 µs."""
        if self._socket.poll(0):
            reply = self._answer(b"".join(self._socket.recv_multipart()))
            self._socket.send(msgspec.msgpack.encode(reply))

    def _answer(self, message: bytes) -> Reply:
        try:
            request = msgspec.msgpack.decode(message, type=Request)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            return Reply(False, f"not understood: {error}")
        if not isinstance(self._source, TaskedTracker):
            return Reply(False, "this source neither records nor calibrates by itself: run the bridge on `capture`")
        try:
            match request.do:
                case Task.START_RECORDING:
                    self._source.start_recording(request.name)
                case Task.STOP_RECORDING:
                    self._source.stop_recording()
                case Task.START_CALIBRATION:
                    self._source.start_calibration()
                case Task.STOP_CALIBRATION:
                    self._source.stop_calibration()
        except SourceError as error:
            return Reply(False, str(error))
        return Reply(True, f"told to {request.do}; the outcome comes as an event")

    def close(self) -> None:
        """Stops listening."""
        self._socket.close()


def tell(address: str, request: Request, keys: ClientKeys | None = None) -> str:
    """Sends a bridge one request; its words. Raises ControlError where it does not do it, or does not answer."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = context.socket(zmq.REQ)
    socket.setsockopt(zmq.LINGER, 0)
    if keys is not None:
        keys.use(socket)
    try:
        socket.connect(address)
        socket.send(msgspec.msgpack.encode(request))
        if not socket.poll(PATIENCE_MS):
            raise ControlError(f"nobody answers at {address}: give the address that the bridge logs as `control`")
        reply = msgspec.msgpack.decode(socket.recv(), type=Reply)
    except zmq.ZMQError as error:
        raise ControlError(f"cannot connect to {address}: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ControlError(f"{address} is no bridge's: {error}") from None
    finally:
        context.destroy(linger=0)
    if not reply.done:
        raise ControlError(reply.reply)
    return reply.reply
