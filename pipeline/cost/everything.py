"""What accuracy costs in every effect and in the whole frame, over all scenes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from entoptic.pipeline.cost import scenes
from entoptic.pipeline.cost.ways import EFFECTS, Row, Stage, measure_ways
from entoptic.pipeline.cost.whole_frame import (
    COMBINATIONS,
    GLARES,
    Size,
    Whole,
    errors_of_combinations,
    parts_ms,
    time_of,
)

PARTS = 6 + len(GLARES) - 1
"""How many parts of a frame are timed."""
RATES_FPS = (90.0, 60.0, 30.0, 5.0)
"""A fast headset, a screen, a film in real time, a preview."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured."""

    scenes: tuple[str, ...]
    size: Size
    """Of the frames whose errors are taken, over 104°."""
    sizes: tuple[Size, ...]
    """Of those whose times are taken, largest first."""
    rounds: int
    """Unless others are asked for."""


FULL = Effort(tuple(scenes.SCENES), (480, 534), ((1440, 1600), (720, 800), (360, 400)), 5)
"""A third of a headset's display (LUI 5.3.2) for errors, as their truth takes a minute a scene there; times at the
display's own size, its half and its quarter."""
QUICK = Effort(("moonlight", "night street"), (72, 80), ((72, 80),), 1)


@dataclasses.dataclass(frozen=True)
class Cost:
    """All that was measured."""

    rows: list[Row]
    """Effect by effect, then scene by scene."""
    wholes: list[Whole]


def steps(effort: Effort, rounds: int) -> int:
    """About how many calls `run` tells of: each effect's ways are known only on a stage."""
    ways = 45 * (rounds + 1) + 30
    return len(effort.scenes) * (ways + 1 + len(COMBINATIONS) + len(effort.sizes) * PARTS * (rounds + 1))


def run(effort: Effort, rounds: int, done: Callable[[str], None] = lambda label: None) -> Cost:
    """Measures every way of every effect, and the whole frame; `done` is told of each call that has ended."""
    rows: list[Row] = []
    wholes: list[Whole] = []
    for name in effort.scenes:
        stage = Stage(scenes.scene(name, *effort.size))
        for effect, make in EFFECTS.items():
            rows += measure_ways(effect, make(stage), stage, rounds, done)
        errors = errors_of_combinations(stage, done)
        parts = {size: parts_ms(Stage(scenes.scene(name, *size)), rounds, done) for size in effort.sizes}
        wholes += [
            Whole(
                combination,
                name,
                of_combination,
                {size: time_of(combination, of_size) for size, of_size in parts.items()},
            )
            for combination, of_combination in errors.items()
        ]
    order = list(EFFECTS)
    rows.sort(key=lambda row: order.index(row.effect))
    return Cost(rows, wholes)
