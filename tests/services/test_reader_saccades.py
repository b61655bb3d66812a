"""States and saccades for frames, recorded or live; and what a renderer makes of saccades."""

import math
from collections.abc import Callable

import pytest
from bridges import MS, Bridge, never, started_reader

from entoptic.services.reader import StateReader
from entoptic.services.rendering import impulses_of, pose_of
from entoptic.services.session.eyes import RecordedEyes
from entoptic.tracker_bridge.chain import Chain, LatencyMode, records_of
from entoptic.tracker_bridge.events import Event, SaccadeKind, SaccadeOffset, StreamEnded, StreamStarted
from entoptic.tracker_bridge.samples import Eye, EyeState, OneEyeState, Phase
from entoptic.tracker_bridge.sources import open_source
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings


def saccade(t_ms: int, azimuth_deg: float = 3.0, *, offset_ms: int | None = None) -> SaccadeOffset:
    offset_ns = (t_ms - 20 if offset_ms is None else offset_ms) * MS
    return SaccadeOffset(
        t_ms * MS, offset_ns - 30 * MS, offset_ns, SaccadeKind.SACCADE, abs(azimuth_deg), 200.0, azimuth_deg, -1.0
    )


def told_ms(saccades: tuple[SaccadeOffset, ...]) -> list[int]:
    return [one.t_ns // MS for one in saccades]


@pytest.mark.parametrize("latency_mode", LatencyMode)
def test_a_recording_s_states_and_saccades_come_with_the_frames_they_belong_to(latency_mode: LatencyMode) -> None:
    source = open_source("simulated", simulated=SimulatedSettings(seconds=8.0, seed=5))
    records = list(records_of(source.samples(), Chain(latency_mode=latency_mode)))
    told = [record.t_ns for record in records if isinstance(record, SaccadeOffset)]
    states = [record.t_ns for record in records if isinstance(record, EyeState)]
    assert len(told) >= 5
    noted: list[EyeState | Event] = []
    eyes = RecordedEyes(source, Chain(latency_mode=latency_mode), None, never, noted.append)
    start_ns, frame_ns = eyes.start_ns, 50 * MS
    for frame in range(160):
        t_ns = start_ns + frame * frame_ns
        got = [one.t_ns for one in eyes.saccades_until(t_ns)]
        assert got == [told_ns for told_ns in told if t_ns - frame_ns * (frame > 0) < told_ns <= t_ns]
        newest = eyes.until(t_ns)
        assert None if newest is None else newest.t_ns == max(one for one in states if one <= t_ns)
    eyes.finish()
    assert noted[1:-1] == records
    assert noted[0] == StreamStarted(start_ns, source.info.t_end_ns, source.info.name)
    assert noted[-1] == StreamEnded(eyes.ended_ns, eyes.states)
    assert eyes.states == len(states)


def test_a_recording_is_read_as_late_as_can_be_and_no_longer_than_asked() -> None:
    source = open_source("simulated", simulated=SimulatedSettings(seconds=3.0, seed=5))
    noted: list[EyeState | Event] = []
    eyes = RecordedEyes(source, Chain(), 1.0, lambda: eyes.states > 60, noted.append)
    assert eyes.until(eyes.start_ns) is not None
    assert eyes.states == 2
    eyes.finish()
    assert 61 <= eyes.states <= 64  # it was asked to stop
    eyes = RecordedEyes(source, Chain(), 1.0, never, noted.append)
    eyes.finish()
    assert eyes.ended_ns is not None
    assert eyes.ended_ns - eyes.start_ns <= 1000 * MS


def test_a_live_reader_hears_each_saccade_once(bridge: Bridge, connect: Callable[..., StateReader]) -> None:
    reader = started_reader(bridge, connect)
    heard: list[int] = []
    for t_ms in (100, 200, 150):
        bridge.event(saccade(t_ms))
    while len(heard) < 3:
        reader.newest()
        heard += told_ms(reader.saccades_received())
    assert heard == [100, 200, 150]
    assert reader.saccades_received() == ()


def test_kicks_are_as_old_as_their_saccades() -> None:
    first, second = impulses_of([saccade(1000, 5.0), saccade(1500, -0.3, offset_ms=1490)], 1600 * MS)
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
    saccade_impulses = impulses_of([saccade(3000, azimuth_deg, offset_ms=offset_ms)], 3000 * MS)
    assert len(saccade_impulses) == counts
    assert all(0.0 <= kick.ago_s <= 2.0 and math.isfinite(kick.right_deg) for kick in saccade_impulses)


def test_looking_has_each_eyes_openness_and_both_eyes_kicks() -> None:
    right = OneEyeState(Phase.BLINK, 4.0, None, 0.0, 0.2, None)
    left = OneEyeState(Phase.DROPOUT, 4.0, None, 0.0, None, None)
    both = EyeState(0, 0, right, left, None)
    saccade_impulses = impulses_of([saccade(0)], 0)
    assert [pose_of(both, eye, saccade_impulses).openness for eye in Eye] == [0.2, 1.0]
    assert all(pose_of(both, eye, saccade_impulses).saccade_impulses == saccade_impulses for eye in Eye)
    assert pose_of(None, Eye.LEFT, saccade_impulses).saccade_impulses == ()
