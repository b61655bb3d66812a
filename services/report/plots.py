"""What a report draws: lines of no more points than can be seen, as SVG."""

from __future__ import annotations

import dataclasses
import io
import itertools
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from entoptic.pipeline import EFFECTS
from entoptic.services.results.tally import LATENCIES

Table = dict[str, list[str]]

COLOURS = {"left": "#2a6fbb", "right": "#c8553d"}
NOT_TRACKING = {"closing": "#f9e2a8", "blink": "#f2c14e", "opening": "#fbeecb"}
NOT_TRACKING |= {"dropout": "#c9c9c9", "lost": "#8c8c8c"}
AWAY = "#b08fd0"
"""The bridge or the worker was not there."""
MOST_POINTS = 600
"""Of a line. Engineering choice: about what a page has pixels for; more takes time to draw and is not seen."""
LATENCY_COLOURS = ("#7fb3d5", "#f5b041", "#82b366", "#333333")
EFFECT_COLOURS = ("#66c2a5", "#fc8d62", "#8da0cb", "#ffd92f", "#a6d854", "#e78ac3", "#e5c494")
PART_COLOURS = {
    "scene": "#bdbdbd",
    "measure": "#969696",
    "plan": "#d9d9d9",
    **dict(zip((effect.name for effect in EFFECTS), itertools.cycle(EFFECT_COLOURS), strict=False)),
    "encode": "#737373",
}


@dataclasses.dataclass(frozen=True)
class Subject:
    """What is drawn."""

    states: Table
    plan: Table
    view: dict[str, float]
    gaps: list[dict[str, Any]]

    def has(self, table: str) -> bool:
        """Whether there is anything in that table."""
        return bool(latencies(self.plan) if table == "latency" else getattr(self, table).get("t_s"))


def numbers(cells: list[str]) -> NDArray[np.float64]:
    """A column; NaN where a cell is empty."""
    return np.array([float(cell) if cell else np.nan for cell in cells])


def latencies(plan: Table) -> dict[str, NDArray[np.float64]]:
    """Times in ms of each stage from the sample to the light, and of all; empty where no frame has any."""
    rows = [row for row in zip(*(plan.get(name, []) for name in LATENCIES), strict=False) if all(row)]
    stages = np.array(rows, float).T
    names = [name.removesuffix("_ms").replace("_", " ") for name in LATENCIES]
    return {**dict(zip(names, stages, strict=True)), "all of it": stages.sum(0)} if rows else {}


def _shade(axes: Axes, t_s: NDArray[np.float64], phases: list[str], low: float, high: float) -> None:
    """Bands where a pupil is not tracked, over a share of the height: a rectangle for each stretch."""
    named = np.array(phases)
    edges = np.flatnonzero(np.append(True, named[1:] != named[:-1])) if len(named) else np.array([], int)
    ends = np.append(t_s[edges[1:]], t_s[-1:]) if len(edges) else t_s
    for phase, colour in NOT_TRACKING.items():
        spans = [(t_s[edge], end - t_s[edge]) for edge, end in zip(edges, ends, strict=True) if phases[edge] == phase]
        axes.broken_barh(spans, (low, high - low), color=colour, alpha=0.55, lw=0, transform=axes.get_xaxis_transform())


def _shade_gaps(axes: Axes, gaps: list[dict[str, Any]], last_s: float) -> None:
    """Bands where the bridge or the worker was away."""
    for gap in gaps:
        end_s = last_s if gap["to_s"] is None else gap["to_s"]
        axes.axvspan(max(gap["from_s"], 0.0), end_s, color=AWAY, alpha=0.45, lw=0)


def _line(axes: Axes, t_s: NDArray[np.float64], values: NDArray[np.float64], *style: str, **look: Any) -> None:
    """A line over time, of no more points than can be seen: where there are more, the least and most of each stretch.

    The line is broken where for a second nothing was measured.
    """
    keep = np.arange(len(t_s))
    if len(t_s) > 2 * MOST_POINTS:
        whole = np.array_split(keep, MOST_POINTS)
        parts = [part[~np.isnan(values[part])] if not np.isnan(values[part]).all() else part[:1] for part in whole]
        keep = np.unique([part[pick(values[part])] for part in parts for pick in (np.argmin, np.argmax)])
    times, shown = t_s[keep], values[keep].copy()
    shown[1:][np.diff(times) > max(1.0, 2 * (times[-1] - times[0]) / MOST_POINTS if len(times) else 1.0)] = np.nan
    axes.plot(times, shown, *style, **look)


def _pupils(subject: Subject) -> Figure:
    states = subject.states
    figure, axes = _figure(2, 4.6)
    t_s = numbers(states["t_s"])
    for one, eye in zip(axes, ("left", "right"), strict=True):
        measured = numbers(states[f"{eye}_measured_mm"])
        credible = np.where((measured > 0) & (measured < 10), measured, np.nan)
        _line(one, t_s, credible, ".", ms=2, color="#999999")
        _line(one, t_s, numbers(states[f"{eye}_pupil_diameter_mm"]), color=COLOURS[eye], lw=1.4)
        _shade(one, t_s, states[f"{eye}_phase"], 0, 1)
        _shade_gaps(one, subject.gaps, t_s[-1])
        one.set(ylabel=f"{eye} pupil / mm", ylim=(1, 9))
    axes[-1].set_xlabel("recorded time / s")
    handles: list[Artist] = [Patch(color=colour, alpha=0.55, label=phase) for phase, colour in NOT_TRACKING.items()]
    handles += [Patch(color=AWAY, alpha=0.45, label="away")] if subject.gaps else []
    handles.append(Line2D([], [], marker=".", ls="", color="#999999", label="measured"))
    handles.append(Line2D([], [], color="#444444", label="used"))
    axes[0].legend(handles=handles, ncols=8, loc="upper center", bbox_to_anchor=(0.5, 1.28), frameon=False, fontsize=8)
    return figure


