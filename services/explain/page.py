"""One wide picture: what the planner saw, decided and why, and what it truly made of the frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure, SubFigure

from entoptic.pipeline.measure import luminance
from entoptic.services.explain import panels, plan_panels
from entoptic.services.explain.panels import INK, side_by_side
from entoptic.services.explain.plan_panels import COLOURS, figure_of, spaced
from entoptic.services.explain.subject import Subject
from entoptic.services.explain.timeline import Timeline
from entoptic.services.explain.variants import Explained

DPI, WIDTH_IN = 100, 17.0
ROW_IN = 6.0
"""Greatest height of a row of images."""
LEAST_COLUMNS = 3
LINE_IN, SPAN_IN, TIMES_IN, TITLE_IN = 0.24, 0.36, 2.4, 0.45
MOST_CHANGES = 8
"""Of a session's changes of level that are listed; its report has them all."""


def write(path: Path, subject: Subject, explained: Explained, timeline: Timeline | None = None) -> None:
    """Draws the page as PNG; of a session its time line comes first, with the frame that is explained marked."""
    planned = explained.planned
    ratio = planned.image.shape[1] / (planned.image.shape[2] * planned.image.shape[0])
    columns = max(len(explained.touched), LEAST_COLUMNS)
    heights = {
        "timeline": 0.0 if timeline is None else sum(_timeline_in(timeline)),
        # A sixth of a panel's width is its scale.
        "images": TITLE_IN + min(WIDTH_IN / 3 * 5 / 6 * ratio, ROW_IN),
        "touched": TITLE_IN + min(0.9 * WIDTH_IN / columns * ratio, ROW_IN) if explained.touched else 0.0,
        "table": LINE_IN * (plan_panels.table_lines(planned.plan) + 2),
    }
    shown = {name: height for name, height in heights.items() if height}
    figure = Figure(figsize=(WIDTH_IN, TITLE_IN + sum(shown.values())), dpi=DPI, layout="constrained")
    figure.suptitle(subject.title, size=13, color=INK, ha="left", x=0.01)
    rows = figure.subfigures(len(shown), 1, height_ratios=list(shown.values()), squeeze=False)[:, 0]
    parts = dict(zip(shown, rows, strict=True))
    if timeline is not None:
        _timeline(parts["timeline"], timeline, subject.t_s)
    _images(parts["images"], subject, explained)
    if explained.touched:
        _touched(parts["touched"].subplots(1, columns), explained)
    plan_panels.table(parts["table"].subplots(), explained)
    figure.savefig(path, format="png")


def _images(part: SubFigure, subject: Subject, explained: Explained) -> None:
    planned, view = explained.planned, subject.frame.view
    seen, light, apart = part.subplots(1, 3)
    gazes = [view.pixel_of(eye.azimuth_deg, eye.elevation_deg) for eye in subject.poses]
    # Both eyes' images lie beside each other.
    gaze_px = [(x_px + k * view.width_px, y_px) for k, (x_px, y_px) in enumerate(gazes)]
    lights_px = [
        (source.x_px + k * view.width_px, source.y_px)
        for k, measured in enumerate(planned.measured)
        for source in measured.sources
    ]
    panels.picture(seen, _together(planned.image), gaze_px, "perceived, as planned; + gaze")
    cd_m2 = side_by_side(np.asarray(luminance(subject.frame.rgb_cd_m2)))
    panels.luminances(part, light, cd_m2, gaze_px, lights_px, planned.state.adapted_cd_m2)
    difference = side_by_side(explained.difference)
    bound, differ = figure_of(planned.plan.bound_code_values), (difference != 0).mean()
    title = f"full minus planned: {np.abs(difference).max():.0f} (bound {bound}), {differ:.1%} of pixels"
    panels.difference(part, apart, difference, title)


def _touched(row: np.ndarray, explained: Explained) -> None:
    image = _together(explained.planned.image)
    for axes in row[len(explained.touched) :]:
        axes.axis("off")
    for axes, (effect, touch) in zip(row, explained.touched.items(), strict=False):
        title = f"{spaced(effect)} changes {touch.share:.1%} of pixels, by {touch.largest:.0f} at most"
        panels.touched(axes, image, side_by_side(touch.change), COLOURS[effect], title)


def _timeline_in(timeline: Timeline) -> tuple[float, float, float]:
    """Heights of levels, times and changes."""
    listed = min(len(timeline.changes), MOST_CHANGES)
    return TITLE_IN + SPAN_IN * len(timeline.effects), TITLE_IN + TIMES_IN, LINE_IN * max(listed, 0.1)


def _timeline(part: SubFigure, timeline: Timeline, at_s: float | None) -> None:
    lanes, times, words = part.subplots(3, 1, height_ratios=_timeline_in(timeline))
    plan_panels.levels(lanes, timeline, at_s)
    plan_panels.milliseconds(times, timeline, at_s)
    times.sharex(lanes)
    plan_panels.changes(words, timeline.changes[:MOST_CHANGES])


def _together(images: np.ndarray) -> np.ndarray:
    """Both eyes' images beside each other, as 8 bits to look at."""
    image = side_by_side(images)
    if np.issubdtype(image.dtype, np.floating):
        return np.asarray(np.clip(image, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    return image if image.dtype == np.uint8 else (image >> 2).astype(np.uint8)
