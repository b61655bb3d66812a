"""The pictures of what accuracy costs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import NullFormatter
from matplotlib.transforms import Bbox

from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.everything import RATES_FPS, Row
from entoptic.pipeline.cost.sun_corner import SunCorner
from entoptic.pipeline.cost.whole_frame import Size, Whole, front, pareto
from entoptic.pipeline.effects.effect import SKIPPED

COLOURS = ("#2a6fbb", "#c8553d", "#3a8f5a", "#8a5aa8", "#b8860b", "#222222")
"""Of settings that are rivals, in their order."""
LEGEND: dict[str, Any] = {"loc": "outside lower center", "frameon": False, "fontsize": 9}
ALONE = "#777777"
"""Of settings without a rival."""
CURVES = ("#c8553d", "#b8860b", "#2a6fbb", "#3a8f5a")
"""Of ways to compute a sun's corner."""
SMALLEST_MS = 1e-3
"""What is left out is drawn at this time."""
SMALLEST_ERROR, UNSEEN = 1e-7, 1e-3
"""What is less, and 0, is drawn here: of an effect alone; and of the whole frame, where it is far from seen."""
SCENE_COLOURS = ("#26355e", "#4a6fa5", "#c8553d", "#b8860b", "#8a5aa8", "#7a8b8b", "#3a8f5a", "#d6409f")
AROUND = tuple((math.cos(turn), math.sin(turn)) for turn in np.linspace(0, 2 * math.pi, 16, endpoint=False))
"""Directions in which a label may lie from its point, to the right first."""
AWAY_PX = (7, 14, 24, 36, 50, 70)
"""How far off its edge may be, nearest first."""

PANELS: Mapping[str, Callable[[Errors], float]] = {
    "ΔE ITP: 95 % of the pixels below": lambda errors: errors.delta_e_p95,
    "relative L2": lambda errors: errors.relative_l2,
}


class Mark(NamedTuple):
    """A point and its label."""

    x: float
    y: float
    label: str
    colour: str


