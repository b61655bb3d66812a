"""The reader, against a publisher on real sockets and against a bare one that loses what a test wants lost."""

import functools
import itertools
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import zmq

from services import event_feed
from services import reader as reading
from services.reader import BridgeRestartedError, BridgeSilentError, StateReader
from tracker_bridge import replay, wire
from tracker_bridge.events import BlinkOnset, Event, Heartbeat, SourceSilent, StreamEnded, StreamStarted
from tracker_bridge.publisher import Publisher
from tracker_bridge.samples import Direction, Eye, EyeState, OneEyeState, Phase

ANY = "tcp://127.0.0.1:*"
MS = 1_000_000
PATIENCE_S = 20.0


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
        self.publisher.publish_event(event, wait=False, stopped=never)

    def start(self) -> None:
        self.event(StreamStarted(0, None, "made up"))

    def blinks(self, numbers: range) -> None:
        for number in numbers:
            self.event(BlinkOnset(number, Eye.LEFT))

    def beat(self) -> None:
        self.event(Heartbeat(0, 0, 0))

    def stream(self, count: int) -> threading.Thread:
        """Waits for a reader and publishes losslessly, from a thread of its own."""

        def work() -> None:
            self.publisher.wait_for_reader(never)
            self.publisher.publish_event(StreamStarted(0, count * 5 * MS, "made up"), wait=True, stopped=never)
            for sequence in range(count):
                self.publisher.publish_state(state(sequence), wait=True, stopped=never)
            self.publisher.publish_event(StreamEnded((count - 1) * 5 * MS, count), wait=True, stopped=never)
            self.publisher.wait_until_left(never)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        return thread


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    made = Bridge()
    yield made
    made.publisher.close()


@pytest.fixture
def connect() -> Iterator[Callable[..., StateReader]]:
    made: list[StateReader] = []

    def reader_of(addresses: tuple[str, str], *, newest_only: bool) -> StateReader:
        made.append(StateReader(*addresses, newest_only=newest_only))
        return made[-1]

    yield reader_of
    for reader in made:
        reader.close()


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


