import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.table import map as table_map_module
from entoptic.tracker_bridge.sources.table.map import read_table_map, shipped_maps
from entoptic.tracker_bridge.sources.table.source import open_table

Shared = Callable[[str], Path]

BOTH_EYES = """
name = "Two eyes"
delimiter = ";"
decimal = ","
where = { Kind = "sample" }
time = { column = "T", unit = "ms" }

[right]
diameter = { column = "DR", unit = "mm" }
openness = { column = "OR", unit = "percent" }
confidence = { column = "CR", unit = "percent" }
gaze = { kind = "angles", azimuth = "HR", elevation = "VR", unit = "deg", signs = [1, -1] }

[left]
diameter = { column = "DL", unit = "um" }
validity = { column = "VL", valid = ["ok", "good"] }

[both]
gaze = { kind = "vector", right = "X", up = "Y", forward = "Z" }
"""
HEADER = "Kind;T;DR;OR;CR;HR;VR;DL;VL;X;Y;Z"
FIRST = "sample;1,5;3,25;50;80;10;5;3500;ok;1;0;1"


def table_map(folder: Path, text: str) -> Path:
    path = folder / "map.toml"
    path.write_text(text, encoding="utf-8")
    return path


def table(folder: Path, *lines: str, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def samples(folder: Path, text: str, *lines: str) -> list[PupilSample | GazeSample]:
    return list(open_table(table(folder, *lines), read_table_map(table_map(folder, text))).samples())


def test_every_kind_of_column(tmp_path: Path) -> None:
    assert samples(tmp_path, BOTH_EYES, HEADER, FIRST) == [
        PupilSample(1_500_000, Eye.RIGHT, 3.25, 0.8, openness=0.5),
        PupilSample(1_500_000, Eye.LEFT, 3.5, 1.0),
        GazeSample(1_500_000, Eye.RIGHT, 10.0, -5.0, 0.8),
        GazeSample(1_500_000, None, 45.0, 0.0, 1.0),
    ]


def test_lines_of_another_kind_are_left_out_and_told(tmp_path: Path) -> None:
    path = table(tmp_path, HEADER, "mark" + FIRST[6:], FIRST, "")
    source = open_table(path, read_table_map(table_map(tmp_path, BOTH_EYES)))
    assert len(list(source.samples())) == 4
    assert "Of 2 lines those of another kind were left out: 1." in source.info.notes


def test_what_is_empty_or_invalid(tmp_path: Path) -> None:
    row = "sample;2;;;NaN;;;3500;bad;0;0;0"
    assert samples(tmp_path, BOTH_EYES, HEADER, row) == [
        PupilSample(2_000_000, Eye.RIGHT, None, 0.0),
        PupilSample(2_000_000, Eye.LEFT, 3.5, 0.0),
    ]


def test_disorder_and_repetition_are_repaired_and_told(tmp_path: Path) -> None:
    rows = [f"sample;{time};3;;100;;;;ok;;;" for time in (3, 1, 2, 2)]
    source = open_table(table(tmp_path, HEADER, *rows), read_table_map(table_map(tmp_path, BOTH_EYES)))
    right = [s.t_ns for s in source.samples() if isinstance(s, PupilSample) and s.eye is Eye.RIGHT]
    assert right == [1_000_000, 2_000_000, 3_000_000]
    assert any("were sorted" in note for note in source.info.notes)
    assert any("were dropped" in note for note in source.info.notes)


def test_either_decimal(tmp_path: Path) -> None:
    text = BOTH_EYES.replace('decimal = ","', 'decimal = "either"')
    assert samples(tmp_path, text, HEADER, FIRST) == samples(tmp_path, text, HEADER, FIRST.replace(",", "."))
    with pytest.raises(SourceError, match=r"'1\.234,5' is no number"):
        samples(tmp_path, text, HEADER, FIRST.replace("3,25", "1.234,5"))


PER_EYE = """
name = "One eye a line"
time = { column = "t", unit = "ns" }
eye = { column = "eye", right = ["R", "0"], left = ["L"] }

[each]
diameter = { column = "d", unit = "px" }
openness = { column = "lid", unit = "mm" }

[each.gaze]
kind = "screen"
x = "x"
y = "y"
width = 1000
height = 500
width_mm = 500
height_mm = 250
distance_mm = 250
"""


def test_one_eye_a_line_and_a_screen(tmp_path: Path) -> None:
    rows = ["t,eye,d,lid,x,y", "1700000000000000001,R,30,8,1000,250", "2,0,31,4,500,0", "3,L,32,5,,", "4,-,1,1,1,1"]
    got = samples(tmp_path, PER_EYE, *rows)
    assert [(s.t_ns, s.eye, s.diameter_px) for s in got if isinstance(s, PupilSample)] == [
        (2, Eye.RIGHT, 31.0),
        (3, Eye.LEFT, 32.0),
        (1_700_000_000_000_000_001, Eye.RIGHT, 30.0),
    ]
    second, last = (s for s in got if isinstance(s, GazeSample))
    assert (last.azimuth_deg, last.elevation_deg) == (45.0, 0.0)
    assert second.azimuth_deg == 0.0
    assert second.elevation_deg == pytest.approx(26.565, abs=0.001)


def test_openness_in_mm_is_that_of_a_wide_open_eye(tmp_path: Path) -> None:
    rows = [f"{at},R,30,{lid},," for at, lid in enumerate([0.0] * 10 + [2.0] * 40 + [8.0] * 49 + [20.0])]
    opennesses = {
        s.openness for s in samples(tmp_path, PER_EYE, "t,eye,d,lid,x,y", *rows) if isinstance(s, PupilSample)
    }
    assert opennesses == {0.0, 0.25, 1.0}


@pytest.mark.parametrize(
    ("origin", "at", "elevation_sign"),
    [
        ("top left", (750, 125), 1),
        ("bottom left", (750, 375), 1),
        ("centre", (250, 125), 1),
        ("top left", (750, 375), -1),
    ],
)
def test_origins_of_a_screen(tmp_path: Path, origin: str, at: tuple[int, int], elevation_sign: int) -> None:
    text = PER_EYE.replace("distance_mm = 250", f'distance_mm = 250\norigin = "{origin}"')
    gaze = samples(tmp_path, text, "t,eye,d,lid,x,y", f"1,R,,,{at[0]},{at[1]}")[1]
    assert isinstance(gaze, GazeSample)
    assert gaze.azimuth_deg == pytest.approx(26.565, abs=0.001)
    assert gaze.elevation_deg == pytest.approx(elevation_sign * 12.604, abs=0.001)


@pytest.mark.parametrize(
    ("row", "what"),
    [
        (FIRST.replace("3,25", "3.25"), "line 3, column 'DR': '3.25' is no number with a decimal ','"),
        (FIRST.replace("3,25", "3_25"), "'3_25' is no number"),
        (FIRST.replace("3,25", "inf"), "'inf' is no number"),
        (FIRST.replace("1,5", ""), "column 'T': '' is empty"),
        (FIRST.replace("1,5", "1e28"), "no time in ms"),
        (FIRST.replace(";10;", ";-999;"), "beyond 180°.*`missing`"),
        (FIRST + ";1", "line 3: its cells number 13, the header's 12"),
    ],
)
def test_a_bad_cell_is_named_with_its_line(tmp_path: Path, row: str, what: str) -> None:
    with pytest.raises(SourceError, match=what) as caught:
        samples(tmp_path, BOTH_EYES, HEADER, FIRST, row)
    assert "table.csv, line 3" in str(caught.value)


def test_a_missing_column_is_named_with_those_that_exist(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"table\.csv has no column 'DL', 'Z'. Its columns are 'Kind', 'T', .*'Y'"):
        samples(tmp_path, BOTH_EYES, HEADER.replace("DL", "DD").replace(";Z", ""))


@pytest.mark.parametrize(
    ("contents", "what"),
    [
        (b"", "is empty"),
        (b"\n\n", "is empty"),
        (HEADER.encode(), "holds no samples"),
        (HEADER.encode("utf-16"), "no table of UTF-8 text"),
        (HEADER.encode() + b"\n\xff\xff;", "no table of UTF-8 text"),
    ],
)
def test_a_file_that_is_no_table_is_named(tmp_path: Path, contents: bytes, what: str) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(contents)
    with pytest.raises(SourceError, match=what):
        open_table(path, read_table_map(table_map(tmp_path, BOTH_EYES)))
    with pytest.raises(SourceError, match="cannot be read"):
        open_table(tmp_path / "nothing.csv", read_table_map(table_map(tmp_path, BOTH_EYES)))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (("[right]", "[right]\nfoo = 1"), r"unknown field `foo` - at `\$.right`"),
        (('unit = "ms"', 'unit = "h"'), r"at `\$.time.unit`"),
        (('kind = "angles"', 'kind = "polar"'), r"at `\$.right.gaze.kind`"),
        (("signs = [1, -1]", "signs = [1, 2]"), r"\$.right.gaze.signs"),
        (('delimiter = ";"', 'delimiter = "  "'), r"\$.delimiter"),
        (('name = "Two eyes"', ""), "missing required field `name`"),
        (("[right]", "[right"), "line"),
        (("[right]", '[each]\ndiameter = { column = "D", unit = "mm" }\n[right]'), "need each other"),
    ],
)
def test_a_bad_map_is_named_with_the_key_at_fault(tmp_path: Path, change: tuple[str, str], what: str) -> None:
    with pytest.raises(SourceError, match=what) as caught:
        read_table_map(table_map(tmp_path, BOTH_EYES.replace(*change)))
    assert "map.toml" in str(caught.value)


