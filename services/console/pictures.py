"""Frames' pictures from the worker, as JPEG: made once for all pages, and only while somebody looks.

Theory of operation: a worker makes the pictures that somebody has subscribed to. So one is asked for when it is due, by
subscribing, and where the next one is not due soon the subscription ends with the picture: the worker is spared the
rest. How soon they are due is for viewers.py to say: the more pages, the rarer.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import zmq

from entoptic.services.console import protocol
from entoptic.services.console.jpeg import jpeg
from entoptic.services.console.listening import Listening
from entoptic.services.ipc import messages
from entoptic.services.ipc.messages import DISPLAYED, PERCEIVED, MessageError, Picture
from entoptic.tracker_bridge.access import ClientKeys

SOON_S = 0.15
"""Pictures that are due within so long are subscribed to all the time: a subscription takes a frame to act."""
QUEUE = 2
"""Pictures of a kind that wait here: the newest one is taken."""
_POLL_MS = 20
KINDS = {protocol.PERCEIVED: PERCEIVED, protocol.DISPLAYED: DISPLAYED}

Wanted = Callable[[], dict[int, float]]
"""Which kinds of picture somebody watches, and how many seconds there are from one to the next."""


class Pictures(Listening):
    """Reads from its making until closed; its thread calls `on_picture` with the kind and what a page is sent."""

    def __init__(
        self,
        address: str,
        wanted: Wanted,
        on_picture: Callable[[int, bytes], None],
        peak_cd_m2: Callable[[], float],
        keys: ClientKeys | None = None,
    ) -> None:
        """Raises zmq.ZMQError for an address that is none."""
        super().__init__()
        self._wanted, self._on_picture, self._peak_cd_m2 = wanted, on_picture, peak_cd_m2
        with self._opening():
            self._streams = {kind: _Stream(self._connected(address, keys, QUEUE), KINDS[kind]) for kind in KINDS}
        self._thread.start()

    def _run(self) -> None:
        poller = zmq.Poller()
        for stream in self._streams.values():
            poller.register(stream.socket, zmq.POLLIN)
        while not self._stop.is_set():
            wanted = self._wanted()
            now_s = time.monotonic()
            for kind, stream in self._streams.items():
                every_s = wanted.get(kind)
                stream.subscribe(every_s is not None and (every_s <= SOON_S or now_s >= stream.due_s))
                if every_s is None:
                    stream.drain()
                elif now_s >= stream.due_s and (message := stream.newest()) is not None:
                    stream.due_s = max(stream.due_s + every_s, now_s + every_s / 2)
                    self._pass_on(kind, message)
            due = any(stream.due_s <= time.monotonic() for stream in self._streams.values())
            if due and wanted:
                poller.poll(_POLL_MS)
            else:
                self._stop.wait(_POLL_MS / 1000 / 2 if wanted else 0.1)

    def _pass_on(self, kind: int, message: bytes) -> None:
        try:
            picture = messages.decode(message, Picture)
            made = jpeg(picture, self._peak_cd_m2())
        except MessageError:
            return
        self._on_picture(kind, protocol.picture(kind, picture.frame, made))


class _Stream:
    """One kind of picture."""

    def __init__(self, socket: zmq.Socket[bytes], topic: bytes) -> None:
        self.socket, self._topic = socket, topic
        self.due_s = 0.0
        self._subscribed = False

    def subscribe(self, wanted: bool) -> None:
        if wanted != self._subscribed:
            self.socket.setsockopt(zmq.SUBSCRIBE if wanted else zmq.UNSUBSCRIBE, self._topic)
            self._subscribed = wanted

    def newest(self) -> bytes | None:
        """Of all that have come."""
        message = None
        while self.socket.poll(0):
            message = self.socket.recv_multipart()[-1]
        return message

    def drain(self) -> None:
        self.newest()
