"""Every event of a stream, once and in order: what the events socket lost is asked for again.

Theory of operation: an event that does not follow the last one, or a heartbeat that says there were more, shows a gap.
Until it is closed, what comes by the socket is only noted for its number, since the replay has it too. Nothing here
waits for the replay: a request is out or its answer is in. A reader that comes late has a gap from the first event on,
and so learns how the stream began. Events that cannot be had again, because the bridge keeps them no more or does not
answer, or because they cannot be read, are counted as lost.
"""

from __future__ import annotations

import collections
import dataclasses
import time

import zmq

from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.publisher import KEEPALIVE
from entoptic.tracker_bridge.wire import Event, Heartbeat, NumberedEvent

ANSWER_WITHIN_S = 2.0
"""Engineering choice: ten times what a busy machine needs."""
ATTEMPTS = 3
"""Requests without an answer, after which a gap is given up."""

MESSAGES_A_READ = 100
"""Engineering choice: 3 ms of them, and yet 9,000 a second at 90 frames a second."""


@dataclasses.dataclass
class _Stream:
    """One run of a bridge, as far as it is known."""

    number: int
    address: str
    """Where its lost events are to be had."""
    last: int = 0
    """The newest event that was passed on."""
    known: int = 0
    """The newest event there is."""
    attempts: int = 0
    asked_s: float | None = None
    """When the request went out that has no answer yet."""


class EventFeed:
    """The events socket of a bridge and, behind it, the one that replays."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], address: str, keys: ClientKeys | None) -> None:
        """Does not subscribe yet. Raises zmq.ZMQError for an address that is none."""
        self._context, self._address, self._keys = context, address, keys
        self._socket = self._open(zmq.SUB)
        self._socket.connect(address)
        self._requests: zmq.Socket[bytes] | None = None
        self._read_event = wire.Reader(wire.decode_event)
        self._read_answer = wire.Reader(wire.decode_answer)
        self._stream: _Stream | None = None
        self.heard_s: float | None = None
        """When the bridge last said anything here, by `time.monotonic`."""
        self.gaps = 0
        """How often events were missing that came after some which were there."""
        self.lost = 0
        """Events that could not be had again."""

    def _open(self, kind: int) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        for option, value in KEEPALIVE:
            socket.setsockopt(option, value)
        if self._keys is not None:
            self._keys.use(socket)
        return socket

    @property
    def socket(self) -> zmq.Socket[bytes]:
        """Where events come in, to subscribe and to watch."""
        return self._socket

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
            if self._requests in ready:
                events += self._take_answer()
            if self._socket in ready:
                numbered = self._read_event.read(self._socket.recv())
                if numbered is not None:
                    events += self._take(numbered)
        self._ask_for_missing()
        return events

    def _poll(self, wait_ms: int) -> dict[zmq.Socket[bytes], int]:
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        if self._requests is not None:
            poller.register(self._requests, zmq.POLLIN)
        return dict(poller.poll(wait_ms))

    def _take(self, numbered: NumberedEvent) -> list[Event]:
        self.heard_s = time.monotonic()
        stream = self._stream
        if stream is None or stream.number != numbered.stream:
            stream = self._begin(numbered)
        had_gap = stream.known > stream.last
        stream.known = max(stream.known, numbered.sequence)
        if not isinstance(numbered.event, Heartbeat) and numbered.sequence == stream.last + 1:
            stream.last += 1
            return [numbered.event]
        if not had_gap and stream.known > stream.last > 0:
            self.gaps += 1
        return []

    def _begin(self, numbered: NumberedEvent) -> _Stream:
        if self._stream is not None:
            self.lost += self._stream.known - self._stream.last
        self._close_requests()
        address = f"{_host(self._address)}:{numbered.replay_port}"
        self._stream = _Stream(numbered.stream, address)
        return self._stream

    def _close_requests(self) -> None:
        if self._requests is not None:
            self._requests.close()
            self._requests = None

    def _ask_for_missing(self) -> None:
        """Sends a request unless one is out; gives a gap up after some without an answer."""
        stream = self._stream
        if stream is None or stream.known <= stream.last:
            return
        if stream.asked_s is not None:
            if time.monotonic() - stream.asked_s < ANSWER_WITHIN_S:
                return
            stream.attempts += 1
        if stream.attempts >= ATTEMPTS:
            self.lost += stream.known - stream.last
            stream.last, stream.attempts, stream.asked_s = stream.known, 0, None
            self._close_requests()
            return
        if self._requests is None:
            self._requests = self._open(zmq.REQ)
            # A request that got no answer neither blocks the next one nor is answered in its stead.
            self._requests.setsockopt(zmq.REQ_RELAXED, 1)
            self._requests.setsockopt(zmq.REQ_CORRELATE, 1)
            self._requests.connect(stream.address)
        self._requests.send(wire.encode_request(stream.last + 1))
        stream.asked_s = time.monotonic()

    def _take_answer(self) -> list[Event]:
        assert self._requests is not None
        assert self._stream is not None
        stream, before = self._stream, self._stream.last
        match self._read_answer.read(self._requests.recv()):
            case wire.Replayed(messages):
                events = self._replayed(messages)
            case wire.EventsGone(oldest, first):
                events = self._replayed((first,))
                self.lost += max(oldest - 1 - stream.last, 0)
                stream.last = max(oldest - 1, stream.last)
            case _:
                events = []
        # An answer that is of no use is as good as none.
        stream.attempts, stream.asked_s = 0 if stream.last > before else stream.attempts + 1, None
        self._ask_for_missing()
        return events

    def _replayed(self, messages: tuple[bytes, ...]) -> list[Event]:
        assert self._stream is not None
        events: list[Event] = []
        unread = 0
        for message in messages:
            numbered = self._read_event.read(message)
            if numbered is None:
                # Passed over as soon as the next one shows that it stood in its place.
                unread += 1
            elif numbered.stream == self._stream.number:
                self._stream.known = max(self._stream.known, numbered.sequence)
                if numbered.sequence == self._stream.last + unread + 1:
                    self.lost += unread
                    self._stream.last, unread = numbered.sequence, 0
                    events.append(numbered.event)
        return events


def _host(address: str) -> str:
    """Where a bridge runs: a replay is always by TCP."""
    return address.rpartition(":")[0] if address.startswith("tcp://") else "tcp://127.0.0.1"
