"""What a running process may be asked, by a person, the console or another process.

One request, one reply, each a msgpack map of one part: `{"do": "start recording", "name": "…"}` is answered by
`{"done": true, "reply": "…"}`. What each process understands is in services/live/requests.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgspec
import zmq

from entoptic.errors import EntopticError
from entoptic.tracker_bridge.access import ClientKeys, ServerKeys, refuse_open
from entoptic.tracker_bridge.publisher import PortInUseError, bind

PATIENCE_MS = 2000
"""Every process answers between two samples, or from a thread of its own."""
MAX_REQUEST_BYTES = 65_536
"""The longest request holds all settings: a tenth of it. A connection that sends more is closed."""

Asked = TypeVar("Asked")


class Reply(msgspec.Struct, frozen=True):
    """Whether it is done."""

    done: bool
    reply: str
    """For a person: what was done, or why not and what to do."""
    data: dict[str, Any] | None = None
    """For a program: of a status, its figures."""


class ControlError(EntopticError):
    """A process cannot be told: the message names it and the remedy."""


class Control(Generic[Asked]):
    """A process's ear for requests; `attend` it now and then, always from the same thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(
        self,
        address: str,
        understood: Any,
        answer: Callable[[Asked], Reply],
        keys: ServerKeys | None,
        context: zmq.Context[zmq.Socket[bytes]],
    ) -> None:
        """`understood`: the type of all requests, a union of records tagged by `do`."""
        if keys is None:
            refuse_open((address,))
        self._decoder: msgspec.msgpack.Decoder[Asked] = msgspec.msgpack.Decoder(understood)
        self._answer_to = answer
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

    def attend(self, wait_ms: int = 0) -> None:
        """Answers one request that has come: whoever asks without end holds nothing up. Where none has: 9 µs."""
        if self._socket.poll(wait_ms):
            reply = self._answer(b"".join(self._socket.recv_multipart()))
            self._socket.send(msgspec.msgpack.encode(reply))

    def _answer(self, message: bytes) -> Reply:
        try:
            request = self._decoder.decode(message)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            return Reply(False, f"not understood: {error}")
        return self._answer_to(request)

    def close(self) -> None:
        """Stops listening."""
        self._socket.close()


def ask(
    address: str, request: msgspec.Struct, keys: ClientKeys | None = None, *, patience_ms: int = PATIENCE_MS
) -> Reply:
    """Sends one request; the answer, be it a refusal. Raises ControlError where none comes."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = context.socket(zmq.REQ)
    socket.setsockopt(zmq.LINGER, 0)
    if keys is not None:
        keys.use(socket)
    try:
        socket.connect(address)
        socket.send(msgspec.msgpack.encode(request))
        if not socket.poll(patience_ms):
            raise ControlError(f"nobody answers at {address}: give the address that the process logs as `control`")
        return msgspec.msgpack.decode(socket.recv(), type=Reply)
    except zmq.ZMQError as error:
        raise ControlError(f"cannot connect to {address}: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ControlError(f"{address} is none of ours: {error}") from None
    finally:
        context.destroy(linger=0)


def tell(address: str, request: msgspec.Struct, keys: ClientKeys | None = None) -> Reply:
    """The same; raises ControlError where it is not done, with the process's own words."""
    reply = ask(address, request, keys)
    if not reply.done:
        raise ControlError(reply.reply)
    return reply
