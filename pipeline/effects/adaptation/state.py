"""One eye's adaptation from frame to frame, and the exposure that follows from it."""

from __future__ import annotations

import dataclasses
import math

from entoptic.pipeline.effects.adaptation.courses import adapt_cd_m2, overshoot_threshold_cd_m2
from entoptic.pipeline.effects.adaptation.pigments import (
    PUPIL_MM,
    UNBLEACHED,
    Pigments,
    equivalent_cd_m2,
    settled,
    step_pigments,
)
from entoptic.pipeline.effects.adaptation.settings import DEFAULT, Adaptation, Bleaching, Course
from entoptic.pipeline.effects.adaptation.targets import FLOOR_CD_M2
from entoptic.pipeline.threshold import threshold_cd_m2


@dataclasses.dataclass(frozen=True)
class Adapted:
    """How one eye is adapted, and all that it takes along to the next frame."""

    luminance_cd_m2: float
    """What all else goes by: the luminance that the eye sees as if it were adapted to it."""
    target_cd_m2: float
    """Where it is going."""
    fast_cd_m2: float
    """Where it would be without bleaching."""
    pigments: Pigments = UNBLEACHED

    def tone_target_cd_m2(self, settings: Adaptation = DEFAULT) -> float:
        """The target for the tone operator `ward`: the adapted luminance itself where nothing overshoots."""
        return self.target_cd_m2 if settings.course is Course.OVERSHOOT else self.luminance_cd_m2

    def threshold_cd_m2(self, settings: Adaptation = DEFAULT) -> float:
        """The smallest difference in luminance that the eye sees now (BAR 4; BAR 8 where it overshoots)."""
        if settings.course is Course.OVERSHOOT:
            return overshoot_threshold_cd_m2(self.luminance_cd_m2, self.target_cd_m2)
        return threshold_cd_m2(self.luminance_cd_m2)


def begin(target_cd_m2: float, settings: Adaptation = DEFAULT, pupil_diameter_mm: float = PUPIL_MM) -> Adapted:
    """An eye that has looked at this luminance for long."""
    return _adapted(target_cd_m2, target_cd_m2, settled(target_cd_m2, settings.bleaching, pupil_diameter_mm), settings)


def step(
    before: Adapted,
    target_cd_m2: float,
    dt_s: float,
    settings: Adaptation = DEFAULT,
    pupil_diameter_mm: float = PUPIL_MM,
) -> Adapted:
    """The eye `dt_s` later, which it spent before this luminance. The pupil matters to bleaching `rushton` alone."""
    fast_cd_m2 = adapt_cd_m2(before.fast_cd_m2, target_cd_m2, dt_s, settings)
    pigments = step_pigments(before.pigments, target_cd_m2, dt_s, settings.bleaching, pupil_diameter_mm)
    return _adapted(fast_cd_m2, target_cd_m2, pigments, settings)


def exposure(adapted_cd_m2: float) -> float:
    """What a luminance in cd/m² is multiplied by: the key over the adapted luminance (Krawczyk 2005; E2, E15).

    The key falls in the dark: a night looks dim even to an eye that has adapted to it.
    """
    adapted_cd_m2 = max(adapted_cd_m2, FLOOR_CD_M2)
    key = 1.03 - 2 / (2 + math.log10(adapted_cd_m2 + 1))
    return key / adapted_cd_m2


def _adapted(fast_cd_m2: float, target_cd_m2: float, pigments: Pigments, settings: Adaptation) -> Adapted:
    if settings.bleaching is Bleaching.OFF:
        return Adapted(fast_cd_m2, target_cd_m2, fast_cd_m2, pigments)
    slow_cd_m2 = equivalent_cd_m2(pigments, settings.bleaching)
    return Adapted(max(fast_cd_m2, slow_cd_m2), target_cd_m2, fast_cd_m2, pigments)
