"""What live messages become, with time in the test's hand: no sockets, no threads."""

from __future__ import annotations

from collections import Counter
from typing import Any

import msgpack

from entoptic.tracker_bridge.events import (
    ClockEstimated,
    ClockJumped,
    SourceBack,
    SourceSilent,
    TaskOutcome,
    TrackerStatus,
    TrackerTask,
)
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, Tick
from entoptic.tracker_bridge.sources.pupil_core import remote as pupil_remote
from entoptic.tracker_bridge.sources.pupil_core.capture import BEFORE_CLOCK, TICK_NS, WRONG_TIME, Arrivals
from entoptic.tracker_bridge.sources.pupil_core.link import (
    Connected,
    Inbox,
    Message,
    News,
    OrderGiven,
    OrderRefused,
    RoundTrip,
    Unreachable,
)
from entoptic.tracker_bridge.sources.pupil_core.remote import RemoteAddress
from entoptic.tracker_bridge.sources.pupil_core.tasks import Command, Order

S, MS = 1_000_000_000, 1_000_000


class Bench:
    """Arrivals, the bridge's clock that they read, and Pupil's, `ahead_ns` of it."""

    def __init__(self, ahead_ns: int = 1000 * S) -> None:
        self.now_ns = 50 * S
        self.ahead_ns = ahead_ns
        self.asked = 0
        self.counts: Counter[str] = Counter()
        self.arrivals = Arrivals(RemoteAddress("lab", 50020), self._ask, self.counts, lambda: self.now_ns)

    def _ask(self) -> None:
        self.asked += 1

    def news(self, *news: News) -> list[Item]:
        return list(self.arrivals.items(news, ()))

    def round_trips(self, count: int = 5) -> list[Item]:
        def one() -> RoundTrip:
            self.now_ns += MS
            return RoundTrip(self.now_ns - 200_000, self.now_ns - 100_000 + self.ahead_ns, self.now_ns)

        return self.news(*(one() for _ in range(count)))

    def message(self, age_ns: int = 5 * MS, eye: int = 0, **fields: Any) -> Message:
        seconds = (self.now_ns - age_ns + self.ahead_ns) / 1e9
        datum = {"id": eye, "topic": f"pupil.{eye}.3d", "timestamp": seconds, "confidence": 1.0, "diameter_3d": 4.0}
        datum |= fields
        return Message(self.now_ns, [str(datum["topic"]).encode(), msgpack.packb(datum)])

    def pupil(self, age_ns: int = 5 * MS, eye: int = 0) -> list[Item]:
        return list(self.arrivals.items((), (self.message(age_ns, eye),)))

    def wait(self, duration_ns: int) -> list[Item]:
        self.now_ns += duration_ns
        return list(self.arrivals.items((), ()))


def ready() -> Bench:
    bench = Bench()
    bench.round_trips()
    bench.pupil()
    return bench


def samples(items: list[Item]) -> list[PupilSample | GazeSample]:
    return [item for item in items if isinstance(item, PupilSample | GazeSample)]


def silences(items: list[Item]) -> list[str]:
    return [item.reason for item in items if isinstance(item, SourceSilent)]


def test_samples_are_put_on_the_bridges_clock() -> None:
    bench = ready()
    (sample,) = samples(bench.pupil(age_ns=5 * MS, eye=1))
    assert isinstance(sample, PupilSample)
    assert (sample.eye, sample.pupil_diameter_mm) == (Eye.LEFT, 4.0)
    assert abs(sample.t_ns - (bench.now_ns - 5 * MS)) < 1000  # a double of Pupil's seconds


def test_samples_from_before_the_clock_is_known_are_left_out_and_counted() -> None:
    bench = Bench()
    assert samples(bench.pupil()) == []
    assert bench.counts[BEFORE_CLOCK] == 1
    assert any(isinstance(item, ClockEstimated) for item in bench.round_trips())
    assert [type(item) for item in bench.pupil()] == [SourceBack, PupilSample, Tick]


def test_late_double_and_backward_samples_are_passed_on() -> None:
    bench = ready()
    ages_ns = [5 * MS, 5 * MS, 3 * S, 9 * S, 5 * MS]
    got = [sample.t_ns for age_ns in ages_ns for sample in samples(bench.pupil(age_ns))]
    assert [round((bench.now_ns - t_ns) / MS) for t_ns in got] == [5, 5, 3000, 9000, 5]


