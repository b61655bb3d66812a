"""The picture of a calibration: what was measured, which part of it counts, and what came out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from entoptic.tracker_bridge.calibration import Screen, ShownScreen
from entoptic.tracker_bridge.calibration_quality import Analysis, EyeResult
from entoptic.tracker_bridge.samples import NS_PER_S, Eye

COLOURS = {Eye.RIGHT: "#c8553d", Eye.LEFT: "#2a6fbb"}
SHADES = {Screen.WHITE: "#ffffff", Screen.BLACK: "#d4d4d4"}
WINDOW = "#f2c14e"
_MOST_DOTS = 3000
"""Measured samples drawn of an eye: more make the file larger and the picture no better."""


def write(path: Path, analysis: Analysis, screens: Sequence[ShownScreen], title: str) -> None:
    """Draws each eye's trace, the screens, the measured windows and their values, as a PNG under 100 kB."""
    results = list(analysis.eyes.values())
    figure = Figure(figsize=(9, 1.6 + 2.2 * max(len(results), 1)), layout="constrained")
    rows = figure.subplots(max(len(results), 1), 1, sharex=True, squeeze=False)[:, 0]
    start_ns = screens[0].t_ns if screens else (int(results[0].trace.t_ns[0]) if results else 0)
    for axes, result in zip(rows, results, strict=False):
        _draw(axes, result, screens, start_ns)
    rows[-1].set_xlabel("time since the first screen / s")
    problems = [f"{problem.name}: {problem.detail}" for problem in analysis.problems]
    figure.suptitle("\n".join([title, *problems]), fontsize=9)
    figure.legend(handles=_handles(), ncols=6, loc="outside lower center", frameon=False, fontsize=8)
    figure.savefig(path, format="png", dpi=100)


def _draw(axes: Axes, result: EyeResult, screens: Sequence[ShownScreen], start_ns: int) -> None:
    trace, colour = result.trace, COLOURS[result.trace.eye]
    t_s = (trace.t_ns - start_ns) / NS_PER_S
    for screen in screens:
        begin_s = (screen.t_ns - start_ns) / NS_PER_S
        axes.axvspan(begin_s, begin_s + screen.seconds, color=SHADES[screen.screen], lw=0)
        axes.axvline(begin_s, color="#777777", lw=0.6)
        axes.text(
            begin_s + screen.seconds / 2, 0.97, screen.screen.value, ha="center", va="top", fontsize=8,
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
    every = max(math.ceil(t_s.size / _MOST_DOTS), 1)
    axes.plot(t_s[::every], trace.measured[::every], ".", ms=1.5, color="#999999")
    axes.plot(t_s, trace.tracked, color=colour, lw=1.2)
    for window in result.windows:
        begin_s, end_s = ((at - start_ns) / NS_PER_S for at in (window.from_ns, window.to_ns))
        axes.axvspan(begin_s, end_s, 0.0, 0.06, color=WINDOW, lw=0)
        if np.isfinite(window.value):
            axes.plot([begin_s, end_s], [window.value] * 2, color="black", lw=2.2)
            axes.annotate(
                f"{window.value:.2f} {trace.unit}", ((begin_s + end_s) / 2, window.value), xytext=(0, 9),
                textcoords="offset points", ha="center", fontsize=8,
            )  # fmt: skip
    middle = np.concatenate([trace.tracked[np.isfinite(trace.tracked)], [result.trace.native_per_mm * 2]])
    axes.set(
        ylabel=f"{trace.eye.name.lower()} pupil / {trace.unit}",
        ylim=(0.5 * float(np.percentile(middle, 1)), 1.2 * float(np.percentile(middle, 99))),
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0)


def _handles() -> list[Artist]:
    return [
        Line2D([], [], marker=".", ls="", color="#999999", label="measured"),
        *(Line2D([], [], color=colour, label=f"trusted, {eye.name.lower()}") for eye, colour in COLOURS.items()),
        Patch(color=WINDOW, label="what counts"),
        Line2D([], [], color="black", lw=2.2, label="value"),
        Patch(facecolor=SHADES[Screen.BLACK], label="black screen"),
    ]