def test_the_example_in_the_documentation_is_a_map(tmp_path: Path) -> None:
    lines = (table_map_module.__doc__ or "").splitlines()
    example = "\n".join(line[4:] for line in lines if line.startswith("    "))
    assert read_table_map(table_map(tmp_path, example)).columns()[:2] == ("Sensor", "Timestamp")


def test_a_map_of_nothing_or_of_both_shapes_is_refused(tmp_path: Path) -> None:
    head = 'name = "x"\ntime = { column = "t", unit = "s" }\n'
    with pytest.raises(SourceError, match="maps no eye"):
        read_table_map(table_map(tmp_path, head))
    with pytest.raises(SourceError, match="not so and so"):
        read_table_map(table_map(tmp_path, PER_EYE + "[right]\n"))
    with pytest.raises(SourceError, match="cannot be read"):
        read_table_map(tmp_path / "nothing.toml")


def test_a_table_that_no_shipped_map_fits_is_told_what_to_do(tmp_path: Path) -> None:
    assert "tobii_pro_lab" in shipped_maps()
    with pytest.raises(SourceError, match=r"tobii_pro_lab.*map\.py"):
        open_table(table(tmp_path, HEADER, FIRST))


cells = st.text('0123456789.,-+eENan;"\nxi ', max_size=8)


