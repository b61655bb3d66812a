"""From the ranges of a frame's tiles to the most that leaving something out may change of the picture.

Every effect says what leaving it out changes, and what it makes of a change that came before it. So a change is carried
from where it arises through all later effects to the display's code values.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects import EFFECTS
from entoptic.pipeline.effects.effect import SKIPPED, Domain, Effect, TileChanges, TileRanges
from entoptic.pipeline.effects.tone.code_values import code_values
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.measure import averaged
from entoptic.pipeline.ranges import Change, Range

FULL = "full"
"""An effect at the level asked for."""
Weights = Mapping[str, Mapping[str, float]]
"""Of each effect that is not in full: the weights of its levels, FULL among them."""


class Chain:
    """One eye's effects, and what may stand in each tile before each of them."""

    def __init__(self, eye: EyeContext) -> None:
        self._eye = eye
        self._stages: dict[str, tuple[Effect[Any, Any], Any, TileRanges]] = {}
        self._reduced: dict[tuple[str, str], Change] = {}
        self._last: str | None = None
        """The last stage that was worked out: they are when they are asked for."""
        self._to_come = [effect for effect in EFFECTS if effect.is_on(effect.settings_of(eye.effects))]
        self._unchanged = np.zeros_like(eye.measured.range_cd_m2.low)

    @functools.cached_property
    def typical(self) -> Chain:
        """The same of a frame whose tiles are as bright all over as these on average: no bounds, but likely errors."""
        return Chain(dataclasses.replace(self._eye, measured=averaged(self._eye.measured)))

    def affected(self, effect: Effect[Any, Any]) -> NDArray[np.bool_] | None:
        """Tiles (row, column) that an effect may change at all; None: perhaps all."""
        if type(effect).affected_tiles is Effect.affected_tiles:
            return None
        of, settings, ranges = self._stage(effect.name)
        return of.affected_tiles(ranges, self._eye, settings)

    def _stage(self, name: str) -> tuple[Effect[Any, Any], Any, TileRanges]:
        while name not in self._stages:
            self._advance()
        return self._stages[name]

    def _advance(self) -> None:
        before, effect = self._behind_last(), self._to_come.pop(0)
        self._stages[effect.name] = effect, effect.settings_of(self._eye.effects), before
        self._last = effect.name

    def _behind_last(self) -> TileRanges:
        if self._last is None:
            return TileRanges(self._eye.measured.range_cd_m2, self._eye.measured.range_cd_m2)
        effect, settings, before = self._stages[self._last]
        hidden = self.reduced(effect.name, SKIPPED) if effect.optional else self._unchanged
        after = effect.ranges_after(before, hidden, self._eye, settings)
        return TileRanges(after, after if effect.domain is Domain.SCENE else before.scene)

    @functools.cached_property
    def _shown(self) -> Range:
        """Behind all of them."""
        while self._to_come:
            self._advance()
        return self._behind_last().image

    def reduced(self, effect: str, level: str) -> Change:
        """The most by which this level of an effect differs from it in full, right behind it, all before it in full."""
        if (effect, level) not in self._reduced:
            of, settings, ranges = self._stage(effect)
            self._reduced[effect, level] = of.bound(ranges, self._eye, settings, level)
        return self._reduced[effect, level]

    def code_values(self, weights: Weights) -> NDArray[np.float64]:
        """By how many code values a pixel of each tile may differ from the full picture, if effects run so weighed."""
        shown, change, scene = self._shown, self._unchanged, self._unchanged
        for effect, settings, ranges in self._stages.values():
            before = TileChanges(change, scene)
            if effect.name not in weights:
                change = self._behind(effect, settings, FULL, before, ranges)
            else:
                change = np.sum(
                    [
                        weight * self._behind(effect, settings, level, before, ranges)
                        for level, weight in weights[effect.name].items()
                    ],
                    axis=0,
                )
                if not change.any():
                    change = self._unchanged
            if effect.domain is Domain.SCENE:
                scene = change
        return code_values(change, shown, self._eye.display)

    def _behind(
        self, effect: Effect[Any, Any], settings: Any, level: str, before: TileChanges, ranges: TileRanges
    ) -> Change:
        """The change behind an effect at a level."""
        unchanged = before.image is self._unchanged
        if level == FULL:
            return before.image if unchanged else effect.propagate(before, ranges, self._eye, settings)
        if unchanged:
            return self.reduced(effect.name, level)
        widened = dataclasses.replace(ranges, image=ranges.image.widened(before.image))
        return before.image + effect.bound(widened, self._eye, settings, level)
