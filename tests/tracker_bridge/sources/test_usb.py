import errno
import itertools
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played_tracker import START_NS, Played, Sample, Time, over, samples_in, tracker

from entoptic.tracker_bridge.events import ClockJumped, SourceBack, SourceSilent, TrackerStatus
from entoptic.tracker_bridge.samples import NS_PER_S, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, Tick
from entoptic.tracker_bridge.sources.loaded import LoadedSource
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.usb.device import (
    GET_DESCRIPTOR,
    GET_REPORT,
    REPORT_DESCRIPTOR,
    SET_REPORT,
    UsbError,
    UsbTimeout,
)
from entoptic.tracker_bridge.usb_twin.backend import TwinBackend, open_usb_simulated
from entoptic.tracker_bridge.usb_twin.faults import parse_faults

Shared = Callable[[str], Path]


def kinds_in(items: Sequence[Item]) -> list[type]:
    """The kinds of what is told, but for clocks."""
    return [type(item) for item in items if isinstance(item, SourceSilent | SourceBack | TrackerStatus)]


# The whole way


def assert_same(was: Sequence[Sample], now: Sequence[Sample], times_ns: int = 1_500) -> None:
    """Within the quanta of the reports: 1 µs, 1 µm, 0.01 px, 1e-4, and 1e-4° at 650 mm."""
    assert [(type(s), s.eye) for s in was] == [(type(s), s.eye) for s in now]
    shift_ns = now[0].t_ns - was[0].t_ns
    for old, new in zip(was, now, strict=True):
        assert abs(new.t_ns - old.t_ns - shift_ns) <= times_ns
        assert new.confidence == pytest.approx(old.confidence, abs=0.6e-4)
        if isinstance(old, PupilSample) and isinstance(new, PupilSample):
            assert new.pupil_diameter_mm == (old.pupil_diameter_mm and pytest.approx(old.pupil_diameter_mm, abs=0.6e-3))
            assert new.diameter_px == (old.diameter_px and pytest.approx(old.diameter_px, abs=0.6e-2))
            assert new.openness == (old.openness and pytest.approx(old.openness, abs=0.6e-4))
            assert new.model_confidence == (old.model_confidence and pytest.approx(old.model_confidence, abs=0.6e-4))
        elif isinstance(old, GazeSample) and isinstance(new, GazeSample):
            assert new.azimuth_deg == pytest.approx(old.azimuth_deg, abs=1e-4)
            assert new.elevation_deg == pytest.approx(old.elevation_deg, abs=1e-4)


def test_simulated_eyes_come_through_the_whole_usb_path() -> None:
    eyes = SimulatedEyes(SimulatedSettings(seconds=4.0, blinks_per_minute=40.0))
    source = open_usb_simulated(eyes, timekeeper=Time())
    assert source.info.live
    assert source.info.name == "Entoptic Simulated eye tracker (1209:0001)"
    assert_same(list(eyes.samples()), samples_in(list(source.samples())))


@pytest.mark.shared_data
def test_a_real_recording_comes_through_the_whole_usb_path(shared: Shared) -> None:
    # Of its 13.7 s the first 4 hold whole and lost pupils, both eyes and gaze.
    whole = open_recording(shared("eye/pupil_core/recording_000"))
    was = [sample for sample in whole.samples() if sample.t_ns < whole.info.t_start_ns + 4 * NS_PER_S]
    recording = LoadedSource(whole.info, tuple(was))
    now = samples_in(list(open_usb_simulated(recording, timekeeper=Time()).samples()))
    assert_same(was, now)
    assert any(sample.confidence == 0.0 for sample in now)


def test_times_are_this_machines_and_in_order() -> None:
    items = list(tracker(3.0).samples())
    times = [sample.t_ns for sample in samples_in(items)]
    assert times == sorted(times)
    assert abs(times[0] - START_NS) <= 2_000_000
    assert abs(times[-1] - times[0] - 2_990_000_000) <= 2_000


def test_every_report_ends_with_a_tick() -> None:
    items = list(tracker(1.0).samples())
    assert sum(isinstance(item, Tick) for item in items) >= 100
    for before, after in itertools.pairwise(items):
        if isinstance(before, GazeSample):
            assert isinstance(after, Tick)


# Faults