@given(st.lists(st.lists(cells, min_size=11, max_size=12), max_size=5))
def test_any_cells_give_samples_or_a_source_error(rows: list[list[str]]) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            got = samples(folder, BOTH_EYES, HEADER, *(";".join(["sample", *row]) for row in rows))
        except SourceError:
            return
        for sample in got:
            assert 0.0 <= sample.confidence <= 1.0


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("name", "lines", "valid_left", "measured_right"),
    [
        ("long blinks", 7200, 3542, 2924),
        ("partial blinks", 7200, 7006, 6921),
        ("slow blinks", 7201, 3903, 3259),
        ("squints", 7200, 4908, 4023),
        ("very long blinks", 7200, 2520, 2455),
    ],
)
def test_real_tables_of_tobii_pro_lab(
    shared: Shared, name: str, lines: int, valid_left: int, measured_right: int
) -> None:
    source = open_table(shared(f"eye/tobii_fusion/P1 - {name}.tsv"))
    pupils = [s for s in source.samples() if isinstance(s, PupilSample)]
    gazes = [s for s in source.samples() if isinstance(s, GazeSample)]
    assert Counter(s.eye for s in pupils) == {Eye.RIGHT: lines, Eye.LEFT: lines}
    right, left = ([s for s in pupils if s.eye is eye] for eye in Eye)
    assert 1e9 / np.mean(np.diff([s.t_ns for s in left])) == pytest.approx(120.0, abs=0.01)
    assert sum(s.confidence == 1.0 for s in right) == measured_right
    assert sum(s.eye is Eye.LEFT for s in gazes) == valid_left
    assert all((s.pupil_diameter_mm is not None) == (s.confidence == 1.0) for s in pupils)
    assert all(0.3 < s.pupil_diameter_mm < 4.0 for s in pupils if s.pupil_diameter_mm is not None)
    assert all(s.openness is None or 0.0 <= s.openness <= 1.0 for s in pupils)
    # Somebody in front of a screen looks at it: forwards, and near its middle.
    assert abs(np.median([s.azimuth_deg for s in gazes])) < 8.0
    assert abs(np.median([s.elevation_deg for s in gazes])) < 15.0
    assert any("Tobii Pro Lab" in note for note in source.info.notes)


@pytest.mark.shared_data
def test_a_lid_that_closes_pulls_the_gaze_down(shared: Shared) -> None:
    """The sign of the table's Y: just before an eye is lost, what is left to see of it lies low."""
    source = open_table(shared("eye/tobii_fusion/P1 - slow blinks.tsv"))
    openness = {s.t_ns: s.openness for s in source.samples() if isinstance(s, PupilSample) and s.eye is Eye.LEFT}
    gazes = [s for s in source.samples() if isinstance(s, GazeSample) and s.eye is Eye.LEFT]
    shut: list[float] = []
    wide: list[float] = []
    for gaze in gazes:
        how_open = openness[gaze.t_ns]
        if how_open is not None:
            (shut if how_open < 0.6 else wide).append(gaze.elevation_deg)
    assert len(shut) > 20
    assert np.mean(shut) < np.mean(wide) - 2.0
