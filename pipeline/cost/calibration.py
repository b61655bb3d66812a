"""What each level of each effect takes on this machine, for the cost model that plans within a budget."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import jax

from entoptic.pipeline.budget import CostModel, Timing, calibrate
from entoptic.pipeline.cost.scenes import scene
from entoptic.pipeline.cost.viewing import SceneViewing
from entoptic.pipeline.cost.whole_frame import Size, runner
from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.adaptation import target_cd_m2
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.measure import measure

SCENE = "night street"
"""Engineering choice: lamps, darkness and colour, so that no effect has an easy time."""
SIZES: tuple[Size, ...] = ((1440, 1600), (720, 800), (360, 400))
"""A headset's display, its half and its quarter: what is fixed and what grows with the pixels then stand apart."""
ROUNDS = 7

Calls = dict[tuple[str, str], Callable[[], Any]]
"""By effect and level."""


def run(sizes: tuple[Size, ...], rounds: int, done: Callable[[], None] = lambda: None) -> CostModel:
    """The model of this machine. `done` is told of each of `steps` frames that has ended."""
    of_sizes = [(size, calls(SceneViewing(scene(SCENE, *size), exact=False))) for size in sizes]
    return calibrate([functools.partial(_timings, *of_size) for of_size in of_sizes], rounds, done)


def steps(sizes: tuple[Size, ...], rounds: int) -> int:
    """How many frames are made."""
    return len(sizes) * (rounds + 1)


def calls(viewing: SceneViewing) -> Calls:
    """What the cost model has a figure for, each to be called alone; but for levels that no variant has, and for
    planning, whose time grows with nothing."""
    shown = viewing.before(EFFECTS[-1]).image
    found: Calls = {
        ("measure", "whole"): lambda: measure(viewing.scene.frame),
        ("encode", "whole"): lambda: encode(shown, viewing.display),
    }
    for effect in EFFECTS:
        for settings in effect.variants().values():
            level = effect.full_level(settings)
            if level in effect.costs:
                found.setdefault((effect.name, level), runner(effect, settings, viewing))
    found["adaptation", next(iter(EFFECTS[0].costs))] = lambda: target_cd_m2(viewing.scene.measured, 0.0, 0.0)
    return found


def _timings(size: Size, of_size: Calls) -> list[Timing]:
    megapixels = size[0] * size[1] / 1e6
    found = []
    for (effect, level), call in of_size.items():
        begun = time.perf_counter()
        jax.block_until_ready(call())
        found.append(Timing(effect, level, megapixels, (time.perf_counter() - begun) * 1e3))
    return found
