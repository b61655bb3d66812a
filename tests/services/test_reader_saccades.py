"""Saccades in step with the states, whatever their sockets do; and what a renderer makes of them."""

import math
import threading
from collections.abc import Callable

import pytest
from bridges import MS, PATIENCE_S, Bridge, LossyBridge, never, started_reader, state, subscribed

from entoptic.services import event_feed
from entoptic.services.reader import BridgeSilentError, StateReader
from entoptic.services.rendering import kicks_of, looking_of
from entoptic.tracker_bridge import bridge as eye_side
from entoptic.tracker_bridge import replay, wire
from entoptic.tracker_bridge.chain import Chain, Lane, records_of
from entoptic.tracker_bridge.events import Event, SaccadeKind, SaccadeOffset, StreamEnded
from entoptic.tracker_bridge.samples import Eye, EyeState, OneEyeState, Phase
from entoptic.tracker_bridge.sources import open_source
from entoptic.tracker_bridge.sources.simulated import SimulatedSettings


def saccade(t_ms: int, azimuth_deg: float = 3.0, *, offset_ms: int | None = None) -> SaccadeOffset:
    offset_ns = (t_ms - 20 if offset_ms is None else offset_ms) * MS
    return SaccadeOffset(
        t_ms * MS, offset_ns - 30 * MS, offset_ns, SaccadeKind.SACCADE, abs(azimuth_deg), 200.0, azimuth_deg, -1.0
    )


class LateEvents:
    """A bridge whose events are kept and to be had, while its events socket says nothing."""

    def __init__(self, lossy: LossyBridge, connect: Callable[..., StateReader]) -> None:
        self._lossy = lossy
        self._ring = replay.EventRing()
        self.reader = subscribed(lossy, connect, newest_only=False)
        self.asked = 0
        lossy.events.send(lossy.message(0, heartbeat=True))
        while self.reader.events.heard_s is None:
            assert self.reader.events.read(int(PATIENCE_S * 1e3)) == []

    def keep(self, event: Event) -> None:
        number = self._ring.last + 1
        self._ring.add(wire.encode_event(event, stream=1, sequence=number, replay_port=self._lossy.port))

    def states(self, numbers: range) -> None:
        for number in numbers:
            self._lossy.states.send(wire.encode_state(state(number)))

    def answering(self) -> bool:
        """Never stops a reader, and answers it in the meantime."""
        while self._lossy.replay.poll(1):
            self._lossy.replay.send(replay.answer(self._ring, self._lossy.replay.recv()))
            self.asked += 1
        return False


@pytest.fixture
def late(lossy: LossyBridge, connect: Callable[..., StateReader]) -> LateEvents:
    return LateEvents(lossy, connect)


