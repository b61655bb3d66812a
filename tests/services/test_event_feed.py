"""Events: each once and in order, the lost ones too."""

import functools
import time
from collections.abc import Callable

import pytest
from bridges import (
    PATIENCE_S,
    Bridge,
    LossyBridge,
    events_until,
    started_reader,
    subscribed,
    times,
)

from entoptic.services import event_recovery
from entoptic.services.reader import StateReader
from entoptic.tracker_bridge import replay, wire
from entoptic.tracker_bridge.events import Event, SourceSilent


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
    reader = connect(bridge.publisher.addresses)
    reader.subscribe()
    assert times(events_until(reader, 101, bridge.beat)) == [0, *range(900, 1000)]
    assert reader.events.lost == 899
    bridge.publisher.close()


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
    monkeypatch.setattr(event_recovery, "ANSWER_WITHIN_S", 0.05)
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


def test_answers_whose_events_had_already_come_are_no_failed_attempts(
    lossy: LossyBridge, connect: Callable[..., StateReader]
) -> None:
    reader = subscribed(lossy, connect)
    lossy.events.send(lossy.message(1))
    got = events_until(reader, 1)
    lossy.events.send(lossy.message(2, heartbeat=True))
    for number in range(2, 8):
        while not lossy.replay.poll(10):
            got += reader.events.read(10)
            assert reader.events.lost == 0
        assert wire.decode_request(lossy.replay.recv()) == number
        lossy.events.send(lossy.message(number))
        got += events_until(reader, 1)
        lossy.events.send(lossy.message(number + 1, heartbeat=True))
        assert reader.events.read(int(PATIENCE_S * 1e3)) == []
        lossy.replay.send(wire.encode_answer(wire.Replayed((lossy.message(number),))))
    assert times(got) == list(range(1, 8))
    assert reader.events.lost == 0
