"""Which event comes next and which to ask for again: the events' protocol without sockets and without a clock.

Messages, answers and times go in; events in order and requests come out. An event that does not follow the last one, or
a heartbeat that says there were more, shows a gap. Until it is closed, what comes by the socket is only noted for its
number, since the replay has it too. One request is out at a time. A reader that comes late has a gap from the first
event on, and so learns how the stream began. Events that cannot be had again, because the bridge keeps them no more or
does not answer, or because they cannot be read, are counted as lost: delivered and lost make up all there were.
"""

from __future__ import annotations

import dataclasses

from entoptic.tracker_bridge.wire import Event, Heartbeat, NumberedEvent

ANSWER_WITHIN_S = 2.0
"""Engineering choice: ten times what a busy machine needs."""
ATTEMPTS = 3
"""Requests in a row that brought nothing nearer, after which a gap is given up."""


@dataclasses.dataclass(frozen=True)
class Request:
    """All events of a stream from a number on."""

    stream: int
    replay_port: int
    first: int
    sent_s: float


@dataclasses.dataclass(frozen=True)
class Answer:
    """Messages from `first` on without a gap, None for one that cannot be read; no messages for an answer of no use.

    Where the bridge keeps no more what was asked for, the messages are the stream's first alone and `oldest` is the
    number from which on there are more.
    """

    messages: tuple[NumberedEvent | None, ...] = ()
    oldest: int = 0


class EventRecovery:
    """One reader's place in a bridge's stream of events."""

    def __init__(self) -> None:
        self.stream: int | None = None
        self.last = 0
        """The newest event that was delivered or given up."""
        self.known = 0
        """The newest event that there is, as far as was heard."""
        self.gaps = 0
        """How often events were missing that came after some which were there."""
        self.lost = 0
        """Events that could not be had again."""
        self._replay_port = 0
        self._request: Request | None = None
        self._attempts = 0

    def message(self, numbered: NumberedEvent) -> list[Event]:
        """What came by the socket; the event, if it is the next one."""
        if self.stream != numbered.stream:
            self.lost += self.known - self.last
            self.stream, self._replay_port = numbered.stream, numbered.replay_port
            self.last = self.known = self._attempts = 0
            self._request = None
        had_gap = self.known > self.last
        self.known = max(self.known, numbered.sequence)
        if not isinstance(numbered.event, Heartbeat) and numbered.sequence == self.last + 1:
            self.last += 1
            return [numbered.event]
        if not had_gap and self.known > self.last > 0:
            self.gaps += 1
        return []

    def answer(self, request: Request, answer: Answer) -> list[Event]:
        """What a request brought, however late: the events that were still missing."""
        if request.stream != self.stream:
            return []
        first = 1 if answer.oldest else request.first
        events: list[Event] = []
        if _fits(answer.messages, request.stream, first):
            for number, message in enumerate(answer.messages, first):
                if number != self.last + 1:
                    continue
                self.last = number
                if message is None:
                    self.lost += 1
                else:
                    events.append(message.event)
        if all(message is None or message.stream == request.stream for message in answer.messages):
            self._give_up(answer.oldest - 1)
        self.known = max(self.known, self.last)
        if request == self._request:
            self._close_request()
        return events

    def next_request(self, now_s: float) -> Request | None:
        """What to send now, if anything; gives a gap up after some requests that brought nothing."""
        if self._request is not None and now_s - self._request.sent_s >= ANSWER_WITHIN_S:
            self._close_request()
        if self._attempts >= ATTEMPTS:
            self._give_up(self.known)
            self._attempts = 0
        if self.stream is None or self._request is not None or self.known <= self.last:
            return None
        self._request = Request(self.stream, self._replay_port, self.last + 1, now_s)
        return self._request

    def _close_request(self) -> None:
        assert self._request is not None
        # What was asked for may have come by the socket meanwhile: the answer then brings nothing and is as it should.
        self._attempts = 0 if self.last >= self._request.first else self._attempts + 1
        self._request = None

    def _give_up(self, number: int) -> None:
        self.lost += max(number - self.last, 0)
        self.last = max(number, self.last)


def _fits(messages: tuple[NumberedEvent | None, ...], stream: int, first: int) -> bool:
    """Whether some can be read and all of these stand where they should: anything else comes from another bridge."""
    readable = [(number, message) for number, message in enumerate(messages, first) if message is not None]
    return bool(readable) and all(
        message.stream == stream and message.sequence == number for number, message in readable
    )
