"""Tables that Pupil Player exports: `pupil_positions.csv` and `gaze_positions.csv`.

Their columns are the fields of Pupil's datums under flat names, so a row is turned back into a datum and read as one.
3-D cells of 2-D rows are empty. Format: Pupil Core's documentation, "Raw Data Exporter".
"""

from __future__ import annotations

import math
from pathlib import Path

from entoptic.tracker_bridge.samples import Eye
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.cells import Row, read_table
from entoptic.tracker_bridge.sources.loaded import LoadedSource
from entoptic.tracker_bridge.sources.pupil_core.datum import TIME_LIMIT_S, Circle3d, GazeDatum, PupilDatum, Vector
from entoptic.tracker_bridge.sources.pupil_core.streams import Gaze, assemble

PUPIL_FILE = "pupil_positions.csv"
GAZE_FILE = "gaze_positions.csv"

_PUPIL_COLUMNS = (
    "pupil_timestamp",
    "eye_id",
    "confidence",
    "diameter",
    "diameter_3d",
    "model_confidence",
    "circle_3d_normal_x",
    "circle_3d_normal_y",
    "circle_3d_normal_z",
)
_GAZE_COLUMNS = (
    "gaze_timestamp",
    "confidence",
    "norm_pos_x",
    "norm_pos_y",
    "base_data",
    "gaze_point_3d_x",
    "gaze_point_3d_y",
    "gaze_point_3d_z",
    *(f"gaze_normal{eye}_{axis}" for eye in "01" for axis in "xyz"),
)


def is_player_export(header: tuple[str, ...]) -> bool:
    """Whether a table with these columns is one of the two."""
    return _PUPIL_COLUMNS[0] in header or _GAZE_COLUMNS[0] in header


def open_player_export(path: Path) -> LoadedSource:
    """The pupils and directions in a folder of Player's exports, or in one of the two tables alone.

    Each eye's own direction takes its confidence from the direction of both. Raises SourceError where a table is
    missing, empty, of another format, or has a cell that cannot be read (with its line), or without samples.
    """
    files = [path / PUPIL_FILE, path / GAZE_FILE] if path.is_dir() else [path]
    present = [file for file in files if file.is_file()]
    if not present:
        raise SourceError(f"{path} holds no {PUPIL_FILE} or {GAZE_FILE}: export the recording in Pupil Player first")
    pupils: list[PupilDatum] = []
    gazes: list[Gaze] = []
    for file in present:
        table = read_table(file, delimiter=",")
        if _PUPIL_COLUMNS[0] in table.header:
            table.need(_PUPIL_COLUMNS)
            pupils += [_pupil(row) for row in table.rows]
        else:
            table.need(_GAZE_COLUMNS)
            gazes += [_gaze(row) for row in table.rows]
    return assemble(f"Pupil Player export {path.resolve().name}", pupils, gazes, [])


def _pupil(row: Row) -> PupilDatum:
    return PupilDatum(
        id=_eye(row, "eye_id", row.text("eye_id")),
        timestamp=_timestamp(row, "pupil_timestamp"),
        confidence=row.required("confidence"),
        diameter=row.number("diameter"),
        diameter_3d=row.number("diameter_3d"),
        model_confidence=row.number("model_confidence"),
        circle_3d=Circle3d(_vector(row, "circle_3d_normal")),
    )


def _gaze(row: Row) -> Gaze:
    normals = {eye: _vector(row, f"gaze_normal{eye}") for eye in Eye}
    x, y = row.number("norm_pos_x"), row.number("norm_pos_y")
    datum = GazeDatum(
        timestamp=_timestamp(row, "gaze_timestamp"),
        confidence=row.required("confidence"),
        norm_pos=None if x is None or y is None else (x, y),
        gaze_point_3d=_vector(row, "gaze_point_3d"),
        gaze_normals_3d={eye: normal for eye, normal in normals.items() if normal is not None},
    )
    return datum, tuple(_base(row, word, datum.confidence) for word in row.text("base_data").split())


def _base(row: Row, word: str, confidence: float) -> PupilDatum:
    """What `base_data` says of one pupil: "329367.890963-0" is its time and its eye."""
    time, _, eye = word.rpartition("-")
    try:
        timestamp = float(time)
    except ValueError:
        timestamp = math.inf
    if not abs(timestamp) < TIME_LIMIT_S:
        raise row.wrong("base_data", "is no row of TIME-EYE")
    return PupilDatum(id=_eye(row, "base_data", eye), timestamp=timestamp, confidence=confidence)


def _eye(row: Row, column: str, text: str) -> Eye:
    if text not in ("0", "1"):
        raise row.wrong(column, f"names the eye {text!r}, which is neither 0 (right) nor 1 (left)")
    return Eye(int(text))


def _timestamp(row: Row, column: str) -> float:
    timestamp = row.required(column)
    if not abs(timestamp) < TIME_LIMIT_S:
        raise row.wrong(column, "is no time in seconds")
    return timestamp


def _vector(row: Row, column: str) -> Vector | None:
    x, y, z = (row.number(f"{column}_{axis}") for axis in "xyz")
    return None if x is None or y is None or z is None else (x, y, z)
