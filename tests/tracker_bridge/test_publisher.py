"""The publisher, on real sockets."""

import gc
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from entoptic.tracker_bridge import publisher as publishing
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.access import OpenAddressError, ServerKeys
from entoptic.tracker_bridge.events import BlinkOnset, Event, Heartbeat, SourceBack, StreamEnded, StreamStarted
from entoptic.tracker_bridge.publisher import SEND_QUEUE, PortInUseError, Publisher
from entoptic.tracker_bridge.samples import Direction, Eye, EyeState, OneEyeState, Phase

ANY = "tcp://127.0.0.1:*"
PATIENCE_MS = 60_000
STATES_TO_FILL_ALL_QUEUES = 20_000
"""The kernel's buffers of a connection hold some 10,000 more than ZeroMQ's own queues."""
PROBE = Heartbeat(0, 0, 0)
"""What is published until a subscription has arrived; so is state 0. A subscriber passes both over."""


def never() -> bool:
    return False


def state(sequence: int) -> EyeState:
    one = OneEyeState(Phase.TRACKING, 4.1, 4.2, 0.97, 0.9, Direction(1.5, -2.5, sequence), sequence)
    return EyeState(sequence, sequence, one, one, Direction(1.5, -2.5, sequence), 250_000)


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    made = Publisher(ANY, ANY)
    yield made
    made.close()


class Subscriber:
    """A bare reader: no logic of ours between it and the socket."""

    def __init__(self, publisher: Publisher) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.states, self.events = (self._connect(zmq.SUB, address) for address in publisher.addresses)
        self.replay = self._connect(zmq.REQ, publisher.replay_address)

    def _connect(self, kind: int, address: str) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.RCVBUF, 65536)
        if kind == zmq.SUB:
            socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.connect(address)
        return socket

    def state(self) -> EyeState:
        while True:
            assert self.states.poll(PATIENCE_MS)
            got = wire.decode_state(self.states.recv())
            if got.sequence:
                return got

    def event(self) -> wire.NumberedEvent:
        while True:
            assert self.events.poll(PATIENCE_MS)
            got = wire.decode_event(self.events.recv())
            if got.event != PROBE:
                return got

    def ask(self, first: int) -> wire.Answer:
        self.replay.send(wire.encode_request(first))
        assert self.replay.poll(PATIENCE_MS)
        return wire.decode_answer(self.replay.recv())

    def close(self) -> None:
        self._context.destroy(linger=0)


@pytest.fixture
def subscribe(publisher: Publisher) -> Iterator[Callable[[], Subscriber]]:
    """Makes subscribers whose subscription has reached the publisher."""
    made: list[Subscriber] = []

    def connect() -> Subscriber:
        subscriber = Subscriber(publisher)
        made.append(subscriber)
        heard = [subscriber.states, subscriber.events]
        deadline = time.monotonic() + PATIENCE_MS / 1e3
        while heard:
            assert time.monotonic() < deadline
            publisher.publish_state(state(0))
            publisher.publish_event(PROBE)
            heard = [socket for socket in heard if not socket.poll(5)]
        return subscriber

    yield connect
    for subscriber in made:
        subscriber.close()


def resident_bytes() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) * 1024
    raise AssertionError


def test_a_port_in_use_is_named_with_the_remedy(publisher: Publisher) -> None:
    for taken in (*publisher.addresses, publisher.replay_address):
        with pytest.raises(PortInUseError, match=r"choose another port"):
            Publisher(taken, ANY)
        with pytest.raises(PortInUseError, match=re.escape(taken)):
            Publisher(ANY, ANY, replay_address=taken)


@pytest.mark.parametrize("open_one", range(3))
def test_no_socket_opens_to_others_without_keys(open_one: int) -> None:
    states, events, replay = ("tcp://*:*" if k == open_one else ANY for k in range(3))
    with pytest.raises(OpenAddressError, match=r"tcp://\*:\*.*entoptic keys"):
        Publisher(states, events, replay_address=replay)


def test_a_malformed_address_is_named() -> None:
    with pytest.raises(PortInUseError, match="5555"):
        Publisher("5555", ANY)
    for address in ("5557", "ipc:///tmp/lost-events"):
        with pytest.raises(PortInUseError, match=f"{address}: lost events go by TCP alone"):
            Publisher(ANY, ANY, replay_address=address)


