"""States, always the newest; and what a reader says when a bridge does not."""

import threading
import time
from collections.abc import Callable

import pytest
from bridges import (
    ANY,
    PATIENCE_S,
    Bridge,
    LossyBridge,
    events_until,
    never,
    started_reader,
    state,
    subscribed,
    times,
)

from entoptic.services.reader import BridgeSilentError, StateReader
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.events import StreamStarted
from entoptic.tracker_bridge.samples import EyeState


def test_a_reader_of_the_newest_sees_the_newest_and_the_end(
    bridge: Bridge, connect: Callable[..., StateReader]
) -> None:
    reader = connect(bridge.publisher.addresses)
    thread = bridge.stream(3000)
    assert reader.wait_for_start(never) is not None
    last: EyeState | None = None
    deadline = time.monotonic() + PATIENCE_S
    while reader.ended is None or last is None or last.sequence < 2999:
        assert time.monotonic() < deadline
        last = reader.newest() or last
        time.sleep(0.02)
    assert last == state(2999)
    reader.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_a_late_reader_learns_how_the_stream_began(bridge: Bridge, connect: Callable[..., StateReader]) -> None:
    bridge.start()
    bridge.blinks(range(1, 6000))  # several helpings
    reader = connect(bridge.publisher.addresses)
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


def test_another_bridge_in_its_place_is_read_from_its_beginning(connect: Callable[..., StateReader]) -> None:
    first = Bridge()
    addresses = first.publisher.addresses
    live = started_reader(first, connect)
    first.blinks(range(1, 50))
    assert times(events_until(live, 49)) == list(range(1, 50))
    first.publisher.close()

    second = Bridge(*addresses)
    second.event(StreamStarted(1000, None, "another"))
    second.blinks(range(1001, 1004))
    got = events_until(live, 4, second.beat)
    assert got[0] == StreamStarted(1000, None, "another")
    assert times(got[1:]) == [1001, 1002, 1003]
    assert live.events.lost == 0
    second.publisher.close()


def test_garbage_on_the_sockets_is_counted_and_lived_through(
    lossy: LossyBridge, connect: Callable[..., StateReader]
) -> None:
    reader = subscribed(lossy, connect)
    good = wire.encode_state(state(4))
    lossy.events.send(b"\x6enoise")
    for message in (b"", b"\xc1", b"\x81\xa1a\x01", good[:-3]):
        assert told(lossy, reader, message) is None
    assert told(lossy, reader, good) == state(4)
    assert (reader.received, reader.skipped) == (5, 0)
    assert reader.refused == {"TruncatedMessageError": 3, "ForeignMessageError": 2}


def told(lossy: LossyBridge, reader: StateReader, message: bytes) -> EyeState | None:
    """The state that a reader makes of a message, which it reads before the next one."""
    before, deadline = reader.received, time.monotonic() + PATIENCE_S
    lossy.states.send(message)
    read = None
    while reader.received == before:
        assert time.monotonic() < deadline
        read = reader.newest()
    return read


def test_states_that_were_not_read_are_counted(lossy: LossyBridge, connect: Callable[..., StateReader]) -> None:
    reader = subscribed(lossy, connect)
    for sequence in (2, 3, 7, 8):  # it came late: what was before its first is not counted
        assert told(lossy, reader, wire.encode_state(state(sequence))) == state(sequence)
    assert (reader.received, reader.skipped) == (4, 3)


def test_a_bridge_that_says_nothing_is_named(connect: Callable[..., StateReader]) -> None:
    reader = connect(("tcp://127.0.0.1:1", "tcp://127.0.0.1:2"))
    with pytest.raises(BridgeSilentError, match=r"127\.0\.0\.1:1"):
        reader.wait_for_start(never, patience_s=0.3)


@pytest.mark.parametrize("addresses", [("nowhere", ANY), ("tcp://127.0.0.1:1", "tcp://127.0.0.1")])
def test_an_address_that_is_none_is_named(addresses: tuple[str, str]) -> None:
    with pytest.raises(BridgeSilentError, match="give an address like"):
        StateReader(*addresses)


def test_the_newest_state_says_when_it_was_sent(lossy: LossyBridge, connect: Callable[..., StateReader]) -> None:
    reader = subscribed(lossy, connect)
    for number, sent_ns in enumerate((None, 7, None)):
        lossy.states.send(wire.encode_state(state(number), sent_ns))
        deadline = time.monotonic() + PATIENCE_S
        while (read := reader.newest()) is None:
            assert time.monotonic() < deadline
        assert (read.sequence, reader.newest_sent_ns) == (number, sent_ns)
