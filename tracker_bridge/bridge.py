"""The one loop of the eye side: a source's items through the chain, out to whoever listens."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator

from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.events import Event, Heartbeat, StreamEnded, StreamStarted
from entoptic.tracker_bridge.publisher import HEARTBEAT_S, Publisher
from entoptic.tracker_bridge.samples import NS_PER_S, EyeState
from entoptic.tracker_bridge.source import Item, Source


def _nothing() -> None:
    """What is done between items unless somebody wants more."""


def run(
    source: Source,
    chain: Chain,
    publisher: Publisher,
    *,
    seconds: float | None,
    stopped: Callable[[], bool],
    on_item: Callable[[Item], None] = lambda item: None,
    on_record: Callable[[EyeState | Event], None] = lambda record: None,
    between: Callable[[], None] = _nothing,
) -> int:
    """Publishes a source until it ends, `seconds` of it are over or `stopped` says so; returns the count of states.

    A live source's states go out as they are made, a recording's when their recorded time has come. `on_item` sees
    every item before the chain does, `on_record` every state and event that is published, `between` is called between
    items, and at least every 100 ms.
    """
    info = source.info
    live = info.live
    start_ns, begun_ns = time.monotonic_ns() if live else info.t_start_ns, time.monotonic_ns()
    ends_ns = [info.t_end_ns, None if seconds is None else start_ns + round(seconds * NS_PER_S)]
    end_ns = min((end for end in ends_ns if end is not None), default=None)
    # A live sample may say any time: only the clock ends a live stream, or its source does.
    until_ns = ends_ns[1] if live else end_ns
    count, t_ns, beat_s = 0, start_ns, -HEARTBEAT_S

    def publish(record: EyeState | Event) -> None:
        nonlocal count, t_ns
        # An event may be told late; time does not go back for it.
        t_ns = max(record.t_ns, t_ns)
        on_record(record)
        if isinstance(record, EyeState):
            count += 1
            publisher.publish_state(record, sent_ns=time.monotonic_ns() if live else None)
        else:
            publisher.publish_event(record)

    def attend() -> None:
        nonlocal beat_s
        between()
        now_s = time.monotonic()
        if now_s - beat_s >= HEARTBEAT_S:
            beat_s = now_s
            publisher.publish_event(Heartbeat(t_ns, count, chain.late_count))

    publish(StreamStarted(start_ns, end_ns, info.name))
    with contextlib.closing(items_of(source)) as items:
        for item in items:
            attend()
            if stopped() or (until_ns is not None and (time.monotonic_ns() if live else item.t_ns) > until_ns):
                break
            if not live:
                _sleep_until(begun_ns + item.t_ns - start_ns, stopped, attend)
            on_item(item)
            for record in chain.step(item):
                publish(record)
        for record in chain.flush():
            publish(record)
    publish(StreamEnded(t_ns, count))
    return count


def items_of(source: Source) -> Generator[Item]:
    """Its items as a generator in any case: closing it closes the source's own."""
    yield from source.samples()


def _sleep_until(when_ns: int, stopped: Callable[[], bool], attend: Callable[[], None]) -> None:
    while not stopped() and (left_ns := when_ns - time.monotonic_ns()) > 0:
        time.sleep(min(left_ns * 1e-9, 0.05))
        attend()
