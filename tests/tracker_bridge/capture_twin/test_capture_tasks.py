from pathlib import Path

import pytest

from entoptic.tracker_bridge.capture_twin.tasks import Calibration, Recording
from entoptic.tracker_bridge.sources.pupil_core.form import Map
from entoptic.tracker_bridge.sources.pupil_core.recorder import RecordingError
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording

PUPIL = {"id": 0, "topic": "pupil.0.2d", "timestamp": 1.0, "confidence": 1.0, "diameter": 20.0}


def subjects(notifications: list[Map]) -> list[str]:
    assert all(each["topic"] == f"notify.{each['subject']}" for each in notifications)
    return [each["subject"] for each in notifications]


def test_a_calibration_is_stopped_then_fitted() -> None:
    calibration = Calibration(fit_s=5.0)
    assert subjects(calibration.notified("calibration.should_start", 0.0)) == ["calibration.started"]
    assert calibration.notified("calibration.should_start", 1.0) == []
    assert subjects(calibration.notified("calibration.should_stop", 3.0)) == ["calibration.stopped"]
    assert calibration.is_fitting
    assert calibration.tick(7.9, 100.0) == []
    done = calibration.tick(8.0, 100.0)
    assert subjects(done) == ["calibration.successful", "calibration.result.v2"]
    assert done[0]["timestamp"] == 100.0
    assert not calibration.is_fitting
    assert calibration.tick(9.0, 101.0) == []


def test_a_calibration_ends_by_itself() -> None:
    calibration = Calibration(fit_s=1.0)
    calibration.notified("calibration.should_start", 0.0)
    assert calibration.tick(9.9, 0.0) == []
    assert subjects(calibration.tick(10.0, 0.0)) == ["calibration.stopped"]


def test_a_calibration_without_points_fails() -> None:
    calibration = Calibration()
    calibration.notified("calibration.should_start", 0.0)
    calibration.notified("calibration.should_stop", 0.5)
    (failed,) = calibration.tick(0.5, 3.0)
    assert failed["subject"] == "calibration.failed"
    assert failed["reason"]


def test_other_notifications_are_not_for_it() -> None:
    assert Calibration().notified("calibration.should_stop", 0.0) == []
    assert Calibration().notified("recording.should_start", 0.0) == []


def test_recordings_are_numbered(tmp_path: Path) -> None:
    recording = Recording(tmp_path)
    for number in range(2):
        (started,) = recording.notified({"subject": "recording.should_start", "session_name": "test 1"}, 0.5)
        assert recording.notified({"subject": "recording.should_start", "session_name": "other"}, 0.6) == []
        recording.write(PUPIL)
        (stopped,) = recording.notified({"subject": "recording.should_stop"}, 2.0)
        assert started["rec_path"] == stopped["rec_path"] == f"{tmp_path.as_posix()}/test 1/{number:03}/"
        assert len(list(open_recording(Path(stopped["rec_path"])).samples())) == 1
    assert recording.notified({"subject": "recording.should_stop"}, 2.0) == []


@pytest.mark.parametrize("name", ["../../../etc", "/etc", "..", "a/../../b", "", None, 7, "C:\\x", "\x00"])
def test_no_name_leads_out_of_the_folder(tmp_path: Path, name: object) -> None:
    recording = Recording(tmp_path)
    (started,) = recording.notified({"subject": "recording.should_start", "session_name": name}, 0.5)
    recording.close()
    assert tmp_path in Path(started["rec_path"]).parents
    assert ".." not in Path(started["rec_path"]).parts


@pytest.mark.parametrize("name", ["語" * 100, "/".join(["long"] * 2000)], ids=["folder", "path"])
def test_a_name_too_long_for_a_folder_is_an_error_and_the_next_is_recorded(tmp_path: Path, name: str) -> None:
    recording = Recording(tmp_path)
    with pytest.raises(RecordingError, match=r"name too long.*Choose another name"):
        recording.notified({"subject": "recording.should_start", "session_name": name}, 0.5)
    (started,) = recording.notified({"subject": "recording.should_start", "session_name": "short"}, 0.5)
    recording.close()
    assert started["session_name"] == "short"


def test_a_name_may_be_a_path(tmp_path: Path) -> None:
    recording = Recording(tmp_path)
    (started,) = recording.notified({"subject": "recording.should_start", "session_name": "study/person 7"}, 0.5)
    recording.close()
    assert (started["session_name"], Path(started["rec_path"])) == ("study/person 7", tmp_path / "study/person 7/000")
