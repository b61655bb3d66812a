"""How fast an eye goes from one adapted luminance to another. Steps are exact for their time, so any is stable."""

from __future__ import annotations

import math

from entoptic.pipeline.effects.adaptation.settings import DEFAULT, Adaptation, Course
from entoptic.pipeline.mesopic import HALF_CD_M2
from entoptic.pipeline.threshold import threshold_cd_m2

TAU_ROD_S, TAU_CONE_S = 0.4, 0.1
"""LUI 5.3, after Krawczyk 2005."""


def rod_sensitivity(luminance_cd_m2: float) -> float:
    """σ: 1 in the dark, 0 in the light (LUI 5.4)."""
    return HALF_CD_M2 / (HALF_CD_M2 + luminance_cd_m2)


def adapt_cd_m2(adapted_cd_m2: float, target: float, dt_s: float, settings: Adaptation = DEFAULT) -> float:
    """One step of adaptation towards a target: of the way, exp(−rate·dt) is left.

    Between both for any dt, and they themselves at 0 and at ever. Time that stands still, goes backwards or is no
    number leaves the state as it is; a course that is instant knows no time.
    """
    if settings.course is Course.INSTANT:
        return target
    if not dt_s > 0:
        return adapted_cd_m2
    way = dt_s * _rate_per_s(adapted_cd_m2, target, settings)
    # A mean of both, not a step added to one: from the sun to starlight, the difference rounds to more than starlight.
    mean = adapted_cd_m2 * math.exp(-way) + target * -math.expm1(-way)
    return min(max(mean, min(adapted_cd_m2, target)), max(adapted_cd_m2, target))


def _rate_per_s(adapted_cd_m2: float, target: float, settings: Adaptation) -> float:
    if settings.course is Course.LUI:
        sigma = rod_sensitivity(target)
        return 1 / (sigma * TAU_ROD_S + (1 - sigma) * TAU_CONE_S)
    lighter = target > adapted_cd_m2
    # BAR 7: p^dt.
    return -math.log(settings.left_after_1_s_to_light if lighter else settings.left_after_1_s_to_dark)


def overshoot_threshold_cd_m2(adapted_cd_m2: float, target_cd_m2: float) -> float:
    """t*: the threshold on the way to a target (BAR 8). On the way to light it starts too high and falls.

    On the way to the dark that of the adapted luminance; the two meet where both luminances do.
    """
    adapted = threshold_cd_m2(adapted_cd_m2)
    if target_cd_m2 <= adapted_cd_m2:
        return adapted
    target = threshold_cd_m2(target_cd_m2)
    return target * (target / adapted)
