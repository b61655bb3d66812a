"""Any table of eye-tracking data, read by a column map (see table_map.py)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample, direction_deg
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.cells import Row, read_header, read_table
from entoptic.tracker_bridge.sources.loaded import LoadedSource, load
from entoptic.tracker_bridge.sources.table.map import (
    AngleGaze,
    EyeChannels,
    Gaze,
    GazeChannels,
    TableMap,
    VectorGaze,
    shipped_maps,
)

_NS_PER_UNIT = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_MM_PER_UNIT = {"mm": 1.0, "um": 1e-3, "m": 1e3}
_FULL = {"fraction": 1.0, "percent": 100.0}
_TIME_LIMIT_NS = 2**63

WIDE_OPEN_PERCENTILE = 95.0
"""An eye counts as wide open at this percentile of its own valid openings. Engineering choice: the largest of 7,200
real openings is an outlier (11.7 mm where the 95th percentile is 9.6), and the median of somebody who was told to keep
the eyes shut is 0."""


def open_table(path: Path, table_map: TableMap | None = None) -> LoadedSource:
    """The samples in a table, one line being one time, or one time and eye.

    Without a map the first shipped map is taken whose columns are all there. An eye's confidence is its confidence
    column, or 1 where there is none; it is 0 where the tracker does not call the eye valid and where a diameter is
    mapped but empty. Openness in mm or px is divided by the 95th percentile of this eye's valid openings and cut to
    0 … 1. Directions that are empty give no sample.

    Raises SourceError where no map fits, a mapped column is missing, a cell cannot be read (with its line), or nothing
    is left to read.
    """
    chosen = _fitting_map(path) if table_map is None else table_map
    table = read_table(path, chosen.delimiter, chosen.decimal, chosen.missing)
    table.need(chosen.columns())
    rows = [row for row in table.rows if all(row.text(column) == cell for column, cell in chosen.where.items())]
    notes = [f"Read by the column map of {chosen.name}.", *_assumptions(chosen)]
    if len(rows) < len(table.rows):
        notes.append(
            f"Of {len(table.rows):,} lines those of another kind were left out: {len(table.rows) - len(rows):,}."
        )
    wide_open = _wide_open(rows, chosen)
    pupils: list[PupilSample] = []
    gazes: list[GazeSample] = []
    for row in rows:
        t_ns = _t_ns(row, chosen)
        for eye, channels in _eye_channels(row, chosen):
            confidence = _confidence(row, channels)
            if channels.diameter is not None or channels.openness is not None:
                pupils.append(_pupil(row, t_ns, eye, channels, confidence, wide_open.get(eye)))
            if channels.gaze is not None and (angles := _angles(row, channels.gaze)) is not None:
                gazes.append(GazeSample(t_ns, eye, *angles, confidence))
        if chosen.both is not None and (angles := _angles(row, chosen.both.gaze)) is not None:
            gazes.append(GazeSample(t_ns, None, *angles, _confidence(row, chosen.both)))
    return load(f"{chosen.name} table {path.name}", pupils, gazes, notes)


def _fitting_map(path: Path) -> TableMap:
    shipped = shipped_maps()
    for table_map in shipped.values():
        if set(table_map.columns()) <= set(read_header(path, table_map.delimiter)):
            return table_map
    raise SourceError(
        f"{path}: none of the column maps that come with the program fits ({', '.join(shipped)}). Name a map of your "
        "own; `tracker_bridge/sources/table/map.py` shows how to write one"
    )


def _assumptions(table_map: TableMap) -> Iterator[str]:
    eyes = [part for part in (table_map.right, table_map.left, table_map.each) if part is not None]
    if any(part.confidence is None and part.validity is None for part in eyes):
        yield "The table does not say how sure it is: every measured pupil counts as certain."
    if any(part.openness is not None and part.openness.unit in ("mm", "px") for part in eyes):
        yield f"An eye counts as wide open at the {WIDE_OPEN_PERCENTILE:g}th percentile of its valid openings."


def _eye_channels(row: Row, table_map: TableMap) -> Iterator[tuple[Eye, EyeChannels]]:
    """The eyes that a line is about."""
    if table_map.eye is not None and table_map.each is not None:
        name = row.text(table_map.eye.column)
        if name in table_map.eye.right:
            yield Eye.RIGHT, table_map.each
        elif name in table_map.eye.left:
            yield Eye.LEFT, table_map.each
    if table_map.right is not None:
        yield Eye.RIGHT, table_map.right
    if table_map.left is not None:
        yield Eye.LEFT, table_map.left


def _wide_open(rows: Iterable[Row], table_map: TableMap) -> dict[Eye, float]:
    """The opening, in the table's own unit, that counts as 1 for each eye whose openness is a length."""
    openings: dict[Eye, list[float]] = {eye: [] for eye in Eye}
    for row in rows:
        for eye, channels in _eye_channels(row, table_map):
            if channels.openness is not None and channels.openness.unit not in _FULL and _is_valid(row, channels):
                opening = row.number(channels.openness.column)
                if opening is not None:
                    openings[eye].append(opening)
    return {eye: float(np.percentile(some, WIDE_OPEN_PERCENTILE)) for eye, some in openings.items() if some}