def by_setting(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows of one setting together, in their order."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row.setting, row.of), []).append(row)
    return list(found.values())


def median_ms(rows: Sequence[Row]) -> float:
    """Over scenes."""
    return float(np.median([row.median_ms for row in rows]))


def error_over_time(path: Path, title: str, rows: Sequence[Row], kind: Callable[[Row], str]) -> None:
    """Draws every setting: its error in the worst scene over its time, and the front that none of its kind beats.

    A thin line goes down to the best scene. A setting of several kinds is one point, of the first one's colour.
    """
    figure = Figure(figsize=(13, 6.4), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    settings = by_setting(rows)
    kinds: dict[str, list[int]] = {}
    for k, of_setting in enumerate(settings):
        for name in dict.fromkeys(map(kind, of_setting)):
            kinds.setdefault(name, []).append(k)
    rivals = {name: members for name, members in kinds.items() if len(members) > 1}
    coloured = list(zip(rivals.values(), itertools.cycle(COLOURS)))
    colours = {k: colour for members, colour in reversed(coloured) for k in members}
    marks = {}
    for axes, (name, error) in zip(figure.subplots(1, 2), PANELS.items(), strict=True):
        marks[axes] = [_point(axes, of_setting, error, colours.get(k, ALONE)) for k, of_setting in enumerate(settings)]
        for (rival, members), colour in zip(rivals.items(), itertools.cycle(COLOURS)):
            points = [(marks[axes][k].x, marks[axes][k].y) for k in members]
            best = np.array([points[k] for k in pareto(points)])
            axes.plot(*best.T, color=colour, lw=1.2, alpha=0.5, drawstyle="steps-post", zorder=1)
            axes.plot([], [], "o", color=colour, label=rival)
        _dress(axes, "time / ms: median", name)
    if rivals:
        figure.legend(*figure.axes[0].get_legend_handles_labels(), **LEGEND, ncols=len(rivals))
    _save(figure, canvas, path, title, marks)


def _point(axes: Axes, rows: Sequence[Row], error: Callable[[Errors], float], colour: str) -> Mark:
    errors = [max(error(row.errors), SMALLEST_ERROR) for row in rows]
    at_ms = max(median_ms(rows), SMALLEST_MS)
    axes.vlines(at_ms, min(errors), max(errors), color=colour, lw=0.8, alpha=0.4)
    axes.plot(at_ms, max(errors), "o", ms=5, color=colour)
    return Mark(at_ms, max(errors), rows[0].setting, colour)


def whole_fronts(path: Path, wholes: Sequence[Whole], size: Size) -> None:
    """Draws each scene's front of the whole frame: what none beats in time and error; with the budgets of rates."""
    figure = Figure(figsize=(13, 7.2), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    marks = []
    scenes = dict.fromkeys(whole.scene for whole in wholes)
    for scene, colour in zip(scenes, itertools.cycle(SCENE_COLOURS)):
        of_scene = [whole for whole in wholes if whole.scene == scene]
        times_ms = [whole.milliseconds[size] for whole in of_scene]
        errors = [max(whole.errors.delta_e_p95, UNSEEN) for whole in of_scene]
        axes.plot(times_ms, errors, ".", ms=4, color=colour, alpha=0.35)
        best = front(of_scene, size)
        x = [whole.milliseconds[size] for whole in best]
        y = [max(whole.errors.delta_e_p95, UNSEEN) for whole in best]
        axes.plot(x, y, "o-", ms=5, lw=1.3, color=colour, drawstyle="steps-post", label=scene)
        marks += [Mark(at_ms, error, _short(whole), colour) for at_ms, error, whole in zip(x, y, best, strict=True)]
    low, high = axes.get_xlim()
    for fps in RATES_FPS:
        if 0.3 * low < 1e3 / fps < high / 0.3:
            axes.axvline(1e3 / fps, color="#999999", lw=0.8, ls=":")
            axes.annotate(
                f"{fps:g} fps", (1e3 / fps, 1), xycoords=("data", "axes fraction"), fontsize=8, color="#777777"
            )
    _dress(axes, f"time of one eye's frame at {size[0]}×{size[1]} / ms", "ΔE ITP: 95 % of the pixels below")
    figure.legend(**LEGEND, ncols=len(scenes))
    _save(figure, canvas, path, "Whole frame: the best of each scene; glare · acuity · night colour", {axes: marks})


def _short(whole: Whole) -> str:
    levels = [level for _, level in whole.combination if level != SKIPPED]
    return " · ".join(levels) or "nothing"


def _dress(axes: Axes, x: str, y: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
    axes.margins(0.12)
    axes.grid(which="major", lw=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _save(
    figure: Figure, canvas: FigureCanvasAgg, path: Path, title: str, marks: Mapping[Axes, Sequence[Mark]]
) -> None:
    figure.suptitle(title, fontsize=11)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # all stays where the labels find it
    for axes, of_axes in marks.items():
        _label(axes, of_axes, canvas)
    figure.savefig(path, format="png")


def _label(axes: Axes, marks: Sequence[Mark], canvas: FigureCanvasAgg) -> None:
    """Writes each label as near to its point as it covers no other point and no other label."""
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    to_px = axes.transData
    at_px = [to_px.transform((mark.x, mark.y)) for mark in marks]
    taken = [Bbox.from_extents(x - 4, y - 4, x + 4, y + 4) for x, y in at_px]
    for mark, (x, y) in zip(marks, at_px, strict=True):
        text = axes.annotate(
            mark.label, (mark.x, mark.y), xytext=(0, 0), textcoords="offset pixels", fontsize=7.5, color=mark.colour,
            ha="center", va="center", arrowprops={"arrowstyle": "-", "lw": 0.5, "color": mark.colour, "shrinkB": 2},
        )  # fmt: skip
        text.set_in_layout(False)
        text.set_path_effects([patheffects.withStroke(linewidth=2, foreground="white")])
        extent = Text.get_window_extent(text, renderer)  # without its line
        wide, high = extent.width, extent.height
        for away, (right, up) in itertools.product(AWAY_PX, AROUND):
            off_x, off_y = right * (away + wide / 2), up * (away + high / 2)
            box = Bbox.from_bounds(x + off_x - wide / 2, y + off_y - high / 2, wide, high)
            if (
                axes.bbox.fully_containsx(box.x0)
                and axes.bbox.fully_containsx(box.x1)
                and not box.count_overlaps(taken)
            ):
                break
        text.set_position((off_x, off_y))
        taken.append(box)


def sun_corner(path: Path, corner: SunCorner) -> None:
    """Draws the light that the eye scatters and the errors of ways to compute it over the angle from the sun."""
    figure = Figure(figsize=(7.6, 5.4), dpi=100, layout="constrained")
    axes = figure.add_subplot(yscale="log")
    axes.plot(corner.deg, corner.truth_cd_m2, color="black", lw=2, label="truth: what the eye makes of the scene")
    for (name, error), colour in zip(corner.error_cd_m2.items(), CURVES, strict=False):
        axes.plot(corner.deg, np.where(error > 0, error, np.nan), color=colour, lw=1.4, label=f"error of {name}")
    axes.axhline(corner.dark_cd_m2, color="#777777", lw=0.8, ls=":", label="the scene without its sun")
    axes.set(xlabel="angle from the sun / °", ylabel="cd/m²; of errors, 95 % below")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(which="major", lw=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(**LEGEND, ncols=2)
    figure.savefig(path, format="png")
