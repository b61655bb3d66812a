"""The smallest difference in luminance that is seen (threshold versus intensity), after Ferwerda 1996.

BAR 1–4 = KRI 4.23–4.24; base-10 logarithms throughout; luminances and thresholds in cd/m².
"""

from __future__ import annotations

import math


def cone_threshold_cd_m2(luminance_cd_m2: float) -> float:
    """t_p: what the cones need."""
    log = _log10(luminance_cd_m2)
    if log <= -2.6:
        return 10**-0.72
    if log >= 1.9:
        return 10 ** (log - 1.255)
    return 10 ** ((0.249 * log + 0.65) ** 2.7 - 0.72)


def rod_threshold_cd_m2(luminance_cd_m2: float) -> float:
    """t_s: what the rods need."""
    log = _log10(luminance_cd_m2)
    if log <= -3.94:
        return 10**-2.86
    if log >= -1.44:
        return 10 ** (log - 0.395)
    return 10 ** ((0.405 * log + 1.6) ** 2.18 - 2.86)


def cone_share(luminance_cd_m2: float) -> float:
    """k: 0 where only rods see, 1 where only cones do (BAR 3, its base clamped at 0: E3)."""
    if luminance_cd_m2 <= 0.03:
        return 0.0
    if luminance_cd_m2 >= 3.0:
        return 1.0
    return max(0.0, 0.5 * _log10(luminance_cd_m2) + 0.761) ** 1.5


def threshold_cd_m2(luminance_cd_m2: float) -> float:
    """t_m: what an eye adapted to this luminance needs, rods and cones together (BAR 4)."""
    k = cone_share(luminance_cd_m2)
    return (1 - k) * rod_threshold_cd_m2(luminance_cd_m2) + k * cone_threshold_cd_m2(luminance_cd_m2)


def _log10(luminance_cd_m2: float) -> float:
    return math.log10(max(luminance_cd_m2, 1e-30))
