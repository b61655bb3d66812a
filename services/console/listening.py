"""A thread that reads sockets for the pages, and says so where something ends it before its time."""

from __future__ import annotations

import abc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import zmq

from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.publisher import KEEPALIVE


class Listening(abc.ABC):
    """Its `_run` is called by the thread, and returns when `_stop` is set."""

    def __init__(self) -> None:
        self.error: Exception | None = None
        """What ended the thread before its time."""
        self._stop = threading.Event()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._thread = threading.Thread(target=self._try_to_run, name=type(self).__name__.lower(), daemon=True)

    @contextmanager
    def _opening(self) -> Iterator[None]:
        """Around the making of sockets: where one cannot be made none is left. Raises zmq.ZMQError."""
        try:
            yield
        except zmq.ZMQError:
            self._context.destroy(linger=0)
            raise

    def _connected(self, address: str, keys: ClientKeys | None, queue: int | None = None) -> zmq.Socket[bytes]:
        """A socket that subscribes to nothing yet; `queue`: messages that wait there, the usual number unless given."""
        socket = self._context.socket(zmq.SUB)
        socket.setsockopt(zmq.LINGER, 0)
        if queue is not None:
            socket.setsockopt(zmq.RCVHWM, queue)
        for option, value in KEEPALIVE:
            socket.setsockopt(option, value)
        if keys is not None:
            keys.use(socket)
        socket.connect(address)
        return socket

    @abc.abstractmethod
    def _run(self) -> None: ...

    def _try_to_run(self) -> None:
        try:
            self._run()
        except Exception as error:
            self.error = error

    def close(self) -> None:
        """Ends the thread."""
        self._stop.set()
        self._thread.join()
        self._context.destroy(linger=0)