@pytest.mark.parametrize(
    ("fault", "lost", "told"),
    [
        ("unplug@2s:1.5s", 175, [SourceSilent, TrackerStatus, SourceBack]),
        ("unplug@2.003s:1s", 125, [SourceSilent, TrackerStatus, SourceBack]),
        ("stall@2s", 3, [TrackerStatus]),
        ("timeout@2s:0.4s", 40, []),
        ("timeout@2s:1.5s", 150, [SourceSilent, SourceBack]),
        ("short@2s", 2, [TrackerStatus]),
        ("short@2s:0.2s", 22, [TrackerStatus]),
        ("long@2s", 2, [TrackerStatus]),
        ("long@2s:0.2s", 22, [TrackerStatus]),
        ("garbage@2s", 2, [TrackerStatus]),
        ("garbage@2s:0.2s", 22, [TrackerStatus]),
    ],
)
def test_a_fault_costs_its_own_samples_alone(fault: str, lost: int, told: list[type]) -> None:
    items = list(tracker(6.0, fault).samples())
    moments = {sample.t_ns for sample in samples_in(items)}
    assert 600 - lost <= len(moments) < 600
    assert min(moments) < START_NS + 10_000_000
    assert max(moments) > START_NS + 5_980_000_000
    kinds = kinds_in(items)
    # It says that it is ready, then sends: what comes after that is the fault's.
    assert kinds[:2] == [TrackerStatus, SourceBack]
    assert [kind for kind, _ in itertools.groupby(kinds[2:])] == told


def test_an_unplugged_tracker_is_silent_then_back_with_its_clock_begun_anew() -> None:
    items = list(tracker(5.0, "unplug@2s:1s").samples())
    silent = next(at for at, item in enumerate(items) if isinstance(item, SourceSilent))
    back = next(at for at, item in enumerate(items) if at > silent and isinstance(item, SourceBack))
    reason = items[silent]
    assert isinstance(reason, SourceSilent)
    assert "was unplugged: plug it in again" in reason.reason
    assert samples_in(items[:silent])
    assert not samples_in(items[silent:back])
    assert samples_in(items[back:])
    assert any(isinstance(item, ClockJumped) for item in items[silent:back])
    assert abs(samples_in(items[back:])[0].t_ns - items[back].t_ns) <= 2_000_000


ALL_FAULTS = ("unplug@1s:0.5s", "stall@2s", "timeout@2.5s:1.2s", "short@4s:0.1s", "long@4.3s:0.1s", "garbage@4.6s:0.1s")


def test_faults_are_repeatable() -> None:
    runs = [list(tracker(5.0, *ALL_FAULTS).samples()) for _ in range(2)]
    assert runs[0] == runs[1]


def test_no_reader_waits_longer_than_100_ms_for_an_item() -> None:
    time = Time()
    last_ns = time.t_ns
    for _ in open_usb_simulated(Played(6.0), ALL_FAULTS, timekeeper=time).samples():
        assert time.t_ns - last_ns <= 100_000_000
        last_ns = time.t_ns


times = st.integers(0, 15).map(lambda tenths: tenths / 10)
any_fault = st.one_of(
    st.tuples(st.sampled_from(["unplug", "timeout", "short", "long", "garbage"]), times, times).map(
        lambda f: f"{f[0]}@{f[1]}s:{f[2]}s"
    ),
    times.map(lambda at: f"stall@{at}s"),
)


@given(st.lists(any_fault, max_size=4))
@settings(max_examples=12)
def test_any_faults_together_are_survived(faults: list[str]) -> None:
    time = Time()
    backend = TwinBackend(Played(4.0), faults, timekeeper=time)
    items = list(over(backend, time).samples()) if not _is_gone_at_first(faults) else []
    if items:
        # All faults are over by then.
        assert {sample.t_ns for sample in samples_in(items) if sample.t_ns > START_NS + 3_600_000_000}
    assert backend.handles == []


def _is_gone_at_first(faults: list[str]) -> bool:
    return any(fault.kind == "unplug" and fault.start_ns == 0 for fault in parse_faults(faults))


@pytest.mark.parametrize("text", ["", "unplug", "unplug@5", "explode@5s", "unplug@-1s", "stall@3s:1s", "short@1s:"])
def test_what_is_no_fault_is_refused(text: str) -> None:
    with pytest.raises(SourceError, match="is no fault"):
        parse_faults([text])


