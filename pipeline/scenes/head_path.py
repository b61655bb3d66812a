"""How the head moves: still, looking around, along a table, or after the eyes.

Theory of operation: a path is stepped. The caller keeps the head and hands it back with the time that went by; a path
that is a function of time alone ignores both. So replays are the same to the bit, and nothing in here remembers.
"""

from __future__ import annotations

import bisect
import csv
import dataclasses
import math
from pathlib import Path
from typing import Protocol

from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.scenes.scene import Head

HEAD_TIME_CONSTANT_S = 0.3
"""How fast the head comes after the eyes: a turn of the head to a new target takes about a second, three of these
(engineering choice)."""

COLUMNS = ("t_s", "yaw_deg", "pitch_deg", "roll_deg")


class HeadPath(Protocol):
    """The movement of a head."""

    def step(self, t_s: float, dt_s: float, head: Head, gaze_deg: tuple[float, float] | None) -> Head:
        """Where the head is at `t_s`, `dt_s` after it was at `head`.

        `gaze_deg` is azimuth and elevation of the gaze, None while it is not known. Latency: none; a path that
        follows the gaze lags it by its time constant.
        """
        ...


class Still:
    """A head on a chin rest."""

    def step(self, t_s: float, dt_s: float, head: Head, gaze_deg: tuple[float, float] | None) -> Head:
        """Straight ahead, always."""
        return Head()


class LookAround:
    """A slow look around that starts straight ahead: sines whose periods have no common multiple within minutes.

    Amplitudes and periods are an engineering choice: the head stays within ±28° and below 12°/s, where a person would
    call it calm.
    """

    def step(self, t_s: float, dt_s: float, head: Head, gaze_deg: tuple[float, float] | None) -> Head:
        """A function of time alone."""
        yaw = 22.0 * math.sin(math.tau * t_s / 17.0) + 6.0 * math.sin(math.tau * t_s / 7.3)
        pitch = 3.0 * math.sin(math.tau * t_s / 11.0) + 2.0 * math.sin(math.tau * t_s / 23.0)
        return Head(yaw, pitch, 1.5 * math.sin(math.tau * t_s / 13.0))


@dataclasses.dataclass(frozen=True)
class Table:
    """A recorded path: linear between its rows, held before the first and after the last."""

    t_s: tuple[float, ...]
    heads: tuple[Head, ...]

    def step(self, t_s: float, dt_s: float, head: Head, gaze_deg: tuple[float, float] | None) -> Head:
        """A function of time alone."""
        after = bisect.bisect_right(self.t_s, t_s)
        if after == 0:
            return self.heads[0]
        if after == len(self.t_s):
            return self.heads[-1]
        start, end = self.t_s[after - 1], self.t_s[after]
        share = (t_s - start) / (end - start)
        return Head(*(a + share * (b - a) for a, b in zip(self.heads[after - 1], self.heads[after], strict=True)))


class FollowGaze:
    """A head that comes after the eyes."""

    def step(self, t_s: float, dt_s: float, head: Head, gaze_deg: tuple[float, float] | None) -> Head:
        """Towards the gaze; held while the gaze is not known."""
        return head if gaze_deg is None else follow(head, *gaze_deg, dt_s)


def follow(
    head: Head,
    azimuth_deg: float,
    elevation_deg: float,
    dt_s: float,
    time_constant_s: float = HEAD_TIME_CONSTANT_S,
) -> Head:
    """The head `dt_s` later, on its way to where the eyes look: the exact solution of a first-order follower.

    One step of 2·dt is two steps of dt. The target is the direction of gaze taken from the body, so a fixed gaze turns
    the head so far and no further; yaw takes the shorter way round, roll goes back to upright. A `dt_s` below 0 (time
    went backwards) or a gaze that is not finite leaves the head where it is.
    """
    if not (math.isfinite(azimuth_deg) and math.isfinite(elevation_deg) and dt_s > 0):
        return head
    share = -math.expm1(-dt_s / time_constant_s)
    turn = (azimuth_deg - head.yaw_deg + 180.0) % 360.0 - 180.0
    return Head(
        head.yaw_deg + share * turn,
        head.pitch_deg + share * (elevation_deg - head.pitch_deg),
        head.roll_deg - share * head.roll_deg,
    )


def open_head_path(spec: str) -> HeadPath:
    """The path called "still", "look-around" or "gaze", or the table in a CSV file with the columns of COLUMNS.

    Raises FrameError that names the file, the line and the remedy.
    """
    named: dict[str, HeadPath] = {"still": Still(), "look-around": LookAround(), "gaze": FollowGaze()}
    return named[spec] if spec in named else _read_table(Path(spec))


def _read_table(path: Path) -> Table:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FrameError(
            f'head path "{path}": no such path and no readable CSV file ({error}); '
            'use "still", "look-around", "gaze" or a CSV file'
        ) from None
    rows = csv.reader(text.splitlines())
    header = tuple(cell.strip() for cell in next(rows, []))
    if header != COLUMNS:
        raise FrameError(f"head path {path}, line 1: the columns must be {','.join(COLUMNS)}, not {','.join(header)}")
    times: list[float] = []
    heads: list[Head] = []
    for row in rows:
        if not row:
            continue
        t_s, head = _read_row(path, rows.line_num, row)
        if times and t_s <= times[-1]:
            raise FrameError(f"head path {path}, line {rows.line_num}: t_s {t_s:g} does not come after {times[-1]:g}")
        times.append(t_s)
        heads.append(head)
    if not times:
        raise FrameError(f"head path {path}: no row below its header; give it one row or more")
    return Table(tuple(times), tuple(heads))


def _read_row(path: Path, line: int, row: list[str]) -> tuple[float, Head]:
    try:
        t_s, *angles = (float(cell) for cell in row)
        head = Head(*angles)
    except (ValueError, TypeError):
        raise FrameError(f"head path {path}, line {line}: {','.join(row)} is not {len(COLUMNS)} numbers") from None
    if len(row) != len(COLUMNS) or not all(math.isfinite(value) for value in (t_s, *head)):
        raise FrameError(f"head path {path}, line {line}: {','.join(row)} is not {len(COLUMNS)} finite numbers")
    if not -90.0 <= head.pitch_deg <= 90.0:
        raise FrameError(f"head path {path}, line {line}: pitch_deg {head.pitch_deg:g} must lie within ±90°")
    return t_s, head
