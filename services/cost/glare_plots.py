"""The pictures of what accuracy costs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import NullFormatter
from matplotlib.transforms import Bbox

from entoptic.pipeline.cost.comparison import Row, pareto
from entoptic.pipeline.cost.errors import Errors
from entoptic.pipeline.cost.sun_corner import SunCorner

COLOURS = ("#2a6fbb", "#c8553d", "#3a8f5a", "#8a5aa8", "#b8860b", "#222222")
"""Of the groups, in their order."""
CURVES = ("#c8553d", "#b8860b", "#2a6fbb", "#3a8f5a")
"""Of ways to compute a sun's corner."""
SMALLEST_SHARE = 0.3
"""An error of 0 is drawn at this share of the smallest one."""
AROUND = tuple((math.cos(turn), math.sin(turn)) for turn in np.linspace(0, 2 * math.pi, 16, endpoint=False))
"""Directions in which a label may lie from its point, to the right first."""
AWAY_PX = (7, 14, 24, 36, 50, 70)
"""How far off its edge may be, nearest first."""


class Mark(NamedTuple):
    """A point and its label."""

    x: float
    y: float
    label: str
    colour: str


def error_over_time(path: Path, rows: Sequence[Row], scene: str) -> None:
    """Draws each setting's two errors over its time, both logarithmic, and the front that none beats."""
    figure = Figure(figsize=(13, 6.4), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    # A setting that belongs to several groups is one point, of the first.
    points = list({row.label: row for row in reversed(rows)}.values())[::-1]
    colours = dict(zip(dict.fromkeys(row.group for row in points), COLOURS, strict=False))
    marks = {
        left: _points(left, points, colours, "ΔE ITP: 95 % of the pixels below", lambda errors: errors.delta_e_p95),
        right: _points(right, points, colours, "relative L2 in cd/m²", lambda errors: errors.relative_l2),
    }
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    figure.suptitle(f"Glare of one eye: error against the reference over time; {scene}", fontsize=11)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # all stays where the labels find it
    for axes, of_axes in marks.items():
        label(axes, of_axes, canvas)
    figure.savefig(path, format="png")


def _points(
    axes: Axes, rows: Sequence[Row], colours: Mapping[str, str], name: str, value: Callable[[Errors], float]
) -> list[Mark]:
    errors = np.array([value(row.errors) for row in rows])
    floor = SMALLEST_SHARE * float(errors[errors > 0].min(initial=1.0))
    errors = np.maximum(errors, floor)
    times_ms = np.array([row.times.median_ms for row in rows])
    for fresh, style in ((False, "-"), (True, "--")):
        of_kind = [k for k, row in enumerate(rows) if row.fresh is fresh and not row.own_truth]
        front = [of_kind[k] for k in pareto([(float(times_ms[k]), float(errors[k])) for k in of_kind])]
        name_of_kind = "best with a new kernel" if fresh else "best with the kernel at hand"
        axes.plot(
            times_ms[front], errors[front], style, color="#aaaaaa", lw=1.2, drawstyle="steps-post", zorder=1,
            label=name_of_kind,
        )  # fmt: skip
    for group, colour in colours.items():
        of_group = [k for k, row in enumerate(rows) if row.group == group]
        low_ms, high_ms = np.array([rows[k].times.middle_half_ms for k in of_group]).T
        axes.hlines(errors[of_group], low_ms, high_ms, color=colour, lw=1, alpha=0.5)
        apart = all(rows[k].own_truth for k in of_group)
        axes.plot(
            times_ms[of_group], errors[of_group], "o", ms=5, color=colour, mfc="white" if apart else colour,
            label=f"{group} (own truth)" if apart else group,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="time / ms: median and middle half", ylabel=name)
    axes.margins(0.12)
    axes.grid(which="major", lw=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return [
        Mark(float(x), float(y), row.label, colours[row.group])
        for x, y, row in zip(times_ms, errors, rows, strict=True)
    ]


def label(axes: Axes, marks: Sequence[Mark], canvas: FigureCanvasAgg) -> None:
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
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    figure.savefig(path, format="png")
