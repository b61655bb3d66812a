"""Pupil Capture or Pupil Service, live over its Network API: samples as they arrive, and what becomes of it.

Sockets and threads are in link.py, messages in bus.py, requests in remote.py; here their yield is
put on the bridge's clock and in words. Latency: a message is taken as soon as it is here, measured 0.4 ms at the
median and 1.4 ms in 99 of 100 on two busy cores; nothing on its way waits for a timer.

Times. Capture's clock is known from round trips (clock.py); samples from before it is known are left out. Somebody may
set that clock at any moment, and until the next round trip its samples' times are wrong. So a sample that would come
from the future, or is older than any that Capture was ever seen to send, is left out, and a sudden change of the
samples' age makes Capture be asked for its time at once.
"""

from __future__ import annotations

import collections
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import msgspec

from entoptic.tracker_bridge.clock import RoundTripClock
from entoptic.tracker_bridge.events import ClockEstimated, SourceBack, SourceSilent, TrackerStatus, TrackerTask
from entoptic.tracker_bridge.samples import NS_PER_S, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, SourceInfo, Tick
from entoptic.tracker_bridge.sources.pupil_core import remote as pupil_remote
from entoptic.tracker_bridge.sources.pupil_core.bus import ERRORS, PupilBus
from entoptic.tracker_bridge.sources.pupil_core.link import (
    ROOM,
    Connected,
    Link,
    Message,
    News,
    OrderGiven,
    RoundTrip,
    Unreachable,
)
from entoptic.tracker_bridge.sources.pupil_core.remote import DEFAULT_REMOTE, RemoteAddress, Request
from entoptic.tracker_bridge.sources.pupil_core.tasks import Command, OpenTasks, Order

TICK_NS: Final = 50_000_000
"""A reader is woken so often. Engineering choice: half of what a live source promises."""
SILENT_NS: Final = NS_PER_S
"""Without a sample for as long, the tracker is called silent. Capture itself pauses for up to 1 s."""
AHEAD_NS: Final = 10_000_000
"""A sample may be so far in the future besides the clock's uncertainty: less is no new timebase (clock.py)."""
OLDEST_NS: Final = 10 * NS_PER_S
"""No sample is older: during a calibration's fit, gaze was seen to arrive 8.3 s late."""
AGE_STEP_NS: Final = 100_000_000
"""From one pupil sample to the next their age changes by less, unless the clock was set. Engineering choice: to ask
for the time once too often costs nothing."""

BEFORE_CLOCK = "before the clock was known"
WRONG_TIME = "at a time that cannot be"
DROPPED = "dropped: the reader was too slow"


class PupilCapture:
    """A live source that waits for Pupil Capture, outlives its restarts, and can start and stop what it does."""

    def __init__(self, remote: str = DEFAULT_REMOTE, *, room: int = ROOM) -> None:
        """`remote`: where Pupil Remote listens, tcp://HOST:PORT; `room`: messages kept for a slow reader.

        Connects when it is read. Raises SourceError for an address that cannot be.
        """
        self._address = RemoteAddress.parse(remote)
        self._room = room
        self._link: Link | None = None
        self._counts: collections.Counter[str] = collections.Counter()
        self._dropped = 0
        """By the readers before this one."""
        self._info = SourceInfo(f"Pupil Capture at {self._address}", time.monotonic_ns(), None, live=True)

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        return self._info

    @property
    def counts(self) -> Mapping[str, int]:
        """What became of the messages and samples so far, by name; errors by the name of their class."""
        link = self._link
        dropped = self._dropped + (0 if link is None else link.inbox.dropped)
        return dict(self._counts) | ({DROPPED: dropped} if dropped else {})

    def samples(self) -> Iterator[Item]:
        """Samples and events in order of arrival, a Tick at least every 100 ms. One reader at a time.

        Closing the iterator ends both threads and frees their sockets. Raises SourceError where one is open already.
        """
        if self._link is not None:
            raise SourceError(f"{self._info.name} is being read already: close the first reader")
        link = Link(self._address, room=self._room)
        arrivals = Arrivals(self._address, link.ask_time, self._counts)
        self._link = link
        link.start()
        try:
            while True:
                yield from arrivals.items(*link.inbox.take(arrivals.patience_s))
        finally:
            self._link = None
            link.close()
            self._dropped += link.inbox.dropped

    def start_recording(self, name: str = "") -> None:
        """Has Capture record, under its own name for it if none is given. From any thread while this is read.

        What becomes of this and of the following comes as a TrackerTask. Raises SourceError for an impossible name.
        """
        self._give(Command.START_RECORDING, pupil_remote.start_recording(name))

    def stop_recording(self) -> None:
        """Has Capture end and save its recording."""
        self._give(Command.STOP_RECORDING, pupil_remote.STOP_RECORDING)

    def start_calibration(self) -> None:
        """Has Capture start the gaze calibration that is chosen in its window."""
        self._give(Command.START_CALIBRATION, pupil_remote.START_CALIBRATION)

    def stop_calibration(self) -> None:
        """Has Capture end its gaze calibration and fit it to what was collected."""
        self._give(Command.STOP_CALIBRATION, pupil_remote.STOP_CALIBRATION)

    def _give(self, command: Command, request: Request) -> None:
        link = self._link
        if link is None:
            raise SourceError(f"{self._info.name} is not being read: it cannot be told to {command}")
        link.give(Order(command, request, time.monotonic_ns()))