def told_ms(saccades: tuple[SaccadeOffset, ...]) -> list[int]:
    return [one.t_ns // MS for one in saccades]


def test_each_frame_has_its_own_saccades_though_their_socket_is_late(late: LateEvents) -> None:
    for t_ms in (40, 50, 51, 120, 400, 900):
        late.keep(saccade(t_ms))
    late.states(range(300))
    got = [told_ms(late.reader.saccades_until(t_ms * MS, late.answering)) for t_ms in (0, 50, 100, 150, 1000)]
    assert got == [[], [40, 50], [51], [120], [400, 900]]
    newest = late.reader.until(1000 * MS, never)
    assert newest is not None
    assert newest.t_ns == 1000 * MS


def test_reading_ahead_loses_no_state(late: LateEvents) -> None:
    late.states(range(400))
    for t_ms in range(0, 1500, 20):
        assert late.reader.saccades_until(t_ms * MS, late.answering) == ()
        newest = late.reader.until(t_ms * MS, never)
        assert newest is not None
        assert newest.t_ns == t_ms * MS
    assert late.asked == 75  # a round trip a frame while there are no events


def test_a_saccade_that_is_told_late_comes_with_its_frame(late: LateEvents) -> None:
    late.states(range(240))  # to 1195 ms
    begun = []

    def publishes_on() -> bool:
        if not begun and late.reader.received == 240:
            begun.append(True)
            late.keep(saccade(1000))
            late.states(range(240, 260))
        return late.answering()

    assert told_ms(late.reader.saccades_until(1000 * MS, publishes_on)) == [1000]


def test_an_answer_from_before_is_not_taken_for_one_from_now(late: LateEvents, lossy: LossyBridge) -> None:
    late.keep(saccade(10))
    lossy.events.send(lossy.message(1, heartbeat=True))  # shows a gap: the reader asks
    while not lossy.replay.poll(0):
        late.reader.events.read(10)
    late.answering()
    late.keep(saccade(20))
    late.states(range(100))
    assert told_ms(late.reader.saccades_until(20 * MS, late.answering)) == [10, 20]


def test_a_bridge_that_answers_nobody_is_named(late: LateEvents, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_feed, "ANSWER_WITHIN_S", 0.05)
    late.states(range(100))
    with pytest.raises(BridgeSilentError, match=r"replay port.*ocular_dynamics\.vitreous"):
        late.reader.saccades_until(0, never)


def test_after_the_end_nobody_is_asked(late: LateEvents, lossy: LossyBridge) -> None:
    late.states(range(10))
    for number, event in enumerate((saccade(20), saccade(45), StreamEnded(45 * MS, 10)), 1):
        lossy.events.send(wire.encode_event(event, stream=1, sequence=number, replay_port=lossy.port))
    assert told_ms(late.reader.saccades_until(30 * MS, never)) == [20]
    assert told_ms(late.reader.saccades_until(50 * MS, never)) == [45]
    assert late.asked == 0


def test_an_end_that_comes_while_asking_is_enough(late: LateEvents, lossy: LossyBridge) -> None:
    late.states(range(100))
    for number, event in enumerate((saccade(20), StreamEnded(495 * MS, 100)), 1):
        lossy.events.send(wire.encode_event(event, stream=1, sequence=number, replay_port=lossy.port))
    assert told_ms(late.reader.saccades_until(30 * MS, never)) == [20]


@pytest.mark.parametrize("lane", Lane)
def test_a_recordings_saccades_come_with_the_frames_they_belong_to(
    lane: Lane, bridge: Bridge, connect: Callable[..., StateReader]
) -> None:
    source = open_source("simulated", simulated=SimulatedSettings(seconds=8.0, seed=5))
    told = [r.t_ns for r in records_of(source.samples(), Chain(lane=lane)) if isinstance(r, SaccadeOffset)]
    assert len(told) >= 5
    reader = connect(bridge.publisher.addresses, newest_only=False)

    def publish() -> None:
        bridge.publisher.wait_for_reader(never)
        eye_side.run(source, Chain(lane=lane), bridge.publisher, real_time=False, seconds=None, stopped=never)

    thread = threading.Thread(target=publish, daemon=True)
    thread.start()
    started = reader.wait_for_start(never)
    assert started is not None
    start_ns, frame_ns = started.t_ns, 50 * MS
    for frame in range(160):
        t_ns = start_ns + frame * frame_ns
        got = [one.t_ns for one in reader.saccades_until(t_ns, never)]
        assert got == [told_ns for told_ns in told if t_ns - frame_ns * (frame > 0) < told_ns <= t_ns]
        reader.until(t_ns, never)
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_a_live_reader_hears_each_saccade_once(bridge: Bridge, connect: Callable[..., StateReader]) -> None:
    reader = started_reader(bridge, connect)
    heard: list[int] = []
    for t_ms in (100, 200, 150):
        bridge.event(saccade(t_ms))
    while len(heard) < 3:
        reader.newest()
        heard += told_ms(reader.saccades_heard())
    assert heard == [100, 200, 150]
    assert reader.saccades_heard() == ()


def test_kicks_are_as_old_as_their_saccades() -> None:
    first, second = kicks_of([saccade(1000, 5.0), saccade(1500, -0.3, offset_ms=1490)], 1600 * MS)
    assert (first.right_deg, first.up_deg, first.ago_s) == (5.0, -1.0, pytest.approx(0.62))
    assert (second.right_deg, second.ago_s) == (-0.3, pytest.approx(0.11))


@pytest.mark.parametrize(
    ("offset_ms", "azimuth_deg", "counts"),
    [
        (3000, 4.0, True),
        (1000, 4.0, True),
        (999, 4.0, False),
        (3050, 4.0, True),
        (3000, 90.0, True),
        (3000, 1e6, False),
    ],
)
def test_old_and_impossible_saccades_kick_nothing(offset_ms: int, azimuth_deg: float, counts: bool) -> None:
    saccade_impulses = kicks_of([saccade(3000, azimuth_deg, offset_ms=offset_ms)], 3000 * MS)
    assert len(saccade_impulses) == counts
    assert all(0.0 <= kick.ago_s <= 2.0 and math.isfinite(kick.right_deg) for kick in saccade_impulses)


def test_looking_has_each_eyes_openness_and_both_eyes_kicks() -> None:
    right = OneEyeState(Phase.BLINK, 4.0, None, 0.0, 0.2, None)
    left = OneEyeState(Phase.DROPOUT, 4.0, None, 0.0, None, None)
    both = EyeState(0, 0, right, left, None)
    saccade_impulses = kicks_of([saccade(0)], 0)
    assert [looking_of(both, eye, saccade_impulses).openness for eye in Eye] == [0.2, 1.0]
    assert all(looking_of(both, eye, saccade_impulses).saccade_impulses == saccade_impulses for eye in Eye)
    assert looking_of(None, Eye.LEFT, saccade_impulses).saccade_impulses == ()
