"""The plan of a frame: a pure function of what it contains, the eyes' state, the observer, the display and a budget."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.budget import SHIPPED, Choice, CostModel, Option, settle
from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.effect import SKIPPED, Effect
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.plan.chain import FULL, Chain, Weights
from entoptic.pipeline.plan.reasons import Reduced, reason_of
from entoptic.pipeline.plan.settings import Planning
from entoptic.pipeline.plan.steps import OFF, Plan, Step

RESERVE_SHARE = 0.13
"""Of a budget that is not planned with. Engineering choice: 95 % of frames take at most 1.15 times the median."""
REVIEW_S = 0.1
"""An effect in full is looked at again so often, to see whether it is still called for. Engineering choice: it costs
more than some effects, and to keep one for a tenth of a second longer changes nothing of the picture for the worse."""
PARTS = ("measure", "plan", "encode")
"""What every frame takes beside its effects."""

AnyEffect = Effect[Any, Any]
Found = Mapping[str, Mapping[str, Reduced]]
"""By effect and reduced level: what it may change, in the eye that it changes most."""


@dataclasses.dataclass(frozen=True, eq=False)
class Planned:
    """A plan, and what is needed to run it and to make the next one."""

    plan: Plan
    choices: dict[str, Choice]
    tiles: dict[str, NDArray[np.bool_] | None]
    """By effect: tiles (row, column) of the ranges that it may change in any eye; None: perhaps all."""
    found: Found
    """What was found of levels short of full, in this frame or lately (REVIEW_S)."""


def make_plan(
    eyes: Sequence[EyeContext],
    planning: Planning = Planning(),
    *,
    before: Mapping[str, Choice] | None = None,
    found: Found | None = None,
    dt_s: float = 0.0,
    costs: CostModel = SHIPPED,
) -> Planned:
    """The plan for a frame, and what planning has to remember for the next one, `dt_s` after the one before.

    An effect runs on all eyes' images if any eye calls for it. Each is left out, or done at its cheapest level, whose
    bound is within the tolerance; one that is seen by threshold also where it stays below that of an eye so adapted.
    Under a budget, the plan of least predicted error that fits: up to the tolerance errors count nothing, beyond it
    what they would be on average if every tile were as bright all over as it is on average. Lights of their own are in
    no range: beside them nothing can be proven, and nothing is left out.

    What is left out is proven for each frame. What runs in full needs no proof: what was `found` of it before serves
    for REVIEW_S, in which only the figures of its reason are so old.
    """
    return _Planner(eyes, planning, before or {}, found or {}, dt_s, costs).planned()


class _Planner:
    """One frame's planning."""

    def __init__(
        self,
        eyes: Sequence[EyeContext],
        planning: Planning,
        before: Mapping[str, Choice],
        found: Found,
        dt_s: float,
        costs: CostModel,
    ) -> None:
        self._eyes, self._planning, self._before, self._dt_s, self._costs = eyes, planning, before, dt_s, costs
        self._settings = {effect.name: effect.settings_of(eyes[0].effects) for effect in EFFECTS}
        self._full = {effect.name: effect.full_level(self._settings[effect.name]) for effect in EFFECTS}
        on = [effect for effect in EFFECTS if effect.is_on(self._settings[effect.name])]
        self._optional = [effect for effect in on if effect.optional]
        self._fixed = [effect for effect in on if not effect.optional]
        self._megapixels = eyes[0].frame.rgb_cd_m2.size / 3e6
        self._lights = len(eyes[0].lights)
        self._found = found if dt_s > 0 and not _is_review(eyes[0].time_s, dt_s) else {}

    def planned(self) -> Planned:
        planning, in_full = self._planning, self._planning.everything and not self._planning.leave_out
        chains = [] if in_full else [Chain(eye) for eye in self._eyes]
        budget_ms = math.inf
        if planning.budget_ms is not None:
            budget_ms = planning.budget_ms * (1 - RESERVE_SHARE) - self._fixed_ms()
        held = {level for choice in self._before.values() for level in choice.weights}
        if not in_full and not held - {SKIPPED} and budget_ms < self._least_ms():
            # Nothing fits and nothing is left to fade out: no need to weigh what is best.
            names = frozenset(effect.name for effect in self._optional)
            self._planning = msgspec.structs.replace(planning, leave_out=names)
        found: Found = {effect.name: {} if in_full else self._reduced(effect, chains) for effect in self._optional}
        choices = settle(
            self._before,
            {effect.name: self._options(effect.name, found[effect.name]) for effect in self._optional},
            self._dt_s,
            budget_ms=budget_ms,
            tolerance_code_values=planning.tolerance_code_values,
        )
        weights: Weights = {
            name: {FULL if level == self._full[name] else level: weight for level, weight in choice.weights.items()}
            for name, choice in choices.items()
            if set(choice.weights) != {self._full[name]}
        }
        steps = tuple(self._step(effect, choices.get(effect.name), found.get(effect.name, {})) for effect in EFFECTS)
        bound = 0.0
        if weights:
            bound = math.inf if self._lights else max(float(chain.code_values(weights).max()) for chain in chains)
        running = [effect for effect, step in zip(EFFECTS, steps, strict=True) if chains and step.runs]
        tiles = {} if planning.everything else {effect.name: _affected(effect, chains) for effect in running}
        return Planned(Plan(steps, bound), choices, tiles, found)

    def _fixed_ms(self) -> float:
        """What every frame takes, its making included, whatever is planned."""
        parts = [(part, "whole") for part in PARTS]
        parts += [(effect.name, self._full[effect.name]) for effect in self._fixed]
        here_ms = sum(self._costs.ms(part, level, self._megapixels) for part, level in parts)
        return here_ms + self._costs.scene_ms(self._megapixels)

    def _least_ms(self) -> float:
        """What the cheapest of all levels that run takes."""
        levels = [
            (effect.name, level) for effect in self._optional for level in self._levels(effect) if level != SKIPPED
        ]
        levels += [(effect.name, self._full[effect.name]) for effect in self._optional]
        return min(self._costs.ms(name, level, self._megapixels) for name, level in levels)

    def _levels(self, effect: AnyEffect) -> Sequence[str]:
        return effect.reduced_levels(self._settings[effect.name])

    def _kept(self, name: str) -> Mapping[str, Reduced] | None:
        """What was found lately of an effect that is in full and called for: it needs no proof."""
        found, choice = self._found.get(name), self._before.get(name)
        if not found or choice is None or name in self._planning.leave_out:
            return None
        called_for = all(one.error_code_values > self._planning.tolerance_code_values for one in found.values())
        return found if called_for and choice.weights == {self._full[name]: 1.0} else None

    def _reduced(self, effect: AnyEffect, chains: Sequence[Chain]) -> Mapping[str, Reduced]:
        """What each level short of full that is open to an effect may change."""
        name, planning = effect.name, self._planning
        if (kept := self._kept(name)) is not None:
            return kept
        if name in planning.leave_out:
            levels: Sequence[str] = [SKIPPED]
        else:
            levels = [] if self._lights else self._levels(effect)
        held = self._before[name].weights.keys() if name in self._before else set()
        found: dict[str, Reduced] = {}
        for level in levels:
            of_eyes = [self._reduced_of(effect, level, which, chain) for which, chain in enumerate(chains)]
            worst = max(of_eyes, key=lambda reduced: reduced.error_code_values)
            most = max(reduced.bound_code_values for reduced in of_eyes)
            found[level] = dataclasses.replace(worst, bound_code_values=most)
            if worst.error_code_values <= planning.tolerance_code_values and not held - {SKIPPED, self._full[name]}:
                break  # nothing dearer can be called for
        return found

    def _reduced_of(self, effect: AnyEffect, level: str, which: int, chain: Chain) -> Reduced:
        planning, name, eye = self._planning, effect.name, self._eyes[which]
        tolerance = planning.tolerance_code_values
        change = chain.reduced(name, level)
        of_tiles = chain.code_values({name: {level: 1.0}}) if change.any() else np.zeros(1)
        worst = float(of_tiles.max())
        threshold_cd_m2 = eye.adapted.threshold_cd_m2(eye.effects.adaptation)
        change_cd_m2 = float(change[3].max()) if effect.seen_by_threshold else math.inf
        if worst <= tolerance:
            error = worst
        elif change_cd_m2 <= threshold_cd_m2:
            # As much within the tolerance as it is below the threshold.
            error = tolerance * change_cd_m2 / threshold_cd_m2
        else:
            if planning.budget_ms is not None and name not in planning.leave_out:
                # A bound is the same for all of a lamp's tile: effects are weighed by what tiles hold on average.
                of_tiles = chain.typical.code_values({name: {level: 1.0}})
            error = max(float(of_tiles.mean()), math.nextafter(tolerance, math.inf))
        return Reduced(which, error, worst, change_cd_m2, threshold_cd_m2)

    def _options(self, name: str, found: Mapping[str, Reduced]) -> list[Option]:
        if name in self._planning.leave_out:
            return [Option(SKIPPED, 0.0, 0.0)]
        full = Option(self._full[name], 0.0, self._costs.ms(name, self._full[name], self._megapixels))
        if self._planning.everything:
            return [full]
        return [
            *(Option(level, of.error_code_values, self._level_ms(name, level)) for level, of in found.items()),
            full,
        ]

    def _level_ms(self, name: str, level: str) -> float:
        return 0.0 if level == SKIPPED else self._costs.ms(name, level, self._megapixels)

    def _step(self, effect: AnyEffect, choice: Choice | None, found: Mapping[str, Reduced]) -> Step:
        name, full = effect.name, self._full[effect.name]
        if choice is None and effect.optional:
            return Step(name, OFF, "switched off in the settings")
        level = full if choice is None else choice.level
        reason = reason_of(
            effect,
            level,
            self._eyes,
            self._settings[name],
            self._planning,
            found,
            self._costs.scene_ms(self._megapixels),
        )
        if choice is None:
            return Step(name, full, reason)
        reduced = [found.get(each) for each in choice.weights if each != full]
        bound = max((one.bound_code_values for one in reduced if one is not None), default=0.0)
        if reduced and self._lights:
            bound = math.inf
        if choice.fade_from is not None:
            reason += f"; {choice.fade:.0%} of the way from {choice.fade_from}"
        return Step(name, choice.level, reason, bound, choice.fade_from, choice.fade)


def _is_review(time_s: float, dt_s: float) -> bool:
    """Whether REVIEW_S passed since the frame before: by the clock of all frames, so a session that goes on from a
    checkpoint looks again when it would have.
    """
    if math.isinf(dt_s) or math.isinf(time_s):
        return True
    return math.floor(time_s / REVIEW_S) != math.floor((time_s - dt_s) / REVIEW_S)


def _affected(effect: AnyEffect, chains: Sequence[Chain]) -> NDArray[np.bool_] | None:
    """Tiles that an effect may change in any eye."""
    of_eyes = [chain.affected(effect) for chain in chains]
    known = [tiles for tiles in of_eyes if tiles is not None]
    return np.any(known, axis=0) if len(known) == len(of_eyes) else None
