"""The light of the scene that a worker renders, as it falls into simulated eyes."""

from __future__ import annotations

import zmq

from entoptic.services.ipc.messages import SHOWN, MessageError, Shown, decode
from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.publisher import KEEPALIVE
from entoptic.tracker_bridge.source import SourceError

QUEUE = 2
"""Frames that wait; those that find it full are lost, and a tenth of a second later the light is right again."""


class SceneLight:
    """Listens to a worker that may be there or not, come later, or be started again. Raises SourceError."""

    def __init__(self, address: str, keys: ClientKeys | None, context: zmq.Context[zmq.Socket[bytes]]) -> None:
        self._socket = context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVHWM, QUEUE)
        for option, value in KEEPALIVE:
            self._socket.setsockopt(option, value)
        if keys is not None:
            keys.use(self._socket)
        self._socket.setsockopt(zmq.SUBSCRIBE, SHOWN)
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self._socket.close()
            raise SourceError(
                f"cannot connect to {address}: {error.strerror}; give the address that the worker logs as `frames`"
            ) from None

    def newest(self, wait_ms: int = 0) -> float | None:
        """The mean luminance before the eyes in the newest frame since the last call, cd/m²."""
        light: float | None = None
        if wait_ms:
            self._socket.poll(wait_ms)
        while self._socket.poll(0):
            try:
                _, message = self._socket.recv_multipart()
                eyes = decode(message, Shown).eyes
            except (MessageError, ValueError):
                continue
            if eyes:
                light = sum(eye.mean_cd_m2 for eye in eyes) / len(eyes)
        return light

    def close(self) -> None:
        """Listens no more."""
        self._socket.close()
