"""plan.csv: a row for every frame, and what all rows come to."""

from __future__ import annotations

import array
import csv
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from entoptic.pipeline import EFFECTS
from entoptic.pipeline.plan import OFF, SKIPPED
from entoptic.services.ipc.messages import LatencyMs
from entoptic.services.rendering import Rendered
from entoptic.services.results.render_log import Begun
from entoptic.tracker_bridge.wire import Eye

PLAN = "plan.csv"
LATENCIES = ("sample_to_state_ms", "state_to_frame_ms", "frame_to_sink_ms")
"""The columns of LatencyMs; empty where there is none."""
_PARTS = ("scene", "measure", "kernel", "plan", "encode")


class Reception(msgspec.Struct, frozen=True):
    """What a worker received of its bridge."""

    states_received: int
    states_skipped: int
    """Published but not read: by intent in live rendering, lost otherwise."""
    event_gaps: int
    """How often events were missing at first."""
    events_lost: int
    """Events that could not be had again."""
    messages_refused: dict[str, int]
    """By the error's name."""


class WorkerSummary(msgspec.Struct, frozen=True):
    """What a worker did."""

    frames: int
    dropped_frames: int
    """Frames that live rendering left out rather than fall behind, or while the worker was away."""
    reception: Reception | None
    """None where it was lost with the worker."""
    perceived_sha256: str
    """Of all perceived frames' code values, in order; a worker that was started again in between goes on from the
    digest so far."""
    median_ms: dict[str, float]
    """Of each part, over the frames in which it ran."""
    share_of_frames: dict[str, float]
    """In which each effect ran."""
    warm_up_s: float | None
    """Compiling, before the first frame; None where that was lost with the worker."""


def plan_columns(eyes: Sequence[Eye]) -> list[str]:
    """The header of plan.csv."""
    columns = ["frame", "t_s"]
    for eye in eyes:
        quantities = (
            "phase",
            "pupil_diameter_mm",
            "gaze_x_px",
            "gaze_y_px",
            "adapted_cd_m2",
            "mean_cd_m2",
            "max_cd_m2",
        )
        columns += [f"{eye.name.lower()}_{quantity}" for quantity in quantities]
    for effect in EFFECTS:
        columns += [f"{effect.name}_{quantity}" for quantity in ("level", "reason", "ms")]
    return [*columns, "bound_code_values", *(f"{part}_ms" for part in (*_PARTS, "total")), *LATENCIES]


def dropped_of(times_s: Sequence[float], fps: float) -> int:
    """How many frames are missing between the first and the last one."""
    due = round((times_s[-1] - times_s[0]) * fps) + 1 if len(times_s) else 0
    return max(due - len(times_s), 0)


class Tally:
    """Rows and their sums."""

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._milliseconds: dict[str, array.array[float]] = {}
        self._runs = dict.fromkeys([effect.name for effect in EFFECTS], 0)
        self._times_s = array.array("d")

    @classmethod
    def read(cls, path: Path, fps: float) -> Tally:
        """Of a file that is there; rows that are not whole do not count."""
        tally = cls(fps)
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                try:
                    t_s = float(row["t_s"])
                    times = {part: float(row[f"{part}_ms"]) for part in _PARTS}
                    effects = {effect.name: float(row[f"{effect.name}_ms"]) for effect in EFFECTS}
                    ran = {k: ms for k, ms in effects.items() if ms > 0 or row[f"{k}_level"] not in (SKIPPED, OFF)}
                except (KeyError, TypeError, ValueError):
                    continue
                tally._count_in(t_s, times | ran, list(ran))
        return tally

    def _count_in(self, t_s: float, milliseconds: dict[str, float], runs: Sequence[str]) -> None:
        self._times_s.append(t_s)
        for effect in runs:
            self._runs[effect] += 1
        for part, one in milliseconds.items():
            self._milliseconds.setdefault(part, array.array("f")).append(one)

    def add(self, rendered: Rendered, begun: Begun, t_s: float, latency: LatencyMs | None) -> list[object]:
        """One more frame, at `t_s` of the tables' time; its cells."""
        cells: list[object] = [rendered.frame_number, f"{t_s:.6f}"]
        perceived = rendered.perceived
        for k, eye in enumerate(begun.eyes):
            pose, measured = rendered.poses[k], perceived.measured[k]
            x_px, y_px = rendered.frame.view.pixel_of(pose.azimuth_deg, pose.elevation_deg)
            phase = "none" if rendered.state is None else rendered.state.of(eye).phase.value
            cells += [phase, f"{perceived.pupil_diameter_mm[k]:.3f}", f"{x_px:.1f}", f"{y_px:.1f}"]
            light = (perceived.state.adapted_cd_m2[k], measured.mean_cd_m2, measured.max_cd_m2)
            cells += [f"{cd_m2:.4g}" for cd_m2 in light]
        milliseconds = {"scene": rendered.scene_ms, **perceived.milliseconds}
        for step in perceived.plan:
            cells += [step.level, step.reason, f"{milliseconds.get(step.effect, 0.0):.2f}"]
        runs = [step.effect for step in perceived.plan if step.runs]
        others = (*(milliseconds[part] for part in _PARTS), sum(milliseconds.values()))
        cells += [f"{perceived.plan.bound_code_values:.3g}", *(f"{value:.2f}" for value in others)]
        stages = () if latency is None else (latency.sample_to_state, latency.state_to_frame, latency.frame_to_sink)
        cells += [f"{stage:.2f}" for stage in stages] or [""] * len(LATENCIES)
        self._count_in(t_s, milliseconds, runs)
        return cells

    def summary(self, reception: Reception | None, perceived_sha256: str, warm_up_s: float | None) -> WorkerSummary:
        """All of it in figures."""
        return WorkerSummary(
            frames=len(self._times_s),
            dropped_frames=dropped_of(self._times_s, self._fps),
            reception=reception,
            perceived_sha256=perceived_sha256,
            median_ms={part: round(float(np.median(times)), 2) for part, times in self._milliseconds.items()},
            share_of_frames={effect: runs / max(len(self._times_s), 1) for effect, runs in self._runs.items()},
            warm_up_s=None if warm_up_s is None else round(warm_up_s, 2),
        )
