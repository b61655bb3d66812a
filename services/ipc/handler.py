"""Answers requests, in the process that is asked (client.py is the other end)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgspec
import zmq

from entoptic.services.ipc.client import Context, Reply
from entoptic.tracker_bridge.access import ServerKeys, refuse_open
from entoptic.tracker_bridge.publisher import PortInUseError, bind

MAX_REQUEST_BYTES = 65_536
"""The longest request holds all settings: a tenth of it. A connection that sends more is closed."""

Request = TypeVar("Request")


class RequestHandler(Generic[Request]):
    """`serve` it now and then, always from the same thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(
        self,
        address: str,
        understood: Any,
        answer: Callable[[Request], Reply],
        keys: ServerKeys | None,
        context: Context,
    ) -> None:
        """`understood`: the type of all requests, a union of records tagged by `do`."""
        if keys is None:
            refuse_open((address,))
        self._decoder: msgspec.msgpack.Decoder[Request] = msgspec.msgpack.Decoder(understood)
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

    def serve(self, wait_ms: int = 0) -> None:
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
