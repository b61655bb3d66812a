"""The plan of a frame: a pure function of what it contains, the eyes' state, the observer, the display and a budget."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.budget import SHIPPED, Choice, CostModel, Option, settle
from entoptic.pipeline.effects.glare import GlareLevel
from entoptic.pipeline.effects.settings import Effects
from entoptic.pipeline.frame import Display
from entoptic.pipeline.plan.chain import FULL, Chain, Eye, Weights
from entoptic.pipeline.plan.reasons import Lesser, reason_of
from entoptic.pipeline.plan.settings import Planning
from entoptic.pipeline.plan.steps import OFF, SKIPPED, Effect, Plan, Step

RESERVE_SHARE = 0.13
"""Of a budget that is not planned with. Engineering choice: 95 % of frames take at most 1.15 times the median."""


@dataclasses.dataclass(frozen=True, eq=False)
class Scenery:
    """What a frame has beside its pixels."""

    megapixels: float
    """All eyes' together."""
    lights: int = 0
    """Lights of their own: they are drawn with their glare, so that is not left out."""


@dataclasses.dataclass(frozen=True, eq=False)
class Planned:
    """A plan, and what is needed to run it and to make the next one."""

    plan: Plan
    choices: dict[str, Choice]
    dark: NDArray[np.bool_] | None
    """(row, column): tiles of the ranges that may hold, in any eye, a pixel dark enough for acuity, which works on
    these alone; None if it is to work on all."""


def make_plan(
    eyes: Sequence[Eye],
    scenery: Scenery,
    effects: Effects = Effects(),
    display: Display = Display(),
    planning: Planning = Planning(),
    *,
    before: Mapping[str, Choice] | None = None,
    dt_s: float = 0.0,
    costs: CostModel = SHIPPED,
) -> Planned:
    """The plan for a frame, and what planning has to remember for the next one, `dt_s` after the one before.

    An effect runs on all eyes' images if any eye calls for it. Each is left out, or done at its cheapest level, whose
    bound is within the tolerance; glare also where it stays below the threshold of an eye so adapted. Under a budget,
    the plan of least predicted error that fits: up to the tolerance errors count nothing, beyond it what they would be
    on average if every tile were as bright all over as it is on average.
    """
    plain = planning.everything and not planning.leave_out
    chains = [] if plain else [Chain(eye, effects, display) for eye in eyes]
    choosable = _choosable(effects)
    budget_ms = math.inf
    if planning.budget_ms is not None:
        budget_ms = planning.budget_ms * (1 - RESERVE_SHARE) - fixed_ms(costs, effects, scenery.megapixels)
    held = {level for choice in (before or {}).values() for level in choice.weights}
    if not plain and not held - {SKIPPED} and budget_ms < _least_ms(choosable, scenery, effects, costs):
        # Nothing fits and nothing is left to fade out: no need to weigh what is best.
        planning = msgspec.structs.replace(planning, leave_out=frozenset(choosable))
    found = {} if plain else _lesser(eyes, chains, scenery, effects, planning, choosable, before or {})
    options = {effect.value: _options(effect, effects, found, scenery, planning, costs) for effect in choosable}
    choices = settle(
        before or {}, options, dt_s, budget_ms=budget_ms, tolerance_code_values=planning.tolerance_code_values
    )
    weights: Weights = {
        effect: {
            FULL if level == _full_level(effect, effects) else level: weight
            for level, weight in choices[effect.value].weights.items()
        }
        for effect in choosable
        if set(choices[effect.value].weights) != {_full_level(effect, effects)}
    }
    steps = [_step(effect, choices.get(effect.value), eyes, scenery, effects, planning, found) for effect in Effect]
    bound = 0.0
    if weights and scenery.lights:
        bound = math.inf
    elif weights:
        bound = max(float(chain.code_values(weights).max()) for chain in chains)
    dark = None if planning.everything else np.any([chain.dark for chain in chains], axis=0)
    return Planned(Plan(tuple(steps), bound), choices, dark)


def fixed_ms(costs: CostModel, effects: Effects, megapixels: float) -> float:
    """What every frame takes, whatever is planned."""
    parts = [(part, "whole") for part in ("measure", "plan", "encode")]
    parts += [(effect.value, _full_level(effect, effects)) for effect in (Effect.ADAPTATION, Effect.TONE)]
    return sum(costs.ms(part, level, megapixels) for part, level in parts)


def _least_ms(choosable: Sequence[Effect], scenery: Scenery, effects: Effects, costs: CostModel) -> float:
    """What the cheapest of all levels that run takes."""
    levels = [(effect, _full_level(effect, effects)) for effect in choosable]
    levels += [(Effect.GLARE, GlareLevel.VEIL.value)]
    return min(costs.ms(effect, level, scenery.megapixels) for effect, level in levels)


def _choosable(effects: Effects) -> tuple[Effect, ...]:
    """The effects that may be left out, as far as they are switched on."""
    further = ((Effect.ROD_NOISE, effects.rod_noise.on), (Effect.AFTERIMAGE, effects.afterimage.on))
    return (
        Effect.GLARE,
        Effect.ACUITY,
        *(effect for effect, on in further[:1] if on),
        Effect.NIGHT_COLOUR,
        *(effect for effect, on in further[1:] if on),
    )