def test_events_are_numbered_and_heartbeats_say_how_far(
    publisher: Publisher, subscribe: Callable[[], Subscriber]
) -> None:
    one = subscribe()
    published: list[Event] = [
        StreamStarted(0, None, "made up"),
        Heartbeat(1, 0, 0),
        BlinkOnset(2, Eye.LEFT),
        SourceBack(3),
        Heartbeat(4, 7, 1),
    ]
    for event in published:
        publisher.publish_event(event)
    got = [one.event() for _ in published]
    assert [each.event for each in got] == published
    assert [each.sequence for each in got] == [1, 1, 2, 3, 3]
    assert len({(each.stream, each.replay_port) for each in got}) == 1
    assert publisher.replay_address.endswith(f":{got[0].replay_port}")
    # What is kept is what was said, the heartbeats apart.
    answer = one.ask(0)
    assert isinstance(answer, wire.Replayed)
    assert [wire.decode_event(message) for message in answer.messages] == [got[0], got[2], got[3]]


def test_a_stalled_reader_starves_nobody_and_costs_bounded_memory(
    publisher: Publisher, subscribe: Callable[[], Subscriber]
) -> None:
    stalled, fast = subscribe(), subscribe()
    message = len(wire.encode_state(state(0)))
    assert message < 500
    got: list[int] = []
    before, batch = 0, 250
    for first in range(1, STATES_TO_FILL_ALL_QUEUES, batch):
        if first > 10 * batch and not before:
            gc.collect()
            before = resident_bytes()
        for sequence in range(first, first + batch):
            publisher.publish_state(state(sequence))
        got += [fast.state().sequence for _ in range(batch)]
    assert got == list(range(1, STATES_TO_FILL_ALL_QUEUES + 1))
    assert publisher.stalls >= 1
    assert resident_bytes() - before < 8e6
    # The stalled one finds the oldest states, for which there was room, and then new ones; the numbers show the gap.
    woken, newest = [stalled.state().sequence], STATES_TO_FILL_ALL_QUEUES
    while woken[-1] <= STATES_TO_FILL_ALL_QUEUES:
        newest += 1
        publisher.publish_state(state(newest))
        assert fast.state().sequence == newest
        while stalled.states.poll(5):
            woken.append(stalled.state().sequence)
    old = [sequence for sequence in woken if sequence <= STATES_TO_FILL_ALL_QUEUES]
    assert old[:SEND_QUEUE] == list(range(1, SEND_QUEUE + 1))
    assert old == sorted(set(old))
    assert len(old) < STATES_TO_FILL_ALL_QUEUES


def test_a_long_request_and_parts_harm_nobody(publisher: Publisher, subscribe: Callable[[], Subscriber]) -> None:
    one, other = subscribe(), subscribe()
    one.replay.send(b"x" * (publishing.MAX_REQUEST_BYTES + 1))
    other.replay.send_multipart([b"a", b"b"])
    assert other.replay.poll(PATIENCE_MS)
    assert isinstance(wire.decode_answer(other.replay.recv()), wire.BadRequest)
    assert not one.replay.poll(100)


def test_the_reader_in_the_documentation_reads(
    publisher: Publisher, subscribe: Callable[[], Subscriber], capsys: pytest.CaptureFixture[str]
) -> None:
    document = (Path(__file__).parents[2] / "docs" / "wire-format.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", document, re.DOTALL)
    for port, address in zip(("5555", "5556"), publisher.addresses, strict=True):
        assert f"tcp://127.0.0.1:{port}" in code
        code = code.replace(f"tcp://127.0.0.1:{port}", address)
    for event in (StreamStarted(0, None, "made up"), BlinkOnset(2, Eye.LEFT)):
        publisher.publish_event(event)
    ended = threading.Event()

    def publish() -> None:
        sequence = 0
        while not ended.is_set():
            publisher.publish_state(state(sequence))
            publisher.publish_event(Heartbeat(sequence, sequence, 0))
            sequence += 1
            if sequence == 100:
                publisher.publish_event(StreamEnded(sequence, sequence))
            time.sleep(0.01)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        exec(compile(code, "wire-format.md", "exec"), {})
    finally:
        ended.set()
        thread.join(20)
    printed = capsys.readouterr().out.splitlines()
    assert [line for line in printed if line.startswith("event")] == [
        "event 1 StreamStarted", "event 2 BlinkOnset", "event 3 StreamEnded"
    ]  # fmt: skip
    assert any(line.startswith("state") and "4.1 mm" in line for line in printed)


def test_a_port_that_is_taken_is_told_of_where_there_are_keys_too(publisher: Publisher, tmp_path: Path) -> None:
    public, secret = zmq.curve_keypair()
    with pytest.raises(PortInUseError):
        Publisher(ANY, publisher.addresses[1], keys=ServerKeys(public, secret, tmp_path))