def test_a_tracker_that_fails_again_and_again_is_let_go_and_taken_again() -> None:
    class Failing(TwinBackend):
        errors = 0

        def intr_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
            if self._elapsed_ns() > 500_000_000 and self.errors < 7:
                self.errors += 1
                raise UsbError("Input/Output Error", None, errno.EIO)
            return super().intr_read(dev_handle, ep, intf, buff, timeout)

    time = Time()
    items = list(over(Failing(Played(3.0), timekeeper=time), time).samples())
    reasons = [item.reason for item in items if isinstance(item, SourceSilent)]
    assert len(reasons) == 1
    assert "fails again and again" in reasons[0]
    assert max(sample.t_ns for sample in samples_in(items)) > START_NS + 2_900_000_000


def test_an_unplugging_that_first_looks_like_an_error_is_told_as_one() -> None:
    class Pulled(TwinBackend):
        def intr_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
            try:
                return super().intr_read(dev_handle, ep, intf, buff, timeout)
            except UsbError as error:
                if error.errno != errno.ENODEV:
                    raise
            raise UsbError("Input/Output Error", None, errno.EIO)

    time = Time()
    items = list(over(Pulled(Played(3.0), ["unplug@1s:0.5s"], timekeeper=time), time).samples())
    (silent,) = [item for item in items if isinstance(item, SourceSilent)]
    assert "was unplugged" in silent.reason


@pytest.mark.parametrize("code", [errno.EPIPE, errno.EIO, errno.EOVERFLOW, None])
def test_a_tracker_that_refuses_requests_for_features_is_read(code: int | None) -> None:
    class Mute(TwinBackend):
        def ctrl_transfer(self, dev_handle: Any, *request: Any) -> int:
            self._mode = 3
            if request[1] in (GET_REPORT, SET_REPORT):
                raise UsbError("Refused", None, code)
            return super().ctrl_transfer(dev_handle, *request)

    time = Time()
    source = over(Mute(Played(1.0), timekeeper=time), time)
    assert any("screen's size" in note for note in source.info.notes)
    found = samples_in(list(source.samples()))
    assert {type(sample) for sample in found} == {PupilSample, GazeSample}
    # It places both eyes, so that their common direction needs no assumption.
    assert len(found) == 300


def test_a_tracker_that_leaves_its_requests_unanswered_is_taken_within_two_seconds() -> None:
    time = Time()

    class Dumb(TwinBackend):
        def ctrl_transfer(self, dev_handle: Any, *request: Any) -> int:
            self._mode = 3
            if request[1:3] == (GET_DESCRIPTOR, REPORT_DESCRIPTOR << 8):
                return super().ctrl_transfer(dev_handle, *request)
            time.wait_ns(request[-1] * 1_000_000)
            raise UsbTimeout("Operation timed out", None, errno.ETIMEDOUT)

    source = over(Dumb(Played(6.0), ["unplug@2s:0.5s"], timekeeper=time), time)
    last_ns, found = time.t_ns, []
    for item in source.samples():
        assert time.t_ns - last_ns <= 2_000_000_000
        last_ns = time.t_ns
        found.append(item)
    assert kinds_in(found) == [TrackerStatus, SourceBack, SourceSilent, TrackerStatus, SourceBack]


# Closing


@pytest.mark.parametrize("count", [0, 1, 2, 50, 700])
def test_closing_frees_the_tracker_and_gives_it_back_to_the_system(count: int) -> None:
    time = Time()
    backend = TwinBackend(Played(3.0), ["unplug@1s:0.5s"], timekeeper=time)
    threads = threading.enumerate()
    source = over(backend, time)
    assert backend.handles == []
    samples = source.samples()
    list(itertools.islice(samples, count))
    samples.close()  # type: ignore[attr-defined]
    assert backend.handles == []
    assert backend.has_system_driver
    assert threading.enumerate() == threads


def test_a_source_that_is_never_read_holds_nothing() -> None:
    time = Time()
    backend = TwinBackend(Played(1.0), timekeeper=time)
    over(backend, time)
    assert (backend.handles, backend.has_system_driver) == ([], True)


def test_a_live_source_cannot_be_played() -> None:
    with pytest.raises(SourceError, match="is live"):
        TwinBackend(tracker(1.0))


def test_the_machines_own_time_will_do() -> None:
    assert len(samples_in(list(open_usb_simulated(Played(0.2)).samples()))) == 60
