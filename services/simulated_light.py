"""The light that a simulated pupil answers to: a number, or a table measured from a scene."""

from __future__ import annotations

import contextlib
import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING

from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.wire import Eye

if TYPE_CHECKING:
    from entoptic.pipeline import View
    from entoptic.pipeline.scenes import Scene

COLUMNS = ("t_s", "cd_m2")
STEP_S = 0.2
"""Finer than a pupil's latency, coarse enough to cost nothing."""

LightSteps = tuple[tuple[float, float], ...]
"""(t_s, cd/m²): each luminance holds from its time on."""


def of_scene(scene: Scene, view: View, head: str, seconds: float) -> LightSteps:
    """The mean luminance before the left eye, from small frames of the scene; a head that follows is held still."""
    from entoptic.pipeline.measure import measure
    from entoptic.pipeline.scenes import Head
    from entoptic.pipeline.scenes.head_path import FollowGaze, Still, open_head_path

    shrink = max(view.width_px, view.height_px) / 100
    small = scene.view_for(max(round(view.width_px / shrink), 1), max(round(view.height_px / shrink), 1), view.fov_deg)
    path = open_head_path(head)
    if isinstance(path, FollowGaze):
        path = Still()
    steps = []
    for k in range(int(seconds / STEP_S) + 1):
        t_s = k * STEP_S
        frame = scene.frame(t_s, small, path.step(t_s, STEP_S, Head(), None), (Eye.LEFT,))
        steps.append((t_s, max(measure(frame)[0].mean_cd_m2, 1e-6)))
    return tuple(steps)


def write(path: Path, steps: LightSteps) -> None:
    """Writes a table that `read` reads."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows((f"{t_s:.3f}", f"{cd_m2:.6g}") for t_s, cd_m2 in steps)


def read(spec: str) -> LightSteps:
    """A luminance in cd/m², or the table in a CSV file. Raises SourceError that names the file and the line."""
    with contextlib.suppress(ValueError):
        return ((0.0, _positive(spec)),)
    try:
        rows = list(csv.reader(Path(spec).read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"luminance {spec!r} is neither a number of cd/m² above 0 nor a CSV file ({error})") from None
    where, head = f"luminance table {spec}", ",".join(COLUMNS)
    if len(rows) < 2 or tuple(rows[0]) != COLUMNS:
        raise SourceError(f"{where}: it must begin with the line {head} and hold a row or more")
    steps = []
    for number, row in enumerate(rows[1:], 2):
        try:
            t_s, cd_m2 = row
            steps.append((float(t_s), _positive(cd_m2)))
        except ValueError:
            raise SourceError(f"{where}, line {number}: {','.join(row)} is no time and luminance") from None
    return tuple(steps)


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise ValueError(text)
    return value
