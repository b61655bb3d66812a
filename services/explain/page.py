"""One wide picture: what the planner saw, decided and why, and what it truly made of the frame."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure, SubFigure

from entoptic.pipeline import EFFECTS, FrameError, Step
from entoptic.pipeline.measure import luminance
from entoptic.services.explain import panels, plan_panels
from entoptic.services.explain.panels import INK, side_by_side
from entoptic.services.explain.plan_panels import Entry
from entoptic.services.explain.subject import Subject
from entoptic.services.explain.timeline import Timeline
from entoptic.services.explain.variants import Explained

DPI, WIDTH_IN = 100, 17.0
COLOURS = dict(
    zip(
        (effect.name for effect in EFFECTS),
        itertools.cycle(("#5d6470", "#c8553d", "#2a6fbb", "#1a8f94", "#b8860b", "#8a5aa8", "#3a8f5a")),
        strict=False,
    )
)
ROW_IN = 6.0
"""Greatest height of a row of images."""
LEAST_COLUMNS = 3
NOTE = (
    "bound, changes: in code values, of any pixel. Touched: another code value with the effect than without it. Images "
    "are reduced so that of each spot the largest change is shown."
)
LINE_IN, SPAN_IN, TIMES_IN, TITLE_IN = 0.24, 0.36, 2.4, 0.45
MOST_CHANGES = 8
"""Of a session's changes of level that are listed; its report has them all."""


def refuse_unwritable(path: Path) -> None:
    """Raises FrameError for a path that no picture can be written to, before any work is done."""
    if path.suffix.lower() != ".png":
        raise FrameError(f"output {path}: the picture is written as PNG; name it {path.with_suffix('.png')}")
    if path.is_dir():
        raise FrameError(f"output {path}: that is a folder; name a file in it")
    if not path.parent.is_dir():
        raise FrameError(f"output {path}: there is no folder {path.parent}; make it first")


def write(path: Path, subject: Subject, explained: Explained, timeline: Timeline | None = None) -> None:
    """Draws the page as PNG; of a session its time line comes first, with the frame that is explained marked."""
    planned = explained.planned
    height, width = planned.image.shape[1], planned.image.shape[2] * planned.image.shape[0]
    entries = [_entry(step, explained) for step in planned.plan]
    small_in = WIDTH_IN / max(len(explained.touched), LEAST_COLUMNS)
    rows = [
        # A sixth of a panel's width is its scale.
        TITLE_IN + min(WIDTH_IN / 3 * 5 / 6 * height / width, ROW_IN),
        TITLE_IN + min(0.9 * small_in * height / width, ROW_IN) if explained.touched else 0.0,
        LINE_IN * (plan_panels.table_lines(entries) + 2),
    ]
    above = [] if timeline is None else [_timeline_in(timeline)]
    figure = Figure(figsize=(WIDTH_IN, TITLE_IN + sum(rows) + sum(above)), dpi=DPI, layout="constrained")
    figure.suptitle(subject.title, size=13, color=INK, ha="left", x=0.01)
    shown = [ratio for ratio in (*above, *rows) if ratio]
    parts = list(figure.subfigures(len(shown), 1, height_ratios=shown, squeeze=False)[:, 0])
    if timeline is not None:
        _timeline(parts.pop(0), timeline, subject.t_s)
    _images(parts.pop(0), subject, explained)
    if explained.touched:
        _touched(parts.pop(0), explained)
    plan_panels.table(parts.pop(0).subplots(), entries, COLOURS, NOTE)
    figure.savefig(path, format="png")


def _entry(step: Step, explained: Explained) -> Entry:
    touch = explained.touched.get(step.effect)
    milliseconds = explained.planned.milliseconds.get(step.effect) if step.runs else None
    return Entry(
        step.effect,
        step.level,
        "" if step.bound_code_values == 0 else _figure(step.bound_code_values),
        "" if touch is None else f"{touch.largest:.0f}",
        "" if milliseconds is None else f"{milliseconds:.1f}",
        step.reason,
    )


def _figure(code_values: float) -> str:
    return f"{code_values:.2g}" if code_values < 100 else f"{code_values:.0f}"


def _images(part: SubFigure, subject: Subject, explained: Explained) -> None:
    planned, view = explained.planned, subject.frame.view
    seen, light, apart = part.subplots(1, 3)
    gaze_px = [
        _shifted(view.pixel_of(eye.azimuth_deg, eye.elevation_deg), k, view.width_px)
        for k, eye in enumerate(subject.looking)
    ]
    lights_px = [
        _shifted((source.x_px, source.y_px), k, view.width_px)
        for k, measured in enumerate(planned.measured)
        for source in measured.sources
    ]
    panels.picture(seen, _together(planned.image), gaze_px, "perceived, as planned; + gaze")
    cd_m2 = side_by_side(np.asarray(luminance(subject.frame.rgb_cd_m2)))
    panels.luminances(part, light, cd_m2, gaze_px, lights_px, planned.state.adapted_cd_m2)
    difference = side_by_side(explained.difference)
    largest, differ = np.abs(difference).max(), (difference != 0).mean()
    title = (
        f"full minus planned: {largest:.0f} (bound {_figure(planned.plan.bound_code_values)}), {differ:.1%} of pixels"
    )
    panels.difference(part, apart, difference, title)


def _touched(part: SubFigure, explained: Explained) -> None:
    image = _together(explained.planned.image)
    columns = max(len(explained.touched), LEAST_COLUMNS)
    for axes, (effect, touch) in zip(
        part.subplots(1, columns, squeeze=False)[0], explained.touched.items(), strict=False
    ):
        title = f"{effect.replace('_', ' ')} changes {touch.share:.1%} of pixels, by {touch.largest:.0f} at most"
        panels.touched(axes, image, side_by_side(touch.change), COLOURS[effect], title)
    for axes in part.axes[len(explained.touched) :]:
        axes.axis("off")


def _timeline_in(timeline: Timeline) -> float:
    listed = min(len(timeline.changes), MOST_CHANGES + 1)
    return TITLE_IN * 2 + SPAN_IN * len(timeline.effects) + TIMES_IN + LINE_IN * listed


def _timeline(part: SubFigure, timeline: Timeline, at_s: float | None) -> None:
    colours: Mapping[str, str] = {**dict.fromkeys(timeline.effects, INK), **COLOURS}
    listed = timeline.changes[:MOST_CHANGES]
    heights = [SPAN_IN * len(timeline.effects) + TITLE_IN, TIMES_IN + TITLE_IN, LINE_IN * max(len(listed), 0.1)]
    lanes, times, words = part.subplots(3, 1, height_ratios=heights)
    plan_panels.levels(lanes, timeline, colours, at_s)
    plan_panels.milliseconds(times, timeline, colours, at_s)
    times.sharex(lanes)
    plan_panels.changes(words, listed, colours)


def _together(images: np.ndarray) -> np.ndarray:
    """Both eyes' images beside each other, as 8 bits to look at."""
    image = np.concatenate(list(images), axis=1)
    if np.issubdtype(image.dtype, np.floating):
        return np.asarray(np.clip(image, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    return image if image.dtype == np.uint8 else (image >> 2).astype(np.uint8)


def _shifted(pixel: tuple[float, float], eye: int, width_px: int) -> tuple[float, float]:
    return pixel[0] + eye * width_px, pixel[1]
