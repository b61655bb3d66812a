"""Requests to other processes whose answers are awaited by and by, so that nothing else waits for them."""

from __future__ import annotations

import time
from typing import TypeAlias

import msgspec
import zmq

from entoptic.services.control import Reply

Context: TypeAlias = "zmq.Context[zmq.Socket[bytes]]"


class Asked:
    """One request on its way. A process that is not there yet is asked as soon as it is."""

    def __init__(self, context: Context, address: str, request: msgspec.Struct) -> None:
        self.request = request
        self.since_s = time.monotonic()
        self._socket = context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RECONNECT_IVL, 50)
        self._socket.setsockopt(zmq.RECONNECT_IVL_MAX, 200)
        self._socket.connect(address)
        self._socket.send(msgspec.msgpack.encode(request))

    def reply(self) -> Reply | None:
        """The answer, None while there is none; asked no more once it came."""
        if not self._socket.poll(0):
            return None
        try:
            return msgspec.msgpack.decode(self._socket.recv(), type=Reply)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            return Reply(False, f"an answer that cannot be read: {error}")

    @property
    def age_s(self) -> float:
        """Since it was asked."""
        return time.monotonic() - self.since_s

    def close(self) -> None:
        """Awaits it no more."""
        self._socket.close()
