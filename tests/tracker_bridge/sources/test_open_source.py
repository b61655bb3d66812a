from pathlib import Path
from typing import Any

import pytest

from entoptic.tracker_bridge.samples import GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources import TrackerSettings, open_source
from entoptic.tracker_bridge.sources.pupil_core.recorder import write_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings

TINY = SimulatedSettings(seconds=1.0)
MAP = 'name = "Mine"\ntime = { column = "t", unit = "s" }\n[right]\ndiameter = { column = "d", unit = "mm" }\n'
EXPORT = (
    "pupil_timestamp,eye_id,confidence,diameter,diameter_3d,model_confidence,"
    "circle_3d_normal_x,circle_3d_normal_y,circle_3d_normal_z\n1.0,0,1.0,20,4.0,1.0,,,\n"
)


def test_a_simulated_eye() -> None:
    assert open_source("simulated", simulated=TINY).info.name == "Simulated eyes 1"
    with pytest.raises(SourceError, match="takes no column map"):
        open_source("simulated", table_map=Path("map.toml"))


def test_a_recording_and_its_files(tmp_path: Path) -> None:
    write_recording(open_source("simulated", simulated=TINY), tmp_path / "rec")
    assert open_source(str(tmp_path / "rec")).info.name == "Pupil recording rec"
    assert open_source(str(tmp_path / "rec" / "gaze.pldata")).info.name == "Pupil recording gaze.pldata"


def test_exports_of_player_by_folder_by_name_and_by_columns(tmp_path: Path) -> None:
    (tmp_path / "pupil_positions.csv").write_text(EXPORT)
    (tmp_path / "renamed.csv").write_text(EXPORT)
    for path in (tmp_path, tmp_path / "pupil_positions.csv", tmp_path / "renamed.csv"):
        assert open_source(str(path)).info.name == f"Pupil Player export {path.name}"


def test_a_table_by_its_map(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP)
    (tmp_path / "table.csv").write_text("t,d\n1,4\n2,5\n")
    source = open_source(str(tmp_path / "table.csv"), table_map=tmp_path / "map.toml")
    assert source.info.name == "Mine table table.csv"
    with pytest.raises(SourceError, match="none of the column maps"):
        open_source(str(tmp_path / "table.csv"))


def test_trackers_and_what_one_sent(tmp_path: Path) -> None:
    capture = open_source("capture", tracker=TrackerSettings(remote="tcp://lab:1234"))
    assert (capture.info.name, capture.info.live) == ("Pupil Capture at tcp://lab:1234", True)
    settings = TrackerSettings(record_raw=tmp_path / "raw", usb_faults=("stall@0.1s",))
    short = SimulatedSettings(seconds=0.3, rate_hz=60.0)
    live = [*open_source("usb-simulated:simulated", simulated=short, tracker=settings).samples()]
    sent = [*open_source(f"usb-file:{tmp_path / 'raw'}").samples()]
    assert sent
    assert sent == [item for item in live if isinstance(item, PupilSample | GazeSample)]


@pytest.mark.parametrize(
    ("spec", "options", "words"),
    [
        ("simulated", {"tracker": TrackerSettings(record_raw=Path("raw"))}, "sends no USB packets"),
        ("capture", {"tracker": TrackerSettings(record_raw=Path("raw"))}, "sends no USB packets"),
        ("usb-file:raw", {"tracker": TrackerSettings(record_raw=Path("raw"))}, "sends no USB packets"),
        ("capture", {"tracker": TrackerSettings(usb_id="1209:0001")}, "leave --usb-id out"),
        ("usb", {"tracker": TrackerSettings(usb_faults=("stall@1s",))}, "only a simulated tracker has faults"),
        ("usb", {"tracker": TrackerSettings(usb_id="mine")}, "is no USB ID"),
        ("capture", {"tracker": TrackerSettings(remote="lab")}, "no address of Pupil Remote"),
        ("capture", {"table_map": Path("map.toml")}, "takes no column map"),
        ("usb", {"table_map": Path("map.toml")}, "takes no column map"),
        ("usb-file:raw", {"table_map": Path("map.toml")}, "takes no column map"),
        ("usb-simulated:capture", {}, "is live"),
        ("usb-simulated:nothing", {}, "does not exist"),
    ],
)
def test_an_option_that_does_not_go_with_the_source_is_named(spec: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(SourceError, match=words):
        open_source(spec, **options)


def test_what_cannot_be_opened_is_named_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="does not exist"):
        open_source(str(tmp_path / "nothing"))
    with pytest.raises(SourceError, match="neither a recording"):
        open_source(str(tmp_path))
    (tmp_path / "eye.mp4").write_text("")
    with pytest.raises(SourceError, match=r"eye\.mp4 is of no kind"):
        open_source(str(tmp_path / "eye.mp4"))
