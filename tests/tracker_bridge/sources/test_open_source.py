from pathlib import Path

import pytest

from tracker_bridge.source import SourceError
from tracker_bridge.sources import open_source
from tracker_bridge.sources.pupil_writer import write_recording
from tracker_bridge.sources.simulated import SimulatedSettings

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


def test_what_cannot_be_opened_is_named_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="does not exist"):
        open_source(str(tmp_path / "nothing"))
    with pytest.raises(SourceError, match="neither a recording"):
        open_source(str(tmp_path))
    (tmp_path / "eye.mp4").write_text("")
    with pytest.raises(SourceError, match=r"eye\.mp4 is of no kind"):
        open_source(str(tmp_path / "eye.mp4"))
