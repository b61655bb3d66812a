"""Any recording as a live source: at its own pace, on this machine's clock, from where it is by now.

Latency: none is added. A tick follows the samples of each time at once, so that nobody waits for the next ones to know
that these are all.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import msgspec

from entoptic.tracker_bridge.events import ClockEstimated
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import Item, Source, SourceInfo, Tick

TICK_S = 0.05
"""Between two ticks; a live source may go 100 ms without one."""


class Played:
    """A recording that happens now. It ends with its last sample; what is past when it is first read is left out."""

    def __init__(self, source: Source, begun_ns: int) -> None:
        """`begun_ns`: when its first sample was or is due, on the monotonic clock."""
        self._source = source
        self._shift_ns = begun_ns - source.info.t_start_ns
        end_ns = source.info.t_end_ns
        self._info = msgspec.structs.replace(
            source.info,
            t_start_ns=begun_ns,
            t_end_ns=None if end_ns is None else end_ns + self._shift_ns,
            live=True,
        )

    @property
    def info(self) -> SourceInfo:
        """What this source is; its times are those of the monotonic clock."""
        return self._info

    def samples(self) -> Iterator[Item]:
        """The samples from now on, each when it is due."""
        now_ns = time.monotonic_ns()
        yield ClockEstimated(now_ns, self._shift_ns, 0.0, 0)
        for sample in self._source.samples():
            due_ns = sample.t_ns + self._shift_ns
            if due_ns < now_ns:
                continue
            yield from ticks_until(due_ns)
            yield msgspec.structs.replace(sample, t_ns=due_ns)
        yield Tick(time.monotonic_ns())


def ticks_until(due_ns: int) -> Iterator[Tick]:
    """Waits until a time of the monotonic clock, if it has not come yet; ticks at once and while it waits."""
    while (now_ns := time.monotonic_ns()) < due_ns:
        yield Tick(now_ns)
        if (left_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(min(left_ns / NS_PER_S, TICK_S))
