"""The parts of the picture that are words and lines: the plan as a table, a session's levels and times."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from entoptic.pipeline.plan import OFF, SKIPPED
from entoptic.services.explain.panels import FAINT, INK
from entoptic.services.explain.timeline import Span, Timeline


class Entry(NamedTuple):
    """A line of the plan's table."""

    effect: str
    level: str
    bound: str
    """In code values."""
    changed: str
    """What it was measured to change."""
    milliseconds: str
    reason: str


COLUMNS = (("effect", 0.0), ("level", 0.1), ("bound", 0.21), ("changes", 0.27), ("ms", 0.345), ("why", 0.36))
"""Heads of the table and where they stand, as shares of its width; figures end there, words begin there."""
WHY_LETTERS = 135
"""In a line of reasons."""
CHANGE_LETTERS = 155
"""In a line of a session's changes, which is smaller."""


def table_lines(entries: Sequence[Entry]) -> int:
    """How many lines the table has, its head included."""
    return 1 + sum(len(_wrapped(entry.reason)) for entry in entries)


def table(axes: Axes, entries: Sequence[Entry], colours: Mapping[str, str], note: str) -> None:
    """The plan, effect by effect, and a note below."""
    lines = table_lines(entries)
    axes.set(xlim=(0, 1), ylim=(lines + 1, -0.3))
    axes.axis("off")

    def write(line: float, column: int, text: str, **look: str) -> None:
        name, x = COLUMNS[column]
        side = "right" if name in ("bound", "changes", "ms") else "left"
        axes.text(x, line + 0.7, text, ha=side, va="baseline", size=10, **look)  # type: ignore[arg-type]

    for column, (name, _) in enumerate(COLUMNS):
        write(0, column, name, color=FAINT)
    at = 1
    for entry in entries:
        axes.axhline(at, color="#dddddd", lw=0.8)
        weight = "bold" if entry.milliseconds else "normal"
        for column, cell in enumerate((entry.effect.replace("_", " "), *entry[1:5])):
            write(at, column, cell, color=colours.get(entry.effect, INK), weight=weight)
        for line in _wrapped(entry.reason):
            write(at, len(COLUMNS) - 1, line, color=INK)
            at += 1
    axes.text(0, at + 0.9, note, size=8.5, va="baseline", color=FAINT)


def _wrapped(reason: str) -> list[str]:
    return textwrap.wrap(reason, WHY_LETTERS) or [""]


def levels(axes: Axes, timeline: Timeline, colours: Mapping[str, str], at_s: float | None) -> None:
    """Which level each effect had when; the key frame that is shown below is marked."""
    effects = timeline.effects
    whole_s = max(timeline.spans[0].end_s, *(span.end_s for span in timeline.spans)) - float(timeline.t_s[0])
    for span in timeline.spans:
        row = effects.index(span.effect)
        runs = span.level not in (SKIPPED, OFF)
        wide = span.end_s - span.begin_s
        axes.barh(
            row, wide, left=span.begin_s, height=0.7, color=colours[span.effect] if runs else "#eceef0",
            alpha=0.85 if runs else 1, edgecolor="white", lw=1,
        )  # fmt: skip
        if wide > 0.012 * whole_s * (len(span.level) + 2):
            axes.text(
                span.begin_s + wide / 2, row, span.level, size=8.5, ha="center", va="center",
                color="white" if runs else FAINT,
            )  # fmt: skip
    axes.set_yticks(range(len(effects)), [effect.replace("_", " ") for effect in effects])
    axes.set(ylim=(len(effects) - 0.4, -0.6), title="level of each effect")
    axes.tick_params(left=False)
    _mark(axes, at_s)


def milliseconds(axes: Axes, timeline: Timeline, colours: Mapping[str, str], at_s: float | None) -> None:
    """What each part of a frame took, one on the other."""
    base = np.zeros_like(timeline.t_s)
    for part, taken in timeline.ms.items():
        axes.fill_between(
            timeline.t_s, base, base + taken, step="post", lw=0, color=colours.get(part, _of_other(part)),
            label=part.replace("_", " "),
        )  # fmt: skip
        base = base + taken
    axes.set(ylabel="ms", xlabel="recorded time / s", title="time of a frame, without making the scene")
    axes.set_ylim(0, float(np.percentile(base, 95)) * 1.2 + 1e-3)
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    _mark(axes, at_s)


def _of_other(part: str) -> str:
    return {"measure": "#c9ccd1", "kernel": "#aeb2b9", "encode": "#93989f"}.get(part, "#d9dbde")


def _mark(axes: Axes, at_s: float | None) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0)
    axes.title.set(size=11, color=INK)
    if at_s is not None:
        axes.axvline(at_s, color=INK, lw=1.2, ls="--")


def changes(axes: Axes, spans: Sequence[Span], colours: Mapping[str, str]) -> None:
    """The changes of level, a line each."""
    axes.set(xlim=(0, 1), ylim=(max(len(spans), 1), 0))
    axes.axis("off")
    for line, span in enumerate(spans):
        axes.text(0.0, line, f"{span.begin_s:.2f} s", size=9, va="top", color=FAINT)
        axes.text(
            0.05, line, f"{span.effect.replace('_', ' ')} → {span.level}", size=9, va="top", color=colours[span.effect]
        )
        axes.text(
            0.21, line, textwrap.shorten(span.reason, CHANGE_LETTERS, placeholder=" …"), size=9, va="top", color=INK
        )
