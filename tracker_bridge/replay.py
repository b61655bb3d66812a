"""Events kept for readers that missed them, in bounded memory, by their number."""

from __future__ import annotations

import threading

from entoptic.tracker_bridge import wire

MAX_EVENTS = 100_000
"""Engineering choice: three hours at ten events a second, which is what fixations with microsaccades, blinks and a
clock report each second come to."""
MAX_BYTES = 16_000_000
"""For MAX_EVENTS at 160 bytes, which no event but a tracker's own words exceeds."""
BYTES_A_MESSAGE = 40
"""What Python keeps beside the bytes of a message: a bytes object's head, and its place in the ring."""
ANSWER_BYTES = 32_000
"""One helping: about 250 events, so that a reader between frames never has more than some 3 ms to take in."""


class EventRing:
    """The last events, each as it was published, and the very first. Safe to use from several threads.

    It holds at most MAX_EVENTS events and MAX_BYTES bytes; the older ones go.
    """

    def __init__(self, max_events: int = MAX_EVENTS, max_bytes: int = MAX_BYTES) -> None:
        self._slots: list[bytes | None] = [None] * max_events
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._oldest, self._last = 1, 0
        self._first = b""
        self.bytes = 0
        """What it holds, without the first event."""

    def add(self, message: bytes) -> None:
        """Keeps the next event; the first has the number 1."""
        with self._lock:
            self._first = self._first or message
            self._last += 1
            if self._last - self._oldest == len(self._slots):
                self._forget_oldest()
            self._slots[self._last % len(self._slots)] = message
            self.bytes += len(message) + BYTES_A_MESSAGE
            while self.bytes > self._max_bytes:
                self._forget_oldest()

    def _forget_oldest(self) -> None:
        slot = self._oldest % len(self._slots)
        message = self._slots[slot]
        assert message is not None
        self.bytes -= len(message) + BYTES_A_MESSAGE
        self._slots[slot] = None
        self._oldest += 1

    @property
    def last(self) -> int:
        """The number of the newest event; 0 before the first."""
        return self._last

    def since(self, first: int) -> wire.Answer:
        """The events from a number on, or where to ask instead. Number 0 is as good as 1."""
        with self._lock:
            sequence = max(first, 1)
            if sequence < self._oldest:
                return wire.EventsGone(self._oldest, self._first)
            messages: list[bytes] = []
            size = 0
            while sequence <= self._last and size < ANSWER_BYTES:
                message = self._slots[sequence % len(self._slots)]
                assert message is not None
                messages.append(message)
                size += len(message)
                sequence += 1
            return wire.Replayed(tuple(messages))


def answer(ring: EventRing, request: bytes) -> bytes:
    """What to say to whoever sent this."""
    try:
        found: wire.Answer = ring.since(wire.decode_request(request))
    except wire.WireError as error:
        found = wire.BadRequest(f'{error}; ask with a msgpack map {{"from": number of the first event wanted}}')
    return wire.encode_answer(found)
