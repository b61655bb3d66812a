"""The ring of events: against a plain list, and at its bounds."""

import threading
import tracemalloc

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge import replay, wire
from entoptic.tracker_bridge.replay import BYTES_A_MESSAGE, EventRing


def ask(ring: EventRing, first: int) -> wire.Answer:
    return wire.decode_answer(replay.answer(ring, wire.encode_request(first)))


@given(st.lists(st.binary(min_size=1, max_size=30), max_size=60), st.integers(1, 20), st.integers(50, 2000), st.data())
def test_it_answers_as_a_list_cut_off_at_the_front_would(
    messages: list[bytes], max_events: int, max_bytes: int, data: st.DataObject
) -> None:
    ring = EventRing(max_events, max_bytes)
    for message in messages:
        ring.add(message)
    kept = messages[-max_events:]
    while sum(len(message) + BYTES_A_MESSAGE for message in kept) > max_bytes:
        kept.pop(0)
    oldest = len(messages) - len(kept) + 1
    first = data.draw(st.integers(0, len(messages) + 2))
    assert ring.last == len(messages)
    assert ring.bytes == sum(len(message) + BYTES_A_MESSAGE for message in kept) <= max_bytes
    if max(first, 1) >= oldest:
        assert ring.since(first) == wire.Replayed(tuple(messages[max(first, 1) - 1 :]))
    else:
        assert ring.since(first) == wire.EventsGone(oldest, messages[0])


def test_many_events_come_in_helpings_without_a_gap() -> None:
    ring = EventRing()
    messages = [k.to_bytes(4) * 25 for k in range(10_000)]
    for message in messages:
        ring.add(message)
    got: list[bytes] = []
    helpings = 0
    while len(got) < len(messages):
        answer = ask(ring, len(got) + 1)
        assert isinstance(answer, wire.Replayed)
        assert sum(map(len, answer.messages)) < replay.ANSWER_BYTES + 100
        got += answer.messages
        helpings += 1
    assert got == messages
    assert helpings == 10_000 // 320 + 1


def test_before_the_first_event_and_after_the_last_there_is_nothing() -> None:
    ring = EventRing()
    assert ask(ring, 0) == wire.Replayed(())
    ring.add(b"event")
    assert ask(ring, 0) == ask(ring, 1) == wire.Replayed((b"event",))
    assert ask(ring, 2) == ask(ring, 2**62) == wire.Replayed(())


@pytest.mark.parametrize(("max_events", "max_bytes"), [(10_000, 10**9), (10**5, 1_600_000)])
def test_memory_stays_within_the_stated_bound_however_long_the_stream(max_events: int, max_bytes: int) -> None:
    tracemalloc.start()
    try:
        ring = EventRing(max_events, max_bytes)
        before, _ = tracemalloc.get_traced_memory()
        for k in range(25_000):
            ring.add(k.to_bytes(8) * 15)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert 1.5e6 < grown < 1.62e6
    answer = ask(ring, 1)
    assert isinstance(answer, wire.EventsGone)
    assert answer.first == bytes(120)
    assert isinstance(ask(ring, answer.oldest), wire.Replayed)


@given(st.binary(max_size=60))
def test_any_request_is_answered(request: bytes) -> None:
    ring = EventRing()
    ring.add(b"event")
    wire.decode_answer(replay.answer(ring, request))


def test_a_request_that_is_none_is_told_how_to_ask() -> None:
    for request in (b"", b"from 3", msgspec.msgpack.encode({"from": -1}), msgspec.msgpack.encode({"since": 3})):
        answer = wire.decode_answer(replay.answer(EventRing(), request))
        assert isinstance(answer, wire.BadRequest)
        assert '{"from"' in answer.reason


def test_a_reader_on_another_thread_never_sees_a_torn_ring() -> None:
    ring = EventRing(max_events=50)
    wrong: list[wire.Answer] = []

    def read() -> None:
        while ring.last < 20_000:
            answer = ring.since(max(ring.last - 40, 1))
            numbers = [int.from_bytes(message) for message in getattr(answer, "messages", ())]
            if numbers != list(range(numbers[0], numbers[0] + len(numbers)) if numbers else []):
                wrong.append(answer)

    thread = threading.Thread(target=read)
    thread.start()
    for k in range(20_000):
        ring.add(k.to_bytes(4))
    thread.join(20)
    assert not thread.is_alive()
    assert wrong == []
