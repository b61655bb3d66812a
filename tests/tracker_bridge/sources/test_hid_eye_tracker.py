import math
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.hid.descriptor import ReportKind
from entoptic.tracker_bridge.sources.hid.eye_tracker import Configuration, EyeTrackerReports, Status
from entoptic.tracker_bridge.sources.hid.gaze import INTERPUPILLARY_MM, middle_mm, samples_of, viewing
from entoptic.tracker_bridge.sources.hid.items import HidDescriptorError
from entoptic.tracker_bridge.sources.hid.report import HidReportError, ReportLayout
from entoptic.tracker_bridge.sources.hid.tracking import Tracking
from entoptic.tracker_bridge.usb_twin.report import (
    DESCRIPTOR,
    EYES_UM,
    MIDDLE_UM,
    feature_report,
    tracking_report,
)

Shared = Callable[[str], Path]
REAL = ["gazehid_eyetracker", "dmf_virtualeyegaze"]
TWIN = EyeTrackerReports(DESCRIPTOR)
FEATURES = {number: report for number in range(0x11, 0x15) if (report := feature_report(number, 3))}
VIEWING = viewing(TWIN.configuration(FEATURES))


def input_layout(reports: EyeTrackerReports, number: int) -> ReportLayout:
    return next(layout for layout in reports.inputs if layout.report_id == number)


def read(reports: EyeTrackerReports, report: bytes) -> Tracking:
    status, tracking = reports.read(input_layout(reports, report[0]), report)
    assert status is None
    assert tracking is not None
    return tracking


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_a_packed_report_is_read_at_its_documented_offsets(shared: Shared, name: str) -> None:
    # GazeHid: ID, u64 time, then i32: gaze x y, left x y z, right x y z, head x y z, head direction x y z.
    reports = EyeTrackerReports(shared(f"hid/{name}_report_descriptor.bin").read_bytes())
    report = struct.pack("<BQ14i", 0x10, 1_234_567_890_123, 265_500, -1, 233_500, 149_000, 651_000, *range(-9, 0))
    report = report[:25] + struct.pack("<i", 651_000) + struct.pack("<3i", 297_000, 150_000, 650_500) + report[41:]
    assert len(report) == 65
    tracking = read(reports, report)
    assert tracking.time_ns == 1_234_567_890_123_000
    assert tracking.gaze_mm == pytest.approx((265.5, -0.001))
    assert tracking.eyes[Eye.LEFT].position_mm == pytest.approx((233.5, 149.0, 651.0))
    assert tracking.eyes[Eye.RIGHT].position_mm == pytest.approx((297.0, 150.0, 650.5))
    assert not any(tracking.eyes[eye].has_pupil for eye in Eye)
    assert any("reports no pupil" in note for note in reports.notes)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_features_of_real_descriptors_are_read(shared: Shared, name: str) -> None:
    reports = EyeTrackerReports(shared(f"hid/{name}_report_descriptor.bin").read_bytes())
    configuration = reports.configuration(
        {
            0x11: struct.pack("<BB5i", 0x11, 1, 500_000, 700_000, 900_000, 600_000, 400_000),
            0x12: struct.pack("<BHHIHII", 0x12, 1, 2, 3, 4, 531_000, 299_000),
            0x13: struct.pack("<BBH", 0x13, 4, 90),
        }
    )
    assert configuration.screen_mm == pytest.approx((531.0, 299.0))
    assert configuration.optimum_distance_mm == pytest.approx(700.0)
    assert configuration.status == Status(4, 90.0)
    assert "calibration" in str(configuration.status)
    request = reports.mode_request()
    assert request is not None
    assert request[1] == b"\x14\x03"
    assert request[0].kind is ReportKind.FEATURE


def test_what_is_no_eye_tracker_is_refused() -> None:
    mouse = bytes.fromhex("05 01 09 02 a1 01 75 08 95 02 15 81 25 7f 09 30 09 31 81 06 c0")
    with pytest.raises(HidDescriptorError, match="no eye tracker"):
        EyeTrackerReports(mouse)


def test_features_nobody_set_or_of_a_wrong_length_say_nothing() -> None:
    reports = EyeTrackerReports(DESCRIPTOR)
    unset = struct.pack("<BHHIHII", 0x12, 0, 0, 0, 0, 0, 0)
    assert reports.configuration({0x12: unset, 0x13: b"\x13\x01"}) == Configuration(None, None, None)
    assert any("feature was left out" in note for note in reports.notes)


@pytest.mark.parametrize(("code", "ready"), [(0, False), (1, True), (2, False), (3, False), (4, False)])
def test_status(code: int, ready: bool) -> None:
    status, tracking = TWIN.read(input_layout(TWIN, 0x13), struct.pack("<BBH", 0x13, code, 120))
    assert tracking is None
    assert status is not None
    assert status.is_ready is ready
    assert "120 samples" in str(status)


