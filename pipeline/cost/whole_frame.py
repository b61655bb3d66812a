"""The whole frame: what each combination of levels costs, how far it is from the truth, and which to take.

Combined are the effects that are on by default and can be left out, each skipped or by one of the variants that
approximate the same truth. Measuring, adaptation, tone mapping and encoding run always. A combination's time is the sum
of its parts' medians, with what effects prepare at hand; its error is that of its own image against all oracles.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Array

from entoptic.pipeline.cost.errors import Errors, OnDisplay, errors_between
from entoptic.pipeline.cost.timing import interleaved
from entoptic.pipeline.cost.viewing import DEFAULT, AnyEffect, SceneViewing, draws
from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.adaptation import target_cd_m2
from entoptic.pipeline.effects.effect import SKIPPED, Picture
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.measure import measure

Size = tuple[int, int]
"""Width and height in pixels."""
Combination = tuple[tuple[str, str], ...]
"""A level of each effect that is combined: (effect, level)."""


def levels(effect: AnyEffect) -> Mapping[str, Any]:
    """The variants that approximate the same truth as an effect's default, by name."""
    variants = effect.variants()
    default = effect.truth_of(effect.settings_of(DEFAULT))
    return {name: settings for name, settings in variants.items() if effect.truth_of(settings) == default}


COMBINED = tuple(effect for effect in EFFECTS if effect.optional and effect.is_on(effect.settings_of(DEFAULT)))
COMBINATIONS: tuple[Combination, ...] = tuple(
    itertools.product(*([(effect.name, level) for level in (SKIPPED, *levels(effect))] for effect in COMBINED))
)

PARTS = 3 + sum(
    len(levels(effect)) if effect in COMBINED else draws(effect) and effect.is_on(effect.settings_of(DEFAULT))
    for effect in EFFECTS
)
"""How many parts of a frame are timed: measuring, adaptation and encoding, and what effects draw."""


@dataclasses.dataclass(frozen=True)
class Whole:
    """One combination on one scene."""

    combination: Combination
    scene: str
    errors: Errors
    milliseconds: Mapping[Size, float]
    """One eye's frame, at each size."""


def in_words(combination: Combination) -> str:
    """What a combination is called."""
    return ", ".join(f"{effect.replace('_', ' ')} {level}" for effect, level in combination)


def parts(viewing: SceneViewing) -> dict[str, Callable[[], Any]]:
    """All that combinations are made of, as `effect` or `effect level`, each to be called alone."""
    frame, display = viewing.scene.frame, viewing.display
    found: dict[str, Callable[[], Any]] = {
        "measure": lambda: measure(frame),
        "adaptation": lambda: target_cd_m2(viewing.scene.measured, 0.0, 0.0),
    }
    for effect in EFFECTS:
        settings = effect.settings_of(DEFAULT)
        if effect in COMBINED:
            found |= {f"{effect.name} {level}": runner(effect, of, viewing) for level, of in levels(effect).items()}
        elif draws(effect) and effect.is_on(settings):
            found[effect.name] = runner(effect, settings, viewing)
    shown = viewing.before(EFFECTS[-1]).image
    return {**found, "encode": lambda: encode(shown, display)}


def runner(effect: AnyEffect, settings: Any, viewing: SceneViewing) -> Callable[..., Array]:
    """What makes an effect's image of a picture, or of what it starts from, with all that it prepares at hand."""
    eye, own = viewing.eye(effect, settings), viewing.before(effect)

    def run(picture: Picture = own) -> Array:
        return effect.apply(picture, [eye], settings, effect.full_level(settings), None)

    return run


def parts_ms(viewing: SceneViewing, rounds: int, done: Callable[[str], None] = lambda label: None) -> dict[str, float]:
    """Median time of each part."""
    return {name: timed.times.median_ms for name, timed in interleaved(parts(viewing), rounds, done).items()}


