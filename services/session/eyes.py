"""A recording's states and events for frames, one after another: always the same ones for the same recording."""

from __future__ import annotations

import collections
import contextlib
import itertools
from collections.abc import Callable, Iterator

from entoptic.tracker_bridge.chain import PATIENCE_NS, Chain, records_of
from entoptic.tracker_bridge.events import Event, SaccadeOffset, StreamEnded, StreamStarted
from entoptic.tracker_bridge.samples import NS_PER_S, EyeState
from entoptic.tracker_bridge.source import Source


class RecordedEyes:
    """A source's records, each passed to `on_record` as soon as it is read, which is as late as can be."""

    def __init__(
        self,
        source: Source,
        chain: Chain,
        seconds: float | None,
        stop: Callable[[], bool],
        on_record: Callable[[EyeState | Event], None],
    ) -> None:
        """As many `seconds` of it, or all; until `stop` says so."""
        info = source.info
        ends_ns = (info.t_end_ns, None if seconds is None else info.t_start_ns + round(seconds * NS_PER_S))
        self.start_ns = info.t_start_ns
        self.end_ns = min((end for end in ends_ns if end is not None), default=None)
        self.ended_ns: int | None = None
        """When the last record was, once all are read."""
        self.states = 0
        """Read so far."""
        self._records = self._all(source, chain, stop)
        self._on_record = on_record
        self._ahead: collections.deque[EyeState] = collections.deque()
        """States that are read and were not asked for yet."""
        self._saccades: list[SaccadeOffset] = []

    def _all(self, source: Source, chain: Chain, stop: Callable[[], bool]) -> Iterator[EyeState | Event]:
        yield StreamStarted(self.start_ns, self.end_ns, source.info.name)
        t_ns = self.start_ns
        with contextlib.closing(item for item in source.samples()) as items:
            wanted = itertools.takewhile(
                lambda item: not stop() and (self.end_ns is None or item.t_ns <= self.end_ns), items
            )
            for record in records_of(wanted, chain):
                # An event may be reported late; time does not go back for it.
                t_ns = max(record.t_ns, t_ns)
                yield record
        self.ended_ns = t_ns
        yield StreamEnded(t_ns, self.states)

    def until(self, t_ns: int) -> EyeState | None:
        """The newest state no younger than `t_ns` that was not given before, if there is one."""
        self._read(t_ns)
        newest = None
        while self._ahead and self._ahead[0].t_ns <= t_ns:
            newest = self._ahead.popleft()
        return newest

    def saccades_until(self, t_ns: int) -> tuple[SaccadeOffset, ...]:
        """The saccades reported no later than `t_ns`, each once. They are reported by PATIENCE_NS late at most."""
        self._read(t_ns + PATIENCE_NS)
        due = tuple(saccade for saccade in self._saccades if saccade.t_ns <= t_ns)
        self._saccades = [saccade for saccade in self._saccades if saccade.t_ns > t_ns]
        return due

    def finish(self) -> None:
        """Reads what is left."""
        for record in self._records:
            self._note(record)

    def _read(self, t_ns: int) -> None:
        """Until a state younger than that has come, or there is no more."""
        while not (self._ahead and self._ahead[-1].t_ns > t_ns):
            record = next(self._records, None)
            if record is None:
                return
            self._note(record)

    def _note(self, record: EyeState | Event) -> None:
        self._on_record(record)
        if isinstance(record, EyeState):
            self.states += 1
            self._ahead.append(record)
        elif isinstance(record, SaccadeOffset):
            self._saccades.append(record)
