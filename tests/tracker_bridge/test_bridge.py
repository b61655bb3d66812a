"""The loop: what it publishes, when, and what it does meanwhile."""

import time
from collections.abc import Iterator

from entoptic.tracker_bridge import bridge
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.events import Event, SourceBack, SourceSilent, StreamEnded, StreamStarted
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.samples import Eye, EyeState, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceInfo, Tick

MS = 1_000_000


class MadeUp:
    """A source of items made up by a test."""

    def __init__(self, items: list[Item], *, live: bool = False) -> None:
        self._items = items
        self.closed = False
        self.info = SourceInfo("made up", items[0].t_ns, None if live else items[-1].t_ns, live=live)

    def samples(self) -> Iterator[Item]:
        try:
            yield from self._items
        finally:
            self.closed = True


def never() -> bool:
    return False


def both_eyes(count: int) -> list[Item]:
    made: list[Item] = []
    for k in range(count):
        made += [PupilSample(k * 5 * MS, eye, 4.0, 1.0) for eye in Eye]
        made.append(GazeSample(k * 5 * MS, None, k % 10, -1.0, 0.9))
    return made


def published(source: MadeUp, **options: object) -> list[EyeState | Event]:
    """All that the loop published of a source, nobody listening."""
    publisher = Publisher("tcp://127.0.0.1:*", "tcp://127.0.0.1:*")
    records: list[EyeState | Event] = []
    given = {"seconds": None, "stopped": never, "on_record": records.append} | options
    bridge.run(source, Chain(live=source.info.live), publisher, **given)
    publisher.close()
    return records


def test_a_stream_begins_and_ends_with_a_word() -> None:
    first, *states, last = published(MadeUp(both_eyes(10)))
    assert first == StreamStarted(0, 45 * MS, "made up")
    assert [state.sequence for state in states if isinstance(state, EyeState)] == list(range(10))
    assert last == StreamEnded(45 * MS, 10)


def test_it_ends_when_so_many_seconds_of_the_recording_are_over() -> None:
    source = MadeUp(both_eyes(100))
    *_, last = published(source, seconds=0.1)
    assert last == StreamEnded(100 * MS, 21)
    assert source.closed


def test_it_ends_when_it_is_asked_to_and_frees_the_source() -> None:
    source = MadeUp(both_eyes(100))
    taken: list[Item] = []
    published(source, on_item=taken.append, stopped=lambda: len(taken) > 30)
    assert len(taken) == 31
    assert source.closed


def test_in_real_time_states_leave_when_their_time_has_come() -> None:
    begun = time.monotonic()
    published(MadeUp(both_eyes(41)))
    assert time.monotonic() - begun >= 0.2


def test_a_source_s_events_go_out_in_their_place() -> None:
    now_ns = time.monotonic_ns()
    silent = SourceSilent(now_ns, "unplugged")
    items: list[Item] = [PupilSample(now_ns, Eye.LEFT, 4.0, 1.0), Tick(now_ns), silent, Tick(now_ns + MS)]
    _, state, event, _ = published(MadeUp(items, live=True))
    assert isinstance(state, EyeState)
    assert event == silent


def test_a_live_stream_is_ended_by_the_clock_and_not_by_a_sample_of_a_broken_time() -> None:
    now_ns = time.monotonic_ns()
    items: list[Item] = [Tick(now_ns), PupilSample(now_ns + 10**12, Eye.LEFT, 4.0, 1.0), Tick(now_ns + MS)]
    taken: list[Item] = []
    published(MadeUp(items, live=True), seconds=60.0, on_item=taken.append)
    assert taken == items
    taken.clear()
    published(MadeUp(items, live=True), seconds=0.001, on_item=taken.append, between=lambda: time.sleep(0.05))
    assert taken == []


def test_a_stream_does_not_end_before_its_last_state_where_an_event_is_told_late() -> None:
    now_ns = time.monotonic_ns() + 100 * MS
    items: list[Item] = [PupilSample(now_ns, Eye.LEFT, 4.0, 1.0), Tick(now_ns), SourceBack(now_ns - 500 * MS)]
    *_, state, _, ended = published(MadeUp(items, live=True))
    assert isinstance(state, EyeState)
    assert ended == StreamEnded(state.t_ns, 1)


def test_between_items_others_get_their_turn() -> None:
    turns = []
    published(MadeUp(both_eyes(5)), between=lambda: turns.append(1))
    assert len(turns) >= 15
