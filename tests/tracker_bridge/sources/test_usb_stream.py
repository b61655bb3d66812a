import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.clock import ArrivalClock
from entoptic.tracker_bridge.events import ClockEstimated, TrackerStatus
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Tick
from entoptic.tracker_bridge.sources.usb.stream import Connection, PacketStream
from entoptic.tracker_bridge.usb_twin.report import DESCRIPTOR, feature_report, status_report, tracking_report

Shared = Callable[[str], Path]
FEATURES = {number: report for number in range(0x11, 0x15) if (report := feature_report(number, 3))}
NOW_NS = 10**15


def stream(descriptor: bytes = DESCRIPTOR) -> PacketStream:
    return PacketStream(Connection("it", descriptor, 64, FEATURES), ArrivalClock())


def report_at(device_us: int) -> tuple[bytes, bytes]:
    report = tracking_report([PupilSample(0, Eye.LEFT, 4.0, 0.9)], device_us, mode=3)
    return report[:64], report[64:]


def test_samples_come_with_the_last_packet_of_their_report() -> None:
    own = stream()
    first, last = report_at(5)
    assert own.add(first, NOW_NS) == []
    kinds = [type(item) for item in own.add(last, NOW_NS + 1)]
    assert kinds == [ClockEstimated, PupilSample, Tick]


def test_a_status_is_told_when_it_changes() -> None:
    own = stream()
    assert own.status is not None
    assert own.add(status_report(), NOW_NS) == []
    needs_calibration = struct.pack("<BBH", 0x13, 4, 0)
    (told,) = own.add(needs_calibration, NOW_NS)
    assert isinstance(told, TrackerStatus)
    assert not told.ready
    assert "calibration" in told.detail
    assert own.add(needs_calibration, NOW_NS) == []


def test_bad_reports_are_told_of_once_a_second_and_all_counted() -> None:
    own = stream()
    told = [item for at in range(300) for item in own.add(b"\x77", NOW_NS + at * 10_000_000)]
    assert own.bad_count == 300
    assert [item.detail for item in told if isinstance(item, TrackerStatus)] == [
        "report 0x77 came, which the descriptor does not have; it was left out",
        "report 0x77 came, which the descriptor does not have; it was left out, and 99 more",
        "report 0x77 came, which the descriptor does not have; it was left out, and 99 more",
    ]


def test_a_stall_in_the_middle_of_a_report_costs_that_report_alone() -> None:
    own = stream()
    own.add(report_at(5)[0], NOW_NS)
    own.lose()
    assert own.bad_count == 0
    found = [item for packet in report_at(10) for item in own.add(packet, NOW_NS)]
    assert any(isinstance(item, PupilSample) for item in found)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["gazehid_eyetracker", "dmf_virtualeyegaze"])
def test_a_tracker_without_the_vendor_page_gives_the_gaze_of_both_eyes(shared: Shared, name: str) -> None:
    own = stream(shared(f"hid/{name}_report_descriptor.bin").read_bytes())
    assert any("reports no pupil" in note for note in own.notes)
    # The eyes at 600 mm, the point 600 mm to the right of their middle and level with it: 45°.
    left, right = (70_000, 150_000, 600_000), (130_000, 150_000, 600_000)
    report = struct.pack("<BQ14i", 0x10, 1_000_000, 700_000, 150_000, *left, *right, *[0] * 6)
    items = [item for packet in (report[:64], report[64:]) for item in own.add(packet, NOW_NS)]
    (gaze,) = [item for item in items if isinstance(item, PupilSample | GazeSample)]
    assert gaze == GazeSample(NOW_NS - 1_000_000, None, pytest.approx(45.0), pytest.approx(0.0), 1.0)


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=64), st.integers(0, 10**9).map(lambda us: report_at(us)[0]), st.just(b"\x10" * 47)
        ),
        max_size=40,
    )
)
def test_any_packets_are_read_or_left_out_and_the_tracker_goes_on(packets: list[bytes]) -> None:
    own = stream()
    for at, packet in enumerate(packets):
        own.add(packet, NOW_NS + at * 5_000_000)
    after = [item for packet in report_at(7) * 3 for item in own.add(packet, NOW_NS + 10**9)]
    assert sum(isinstance(item, PupilSample) for item in after) >= 1
