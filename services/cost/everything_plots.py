"""The pictures of what every effect costs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from entoptic.pipeline.cost.comparison import pareto
from entoptic.pipeline.cost.everything import Row
from entoptic.pipeline.cost.whole_frame import Size, Whole, front
from entoptic.pipeline.effects.effect import SKIPPED
from entoptic.services.cost.glare_plots import COLOURS, SMALLEST_SHARE, Mark, label

SMALLEST_MS = 1e-3
"""What is left out is drawn at this time."""
SMALLEST_ERROR, UNSEEN = 1e-7, 1e-3
"""What is less, and 0, is drawn here: of an effect alone; and of the whole frame, where it is far from seen."""
RATES_FPS = (90, 60, 30, 5)
SCENE_COLOURS = ("#26355e", "#4a6fa5", "#c8553d", "#b8860b", "#8a5aa8", "#7a8b8b", "#3a8f5a", "#d6409f")


def by_setting(rows: Sequence[Row], effect: str) -> list[list[Row]]:
    """The rows of an effect, together for each setting, in their order."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row.effect == effect:
            found.setdefault((row.setting, row.of), []).append(row)
    return list(found.values())


def median_ms(rows: Sequence[Row]) -> float:
    """Over scenes."""
    return float(np.median([row.median_ms for row in rows]))


def effect_front(path: Path, effect: str, rows: Sequence[Row]) -> None:
    """Draws every setting of an effect: its error in the worst scene over its time, and the front that none beats.

    A thin line goes down to the best scene. Settings beside another truth are other pictures: each has its own colour.
    """
    figure = Figure(figsize=(13, 6.2), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    settings = by_setting(rows, effect)
    of = list(dict.fromkeys(row.of for row in rows))
    # Where no setting has a rival, colours say nothing.
    shared = [truth for truth in of if sum(rows_[0].of == truth for rows_ in settings) > 1]
    colours = {truth: COLOURS[k % len(COLOURS)] for k, truth in enumerate(shared)}
    titles = ("ΔE ITP: 95 % of the pixels below", "relative L2")
    marks = {}
    for axes, title in zip(figure.subplots(1, 2), titles, strict=True):
        marks[axes] = _settings(axes, settings, colours, title)
    figure.suptitle(f"{effect.replace('_', ' ')}: error in the worst scene against float64, over time", fontsize=11)
    for truth, colour in colours.items():
        figure.axes[0].plot([], [], "o", color=colour, label=f"beside {truth}")
    if colours:
        figure.legend(loc="outside lower center", ncols=len(colours), frameon=False, fontsize=9)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # all stays where the labels find it
    for axes, of_axes in marks.items():
        label(axes, of_axes, canvas)
    figure.savefig(path, format="png")


def _settings(axes: Axes, settings: Sequence[Sequence[Row]], colours: dict[str, str], title: str) -> list[Mark]:
    marks = []
    rivals: dict[str, list[tuple[float, float]]] = {}
    for of_setting in settings:
        errors = [row.errors.delta_e_p95 if "ΔE" in title else row.errors.relative_l2 for row in of_setting]
        best, worst = (max(value, SMALLEST_ERROR) for value in (min(errors), max(errors)))
        at_ms = max(median_ms(of_setting), SMALLEST_MS)
        truth = of_setting[0].of
        colour = colours.get(truth, "#777777")
        axes.vlines(at_ms, best, worst, color=colour, lw=0.8, alpha=0.4)
        axes.plot(at_ms, worst, "o", ms=5, color=colour)
        rivals.setdefault(truth, []).append((at_ms, worst))
        marks.append(Mark(at_ms, worst, of_setting[0].setting, colour))
    for truth, colour in colours.items():
        points = rivals[truth]
        best_of = np.array([points[k] for k in pareto(points)])
        axes.plot(*best_of.T, color=colour, lw=1.2, alpha=0.5, drawstyle="steps-post", zorder=1)
    _dress(axes, "time / ms: median", title)
    return marks


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
        if SMALLEST_SHARE * low < 1e3 / fps < high / SMALLEST_SHARE:
            axes.axvline(1e3 / fps, color="#999999", lw=0.8, ls=":")
            axes.annotate(f"{fps} fps", (1e3 / fps, 1), xycoords=("data", "axes fraction"), fontsize=8, color="#777777")
    _dress(axes, f"time of one eye's frame at {size[0]}×{size[1]} / ms", "ΔE ITP: 95 % of the pixels below")
    figure.legend(loc="outside lower center", ncols=len(scenes), frameon=False, fontsize=9)
    figure.suptitle("Whole frame: the best of each scene; glare · acuity · night colour", fontsize=11)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    label(axes, marks, canvas)
    figure.savefig(path, format="png")


def _short(whole: Whole) -> str:
    levels = [level for _, level in whole.combination if level != SKIPPED]
    return " · ".join(levels) or "nothing"


def _dress(axes: Axes, x: str, y: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
    axes.margins(0.12)
    axes.grid(which="major", lw=0.3)
    axes.spines[["top", "right"]].set_visible(False)