def vendor(body: str) -> EyeTrackerReports:
    """A tracker whose right eye's collection holds this."""
    head = "05 12 09 01 a1 01 85 10 15 00 26 ff 7f 75 10 95 01"
    eye = "0b 01 00 12 ff a1 02 0b 02 00 12 ff a1 02"
    return EyeTrackerReports(bytes.fromhex(f"{head} {eye} {body} c0 c0 c0"))


def test_a_diameter_without_confidence_is_trusted_where_there_is_one() -> None:
    reports = vendor("65 11 55 0c 0b 20 00 12 ff 81 42")
    seen, lost = (read(reports, b"\x10" + value).eyes[Eye.RIGHT] for value in (b"\xa0\x0f", b"\xff\xff"))
    assert (seen.has_pupil, seen.pupil_diameter_mm, seen.confidence) == (True, pytest.approx(4.0), 1.0)
    assert (lost.has_pupil, lost.pupil_diameter_mm, lost.confidence) == (True, None, 0.0)
    assert not read(reports, b"\x10\x00\x00").eyes[Eye.LEFT].has_pupil


def test_a_diameter_in_no_unit_and_shares_that_do_not_end_at_one_are_left_out_with_a_note() -> None:
    reports = vendor("65 00 0b 20 00 12 ff 81 42 0b 24 00 12 ff 81 42")
    eye = read(reports, b"\x10\xa0\x0f\xa0\x0f").eyes[Eye.RIGHT] if reports.notes == [] else None
    assert eye is None
    assert any("no unit of length" in note for note in reports.notes)
    assert any("does not go from 0 to 1" in note for note in reports.notes)


def test_the_vendor_page_counts_only_inside_its_own_collection() -> None:
    foreign = "05 12 09 01 a1 01 15 00 26 ff 7f 75 10 95 01 65 11 55 0c 0b 02 00 12 ff a1 02 0b 20 00 12 ff 81 42 c0 c0"
    reports = EyeTrackerReports(bytes.fromhex(foreign))
    assert any("reports no pupil" in note for note in reports.notes)


T_NS = 7_000_000_000
angles = st.tuples(st.floats(-60, 60), st.floats(-50, 50))
shares = st.floats(0, 1)
maybe_shares = st.none() | shares


@given(
    st.lists(st.tuples(angles, shares), min_size=3, max_size=3),
    st.none() | st.floats(-10_000, 20_000),
    shares,
    maybe_shares,
    st.none() | st.floats(0, 600),
    maybe_shares,
)
def test_samples_come_back_within_their_quanta(
    gazes: list[tuple[tuple[float, float], float]],
    pupil_diameter_mm: float | None,
    confidence: float,
    model: float | None,
    image_px: float | None,
    openness: float | None,
) -> None:
    pupils = [PupilSample(T_NS, eye, pupil_diameter_mm, confidence, model, image_px, openness) for eye in Eye]
    directions = [GazeSample(T_NS, eye, *angle, share) for eye, (angle, share) in zip((*Eye, None), gazes, strict=True)]
    found = samples_of(read(TWIN, tracking_report([*pupils, *directions], 5_000_000, mode=3)), VIEWING, T_NS)
    assert [(type(s), s.eye) for s in found] == [(type(s), s.eye) for s in (*pupils, *directions)]
    for was, now in zip([*pupils, *directions], found, strict=True):
        if isinstance(was, PupilSample) and isinstance(now, PupilSample):
            near(was.pupil_diameter_mm, now.pupil_diameter_mm, 0.0006)
            near(was.diameter_px, now.diameter_px, 0.0051)
            near(was.confidence, now.confidence, 0.00006)
            near(was.model_confidence, now.model_confidence, 0.00006)
            near(was.openness, now.openness, 0.00006)
        elif isinstance(was, GazeSample) and isinstance(now, GazeSample):
            near(was.azimuth_deg, now.azimuth_deg, 0.0001)
            near(was.elevation_deg, now.elevation_deg, 0.0001)
            near(was.confidence, now.confidence, 0.00006)


def near(was: float | None, now: float | None, by: float) -> None:
    assert (was is None) == (now is None)
    assert was is None or now is None or abs(was - now) <= by


def test_what_a_moment_lacks_is_not_made_up() -> None:
    only = [PupilSample(T_NS, Eye.LEFT, 4.0, 0.9), GazeSample(T_NS, None, 1.0, 2.0, 0.8)]
    found = samples_of(read(TWIN, tracking_report(only, 0, mode=3)), VIEWING, T_NS)
    assert [(type(sample), sample.eye) for sample in found] == [(PupilSample, Eye.LEFT), (GazeSample, None)]
    assert samples_of(read(TWIN, tracking_report([], 0, mode=3)), VIEWING, T_NS) == []


@pytest.mark.parametrize(("azimuth", "elevation"), [(91.0, 0.0), (-80.0, 0.0), (0.0, 90.0), (180.0, 0.0)])
def test_gaze_past_the_reports_limits_is_left_out(azimuth: float, elevation: float) -> None:
    report = tracking_report([GazeSample(T_NS, None, azimuth, elevation, 1.0)], 0, mode=3)
    assert samples_of(read(TWIN, report), VIEWING, T_NS) == []


