"""From the ranges of a frame's tiles to the most that leaving something out may change of the picture.

Every effect says what leaving it out changes, and what it makes of a change that came before it. So a change is carried
from where it arises through all later effects to the display's code values.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from pipeline.effects import acuity, afterimage, night_colour, rod_noise, tone
from pipeline.effects.adaptation import Adapted
from pipeline.effects.afterimage import Retina
from pipeline.effects.glare import GlareLevel, Mixture, bounds, changes
from pipeline.effects.settings import Effects
from pipeline.frame import Display, Light
from pipeline.measure import Measurement
from pipeline.plan.steps import SKIPPED, Effect
from pipeline.ranges import Change, Range

FULL = "full"
"""An effect at the level asked for."""
Weights = Mapping[Effect, Mapping[str, float]]
"""Of each effect that is not in full: its levels' weights, FULL among them."""


@dataclasses.dataclass(frozen=True, eq=False)
class Eye:
    """One eye before one image: all that planning needs to know of it."""

    measured: Measurement
    adapted: Adapted
    threshold_cd_m2: float
    """The smallest difference in luminance that it sees."""
    kernel: Mixture
    gaze_px: tuple[float, float]
    ceiling_cd_m2: float | None
    retina: Retina | None
    lights: tuple[Light, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Stage:
    """One effect on the way from the frame to the display."""

    effect: Effect
    lesser: Mapping[str, Callable[[Range], Change]]
    """Of each level short of full: the most by which it differs from full. `skipped` always is one."""
    passed_on: Callable[[Change, Range], Change]
    """What becomes of a change that came before it."""
    after: Callable[[Range], Range]
    """What may stand in a tile once it has run, or has not."""


class Chain:
    """What one eye's effects make of changes. Ranges are those of a frame with every effect in full, or without."""

    def __init__(self, eye: Eye, effects: Effects, display: Display) -> None:
        self.eye, self._display = eye, display
        self._scene, self._displayed = _stages(eye, effects, display)
        self._tone = _tone(eye, effects, display)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Those that may be left out."""
        return tuple(stage.effect for stage in (*self._scene, *self._displayed))

    def lesser(self, effect: Effect, level: str) -> Change:
        """The most by which a level differs from the full effect, where the effect ends: cd/m², or of the peak."""
        stage, range_ = next(pair for pair in self._ranges if pair[0].effect is effect)
        return stage.lesser[level](range_)

    def code_values(self, weights: Weights) -> NDArray[np.float64]:
        """By how many code values a pixel of each tile differs at most from that of the full picture."""
        change = np.zeros_like(self.eye.measured.range_cd_m2.low)
        range_ = self.eye.measured.range_cd_m2
        shown = False
        for stage, range_ in self._ranges:
            if stage in self._displayed and not shown:
                change, shown = self._to_display(change), True
            change = _mixed(stage, weights.get(stage.effect, {FULL: 1.0}), change, range_)
        if not shown:
            change = self._to_display(change)
        return tone.code_values(change, self._last, self._display)