def time_of(combination: Combination, milliseconds: Mapping[str, float]) -> float:
    """Of a frame whose parts take so long."""
    always = [part for part in milliseconds if " " not in part]
    runs = [f"{effect} {level}" for effect, level in combination if level != SKIPPED]
    return sum(milliseconds[part] for part in (*always, *runs))


def errors_of_combinations(
    viewing: SceneViewing, done: Callable[[str], None] = lambda label: None
) -> dict[Combination, Errors]:
    """Each combination's image on the display against the truth."""
    last = EFFECTS[-1]
    peak_cd_m2, display = viewing.display.peak_cd_m2, viewing.display
    truth = np.clip(np.asarray(viewing.before(last).image[0], np.float64), 0, 1)
    true = OnDisplay(truth * peak_cd_m2, display)
    runners = {
        (effect.name, level): runner(effect, of, viewing) for effect in COMBINED for level, of in levels(effect).items()
    }
    always = {
        effect.name: runner(effect, effect.settings_of(DEFAULT), viewing)
        for effect in EFFECTS
        if effect not in COMBINED and draws(effect) and effect.is_on(effect.settings_of(DEFAULT))
    }
    found = {}
    for combination in COMBINATIONS:
        chosen = dict(combination)
        picture = Picture(viewing.scene.frame.rgb_cd_m2, viewing.scene.frame.rgb_cd_m2)
        for effect in EFFECTS:
            run = runners.get((effect.name, chosen.get(effect.name, ""))) or always.get(effect.name)
            if run is not None:
                picture = picture.after(run(picture), effect.domain)
        seen = OnDisplay(np.clip(np.asarray(picture.image[0], np.float64), 0, 1) * peak_cd_m2, display)
        found[combination] = errors_between(seen.light_cd_m2, true.light_cd_m2, seen, true)
        done(in_words(combination))
    return found


@dataclasses.dataclass(frozen=True)
class Choice:
    """What to take at one rate and size."""

    fps: float
    size: Size
    combination: Combination | None
    """None where nothing fits."""
    milliseconds: float
    """Of what is taken, on the slowest scene; where nothing fits, of the cheapest."""
    delta_e_p95: float
    share_changed: float
    """Both of the worst scene."""
    worst_scene: str


def choose(wholes: Sequence[Whole], fps: float, size: Size) -> Choice:
    """The combination of least error in its worst scene that fits the time of a frame in its slowest scene."""
    by_combination: dict[Combination, list[Whole]] = {}
    for whole in wholes:
        by_combination.setdefault(whole.combination, []).append(whole)
    slowest = {combination: max(whole.milliseconds[size] for whole in of) for combination, of in by_combination.items()}
    fitting = [combination for combination, ms in slowest.items() if ms <= 1e3 / fps]
    if not fitting:
        return Choice(fps, size, None, min(slowest.values()), np.nan, np.nan, "")
    best = min(fitting, key=lambda combination: (*_worst(by_combination[combination])[:2], slowest[combination]))
    delta_e, changed, scene = _worst(by_combination[best])
    return Choice(fps, size, best, slowest[best], delta_e, changed, scene)


def _worst(of: Sequence[Whole]) -> tuple[float, float, str]:
    """Largest ΔE below which 95 % of a scene's pixels stay, to what an eye could tell; largest share changed."""
    scene = max(of, key=lambda whole: (round(whole.errors.delta_e_p95, 2), whole.errors.share_changed))
    return (
        round(scene.errors.delta_e_p95, 2),
        max(whole.errors.share_changed for whole in of),
        scene.scene,
    )


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Which points none beats in both values, less being better; in the order of the first value."""
    best, front = np.inf, []
    for k in sorted(range(len(points)), key=lambda k: points[k]):
        if points[k][1] < best:
            best = points[k][1]
            front.append(k)
    return front


def front(wholes: Sequence[Whole], size: Size) -> list[Whole]:
    """Of one scene: what none beats in time and error, cheapest first."""
    points = [(whole.milliseconds[size], whole.errors.delta_e_p95) for whole in wholes]
    return [wholes[k] for k in pareto(points)]
