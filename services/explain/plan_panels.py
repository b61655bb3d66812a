"""The parts of the picture that are words and lines: the plan as a table, a session's levels and times."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes

from entoptic.pipeline import EFFECTS, Step
from entoptic.pipeline.plan import OFF, SKIPPED
from entoptic.services.explain.panels import FAINT, INK
from entoptic.services.explain.timeline import Span, Timeline
from entoptic.services.explain.variants import Explained

COLOURS = {"measure": "#c9ccd1", "kernel": "#aeb2b9", "encode": "#93989f"} | dict(
    zip(
        (effect.name for effect in EFFECTS),
        itertools.cycle(("#5d6470", "#c8553d", "#2a6fbb", "#1a8f94", "#b8860b", "#8a5aa8", "#3a8f5a")),
        strict=False,
    )
)
COLUMNS = (("effect", 0.0), ("level", 0.1), ("bound", 0.21), ("changes", 0.27), ("ms", 0.345), ("why", 0.36))
"""Heads of the table and where they stand, as shares of its width; figures end there, words begin there."""
WHY_LETTERS, CHANGE_LETTERS = 135, 155
"""In a line of reasons, and in one of a session's changes, which is smaller."""
NOTE = (
    "bound, changes: in code values, of any pixel. Touched: another code value with the effect than without it. Images "
    "are reduced so that of each spot the largest change is shown."
)


def spaced(effect: str) -> str:
    """An effect's name for a reader."""
    return effect.replace("_", " ")


def figure_of(code_values: float) -> str:
    """Two digits, or all before the point."""
    return f"{code_values:.2g}" if code_values < 100 else f"{code_values:.0f}"


def table_lines(plan: Iterable[Step]) -> int:
    """How many lines the table has, its head included."""
    return 1 + sum(len(_wrapped(step.reason)) for step in plan)


def table(axes: Axes, explained: Explained) -> None:
    """The plan, effect by effect, and a note below."""
    plan, milliseconds = explained.planned.plan, explained.planned.milliseconds
    axes.set(xlim=(0, 1), ylim=(table_lines(plan) + 1, -0.3))
    axes.axis("off")

    def write(line: float, cells: Sequence[str], colour: str, weight: str = "normal") -> None:
        for (name, x), cell in zip(COLUMNS, cells, strict=False):
            side = "right" if name in ("bound", "changes", "ms") else "left"
            axes.text(x, line + 0.7, cell, ha=side, va="baseline", size=10, color=colour, weight=weight)

    write(0, [name for name, _ in COLUMNS], FAINT)
    at = 1
    for step in plan:
        axes.axhline(at, color="#dddddd", lw=0.8)
        touch, taken = explained.touched.get(step.effect), milliseconds.get(step.effect) if step.runs else None
        cells = [
            spaced(step.effect),
            step.level,
            figure_of(step.bound_code_values) if step.bound_code_values else "",
            "" if touch is None else f"{touch.largest:.0f}",
            "" if taken is None else f"{taken:.1f}",
        ]
        write(at, cells, COLOURS[step.effect], "normal" if taken is None else "bold")
        for line in _wrapped(step.reason):
            axes.text(COLUMNS[-1][1], at + 0.7, line, va="baseline", size=10, color=INK)
            at += 1
    axes.text(0, at + 0.9, NOTE, size=8.5, va="baseline", color=FAINT)


def _wrapped(reason: str) -> list[str]:
    return textwrap.wrap(reason, WHY_LETTERS) or [""]


def levels(axes: Axes, timeline: Timeline, at_s: float | None) -> None:
    """Which level each effect had when; the key frame that is shown below is marked."""
    effects = timeline.effects
    whole_s = max(span.end_s for span in timeline.spans) - float(timeline.t_s[0])
    for span in timeline.spans:
        row, wide = effects.index(span.effect), span.end_s - span.begin_s
        runs = span.level not in (SKIPPED, OFF)
        colour = COLOURS[span.effect] if runs else "#eceef0"
        axes.barh(row, wide, 0.7, span.begin_s, color=colour, alpha=0.85 if runs else 1, edgecolor="white", lw=1)
        if wide > 0.012 * whole_s * (len(span.level) + 2):
            middle, ink = span.begin_s + wide / 2, "white" if runs else FAINT
            axes.text(middle, row, span.level, size=8.5, ha="center", va="center", color=ink)
    axes.set_yticks(range(len(effects)), [spaced(effect) for effect in effects])
    axes.set(ylim=(len(effects) - 0.4, -0.6), title="level of each effect")
    axes.tick_params(left=False)
    _mark(axes, at_s)


def milliseconds(axes: Axes, timeline: Timeline, at_s: float | None) -> None:
    """What each part of a frame took, one on the other."""
    total = sum(timeline.ms.values())
    colours = [COLOURS.get(part, "#d9dbde") for part in timeline.ms]
    labels = [spaced(part) for part in timeline.ms]
    axes.stackplot(timeline.t_s, *timeline.ms.values(), step="post", lw=0, colors=colours, labels=labels)
    axes.set(ylabel="ms", xlabel="recorded time / s", title="time of a frame, without making the scene")
    axes.set_ylim(0, float(np.percentile(total, 95)) * 1.2 + 1e-3)
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    _mark(axes, at_s)


def _mark(axes: Axes, at_s: float | None) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0)
    axes.title.set(size=11, color=INK)
    if at_s is not None:
        axes.axvline(at_s, color=INK, lw=1.2, ls="--")


def changes(axes: Axes, spans: Sequence[Span]) -> None:
    """The changes of level, a line each."""
    axes.set(xlim=(0, 1), ylim=(max(len(spans), 1), 0))
    axes.axis("off")
    for line, span in enumerate(spans):
        reason = textwrap.shorten(span.reason, CHANGE_LETTERS, placeholder=" …")
        axes.text(0.0, line, f"{span.begin_s:.2f} s", size=9, va="top", color=FAINT)
        axes.text(0.05, line, f"{spaced(span.effect)} → {span.level}", size=9, va="top", color=COLOURS[span.effect])
        axes.text(0.21, line, reason, size=9, va="top", color=INK)
