"""Detail that an eye loses in the dark.

cielab.py      lightness, which alone is blurred
fit.py         LUI's fast fit, on whole frames
cheap.py       cube root and exponential, at half the price
"""

from __future__ import annotations

from pipeline.effects.acuity.cielab import EPSILON, KAPPA, WHITE_CD_M2, lightness, luminance_of
from pipeline.effects.acuity.fit import LIMIT_CD_M2, RADIUS_PX, dark_acuity

__all__ = [
    "EPSILON",
    "KAPPA",
    "LIMIT_CD_M2",
    "RADIUS_PX",
    "WHITE_CD_M2",
    "dark_acuity",
    "lightness",
    "luminance_of",
]
