"""report.html: what a person looks at after a session, made from the tables that the session left."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipeline.plan import SKIPPED, Effect

Table = dict[str, list[str]]

COLOURS = {"left": "#2a6fbb", "right": "#c8553d"}
NOT_TRACKING = {
    "closing": "#f9e2a8",
    "blink": "#f2c14e",
    "opening": "#fbeecb",
    "dropout": "#c9c9c9",
    "lost": "#8c8c8c",
}
PART_COLOURS = dict(
    zip(
        ("scene", "measure", "plan", *(effect.value for effect in Effect), "encode"),
        (
            *(
                "#bdbdbd",
                "#969696",
                "#d9d9d9",
                "#66c2a5",
                "#fc8d62",
                "#8da0cb",
                "#ffd92f",
                "#a6d854",
                "#e78ac3",
                "#e5c494",
            ),
            "#737373",
        ),
        strict=True,
    )
)


def write(folder: Path) -> None:
    """Writes report.html into a session's folder, from its summary, states.csv, events.csv and plan.csv."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    states, events, plan = (_read(folder / name) for name in ("states.csv", "events.csv", "plan.csv"))
    key_frames = folder / "key_frames" / "key_frames.json"
    page = _template().render(
        summary=summary,
        worker=summary["worker"],
        key_frames=json.loads(key_frames.read_text(encoding="utf-8")) if key_frames.exists() else [],
        eyes=[eye for eye in ("left", "right") if f"{eye}_pupil_mm" in plan],
        effects=_effects(plan),
        events=Counter(events["event"]).most_common(),
        plots=[(title, _svg(draw(states, plan, summary["view"]))) for title, draw in PLOTS if plan["frame"]],
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _template() -> jinja2.Template:
    loader = jinja2.PackageLoader("services", package_path="")
    return jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True).get_template(
        "report.html.jinja"
    )


def _read(path: Path) -> Table:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


def _effects(plan: Table) -> list[dict[str, Any]]:
    """Of each effect: how often each level was taken, with the reason that was given first."""
    frames = max(len(plan["frame"]), 1)
    rows = []
    for effect in Effect:
        levels, reasons = plan[f"{effect.value}_level"], plan[f"{effect.value}_reason"]
        milliseconds = _numbers(plan[f"{effect.value}_ms"])
        for level, count in Counter(levels).most_common():
            chosen = np.array([one == level for one in levels])
            rows.append(
                {
                    "effect": effect.value.replace("_", " "),
                    "level": level,
                    "ran": level != SKIPPED,
                    "share": count / frames,
                    "reason": reasons[levels.index(level)],
                    "ms": float(np.median(milliseconds[chosen])) if level != SKIPPED else 0.0,
                }
            )
    return rows


def _numbers(cells: list[str]) -> NDArray[np.float64]:
    return np.array([float(cell) if cell else np.nan for cell in cells])


def _shade(axes: Axes, t_s: NDArray[np.float64], phases: list[str], low: float, high: float) -> None:
    """Bands where a pupil is not tracked, over a share of the height."""
    for phase, colour in NOT_TRACKING.items():
        inside = np.array([one == phase for one in phases])
        if inside.any():
            axes.fill_between(
                t_s, low, high, where=inside, color=colour, alpha=0.55, lw=0, transform=axes.get_xaxis_transform()
            )


def _pupils(states: Table, plan: Table, view: dict[str, float]) -> Figure:
    figure, axes = _figure(2, 4.6)
    t_s = _numbers(states["t_s"])
    for one, eye in zip(axes, ("left", "right"), strict=True):
        measured = _numbers(states[f"{eye}_measured_mm"])
        one.plot(t_s, np.where((measured > 0) & (measured < 10), measured, np.nan), ".", ms=2, color="#999999")
        one.plot(t_s, _numbers(states[f"{eye}_diameter_mm"]), color=COLOURS[eye], lw=1.4)
        _shade(one, t_s, states[f"{eye}_phase"], 0, 1)
        one.set(ylabel=f"{eye} pupil / mm", ylim=(1, 9))
    axes[-1].set_xlabel("recorded time / s")
    handles: list[Artist] = [Patch(color=colour, alpha=0.55, label=phase) for phase, colour in NOT_TRACKING.items()]
    handles.append(Line2D([], [], marker=".", ls="", color="#999999", label="measured"))
    handles.append(Line2D([], [], color="#444444", label="used"))
    axes[0].legend(handles=handles, ncols=7, loc="upper center", bbox_to_anchor=(0.5, 1.28), frameon=False, fontsize=8)
    return figure


