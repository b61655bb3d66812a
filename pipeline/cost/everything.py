"""What accuracy costs in every variant of every effect, over all scenes: errors beside oracles, times in turns."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Array

from entoptic.pipeline.cost import scenes
from entoptic.pipeline.cost.errors import Errors, OnDisplay, errors_between
from entoptic.pipeline.cost.timing import Times, interleaved
from entoptic.pipeline.cost.viewing import AnyEffect, Reals, SceneViewing
from entoptic.pipeline.cost.whole_frame import (
    COMBINATIONS,
    PARTS,
    Size,
    Whole,
    errors_of_combinations,
    parts_ms,
    time_of,
)
from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.effect import SKIPPED, Domain

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
class Row:
    """One setting on one scene."""

    effect: str
    """Or, where one effect is measured in depth, what is varied."""
    setting: str
    of: str
    """Its truth, by the first variant that has the same: these are rivals, others are other pictures."""
    scene: str
    errors: Errors
    times: Times | None
    """None where nothing ran."""

    @property
    def median_ms(self) -> float:
        """0 where nothing ran."""
        return 0.0 if self.times is None else self.times.median_ms


@dataclasses.dataclass(frozen=True)
class Cost:
    """All that was measured."""

    rows: list[Row]
    """Effect by effect, then scene by scene."""
    wholes: list[Whole]


def steps(effort: Effort, rounds: int) -> int:
    """How many calls `run` tells of."""
    variants = sum(len(effect.variants()) * (rounds + 1) for effect in EFFECTS) + len(EFFECTS)
    parts = len(effort.sizes) * (rounds + 1) * PARTS
    return len(effort.scenes) * (variants + len(COMBINATIONS) + parts)


def run(effort: Effort, rounds: int, done: Callable[[str], None] = lambda label: None) -> Cost:
    """Measures every variant of every effect, and the whole frame; `done` is told of each call that has ended."""
    rows: list[Row] = []
    wholes: list[Whole] = []
    for name in effort.scenes:
        viewing = SceneViewing(scenes.scene(name, *effort.size))
        for effect in EFFECTS:
            rows += measure_effect(effect, viewing, rounds, done)
        errors = errors_of_combinations(viewing, done)
        parts = {
            size: parts_ms(SceneViewing(scenes.scene(name, *size), exact=False), rounds, done) for size in effort.sizes
        }
        wholes += [
            Whole(combination, name, of, {size: time_of(combination, of_size) for size, of_size in parts.items()})
            for combination, of in errors.items()
        ]
    order = [effect.name for effect in EFFECTS]
    rows.sort(key=lambda row: order.index(row.effect))
    return Cost(rows, wholes)


def measure_effect(
    effect: AnyEffect, viewing: SceneViewing, rounds: int, done: Callable[[str], None] = lambda label: None
) -> list[Row]:
    """A row for each variant, and one for leaving the effect out."""
    picture, variants = viewing.before(effect), effect.variants()
    eyes = {name: viewing.eye(effect, settings) for name, settings in variants.items()}

    def call(name: str, settings: Any) -> Callable[[], Array]:
        return lambda: effect.apply(picture, [eyes[name]], settings, effect.full_level(settings), None)

    timed = interleaved({name: call(name, settings) for name, settings in variants.items()}, rounds, done)
    rivals: dict[object, str] = {}
    truths: dict[str, tuple[Reals, OnDisplay]] = {}
    rows: list[Row] = []
    unit_cd_m2 = 1.0 if effect.domain is Domain.SCENE else viewing.display.peak_cd_m2

    def row(name: str, of: str, image: Reals, times: Times | None) -> Row:
        seen = OnDisplay(viewing.on_display(effect, image), viewing.display)
        truth, shown = truths[of]
        errors = errors_between(image * unit_cd_m2, truth * unit_cd_m2, seen, shown)
        return Row(effect.name, name, of, viewing.scene.name, errors, times)

    for name, settings in variants.items():
        of = rivals.setdefault(effect.truth_of(settings), name)
        if of not in truths:
            truth = effect.oracle(picture, eyes[name], settings)
            truths[of] = truth, OnDisplay(viewing.on_display(effect, truth), viewing.display)
        if not rows and effect.optional:
            rows.append(row(SKIPPED, of, np.asarray(picture.image[0], np.float64), None))
        rows.append(row(name, of, np.asarray(timed[name].result[0], np.float64), timed[name].times))
    done(f"{effect.name} truth")
    return rows