def _full_level(effect: Effect, effects: Effects) -> str:
    """What an effect's level is called when nothing of it is left out."""
    match effect:
        case Effect.ADAPTATION:
            return effects.adaptation.target.value
        case Effect.GLARE:
            return effects.glare.level.value
        case Effect.ACUITY:
            return effects.acuity.method.value
        case Effect.TONE:
            return effects.tone.operator.value
        case Effect.NIGHT_COLOUR:
            return effects.night_colour.method.value
        case _:
            return "on"


def _lesser(
    eyes: Sequence[Eye],
    chains: Sequence[Chain],
    scenery: Scenery,
    effects: Effects,
    planning: Planning,
    choosable: Sequence[Effect],
    before: Mapping[str, Choice],
) -> dict[tuple[Effect, str], Lesser]:
    """Of each level short of full that is open to an effect: what it may change, in the eye that it changes most."""
    found: dict[tuple[Effect, str], Lesser] = {}
    for effect in choosable:
        held = before[effect].weights if effect in before else {}
        levels = [SKIPPED] if effect in planning.leave_out else _open(effect, scenery, effects)
        for level in levels:
            of_eyes = [
                _lesser_of(eye, chain, effect, level, effects, planning)
                for eye, chain in zip(eyes, chains, strict=True)
            ]
            worst = max(of_eyes, key=lambda lesser: lesser.error_code_values)
            most = max(lesser.bound_code_values for lesser in of_eyes)
            found[effect, level] = dataclasses.replace(worst, bound_code_values=most)
            if found[effect, level].error_code_values <= planning.tolerance_code_values and not held.keys() - {
                SKIPPED,
                _full_level(effect, effects),
            }:
                break  # nothing dearer can be called for
    return found


def _open(effect: Effect, scenery: Scenery, effects: Effects) -> list[str]:
    """The levels that may stand in for the one asked for, cheapest first.

    Lights of their own are in no range: beside them nothing can be proven, and nothing is left out.
    """
    if scenery.lights:
        return []
    if effect is not Effect.GLARE:
        return [SKIPPED]
    asked = effects.glare.level
    if asked is GlareLevel.REFERENCE:
        return []
    levels = [SKIPPED]
    if asked is not GlareLevel.VEIL:
        levels.append(GlareLevel.VEIL.value)
    return levels


def _lesser_of(eye: Eye, chain: Chain, effect: Effect, level: str, effects: Effects, planning: Planning) -> Lesser:
    tolerance = planning.tolerance_code_values
    change = chain.lesser(effect, level)
    of_tiles = chain.code_values({effect: {level: 1.0}}) if change.any() else np.zeros(1)
    worst = float(of_tiles.max())
    threshold_cd_m2 = eye.adapted.threshold_cd_m2(effects.adaptation)
    change_cd_m2 = float(change[3].max()) if effect is Effect.GLARE else math.inf
    if worst <= tolerance:
        error = worst
    elif change_cd_m2 <= threshold_cd_m2:
        # As much within the tolerance as it is below the threshold.
        error = tolerance * change_cd_m2 / threshold_cd_m2
    else:
        if planning.budget_ms is not None and effect not in planning.leave_out:
            # A bound is the same for all of a lamp's tile: effects are weighed by what tiles hold on average.
            of_tiles = chain.typical.code_values({effect: {level: 1.0}})
        error = max(float(of_tiles.mean()), math.nextafter(tolerance, math.inf))
    return Lesser(eye, chain, error, worst, change_cd_m2, threshold_cd_m2)


def _options(
    effect: Effect,
    effects: Effects,
    found: Mapping[tuple[Effect, str], Lesser],
    scenery: Scenery,
    planning: Planning,
    costs: CostModel,
) -> list[Option]:
    if effect in planning.leave_out:
        return [Option(SKIPPED, 0.0, 0.0)]
    full = _full_level(effect, effects)
    in_full = Option(full, 0.0, costs.ms(effect, full, scenery.megapixels))
    if planning.everything:
        return [in_full]
    lesser = [
        Option(level, error.error_code_values, 0.0 if level == SKIPPED else costs.ms(effect, level, scenery.megapixels))
        for (of_effect, level), error in found.items()
        if of_effect is effect
    ]
    return [*lesser, in_full]


def _step(
    effect: Effect,
    choice: Choice | None,
    eyes: Sequence[Eye],
    scenery: Scenery,
    effects: Effects,
    planning: Planning,
    found: Mapping[tuple[Effect, str], Lesser],
) -> Step:
    if choice is None and effect not in (Effect.ADAPTATION, Effect.TONE):
        return Step(effect, OFF, "switched off in the settings")
    full = _full_level(effect, effects)
    if choice is None:
        return Step(effect, full, reason_of(effect, full, eyes, scenery.lights, effects, planning, found))
    lesser = [found.get((effect, level)) for level in choice.weights if level != full]
    bound = max((one.bound_code_values for one in lesser if one is not None), default=0.0)
    if lesser and scenery.lights:
        bound = math.inf
    reason = reason_of(effect, choice.level, eyes, scenery.lights, effects, planning, found)
    if choice.fade_from is not None:
        reason += f"; {choice.fade:.0%} of the way from {choice.fade_from}"
    return Step(effect, choice.level, reason, bound, choice.fade_from, choice.fade)
