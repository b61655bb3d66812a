"""The luminance an eye is adapted to, over time, and the exposure that follows from it (LUI 5.1).

settings.py   which target, which course, and what else
targets.py    the luminance that an eye is on its way to, from a frame's tiles
courses.py    how fast it goes there
pigments.py   what strong light bleaches, and what the eye loses by it for half an hour
state.py      one eye's adaptation from frame to frame
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.adaptation.courses import (
    TAU_CONE_S,
    TAU_ROD_S,
    adapt_cd_m2,
    overshoot_threshold_cd_m2,
    rod_sensitivity,
)
from entoptic.pipeline.effects.adaptation.pigments import (
    Pigments,
    equivalent_cd_m2,
    sensitivity,
    settled,
    step_pigments,
)
from entoptic.pipeline.effects.adaptation.settings import GAZE_SD_DEG, Adaptation, Bleaching, Course, Target
from entoptic.pipeline.effects.adaptation.state import Adapted, begin, exposure, step
from entoptic.pipeline.effects.adaptation.targets import FLOOR_CD_M2, target_cd_m2
from entoptic.pipeline.effects.effect import Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.oracles import adaptation as oracle
from entoptic.pipeline.ranges import Change
from entoptic.pipeline.words import of_each_eye

__all__ = [
    "ADAPTATION",
    "FLOOR_CD_M2",
    "GAZE_SD_DEG",
    "TAU_CONE_S",
    "TAU_ROD_S",
    "Adaptation",
    "AdaptationEffect",
    "Adapted",
    "Bleaching",
    "Course",
    "Pigments",
    "Target",
    "adapt_cd_m2",
    "begin",
    "equivalent_cd_m2",
    "exposure",
    "overshoot_threshold_cd_m2",
    "rod_sensitivity",
    "sensitivity",
    "settled",
    "step",
    "step_pigments",
    "target_cd_m2",
]


if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext


class AdaptationEffect(Effect[Adaptation, None]):
    """The luminance that an eye is adapted to: it changes no image itself, all that follows goes by it."""

    name = "adaptation"
    domain = Domain.SCENE
    Settings = Adaptation
    optional = False
    costs: Mapping[str, Cost] = {"lui": Cost(0.3, 0.0)}

    def full_level(self, settings: Adaptation) -> str:
        return settings.target.value

    def required(self, eyes: Sequence[EyeContext], settings: Adaptation) -> str:
        return f"adapted to {of_each_eye(eye.adapted_cd_m2 for eye in eyes)} cd/m²"

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Adaptation,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        return picture.image

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: Adaptation, level: str) -> Change:
        return np.zeros_like(ranges.image.low)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: Adaptation) -> Change:
        return changes.image

    def reason(self, eye: EyeContext, settings: Adaptation) -> str:
        return self.required([eye], settings)

    def oracle(self, picture: Picture, eye: EyeContext, settings: Adaptation) -> NDArray[np.float64]:
        true_cd_m2 = oracle.target_of(np.asarray(eye.frame.rgb_cd_m2[eye.image], np.float64), eye, settings)
        # A wrong target is a wrong exposure.
        wrong = oracle.exposure(true_cd_m2) / oracle.exposure(eye.adapted.target_cd_m2)
        return np.asarray(picture.image[0], np.float64) * wrong

    def variants(self) -> Mapping[str, Adaptation]:
        return {target.value: Adaptation(target=target) for target in Target} | {"lui, robust": Adaptation(robust=True)}


ADAPTATION = AdaptationEffect()
