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

from entoptic.pipeline.effects import acuity, afterimage, rod_noise, tone
from entoptic.pipeline.effects.adaptation import Adapted
from entoptic.pipeline.effects.afterimage import Retina
from entoptic.pipeline.effects.glare import GlareLevel, Mixture, changes
from entoptic.pipeline.effects.glare.kernel import least_stays
from entoptic.pipeline.effects.night_colour import bounds as night_colour
from entoptic.pipeline.effects.settings import Effects
from entoptic.pipeline.frame import Display
from entoptic.pipeline.measure import Measurement, averaged
from entoptic.pipeline.plan.steps import SKIPPED, Effect
from entoptic.pipeline.ranges import Change, Range

FULL = "full"
"""An effect at the level asked for."""
Weights = Mapping[Effect, Mapping[str, float]]
"""Of each effect that is not in full: the weights of its levels, FULL among them."""


@dataclasses.dataclass(frozen=True, eq=False)
class Eye:
    """One eye before one image: all that planning needs to know of it."""

    measured: Measurement
    adapted: Adapted
    kernel: Mixture
    gaze_px: tuple[float, float]
    pupil_mm: float
    ceiling_cd_m2: float | None = None
    """Where given, only the light above it scatters."""
    retina: Retina | None = None
    """None where no afterimages are asked for."""


@dataclasses.dataclass(frozen=True, eq=False)
class Stage:
    """One effect on the way from the frame to the display. Ranges and changes are in cd/m², after tone of the peak."""

    effect: Effect
    lesser: Mapping[str, Callable[[Range], Change]]
    """Of each level short of full: the most by which it differs from the full effect."""
    passed_on: Callable[[Change, Range, Change], Change]
    """What becomes of a change that came before it; the third is the change before tone mapping."""
    after: Callable[[Range, Change], Range]
    """What may stand in a tile after it, whether it ran or not; the change is what skipping it hides."""


class Chain:
    """One eye's effects, and what may stand in each tile before each of them."""

    def __init__(self, eye: Eye, effects: Effects, display: Display) -> None:
        self._asked = eye, effects, display
        self._display = display
        self._before: dict[Effect, tuple[Stage, Range]] = {}
        self._alone: dict[tuple[Effect, str], Change] = {}
        range_ = eye.measured.range_cd_m2
        self._unchanged = np.zeros_like(range_.low)
        for stage in _scene_stages(eye, effects):
            range_ = self._add(stage, range_)
        for stage in _displayed_stages(eye, effects, display, range_):
            range_ = self._add(stage, range_)
        self._shown = range_
        self.dark = acuity.dark_tiles(self._before[Effect.ACUITY][1], eye.measured.view.ppd_centre, effects.acuity)
        """Tiles (row, column) that may hold a pixel dark enough for acuity."""

    @functools.cached_property
    def typical(self) -> Chain:
        """The same of a frame whose tiles are as bright all over as these on average: no bounds, but likely errors."""
        eye, effects, display = self._asked
        return Chain(dataclasses.replace(eye, measured=averaged(eye.measured)), effects, display)

    def _add(self, stage: Stage, range_: Range) -> Range:
        self._before[stage.effect] = stage, range_
        return stage.after(range_, self.lesser(stage.effect, SKIPPED) if stage.lesser else self._unchanged)

    def lesser(self, effect: Effect, level: str) -> Change:
        """The most by which this level of an effect differs from it in full, right behind it, all before it in full."""
        if (effect, level) not in self._alone:
            stage, range_ = self._before[effect]
            self._alone[effect, level] = stage.lesser[level](range_)
        return self._alone[effect, level]

    def code_values(self, weights: Weights) -> NDArray[np.float64]:
        """By how many code values a pixel of each tile may differ from the full picture, if effects run so weighed."""
        change = scene_change = self._unchanged
        for stage, range_ in self._before.values():
            if stage.effect is Effect.TONE:
                scene_change = change
            unchanged = change is self._unchanged
            of_stage = weights.get(stage.effect)
            if of_stage is None:
                # Until something is left out, nothing has changed.
                if not unchanged:
                    change = stage.passed_on(change, range_, scene_change)
                continue
            weighed = []
            for level, weight in of_stage.items():
                if level == FULL:
                    of_level = change if unchanged else stage.passed_on(change, range_, scene_change)
                elif unchanged:
                    of_level = self.lesser(stage.effect, level)
                else:
                    of_level = change + stage.lesser[level](range_.widened(change))
                weighed.append(weight * of_level)
            change = np.sum(weighed, axis=0) if len(weighed) > 1 else weighed[0]
            if not change.any():
                change = self._unchanged
        return tone.code_values(change, self._shown, self._display)


def _scene_stages(eye: Eye, effects: Effects) -> list[Stage]:
    measured = eye.measured
    glare = (eye.kernel, measured, eye.gaze_px)
    kernel = changes.lesser(*glare, effects.glare.level, eye.ceiling_cd_m2)
    most = kernel + changes.veil(eye.kernel, measured, eye.ceiling_cd_m2)

    stages = [
        Stage(
            Effect.GLARE,
            {
                SKIPPED: lambda range_: most,
                GlareLevel.VEIL.value: lambda range_: kernel,
            },
            lambda change, range_, scene: change,
            lambda range_, hidden: changes.after(measured, hidden, least_stays(eye.kernel)),
        )
    ]
    ppd = measured.view.ppd_centre
    stages.append(
        Stage(
            Effect.ACUITY,
            {SKIPPED: lambda range_: acuity.skipped(range_, ppd, effects.acuity)},
            lambda change, range_, scene: acuity.passed_on(change, range_, ppd, effects.acuity),
            Range.widened,
        )
    )
    if effects.rod_noise.on:
        stages.append(
            Stage(
                Effect.ROD_NOISE,
                {SKIPPED: lambda range_: rod_noise.skipped(range_, eye.pupil_mm, effects.rod_noise)},
                lambda change, range_, scene: rod_noise.passed_on(change, range_, eye.pupil_mm, effects.rod_noise),
                Range.widened,
            )
        )
    return stages


def _displayed_stages(eye: Eye, effects: Effects, display: Display, scene: Range) -> list[Stage]:
    adapted = eye.adapted.luminance_cd_m2
    toned = (adapted, eye.adapted.tone_target_cd_m2(effects.adaptation), effects.tone, display)
    night = effects.night_colour
    stages = [
        Stage(
            Effect.TONE,
            {},
            lambda change, range_, scene_change: tone.passed_on(change, range_, *toned),
            lambda range_, hidden: tone.shown(range_, *toned),
        ),
        Stage(
            Effect.NIGHT_COLOUR,
            {SKIPPED: lambda range_: night_colour.skipped(range_, adapted, night, scene)},
            lambda change, range_, scene_change: night_colour.passed_on(
                change, range_, adapted, night, scene, scene_change
            ),
            Range.widened,
        ),
    ]
    if eye.retina is not None:
        where = (eye.retina, eye.measured.view, eye.gaze_px)
        stages.append(
            Stage(
                Effect.AFTERIMAGE,
                {SKIPPED: lambda range_: afterimage.skipped(range_, *where)},
                lambda change, range_, scene_change: afterimage.passed_on(change, range_, *where),
                Range.widened,
            )
        )
    return stages
