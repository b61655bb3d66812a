"""States: all of them by recorded time, or always the newest; and what a reader says when a bridge does not."""

import itertools
import threading
import time
from collections.abc import Callable

import pytest
from bridges import (
    ANY,
    MS,
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

from entoptic.services import reader as reading
from entoptic.services.reader import BridgeRestartedError, BridgeSilentError, StateReader
from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.events import StreamEnded, StreamStarted
from entoptic.tracker_bridge.samples import EyeState


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
    assert reader.received + reader.skipped <= 3000  # what came before its first is not counted
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


def test_the_newest_state_says_when_it_was_sent(lossy: LossyBridge, connect: Callable[..., StateReader]) -> None:
    reader = subscribed(lossy, connect, newest_only=False)
    for number, sent_ns in enumerate((None, 7, None)):
        lossy.states.send(wire.encode_state(state(number), sent_ns))
        deadline = time.monotonic() + PATIENCE_S
        while (read := reader.newest()) is None:
            assert time.monotonic() < deadline
        assert (read.sequence, reader.newest_sent_ns) == (number, sent_ns)
