"""How long it took from the sample to the light: the three stages of LatencyMs, from plan.csv."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

STAGES = {
    "sample_to_state_ms": ("sample to state", "#7fb3d5"),
    "state_to_frame_ms": ("state to frame", "#f5b041"),
    "frame_to_sink_ms": ("frame to sink", "#82b366"),
}
TOTAL = ("all of it", "#333333")
_BINS = 60


def _stages(plan: dict[str, list[str]]) -> np.ndarray | None:
    """(stage, frame) in ms, of the frames that have any; None where none has."""
    columns = [plan.get(name, []) for name in STAGES]
    rows = [row for row in zip(*columns, strict=False) if all(row)]
    return np.array(rows, float).T if rows else None


def figures(plan: dict[str, list[str]]) -> list[dict[str, Any]] | None:
    """Median and 95 % of each stage and of all together; None without a frame whose latency is known."""
    stages = _stages(plan)
    if stages is None:
        return None
    named = zip([*(name for name, _ in STAGES.values()), TOTAL[0]], [*stages, stages.sum(0)], strict=True)
    return [
        {"stage": name, "median_ms": float(np.median(times)), "most_ms": float(np.percentile(times, 95))}
        for name, times in named
    ]


def draw(axes: Axes, plan: dict[str, list[str]]) -> None:
    """A histogram of each stage and of all together, up to where 99 % lie."""
    stages = _stages(plan)
    assert stages is not None
    total = stages.sum(0)
    edges = np.linspace(0.0, float(np.percentile(total, 99)) * 1.1 + 1e-3, _BINS + 1)
    for (name, colour), times in zip([*STAGES.values(), TOTAL], [*stages, total], strict=True):
        counts, _ = np.histogram(times, edges)
        said = f"{name}: {np.median(times):.1f} ms, 95 % below {np.percentile(times, 95):.1f} ms"
        axes.stairs(counts, edges, color=colour, fill=name != TOTAL[0], alpha=0.6, lw=1.4, label=said)
    axes.set(xlabel="latency / ms", ylabel="frames")
    axes.legend(frameon=False, fontsize=8, loc="upper right")
