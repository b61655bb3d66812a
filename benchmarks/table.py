"""Interleaved timing and a table of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from entoptic.pipeline.cost.timing import interleaved as timed


def interleaved(parts: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds of each part in each round; the parts take turns, after one round that does not count."""
    return {name: part.times.steady_ms for name, part in timed(parts, rounds).items()}


def show(title: str, milliseconds: dict[str, np.ndarray], compared_to: str) -> None:
    """Prints medians, the middle half of the runs, and each part's ratio to one of them, as Markdown."""
    base = float(np.median(milliseconds[compared_to]))
    print(f"\n### {title}\n\n| | median ms | middle half | of “{compared_to}” |\n|---|---:|---:|---:|")
    for name, times in milliseconds.items():
        low, middle, high = np.percentile(times, [25, 50, 75])
        print(f"| {name} | {middle:.1f} | {low:.1f}–{high:.1f} | {middle / base:.2f} |")
