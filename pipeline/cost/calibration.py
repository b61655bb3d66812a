"""What each level of each effect takes on this machine, for the cost model that plans within a budget."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import jax

from entoptic.pipeline.budget import SHIPPED, CostModel, Timing, calibrate
from entoptic.pipeline.cost.scenes import scene
from entoptic.pipeline.cost.ways import EFFECTS, Stage
from entoptic.pipeline.cost.ways.on_display import DEFAULT_CELLS
from entoptic.pipeline.cost.whole_frame import Size
from entoptic.pipeline.measure import measure

SCENE = "night street"
"""Engineering choice: lamps, darkness and colour, so that no effect has an easy time."""
SIZES: tuple[Size, ...] = ((1440, 1600), (720, 800), (360, 400))
"""A headset's display, its half and its quarter: what is fixed and what grows with the pixels then stand apart."""
ROUNDS = 7
LEVELS = {("encode", "srgb"): ("encode", "whole"), ("afterimage", DEFAULT_CELLS): ("afterimage", "on")}
"""What the cost model calls ways of effects that it has other names for."""

Calls = dict[tuple[str, str], Callable[[], Any]]
"""By effect and level."""


def run(sizes: tuple[Size, ...], rounds: int, done: Callable[[], None] = lambda: None) -> CostModel:
    """The model of this machine. `done` is told of each of `steps` frames that has ended."""
    of_sizes = [(size, calls(Stage(scene(SCENE, *size)))) for size in sizes]
    return calibrate([functools.partial(_timings, *of_size) for of_size in of_sizes], rounds, done)


def steps(sizes: tuple[Size, ...], rounds: int) -> int:
    """How many frames are made."""
    return len(sizes) * (rounds + 1)


def calls(stage: Stage) -> Calls:
    """What the cost model has a figure for, each to be called alone; but for the glare reference, which takes minutes,
    and for planning, whose time grows with nothing."""
    found: Calls = {("measure", "whole"): lambda: measure(stage.scene.frame)}
    for effect, ways in EFFECTS.items():
        for way in ways(stage).ways:
            level = LEVELS.get((effect, way.name), (effect, way.name))
            if way.run is not None and level[1] in SHIPPED.costs.get(level[0], {}):
                found[level] = way.run
    return found


def _timings(size: Size, of_size: Calls) -> list[Timing]:
    megapixels = size[0] * size[1] / 1e6
    found = []
    for (effect, level), call in of_size.items():
        begun = time.perf_counter()
        jax.block_until_ready(call())
        found.append(Timing(effect, level, megapixels, (time.perf_counter() - begun) * 1e3))
    return found