def _gaze(states: Table, plan: Table, view: dict[str, float]) -> Figure:
    figure, axes = _figure(2, 3.8)
    t_s = _numbers(states["t_s"])
    for one, angle, label in zip(axes, ("azimuth", "elevation"), ("right", "up"), strict=True):
        one.plot(t_s, _numbers(states[f"gaze_{angle}_deg"]), color="#333333", lw=1)
        for eye, low in (("left", 0.5), ("right", 0.0)):
            _shade(one, t_s, states[f"{eye}_phase"], low, low + 0.5)
        one.set(ylabel=f"gaze {angle} / °\n({label} positive)")
    axes[-1].set_xlabel("recorded time / s  (shaded: upper half left eye, lower half right eye)")
    return figure


def _luminance(states: Table, plan: Table, view: dict[str, float]) -> Figure:
    figure, (axes,) = _figure(1, 2.8)
    t_s = _numbers(plan["t_s"])
    for eye, colour in COLOURS.items():
        if f"{eye}_adapted_cd_m2" in plan:
            axes.semilogy(
                t_s, _numbers(plan[f"{eye}_max_cd_m2"]), ":", color=colour, lw=1, label=f"{eye}: brightest pixel"
            )
            axes.semilogy(t_s, _numbers(plan[f"{eye}_mean_cd_m2"]), "--", color=colour, lw=1, label=f"{eye}: mean")
            axes.semilogy(t_s, _numbers(plan[f"{eye}_adapted_cd_m2"]), color=colour, lw=1.6, label=f"{eye}: adapted to")
    axes.set(xlabel="recorded time / s", ylabel="luminance / cd/m²")
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def _time(states: Table, plan: Table, view: dict[str, float]) -> Figure:
    figure, (axes,) = _figure(1, 2.8)
    frames = _numbers(plan["frame"])
    base = np.zeros_like(frames)
    for part, colour in PART_COLOURS.items():
        part_ms = np.nan_to_num(_numbers(plan[f"{part}_ms"]))
        axes.fill_between(frames, base, base + part_ms, color=colour, lw=0, step="mid", label=part.replace("_", " "))
        base = base + part_ms
    axes.set(xlabel="frame", ylabel="time of a frame / ms", ylim=(0, float(np.percentile(base, 99)) * 1.15 + 1e-3))
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def _where(states: Table, plan: Table, view: dict[str, float]) -> Figure:
    figure = Figure(figsize=(4.2, 4.2 * view["height_px"] / view["width_px"]), layout="constrained")
    axes = figure.add_subplot()
    for eye, colour in COLOURS.items():
        if f"{eye}_gaze_x_px" in plan:
            x_px, y_px = _numbers(plan[f"{eye}_gaze_x_px"]), _numbers(plan[f"{eye}_gaze_y_px"])
            axes.plot(x_px, y_px, "-", lw=0.4, color=colour, alpha=0.5)
            axes.plot(x_px, y_px, ".", ms=4, color=colour, label=eye)
    axes.set(xlim=(0, view["width_px"]), ylim=(view["height_px"], 0), xlabel="x / px", ylabel="y / px", aspect="equal")
    axes.legend(frameon=False, fontsize=8)
    return figure


PLOTS = (
    ("Pupils", _pupils),
    ("Gaze", _gaze),
    ("Light before the eyes, and what they are adapted to", _luminance),
    ("Time of each part of a frame", _time),
    ("Where the eyes looked in the frame", _where),
)


def _figure(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(10, height), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for one in axes:
        one.spines[["top", "right"]].set_visible(False)
        one.grid(alpha=0.25)
        one.margins(x=0)
    return figure, list(axes)


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "entoptic", "font.family": "sans-serif"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]