def _gaze(subject: Subject) -> Figure:
    states = subject.states
    figure, axes = _figure(2, 3.8)
    t_s = numbers(states["t_s"])
    for one, angle, label in zip(axes, ("azimuth", "elevation"), ("right", "up"), strict=True):
        _line(one, t_s, numbers(states[f"gaze_{angle}_deg"]), color="#333333", lw=1)
        for eye, low in (("left", 0.5), ("right", 0.0)):
            _shade(one, t_s, states[f"{eye}_phase"], low, low + 0.5)
        _shade_gaps(one, subject.gaps, t_s[-1])
        one.set(ylabel=f"gaze {angle} / °\n({label} positive)")
    axes[-1].set_xlabel("recorded time / s  (shaded: upper half left eye, lower half right eye)")
    return figure


def _luminance(subject: Subject) -> Figure:
    plan = subject.plan
    figure, (axes,) = _figure(1, 2.8)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda cd_m2, place: f"{cd_m2:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    t_s = numbers(plan["t_s"])
    for eye, colour in COLOURS.items():
        if f"{eye}_adapted_cd_m2" in plan:
            for quantity, label, style, width in (
                ("max", "brightest pixel", ":", 1.0),
                ("mean", "mean", "--", 1.0),
                ("adapted", "adapted to", "-", 1.6),
            ):
                values = numbers(plan[f"{eye}_{quantity}_cd_m2"])
                _line(axes, t_s, values, style, color=colour, lw=width, label=f"{eye}: {label}")
    _shade_gaps(axes, subject.gaps, t_s[-1])
    axes.set(xlabel="recorded time / s", ylabel="luminance / cd/m²")
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def _time(subject: Subject) -> Figure:
    """The middle frame of each stretch, where there are more frames than can be seen."""
    plan = subject.plan
    figure, (axes,) = _figure(1, 2.8)
    t_s = numbers(plan["t_s"])
    stretches = np.array_split(np.arange(len(t_s)), min(len(t_s), MOST_POINTS // 3))
    middle = np.array([part[len(part) // 2] for part in stretches])
    parts = [np.nan_to_num(numbers(plan[f"{part}_ms"]))[middle] for part in PART_COLOURS]
    labels = [part.replace("_", " ") for part in PART_COLOURS]
    axes.stackplot(t_s[middle], *parts, colors=PART_COLOURS.values(), labels=labels, lw=0, step="mid")
    _shade_gaps(axes, subject.gaps, t_s[-1])
    limit = float(np.percentile(sum(parts), 99)) * 1.15 + 1e-3
    axes.set(xlabel="recorded time / s", ylabel="time of a frame / ms", ylim=(0, limit))
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def _latency(subject: Subject) -> Figure:
    """A histogram of each stage and of all together, up to where 99 % lie."""
    figure, (axes,) = _figure(1, 2.8)
    named = latencies(subject.plan)
    edges = np.linspace(0.0, float(np.percentile(named["all of it"], 99)) * 1.1 + 1e-3, 61)
    for (name, times), colour in zip(named.items(), LATENCY_COLOURS, strict=True):
        counts, _ = np.histogram(times, edges)
        axes.stairs(counts, edges, color=colour, fill=name != "all of it", alpha=0.6, lw=1.4, label=name)
    axes.set(xlabel="latency / ms", ylabel="frames")
    axes.legend(frameon=False, fontsize=8, loc="upper right")
    return figure


def _where(subject: Subject) -> Figure:
    plan, width_px, height_px = subject.plan, subject.view["width_px"], subject.view["height_px"]
    figure = Figure(figsize=(4.8, 0.8 + 4.0 * height_px / width_px), layout="constrained")
    axes = figure.add_subplot()
    for eye in (eye for eye in COLOURS if f"{eye}_gaze_x_px" in plan):
        at_px = [numbers(plan[f"{eye}_gaze_{axis}_px"]) for axis in "xy"]
        every = max(len(at_px[0]) // MOST_POINTS, 1)
        axes.plot(at_px[0][::every], at_px[1][::every], ".-", ms=4, lw=0.2, color=COLOURS[eye], label=eye)
    axes.set(xlim=(0, width_px), ylim=(height_px, 0), xlabel="x / px", ylabel="y / px", aspect="equal")
    axes.legend(frameon=False, fontsize=8)
    return figure


PLOTS = (
    ("Pupils", _pupils, "states"),
    ("Gaze", _gaze, "states"),
    ("Light before the eyes, and what they are adapted to", _luminance, "plan"),
    ("Time of each part of a frame", _time, "plan"),
    ("From the sample to the light", _latency, "latency"),
    ("Where the eyes looked in the frame", _where, "plan"),
)


def _figure(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    # Margins in inches, by hand: finding them takes as long as drawing.
    figure = Figure(figsize=(10, height))
    figure.subplots_adjust(left=0.1, right=0.82 if rows == 1 else 0.98, top=1 - 0.5 / height, bottom=0.5 / height)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for one in axes:
        one.spines[["top", "right"]].set_visible(False)
        one.grid(alpha=0.25)
        one.margins(x=0)
    return figure, list(axes)


def svg(figure: Figure) -> str:
    """As an element of a page."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "entoptic", "font.family": "sans-serif"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]
