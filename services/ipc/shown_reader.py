"""What a worker says of its frames, for somebody who looks now and then."""

from __future__ import annotations

import contextlib

import zmq

from entoptic.services.ipc.client import Context
from entoptic.services.ipc.messages import SHOWN, MessageError, Shown, decode
from entoptic.tracker_bridge.access import ClientKeys


class ShownReader:
    """Hears the topic `shown` of a worker's frames."""

    def __init__(self, context: Context, address: str, keys: ClientKeys | None = None) -> None:
        self._socket = context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVHWM, 10)
        if keys is not None:
            keys.use(self._socket)
        self._socket.setsockopt(zmq.SUBSCRIBE, SHOWN)
        self._socket.connect(address)

    def newest(self, wait_ms: int = 0) -> Shown | None:
        """The newest that came since the last call, None where none did."""
        found = None
        while self._socket.poll(wait_ms if found is None else 0):
            parts = self._socket.recv_multipart()
            with contextlib.suppress(MessageError):
                found = decode(parts[-1], Shown)
        return found

    def close(self) -> None:
        """Hears no more."""
        self._socket.close()
