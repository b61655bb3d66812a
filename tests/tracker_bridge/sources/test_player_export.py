from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.pupil_core.player_export import open_player_export

# The columns that Pupil Player writes, in its order.
PUPIL_HEADER = (
    "pupil_timestamp,world_index,eye_id,confidence,norm_pos_x,norm_pos_y,diameter,method,ellipse_center_x,"
    "ellipse_center_y,ellipse_axis_a,ellipse_axis_b,ellipse_angle,diameter_3d,model_confidence,model_id,"
    "sphere_center_x,sphere_center_y,sphere_center_z,sphere_radius,circle_3d_center_x,circle_3d_center_y,"
    "circle_3d_center_z,circle_3d_normal_x,circle_3d_normal_y,circle_3d_normal_z,circle_3d_radius,theta,phi,"
    "projected_sphere_center_x,projected_sphere_center_y,projected_sphere_axis_a,projected_sphere_axis_b,"
    "projected_sphere_angle"
)
ROW_3D = (
    "{time},7,{eye},0.99,0.5,0.5,20.0,pye3d 0.3.2 real-time,96,96,19,20,0,4.25,1.0,,0,0,42,10.4,0,0,31.5,"
    "0.0,0.1,-0.99,2.1,1.5,-1.5,96,96,83,83,0"
)
ROW_2D = "{time},7,{eye},0.97,0.5,0.5,20.5,2d c++,96,96,19,20,0" + "," * 21
GAZE_HEADER = (
    "gaze_timestamp,world_index,confidence,norm_pos_x,norm_pos_y,base_data,gaze_point_3d_x,gaze_point_3d_y,"
    "gaze_point_3d_z,eye_center0_3d_x,eye_center0_3d_y,eye_center0_3d_z,gaze_normal0_x,gaze_normal0_y,"
    "gaze_normal0_z,eye_center1_3d_x,eye_center1_3d_y,eye_center1_3d_z,gaze_normal1_x,gaze_normal1_y,gaze_normal1_z"
)
GAZE_BOTH = "2.0,7,0.9,0.5,0.5,1.99-0 2.01-1,0,0,500,30,0,0,-0.1,0,1,-30,0,0,0.1,0,1"
GAZE_LEFT = "3.0,7,0.8,0.5,0.5,3.0-1,50,0,500,,,,,,,-30,0,0,0.1,0,1"


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_folder_of_exports(tmp_path: Path) -> None:
    assert PUPIL_HEADER.count(",") == 33
    rows = [ROW_2D.format(time=1.5, eye=0), ROW_3D.format(time=1.5, eye=0), ROW_2D.format(time=1.6, eye=1)]
    write(tmp_path / "pupil_positions.csv", PUPIL_HEADER, *rows)
    write(tmp_path / "gaze_positions.csv", GAZE_HEADER, GAZE_BOTH, GAZE_LEFT)
    source = open_player_export(tmp_path)
    assert [s for s in source.samples() if isinstance(s, PupilSample)] == [
        PupilSample(1_500_000_000, Eye.RIGHT, 4.25, 0.99, 1.0, 20.0),
        PupilSample(1_600_000_000, Eye.LEFT, None, 0.97, None, 20.5),
    ]
    gazes = [
        (s.t_ns, s.eye, round(s.azimuth_deg, 2), s.confidence) for s in source.samples() if isinstance(s, GazeSample)
    ]
    assert gazes == [
        (1_990_000_000, Eye.RIGHT, -5.71, 0.9),
        (2_000_000_000, None, 0.0, 0.9),
        (2_010_000_000, Eye.LEFT, 5.71, 0.9),
        (3_000_000_000, Eye.LEFT, 5.71, 0.8),
    ]
    assert source.info.notes == ("Two-dimensional measurements that repeat an image were left out: 1.",)


@pytest.mark.parametrize(
    ("row", "what"),
    [
        (ROW_3D.format(time="soon", eye=0), "line 2, column 'pupil_timestamp': 'soon'"),
        (ROW_3D.format(time="", eye=0), "line 2, column 'pupil_timestamp': '' is empty"),
        (ROW_3D.format(time="1e20", eye=0), "no time in seconds"),
        (ROW_3D.format(time=1, eye=2), "line 2, column 'eye_id': '2'"),
        ("1.0,2", "line 2: its cells number 2, the header's 34"),
    ],
)
def test_a_bad_cell_is_named_with_its_line(tmp_path: Path, row: str, what: str) -> None:
    with pytest.raises(SourceError, match=what):
        open_player_export(write(tmp_path / "pupil_positions.csv", PUPIL_HEADER, row))


@pytest.mark.parametrize("base", ["2.0", "2.0-2", "x-0", "1e400-1"])
def test_bad_base_data_is_named_with_its_line(tmp_path: Path, base: str) -> None:
    row = GAZE_BOTH.replace("1.99-0 2.01-1", base)
    with pytest.raises(SourceError, match="line 2, column 'base_data'"):
        open_player_export(write(tmp_path / "gaze_positions.csv", GAZE_HEADER, row))


def test_missing_columns_files_and_rows_are_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"pupil_positions\.csv or gaze_positions\.csv"):
        open_player_export(tmp_path)
    with pytest.raises(SourceError, match=r"no column 'confidence'.*Its columns are 'pupil_timestamp', 'eye_id'"):
        open_player_export(write(tmp_path / "pupil_positions.csv", "pupil_timestamp,eye_id", "1,0"))
    with pytest.raises(SourceError, match="holds no samples"):
        open_player_export(write(tmp_path / "pupil_positions.csv", PUPIL_HEADER))


@pytest.mark.shared_data
def test_a_real_export(shared: Callable[[str], Path]) -> None:
    source = open_player_export(shared("eye/pupil_core/tutorial10_gaze_positions.csv"))
    gazes = [s for s in source.samples() if isinstance(s, GazeSample)]
    assert Counter(s.eye for s in gazes) == {None: 1589, Eye.RIGHT: 1000, Eye.LEFT: 994}
    assert source.info.t_end_ns is not None
    assert (source.info.t_end_ns - source.info.t_start_ns) / 1e9 == pytest.approx(6.94, abs=0.01)
    assert source.info.notes == (
        "No pupil data: diameters and blinks are not known.",
        "Of 2,054 gaze data those without a direction were left out: 61.",
    )