class Arrivals:
    """What to yield for what arrives.

    Pure but for `ask_time`, which has Capture asked for its time at once, and `now_ns`, the bridge's clock.
    """

    def __init__(
        self,
        address: RemoteAddress,
        ask_time: Callable[[], None],
        counts: collections.Counter[str],
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._address = address
        self._ask_time = ask_time
        self._counts = counts
        self._now_ns = now_ns
        self._bus = PupilBus()
        self._clock = RoundTripClock()
        self._uncertainty_ns = 0
        self._tasks = OpenTasks()
        self._connected: Connected | None = None
        self._unreachable: str | None = address.silence
        self._age_ns: int | None = None
        self._woken_ns = self._quiet_since_ns = self._answered_ns = now_ns()
        self._wrong_time_ns = self._unread_ns = self._quiet_since_ns - SILENT_NS
        self._quiet = True
        self._reported: str | None = ""
        """Why the tracker is silent, as told; "" before the first sample, None while samples come."""

    @property
    def patience_s(self) -> float:
        """How long to wait for something to arrive."""
        return max(self._woken_ns + TICK_NS - self._now_ns(), 0) / NS_PER_S

    def items(self, news: Sequence[News], messages: Sequence[Message]) -> Iterator[Item]:
        """What has arrived, and what is due because time has passed."""
        self._quiet = True
        for each in news:
            yield from self._handle(each)
        for message in messages:
            yield from self._read(message)
            yield from self._tick()
        yield from self._tasks.overdue(self._now_ns())
        if self._quiet:
            # Only then: to a reader that comes back from a pause its old messages are no silence.
            yield from self._silence()
        # Nothing more is here: who reads this need not wait for a moment to be whole.
        yield from self._tick(at_once=not self._quiet)

    def _handle(self, news: News) -> Iterator[Item]:
        if isinstance(news, RoundTrip):
            self._answered_ns = news.received_ns
            for event in self._clock.add(news.sent_ns, news.pupil_ns, news.received_ns):
                if isinstance(event, ClockEstimated):
                    self._uncertainty_ns = event.uncertainty_ns
                yield event
        elif isinstance(news, Connected):
            if self._unreachable is not None:
                # Its data need a moment to come.
                self._quiet_since_ns = max(news.t_ns, self._quiet_since_ns)
            known, self._connected, self._unreachable = self._connected, news, None
            if known is None or (known.version, known.port) != (news.version, news.port):
                detail = f"Pupil Capture {news.version} answers at {self._address}, its data is at port {news.port}"
                yield TrackerStatus(news.t_ns, True, detail)
        elif isinstance(news, Unreachable):
            self._unreachable = news.reason
        elif isinstance(news, OrderGiven):
            self._tasks.expect(news.order)
        else:
            yield from self._tasks.refused(news.order, news.reason, self._now_ns())

    def _read(self, message: Message) -> Iterator[Item]:
        read = self._bus.read(message.frames, message.received_ns)
        self._counts[read.became] += 1
        if read.event is not None:
            if isinstance(read.event, TrackerTask):
                self._tasks.note(read.event)
            yield read.event
        if read.remark:
            self._tasks.remark(read.remark, message.received_ns)
        if read.became in ERRORS:
            self._unread_ns = message.received_ns
        for sample in read.samples:
            placed = self._placed(sample, message.received_ns)
            if placed is None:
                continue
            self._quiet_since_ns = max(message.received_ns, self._quiet_since_ns)
            self._quiet = False
            if self._reported is not None:
                self._reported = None
                yield SourceBack(message.received_ns)
            yield placed

    def _placed(self, sample: PupilSample | GazeSample, received_ns: int) -> PupilSample | GazeSample | None:
        """The sample on the bridge's clock; None, and counted, where that cannot be."""
        t_ns = self._clock.bridge_ns(sample.t_ns)
        if t_ns is None:
            self._counts[BEFORE_CLOCK] += 1
            return None
        age_ns = received_ns - t_ns
        if isinstance(sample, PupilSample):
            if self._age_ns is not None and abs(age_ns - self._age_ns) > AGE_STEP_NS:
                self._ask_time()
            self._age_ns = age_ns
        if -AHEAD_NS - self._uncertainty_ns <= age_ns <= OLDEST_NS:
            return msgspec.structs.replace(sample, t_ns=t_ns)
        self._counts[WRONG_TIME] += 1
        if received_ns - self._wrong_time_ns > TICK_NS:
            self._wrong_time_ns = received_ns
            self._ask_time()
        return None

    def _silence(self) -> Iterator[Item]:
        now_ns = self._now_ns()
        if now_ns - self._quiet_since_ns >= SILENT_NS and (reason := self._reason(now_ns)) != self._reported:
            self._reported = reason
            yield SourceSilent(now_ns, reason)

    def _tick(self, *, at_once: bool = False) -> Iterator[Item]:
        now_ns = self._now_ns()
        if at_once or now_ns - self._woken_ns >= TICK_NS:
            self._woken_ns = now_ns
            yield Tick(now_ns)

    def _reason(self, now_ns: int) -> str:
        """Why there are no samples. Without figures, so that it is told once as long as it stays the same."""
        if self._unreachable is not None:
            return self._unreachable
        if self._answered_ns < self._quiet_since_ns:
            return f"nothing comes from Pupil Capture at {self._address} any more: see whether it is still running"
        if now_ns - self._wrong_time_ns < SILENT_NS:
            return (
                "Pupil Capture sends eye data whose times do not fit its own clock: restart it, and see that no other "
                "program sets its time"
            )
        if now_ns - self._unread_ns < SILENT_NS:
            return (
                "Pupil Capture sends eye data that cannot be read: see that its version is 1 to 3, and that nothing "
                "else publishes under its topics"
            )
        return (
            f"Pupil Capture answers at {self._address}, but sends no eye data: switch on the detection of both eyes in "
            "its window, and look at the eye cameras' pictures"
        )