def test_a_clock_set_forwards_is_found_out_at_the_first_sample() -> None:
    bench = ready()
    bench.ahead_ns += 100 * S
    assert bench.asked == 0
    assert samples(bench.pupil()) == []
    assert (bench.counts[WRONG_TIME], bench.asked > 0) == (1, True)
    (jump,) = (item for item in bench.round_trips(1) if isinstance(item, ClockJumped))
    assert abs(jump.jump_ns - 100 * S) < MS
    (sample,) = samples(bench.pupil())
    assert abs(sample.t_ns - (bench.now_ns - 5 * MS)) < MS


def test_a_clock_set_far_back_is_found_out_at_the_first_sample() -> None:
    bench = ready()
    bench.ahead_ns -= 100 * S
    assert samples(bench.pupil()) == []
    assert (bench.counts[WRONG_TIME], bench.asked > 0) == (1, True)
    assert any(isinstance(item, ClockJumped) for item in bench.round_trips(1))
    assert len(samples(bench.pupil())) == 1


def test_a_clock_set_back_a_little_makes_capture_be_asked_for_its_time() -> None:
    bench = ready()
    bench.ahead_ns -= 2 * S
    bench.pupil()
    assert bench.asked == 1
    bench.pupil()
    assert bench.asked == 1


def test_a_little_into_the_future_is_the_clocks_uncertainty() -> None:
    bench = ready()
    assert len(samples(bench.pupil(age_ns=-9 * MS))) == 1
    assert samples(bench.pupil(age_ns=-12 * MS)) == []


def test_times_that_never_fit_are_told_to_a_person() -> None:
    bench = ready()
    bench.news(Connected(bench.now_ns, "3.6.14", 1234))
    reasons: list[str] = []
    for _ in range(30):
        bench.round_trips(1)
        reasons += silences(bench.pupil(age_ns=-S)) + silences(bench.wait(100 * MS))
    assert ["times do not fit" in reason for reason in reasons] == [True]


def test_a_tick_comes_when_nothing_else_does() -> None:
    bench = ready()
    assert 0.0 <= bench.arrivals.patience_s <= 0.05
    assert bench.wait(TICK_NS - 1) == []
    assert bench.wait(1) == [Tick(bench.now_ns)]
    assert bench.wait(TICK_NS) == [Tick(bench.now_ns)]
    bench.now_ns += TICK_NS - 1
    bench.pupil()
    assert bench.wait(1) == []


def test_ticks_come_among_messages_without_samples() -> None:
    bench = ready()
    bench.now_ns += 2 * TICK_NS
    blink = bench.message(topic="blinks", type="onset")
    assert Tick(bench.now_ns) in list(bench.arrivals.items((), (blink,) * 3))


def test_a_message_waits_for_nothing() -> None:
    # The latency of this layer is zero: an item comes out of the very call that its message goes into.
    bench = ready()
    for eye in (0, 1) * 20:
        bench.now_ns += 2 * MS
        assert len(samples(bench.pupil(eye=eye))) == 1


def test_nobody_there_is_told_once_and_the_first_sample_ends_it() -> None:
    bench = Bench()
    (reason,) = silences(bench.wait(S))
    assert "start Pupil Capture" in reason
    assert silences(bench.news(Unreachable(reason))) == []
    assert silences(bench.news(Unreachable("not Pupil Remote"))) == ["not Pupil Remote"]
    items = bench.news(Connected(bench.now_ns, "3.6.14", 1234)) + bench.round_trips()
    assert [item.detail for item in items if isinstance(item, TrackerStatus)] == [
        "Pupil Capture 3.6.14 answers at tcp://lab:50020, its data is at port 1234"
    ]
    assert silences(items) == []
    assert [type(item) for item in bench.pupil()] == [SourceBack, PupilSample, Tick]
    assert [type(item) for item in bench.pupil()] == [PupilSample, Tick]


