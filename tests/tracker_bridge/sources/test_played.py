"""A recording that happens now."""

import time
from collections.abc import Iterator

import pytest

from entoptic.tracker_bridge.events import ClockEstimated
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceInfo, Tick
from entoptic.tracker_bridge.sources.played import Played

MS = 1_000_000


class Recorded:
    """40 samples in 400 ms of another clock, and one more after a pause of 300 ms."""

    def __init__(self) -> None:
        self.times_ns = [5_000_000_000 + at * 10 * MS for at in range(40)] + [5_700_000_000]
        self.info = SourceInfo("made up", self.times_ns[0], self.times_ns[-1])

    def samples(self) -> Iterator[PupilSample | GazeSample]:
        for t_ns in self.times_ns:
            yield PupilSample(t_ns, Eye.LEFT, 4.0, 1.0)
            yield GazeSample(t_ns, None, 1.0, 2.0, 1.0)


def heard(source: Played) -> list[tuple[int, Item]]:
    """All items after the first, which says that the clock is this machine's."""
    clock, *items = [(time.monotonic_ns(), item) for item in source.samples()]
    assert isinstance(clock[1], ClockEstimated)
    assert clock[1].uncertainty_ns == 0
    return items


@pytest.fixture(scope="module")
def whole() -> tuple[int, Played, list[tuple[int, Item]]]:
    begun_ns = time.monotonic_ns() + 150 * MS
    source = Played(Recorded(), begun_ns)
    return begun_ns, source, heard(source)


def test_all_is_played_in_order_by_the_clock(whole: tuple[int, Played, list[tuple[int, Item]]]) -> None:
    begun_ns, source, items = whole
    assert source.info.live
    assert (source.info.t_start_ns, source.info.t_end_ns) == (begun_ns, begun_ns + 700 * MS)
    samples = [(at_ns, item) for at_ns, item in items if not isinstance(item, Tick)]
    assert [type(item) for _, item in samples] == [PupilSample, GazeSample] * 41
    assert [item.t_ns - begun_ns + 5_000_000_000 for _, item in samples] == [
        t_ns for t_ns in Recorded().times_ns for _ in range(2)
    ]
    assert min(at_ns - item.t_ns for at_ns, item in samples) >= 0


def test_a_tick_comes_at_least_every_tenth_of_a_second_and_ends_each_moment(
    whole: tuple[int, Played, list[tuple[int, Item]]],
) -> None:
    begun_ns, source, items = whole
    assert source.info.t_end_ns is not None
    ticks = [item.t_ns for _, item in items if isinstance(item, Tick)]
    quiet = [t_ns for t_ns in ticks if begun_ns + 400 * MS < t_ns < source.info.t_end_ns]
    assert len(quiet) >= 2
    assert isinstance(items[0][1], Tick)
    assert isinstance(items[-1][1], Tick)
    assert len(ticks) >= 10


def test_one_that_is_started_anew_goes_on_where_the_clock_is() -> None:
    begun_ns = time.monotonic_ns() - 205 * MS
    items = heard(Played(Recorded(), begun_ns))
    samples = [item for _, item in items if not isinstance(item, Tick)]
    assert begun_ns + 205 * MS < samples[0].t_ns
    assert samples[-1].t_ns == begun_ns + 700 * MS


def test_nothing_is_left_of_one_that_is_over() -> None:
    assert [type(item) for _, item in heard(Played(Recorded(), time.monotonic_ns() - 10**12))] == [Tick]
