"""Every event of a stream, once and in order: the sockets; `event_recovery` holds the protocol.

Nothing here waits for the replay: a request is out or its answer is in.
"""

from __future__ import annotations

import collections
import time

import zmq

from entoptic.services.event_recovery import Answer, EventRecovery, Request
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.publisher import KEEPALIVE
from entoptic.tracker_bridge.wire import Event

MESSAGES_A_READ = 100
"""Engineering choice: 3 ms of them, and yet 9,000 a second at 90 frames a second."""


class EventFeed:
    """The events socket of a bridge and, behind it, the one that replays."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], address: str, keys: ClientKeys | None) -> None:
        """Does not subscribe yet. Raises zmq.ZMQError for an address that is none."""
        self._context, self._address, self._keys = context, address, keys
        self.socket = self._open(zmq.SUB)
        """Where events come in, to subscribe and to watch."""
        self.socket.connect(address)
        self._requests: zmq.Socket[bytes] | None = None
        self._request: Request | None = None
        """The last one sent."""
        self._read_event = wire.Reader(wire.decode_event)
        self._read_answer = wire.Reader(wire.decode_answer)
        self._recovery = EventRecovery()
        self.received_s: float | None = None
        """When the bridge last said anything here, by `time.monotonic`."""

    def _open(self, kind: int) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        for option, value in KEEPALIVE:
            socket.setsockopt(option, value)
        if self._keys is not None:
            self._keys.use(socket)
        return socket

    @property
    def gaps(self) -> int:
        """How often events were missing that came after some which were there."""
        return self._recovery.gaps

    @property
    def lost(self) -> int:
        """Events that could not be had again."""
        return self._recovery.lost

    @property
    def refused(self) -> collections.Counter[str]:
        """How many messages were refused, by the error's name."""
        return self._read_event.refused + self._read_answer.refused

    def read(self, wait_ms: int = 0) -> list[Event]:
        """The events that have come, after waiting for one, or for a replay, for so long at most.

        Not all of them at once if they are many, so that nobody who reads events between frames misses a frame.
        """
        events: list[Event] = []
        for _ in range(MESSAGES_A_READ):
            if not (ready := self._poll(wait_ms)):
                break
            wait_ms = 0
            if self._requests is not None and self._requests in ready:
                assert self._request is not None
                events += self._recovery.answer(self._request, self._decoded(self._requests.recv()))
                self._send_request()
            if self.socket in ready:
                numbered = self._read_event.read(self.socket.recv())
                if numbered is not None:
                    self.received_s = time.monotonic()
                    events += self._recovery.message(numbered)
        self._send_request()
        return events

    def _poll(self, wait_ms: int) -> dict[zmq.Socket[bytes], int]:
        poller = zmq.Poller()
        for socket in (self.socket, self._requests):
            if socket is not None:
                poller.register(socket, zmq.POLLIN)
        return dict(poller.poll(wait_ms))

    def _send_request(self) -> None:
        request = self._recovery.next_request(time.monotonic())
        if request is None:
            return
        if self._requests is None or self._request is None or self._request.stream != request.stream:
            if self._requests is not None:
                self._requests.close()
            self._requests = self._open(zmq.REQ)
            # A request that got no answer neither blocks the next one nor is answered in its stead.
            self._requests.setsockopt(zmq.REQ_RELAXED, 1)
            self._requests.setsockopt(zmq.REQ_CORRELATE, 1)
            self._requests.connect(f"{_host(self._address)}:{request.replay_port}")
        self._requests.send(wire.encode_request(request.first))
        self._request = request

    def _decoded(self, message: bytes) -> Answer:
        match self._read_answer.read(message):
            case wire.Replayed(messages):
                return Answer(tuple(map(self._read_event.read, messages)))
            case wire.EventsGone(oldest, first):
                return Answer((self._read_event.read(first),), oldest)
            case _:
                return Answer()


def _host(address: str) -> str:
    """Where a bridge runs: a replay is always by TCP."""
    return address.rpartition(":")[0] if address.startswith("tcp://") else "tcp://127.0.0.1"
