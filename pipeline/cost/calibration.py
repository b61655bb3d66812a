"""What each level of each effect takes on this machine, for the cost model that plans within a budget."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable

import jax

from pipeline.budget import CostModel, Timing, calibrate
from pipeline.cost.scenes import scene
from pipeline.cost.ways import Stage
from pipeline.cost.whole_frame import Size, parts

SCENE = "night street"
"""Engineering choice: lamps, darkness and colour, so that no effect has an easy time."""
SIZES: tuple[Size, ...] = ((1440, 1600), (720, 800), (360, 400))
"""A headset's display, its half and its quarter: what is fixed and what grows with the pixels then stand apart."""
ROUNDS = 7
LEVELS = {
    "measure": ("measure", "whole"),
    "adaptation": ("adaptation", "temporal"),
    "acuity fit": ("acuity", "lightness"),
    "tone": ("tone", "aces"),
    "night_colour lui": ("night_colour", "tint"),
    "encode": ("encode", "whole"),
}
"""What the cost model calls the parts of a frame; of glare, both say the level."""


def run(sizes: tuple[Size, ...] = SIZES, rounds: int = ROUNDS, done: Callable[[], None] = lambda: None) -> CostModel:
    """The model of this machine. `done` is told of each of `steps` frames that has ended."""
    return calibrate([functools.partial(_timings, _stage(size)) for size in sizes], rounds, done)


def steps(sizes: tuple[Size, ...] = SIZES, rounds: int = ROUNDS) -> int:
    """How many frames are made."""
    return len(sizes) * (rounds + 1)


def _stage(size: Size) -> Stage:
    return Stage(scene(SCENE, *size))


def _timings(stage: Stage) -> list[Timing]:
    view = stage.scene.frame.view
    megapixels = view.width_px * view.height_px / 1e6
    timings = []
    for part, call in parts(stage).items():
        begun = time.perf_counter()
        jax.block_until_ready(call())
        milliseconds = (time.perf_counter() - begun) * 1e3
        effect, level = LEVELS[part] if part in LEVELS else tuple(part.split(" ", 1))
        timings.append(Timing(effect, level, megapixels, milliseconds))
    return timings