def _pupil(
    row: Row, t_ns: int, eye: Eye, channels: EyeChannels, confidence: float, wide_open: float | None
) -> PupilSample:
    pupil_diameter_mm = diameter_px = None
    if channels.diameter is not None:
        diameter = row.number(channels.diameter.column)
        if diameter is not None and channels.diameter.unit == "px":
            diameter_px = diameter
        elif diameter is not None:
            pupil_diameter_mm = diameter * _MM_PER_UNIT[channels.diameter.unit]
        else:
            confidence = 0.0
    openness = None
    if channels.openness is not None:
        opening = row.number(channels.openness.column)
        full = _FULL.get(channels.openness.unit, wide_open)
        # An eye that never opened has nothing to be measured against.
        if opening is not None and full is not None and full > 0.0:
            openness = min(max(opening / full, 0.0), 1.0)
    return PupilSample(t_ns, eye, pupil_diameter_mm, confidence, diameter_px=diameter_px, openness=openness)


def _confidence(row: Row, channels: EyeChannels | GazeChannels) -> float:
    if not _is_valid(row, channels):
        return 0.0
    if channels.confidence is None:
        return 1.0
    confidence = row.number(channels.confidence.column) or 0.0
    return min(max(confidence / _FULL[channels.confidence.unit], 0.0), 1.0)


def _is_valid(row: Row, channels: EyeChannels | GazeChannels) -> bool:
    return channels.validity is None or row.text(channels.validity.column) in channels.validity.valid


def _t_ns(row: Row, table_map: TableMap) -> int:
    column, ns_per_unit = table_map.time.column, _NS_PER_UNIT[table_map.time.unit]
    time = row.required(column)
    if abs(time) * ns_per_unit >= _TIME_LIMIT_NS:
        raise row.wrong(column, f"is no time in {table_map.time.unit}")
    try:
        # Whole numbers exactly: nanoseconds since 1970 have more digits than a float.
        return int(row.text(column)) * ns_per_unit
    except ValueError:
        return round(time * ns_per_unit)


def _angles(row: Row, gaze: Gaze) -> tuple[float, float] | None:
    """Azimuth and elevation in degrees, or None where the table has none on this line."""
    if isinstance(gaze, VectorGaze):
        vector = [row.number(column) for column in (gaze.right, gaze.up, gaze.forward)]
        right, up, forward = (sign * (part or 0.0) for sign, part in zip(gaze.signs, vector, strict=True))
        if None in vector or (right, up, forward) == (0.0, 0.0, 0.0):
            return None
        return direction_deg(right, up, forward)
    if isinstance(gaze, AngleGaze):
        azimuth, elevation = row.number(gaze.azimuth), row.number(gaze.elevation)
        if azimuth is None or elevation is None:
            return None
        to_deg = math.degrees(1.0) if gaze.unit == "rad" else 1.0
        azimuth, elevation = (sign * a * to_deg for sign, a in zip(gaze.signs, (azimuth, elevation), strict=True))
        for column, angle, most in ((gaze.azimuth, azimuth, 180.0), (gaze.elevation, elevation, 90.0)):
            if abs(angle) > most:
                raise row.wrong(column, f'is beyond {most:g}°; if it means "no value", list it under `missing`')
        return azimuth, elevation
    x, y = row.number(gaze.x), row.number(gaze.y)
    if x is None or y is None:
        return None
    middle_x, middle_y = (0.0, 0.0) if gaze.origin == "centre" else (gaze.width / 2, gaze.height / 2)
    upwards = -1.0 if gaze.origin == "top left" else 1.0
    return direction_deg(
        (x - middle_x) * gaze.width_mm / gaze.width,
        (y - middle_y) * gaze.height_mm / gaze.height * upwards,
        gaze.distance_mm,
    )