def test_a_slow_reader_by_recorded_time_gets_every_state(bridge: Bridge, connect: Callable[..., StateReader]) -> None:
    reader = connect(bridge.publisher.addresses, newest_only=False)
    thread = bridge.stream(12_000)
    started = reader.wait_for_start(never)
    assert started is not None
    assert (started.t_ns, started.t_end_ns) == (0, 12_000 * 5 * MS)
    newest = []
    for frame in range(0, 60_000, 40):
        got = reader.until(frame * MS, never)
        newest.append(None if got is None else got.t_ns // MS)
        if frame == 4000:
            time.sleep(0.5)  # the bridge runs into full queues
    assert newest == list(range(0, 60_000, 40))
    assert reader.until(10**12, never) is not None
    assert (reader.received, reader.skipped) == (12_000, 0)
    assert reader.ended == StreamEnded(11_999 * 5 * MS, 12_000)
    reader.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()  # the bridge stayed until its reader had left


def test_a_reader_of_the_newest_sees_the_newest_and_the_end(
    bridge: Bridge, connect: Callable[..., StateReader]
) -> None:
    reader = connect(bridge.publisher.addresses, newest_only=True)
    thread = bridge.stream(3000)
    assert reader.wait_for_start(never) is not None
    last: EyeState | None = None
    deadline = time.monotonic() + PATIENCE_S
    while reader.ended is None or last is None or last.sequence < 2999:
        assert time.monotonic() < deadline
        last = reader.newest() or last
        time.sleep(0.02)
    assert last == state(2999)
    assert reader.received + reader.skipped <= 3000  # what came before its first is not counted
    reader.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_a_late_reader_learns_how_the_stream_began(bridge: Bridge, connect: Callable[..., StateReader]) -> None:
    bridge.start()
    bridge.blinks(range(1, 6000))  # several helpings
    reader = connect(bridge.publisher.addresses, newest_only=True)
    beats = threading.Event()

    def beat() -> None:
        while not beats.wait(0.02):
            bridge.beat()

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        assert reader.wait_for_start(never, PATIENCE_S) == StreamStarted(0, None, "made up")
    finally:
        beats.set()
        thread.join()
    assert (reader.events.gaps, reader.events.lost) == (0, 0)


def started_reader(bridge: Bridge, connect: Callable[..., StateReader]) -> StateReader:
    reader = connect(bridge.publisher.addresses, newest_only=True)
    reader.subscribe()
    bridge.start()
    assert times(events_until(reader, 1, bridge.beat)) == [0]
    return reader


def test_no_event_is_lost_to_a_reader_that_stalls(bridge: Bridge, connect: Callable[..., StateReader]) -> None:
    reader = started_reader(bridge, connect)
    count = 15_000  # of so many bytes: more than all queues hold, ZeroMQ's and the kernel's
    for number in range(1, count + 1):
        bridge.event(SourceSilent(number, "nothing " * 80))
    assert bridge.publisher.stalls >= 1
    assert times(events_until(reader, count, bridge.beat)) == list(range(1, count + 1))
    assert reader.events.gaps >= 1
    assert (reader.events.lost, reader.refused) == (0, {})


def test_events_that_are_gone_are_counted_and_the_rest_comes(
    connect: Callable[..., StateReader], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay, "EventRing", functools.partial(replay.EventRing, 100))
    bridge = Bridge()
    bridge.start()
    bridge.blinks(range(1, 1000))  # 1000 events, of which 901 to 1000 are kept, and the first
    reader = connect(bridge.publisher.addresses, newest_only=True)
    reader.subscribe()
    assert times(events_until(reader, 101, bridge.beat)) == [0, *range(900, 1000)]
    assert reader.events.lost == 899
    bridge.publisher.close()


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


@pytest.fixture
def lossy() -> Iterator[LossyBridge]:
    made = LossyBridge()
    yield made
    made.context.destroy(linger=0)


def subscribed(lossy: LossyBridge, connect: Callable[..., StateReader], *, newest_only: bool = True) -> StateReader:
    reader = connect(lossy.addresses, newest_only=newest_only)
    reader.subscribe()
    lossy.wait_for_reader()
    return reader


def test_a_heartbeat_shows_a_gap_without_a_new_event(lossy: LossyBridge, connect: Callable[..., StateReader]) -> None:
    reader = subscribed(lossy, connect)
    lossy.events.send(lossy.message(1))
    assert times(events_until(reader, 1)) == [1]
    lossy.events.send(lossy.message(3, heartbeat=True))
    assert reader.events.read(int(PATIENCE_S * 1e3)) == []
    assert lossy.replay.poll(int(PATIENCE_S * 1e3))
    assert wire.decode_request(lossy.replay.recv()) == 2
    lossy.replay.send(wire.encode_answer(wire.Replayed((lossy.message(2), lossy.message(3)))))
    assert times(events_until(reader, 2)) == [2, 3]
    assert (reader.events.gaps, reader.events.lost) == (1, 0)


def test_events_come_once_and_in_order_whatever_the_sockets_do(
    lossy: LossyBridge, connect: Callable[..., StateReader]
) -> None:
    reader = subscribed(lossy, connect)
    for sequence in (1, 2, 5, 5, 4, 7, 2, 8):
        lossy.events.send(lossy.message(sequence))
    got = events_until(reader, 2)
    while not lossy.replay.poll(10):
        got += reader.events.read(10)
    assert wire.decode_request(lossy.replay.recv()) == 3
    # The first helping overlaps what comes by the socket meanwhile.
    lossy.replay.send(wire.encode_answer(wire.Replayed(tuple(map(lossy.message, (3, 4, 5))))))
    while not lossy.replay.poll(10):
        got += reader.events.read(10)
    assert wire.decode_request(lossy.replay.recv()) == 6
    lossy.replay.send(wire.encode_answer(wire.Replayed(tuple(map(lossy.message, (6, 7, 8, 9))))))
    lossy.events.send(lossy.message(9))
    lossy.events.send(lossy.message(10))
    got += events_until(reader, 10 - len(got))
    assert times(got) == list(range(1, 11))
    assert reader.events.gaps in (1, 2)  # number 7 may come when the first gap is closed
    assert reader.events.lost == 0


@pytest.mark.parametrize("answer", [None, b"garbage", wire.encode_answer(wire.Replayed(())), "wrong stream"])
def test_a_replay_that_is_of_no_use_is_given_up_and_new_events_come(
    lossy: LossyBridge,
    connect: Callable[..., StateReader],
    monkeypatch: pytest.MonkeyPatch,
    answer: bytes | str | None,
) -> None:
    monkeypatch.setattr(event_feed, "ANSWER_WITHIN_S", 0.05)
    if answer == "wrong stream":
        answer = wire.encode_answer(wire.Replayed((lossy.message(2, stream=9),)))
    reader = subscribed(lossy, connect)
    for sequence in (1, 4):
        lossy.events.send(lossy.message(sequence))
    got: list[Event] = []
    deadline = time.monotonic() + PATIENCE_S
    while reader.events.lost == 0:
        assert time.monotonic() < deadline
        got += reader.events.read(10)
        if lossy.replay.poll(0):
            lossy.replay.recv()
            lossy.replay.send(answer if isinstance(answer, bytes) else b"")
    lossy.events.send(lossy.message(5))
    got += events_until(reader, 1)
    assert times(got) == [1, 5]
    assert reader.events.lost == 3


def test_an_event_that_cannot_be_read_costs_no_other(lossy: LossyBridge, connect: Callable[..., StateReader]) -> None:
    reader = subscribed(lossy, connect)
    strange = lossy.message(2).replace(b"BlinkOnset", b"BlinkOddly")
    messages = [lossy.message(1), strange, lossy.message(3), lossy.message(4)]
    for message in messages:
        lossy.events.send(message)
    got: list[Event] = []
    while not lossy.replay.poll(10):
        got += reader.events.read(10)
    assert wire.decode_request(lossy.replay.recv()) == 2
    lossy.replay.send(wire.encode_answer(wire.Replayed(tuple(messages[1:]))))
    got += events_until(reader, 3 - len(got))
    assert times(got) == [1, 3, 4]
    assert reader.events.lost == 1


def test_another_bridge_in_its_place_is_read_from_its_beginning(connect: Callable[..., StateReader]) -> None:
    first = Bridge()
    addresses = first.publisher.addresses
    live = started_reader(first, connect)
    lossless = connect(addresses, newest_only=False)
    first.blinks(range(1, 50))
    assert times(events_until(live, 49)) == list(range(1, 50))
    until_it_has_begun = threading.Event()

    def beat() -> None:
        while not until_it_has_begun.wait(0.02):
            first.beat()

    thread = threading.Thread(target=beat)
    thread.start()
    assert lossless.wait_for_start(never) is not None
    until_it_has_begun.set()
    thread.join()
    first.publisher.close()

    second = Bridge(*addresses)
    second.event(StreamStarted(1000, None, "another"))
    second.blinks(range(1001, 1004))
    got = events_until(live, 4, second.beat)
    assert got[0] == StreamStarted(1000, None, "another")
    assert times(got[1:]) == [1001, 1002, 1003]
    assert live.events.lost == 0

    def beat_on() -> bool:
        second.beat()
        return False

    with pytest.raises(BridgeRestartedError, match="anew"):
        lossless.until(10**12, beat_on)
    second.publisher.close()


def test_garbage_on_the_sockets_is_counted_and_lived_through(
    lossy: LossyBridge, connect: Callable[..., StateReader]
) -> None:
    reader = subscribed(lossy, connect, newest_only=False)
    good = wire.encode_state(state(4))
    for message in (b"", b"\xc1", b"\x81\xa1a\x01", good[:-3], good):
        lossy.states.send(message)
    lossy.events.send(b"\x6enoise")
    lossy.events.send(wire.encode_event(StreamEnded(0, 5), stream=1, sequence=1, replay_port=lossy.port))
    assert reader.until(10**12, never) == state(4)
    assert (reader.received, reader.skipped) == (5, 0)
    assert reader.refused == {"TruncatedMessageError": 3, "ForeignMessageError": 2}


def test_states_that_were_lost_are_counted_and_do_not_hold_up_the_end(
    lossy: LossyBridge, connect: Callable[..., StateReader], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "TAIL_S", 0.2)
    reader = subscribed(lossy, connect, newest_only=False)
    for sequence in (2, 3, 7, 8):  # it came late: what was before its first is not counted
        lossy.states.send(wire.encode_state(state(sequence)))
    lossy.events.send(wire.encode_event(StreamEnded(0, 11), stream=1, sequence=1, replay_port=lossy.port))
    assert reader.until(10**12, never) == state(8)
    assert (reader.received, reader.skipped) == (4, 3 + 2)


def test_a_bridge_that_says_nothing_is_named(connect: Callable[..., StateReader]) -> None:
    reader = connect(("tcp://127.0.0.1:1", "tcp://127.0.0.1:2"), newest_only=False)
    with pytest.raises(BridgeSilentError, match=r"127\.0\.0\.1:1"):
        reader.wait_for_start(never, patience_s=0.3)


@pytest.mark.parametrize("addresses", [("nowhere", ANY), ("tcp://127.0.0.1:1", "tcp://127.0.0.1")])
def test_an_address_that_is_none_is_named(addresses: tuple[str, str]) -> None:
    with pytest.raises(BridgeSilentError, match="give an address like"):
        StateReader(*addresses, newest_only=False)


def test_heartbeats_keep_a_lossless_reader_waiting_and_silence_ends_it(
    lossy: LossyBridge, connect: Callable[..., StateReader], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "SILENCE_S", 0.4)
    reader = subscribed(lossy, connect, newest_only=False)
    beats = itertools.count()
    begun = time.monotonic()

    def beat_for_a_second() -> bool:
        if time.monotonic() - begun < 1.0:
            next(beats)
            lossy.events.send(lossy.message(0, heartbeat=True))
        return False

    with pytest.raises(BridgeSilentError, match="mid-stream"):
        reader.until(0, beat_for_a_second)
    assert time.monotonic() - begun > 1.3
    assert reader.silent_s > 0.4
    assert next(beats) > 0