def test_capture_that_dies_is_told_before_and_after_its_remote_was_asked() -> None:
    bench = ready()
    bench.news(Connected(bench.now_ns, "3.6.14", 1234))
    bench.now_ns += MS
    bench.pupil()
    assert ["still running" in reason for reason in silences(bench.wait(S))] == [True]
    assert silences(bench.news(Unreachable("nobody answers"))) == ["nobody answers"]


def test_capture_without_eye_data_is_told_with_a_remedy() -> None:
    bench = ready()
    bench.news(Connected(bench.now_ns, "3.6.14", 1234))
    bench.round_trips(1)
    assert ["switch on the detection" in reason for reason in silences(bench.wait(S))] == [True]
    assert silences(bench.wait(S)) == []
    assert isinstance(bench.pupil()[0], SourceBack)


def test_unreadable_data_is_told_with_a_remedy() -> None:
    bench = ready()
    bench.news(Connected(bench.now_ns, "3.6.14", 1234))
    reasons: list[str] = []
    for _ in range(20):
        bench.round_trips(1)
        reasons += silences(list(bench.arrivals.items((), (Message(bench.now_ns, [b"pupil.0.3d", b"\xc1"]),))))
        reasons += silences(bench.wait(100 * MS))
    assert ["cannot be read" in reason for reason in reasons] == [True]
    assert bench.counts["DatumError"] == 20


def test_a_reader_that_paused_takes_its_old_messages_for_no_silence() -> None:
    bench = ready()
    messages = tuple(bench.message() for _ in range(3))
    bench.now_ns += 5 * S
    items = list(bench.arrivals.items((), messages))
    assert (len(samples(items)), silences(items)) == (3, [])


def test_the_same_capture_is_announced_once() -> None:
    bench = Bench()
    first, again, other = (bench.news(Connected(bench.now_ns, "3.6.14", port)) for port in (1234, 1234, 4321))
    assert [len(first), len(again), len(other)] == [1, 0, 1]


def notice(bench: Bench, subject: str, **fields: object) -> list[Item]:
    frames = [f"notify.{subject}".encode(), msgpack.packb({"subject": subject, **fields})]
    return list(bench.arrivals.items((), (Message(bench.now_ns, frames),)))


def test_an_order_is_answered_by_the_notification_alone() -> None:
    bench = ready()
    bench.news(OrderGiven(Order(Command.START_RECORDING, pupil_remote.start_recording("a"), bench.now_ns)))
    (task,) = notice(bench, "recording.started", rec_path="/r/a/000")
    assert isinstance(task, TrackerTask)
    assert (task.outcome, task.detail) == (TaskOutcome.STARTED, "/r/a/000")
    assert not any(isinstance(item, TrackerTask) for item in bench.wait(100 * S))


def test_an_order_without_a_notification_fails_with_what_capture_logged() -> None:
    bench = ready()
    bench.news(OrderGiven(Order(Command.START_CALIBRATION, pupil_remote.START_CALIBRATION, bench.now_ns)))
    record = {"name": "base_plugin", "msg": "Calibration already running."}
    list(bench.arrivals.items((), (Message(bench.now_ns + 1, [b"logging.warning", msgpack.packb(record)]),)))
    (task,) = (item for item in bench.wait(5 * S) if isinstance(item, TrackerTask))
    assert task.outcome is TaskOutcome.FAILED
    assert "already running" in task.detail


def test_an_order_that_cannot_be_sent_fails_at_once() -> None:
    bench = ready()
    order = Order(Command.STOP_RECORDING, pupil_remote.STOP_RECORDING, bench.now_ns)
    items = bench.news(OrderGiven(order), OrderRefused(order, "nobody answers"))
    assert [item.outcome for item in items if isinstance(item, TrackerTask)] == [TaskOutcome.FAILED]


def test_a_full_inbox_keeps_the_newest_samples_and_every_notification() -> None:
    inbox = Inbox(room=3)
    for number in range(10):
        inbox.put_message(Message(number, [b"pupil.0.3d"]))
        if number < 2:
            inbox.put_message(Message(number, [b"notify.recording.started"]))
    news, messages = inbox.take(0.0)
    assert ([message.received_ns for message in messages], news) == ([0, 1, 7, 8, 9], [])
    assert inbox.dropped == 7
    assert inbox.take(0.0) == ([], [])
