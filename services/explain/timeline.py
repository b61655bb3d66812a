"""A session's plan over its time: which level each effect had when, why it changed, and what it took."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline import FrameError
from entoptic.services.results.appended import columns
from entoptic.services.results.tally import LATENCIES

LEVEL, REASON, MS = "_level", "_reason", "_ms"
"""Ends of plan.csv's columns."""
NOT_A_FRAMES_WORK = {"total_ms", "scene_ms", *LATENCIES}
"""Columns that are no part of perceiving: their sum, making the scene, and the latencies of a live frame."""


@dataclasses.dataclass(frozen=True)
class Span:
    """An effect's level, from one frame to another."""

    effect: str
    level: str
    begin_s: float
    end_s: float
    reason: str
    """Of its first frame."""


@dataclasses.dataclass(frozen=True, eq=False)
class Timeline:
    """All frames of a session."""

    t_s: NDArray[np.float64]
    spans: tuple[Span, ...]
    """By effect in the order in which they run, then by time."""
    ms: dict[str, NDArray[np.float64]]
    """Time of each part in each frame."""

    @property
    def effects(self) -> tuple[str, ...]:
        """In the order in which they run."""
        return tuple(dict.fromkeys(span.effect for span in self.spans))

    @property
    def changes(self) -> tuple[Span, ...]:
        """The levels that followed on another, by time."""
        later = [span for before, span in itertools.pairwise(self.spans) if before.effect == span.effect]
        return tuple(sorted(later, key=lambda span: span.begin_s))


def read(path: Path) -> Timeline:
    """From a session's plan.csv. Raises FrameError if it holds no frame."""
    table = columns(path)
    if not table.get("t_s"):
        raise FrameError(f"{path} holds no frame; render the session again: entoptic session")
    t_s = np.array(table["t_s"], float)
    step_s = float(np.median(np.diff(t_s))) if t_s.size > 1 else 1.0
    ends_s = np.append(t_s[1:], t_s[-1] + step_s)
    spans = []
    for effect in (name.removesuffix(LEVEL) for name in table if name.endswith(LEVEL)):
        levels = table[effect + LEVEL]
        begins = [k for k in range(len(levels)) if k == 0 or levels[k] != levels[k - 1]]
        for k, end in zip(begins, [*begins[1:], len(levels)], strict=True):
            reason = table[effect + REASON][k]
            spans.append(Span(effect, levels[k], float(t_s[k]), float(ends_s[end - 1]), reason))
    parts = [name for name in table if name.endswith(MS) and name not in NOT_A_FRAMES_WORK]
    return Timeline(t_s, tuple(spans), {name.removesuffix(MS): np.array(table[name], float) for name in parts})
