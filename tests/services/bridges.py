"""Bridges for readers' tests: a publisher on real sockets, and a bare one that loses what a test wants lost."""

import threading
import time
from collections.abc import Callable

import zmq

from entoptic.services.reader import StateReader
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.events import BlinkOnset, Event, Heartbeat, StreamEnded, StreamStarted
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.samples import Direction, Eye, EyeState, OneEyeState, Phase

ANY = "tcp://127.0.0.1:*"
MS = 1_000_000
PATIENCE_S = 60.0


def never() -> bool:
    return False


def state(sequence: int) -> EyeState:
    one = OneEyeState(Phase.TRACKING, 4.0, 4.0, 1.0, None, None)
    return EyeState(sequence, sequence * 5 * MS, one, one, Direction(sequence % 10, -1.0, sequence * 5 * MS))


class Bridge:
    """A publisher, and what a bridge does with it."""

    def __init__(self, states: str = ANY, events: str = ANY) -> None:
        self.publisher = Publisher(states, events)

    def event(self, event: Event) -> None:
        self.publisher.publish_event(event)

    def start(self) -> None:
        self.event(StreamStarted(0, None, "made up"))

    def blinks(self, numbers: range) -> None:
        for number in numbers:
            self.event(BlinkOnset(number, Eye.LEFT))

    def beat(self) -> None:
        self.event(Heartbeat(0, 0, 0))

    def stream(self, count: int) -> threading.Thread:
        """Publishes once somebody reads, from a thread of its own, and says to the end that it is there."""

        def work() -> None:
            while not self.publisher.readers:
                self.beat()
                time.sleep(0.01)
            self.publisher.publish_event(StreamStarted(0, count * 5 * MS, "made up"))
            for sequence in range(count):
                self.publisher.publish_state(state(sequence))
            self.publisher.publish_event(StreamEnded((count - 1) * 5 * MS, count))
            while self.publisher.readers:
                # One whose queue was full has missed it.
                self.publisher.publish_state(state(count - 1))
                self.beat()
                time.sleep(0.01)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        return thread


def events_until(reader: StateReader, count: int, meanwhile: Callable[[], None] = lambda: None) -> list[Event]:
    """Reads the feed until it has given so many events."""
    events: list[Event] = []
    deadline = time.monotonic() + PATIENCE_S
    while len(events) < count:
        assert time.monotonic() < deadline, f"{len(events)} of {count} events"
        meanwhile()
        events += reader.events.read(20)
    return events


def times(events: list[Event]) -> list[int]:
    return [event.t_ns for event in events]


def started_reader(bridge: Bridge, connect: Callable[..., StateReader]) -> StateReader:
    reader = connect(bridge.publisher.addresses)
    reader.subscribe()
    bridge.start()
    assert times(events_until(reader, 1, bridge.beat)) == [0]
    return reader


class LossyBridge:
    """Sockets of a test's own, to say what no publisher says."""

    def __init__(self) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.states, self.events, self.replay = (self.context.socket(kind) for kind in (zmq.XPUB, zmq.XPUB, zmq.REP))
        for socket in (self.states, self.events, self.replay):
            socket.bind(ANY)
        self.addresses = tuple(socket.getsockopt_string(zmq.LAST_ENDPOINT) for socket in (self.states, self.events))
        self.port = int(self.replay.getsockopt_string(zmq.LAST_ENDPOINT).rpartition(":")[2])

    def wait_for_reader(self) -> None:
        for socket in (self.states, self.events):
            assert socket.poll(int(PATIENCE_S * 1e3))
            socket.recv()

    def message(self, sequence: int, *, stream: int = 1, heartbeat: bool = False) -> bytes:
        event: Event = Heartbeat(0, 0, 0) if heartbeat else BlinkOnset(sequence, Eye.LEFT)
        return wire.encode_event(event, stream=stream, sequence=sequence, replay_port=self.port)


def subscribed(lossy: LossyBridge, connect: Callable[..., StateReader]) -> StateReader:
    reader = connect(lossy.addresses)
    reader.subscribe()
    lossy.wait_for_reader()
    return reader