def tracking_with(left: tuple[int, int, int], right: tuple[int, int, int], gaze_um: tuple[int, int]) -> Tracking:
    report = bytearray(tracking_report([], 0, mode=3))
    report[9:41] = struct.pack("<2i3i3i", *gaze_um, *left, *right)
    return read(TWIN, bytes(report))


def both_deg(tracking: Tracking) -> tuple[float, float]:
    (sample,) = samples_of(tracking, VIEWING, T_NS)
    assert isinstance(sample, GazeSample)
    return sample.azimuth_deg, sample.elevation_deg


def test_the_direction_is_that_from_between_the_eyes_to_the_point() -> None:
    left, right = (100_000, 200_000, 600_000), (160_000, 200_000, 600_000)
    # 346.41 mm to the right of 130 mm, at 600 mm: 30°. Then up by the same distance along the line of sight.
    assert both_deg(tracking_with(left, right, (130_000 + 346_410, 200_000))) == pytest.approx((30.0, 0.0), abs=1e-4)
    assert both_deg(tracking_with(left, right, (130_000, -400_000))) == pytest.approx((0.0, 45.0), abs=1e-4)
    distance = math.hypot(600.0, 346.41)
    up = 200_000 - round(distance * 1000)
    assert both_deg(tracking_with(left, right, (476_410, up))) == pytest.approx((30.0, 45.0), abs=1e-3)


def test_gaze_does_not_jump_when_an_eye_is_lost() -> None:
    left, right = EYES_UM[Eye.LEFT], EYES_UM[Eye.RIGHT]
    gaze, nobody = (300_000, 100_000), (0, 0, 0)
    whole = both_deg(tracking_with(left, right, gaze))
    for seen in (tracking_with(left, nobody, gaze), tracking_with(nobody, right, gaze)):
        assert middle_mm(seen) == pytest.approx([um / 1000 for um in MIDDLE_UM])
        assert both_deg(seen) == pytest.approx(whole)


def test_eyes_that_are_not_placed_are_assumed_and_it_is_said() -> None:
    nobody = (0, 0, 0)
    tracking = tracking_with(nobody, nobody, (MIDDLE_UM[0], MIDDLE_UM[1]))
    assert both_deg(tracking) == pytest.approx((0.0, 0.0))
    assert "650 mm" in VIEWING.notes[0]
    usual = viewing(Configuration(screen_mm=(500.0, 300.0)))
    assert usual.middle_mm == (250.0, 150.0, 650.0)
    assert usual.eye_mm(Eye.RIGHT) == (250.0 + INTERPUPILLARY_MM / 2, 150.0, 650.0)
    unknown = viewing(Configuration())
    assert samples_of(tracking, unknown, T_NS) == []
    assert "no direction" in unknown.notes[0]


def test_the_mode_decides_what_is_reported() -> None:
    everything = [PupilSample(T_NS, Eye.LEFT, 4.0, 0.9), GazeSample(T_NS, None, 1.0, 2.0, 0.8)]
    eyes_only = read(TWIN, tracking_report(everything, 0, mode=2))
    assert eyes_only.gaze_mm is None
    assert eyes_only.eyes[Eye.LEFT].position_mm is not None
    gaze_only = read(TWIN, tracking_report(everything, 0, mode=1))
    assert gaze_only.gaze_mm is not None
    assert gaze_only.eyes[Eye.LEFT].position_mm is None


def test_an_impossible_time_is_refused() -> None:
    report = bytearray(tracking_report([], 0, mode=3))
    report[1:9] = b"\xff" * 8
    with pytest.raises(HidReportError, match="impossible time"):
        read(TWIN, bytes(report))


def test_one_report_may_tell_of_the_tracker_and_of_the_eyes() -> None:
    head = "05 12 09 01 a1 01 85 10 15 00 25 04 75 08 95 01 0a 01 03 81 02"
    eye = "26 ff 7f 75 10 65 11 55 0c 0b 01 00 12 ff a1 02 0b 02 00 12 ff a1 02 0b 20 00 12 ff 81 42 c0 c0 c0"
    reports = EyeTrackerReports(bytes.fromhex(head + eye))
    status, tracking = reports.read(input_layout(reports, 0x10), b"\x10\x01\xa0\x0f")
    assert status == Status(1, None)
    assert tracking is not None
    assert tracking.eyes[Eye.RIGHT].pupil_diameter_mm == pytest.approx(4.0)


@given(st.binary(min_size=110, max_size=110))
def test_samples_of_any_report_are_within_their_ranges(body: bytes) -> None:
    report = b"\x10" + body[:6] + b"\0\0" + body[8:]
    for sample in samples_of(read(TWIN, report), VIEWING, T_NS):
        assert 0.0 <= sample.confidence <= 1.0
        if isinstance(sample, GazeSample):
            assert abs(sample.azimuth_deg) <= 90.0
            assert abs(sample.elevation_deg) <= 90.0
        else:
            assert sample.openness is None or 0.0 <= sample.openness <= 1.0
