"""Luminance where rods and cones see together: the CIE's system for mesopic photometry (CIE 191:2010, MES2).

Photopic and scotopic luminances in cd/m². The adaptation coefficient m runs from 0, rods alone, at a mesopic luminance
of 0.005 cd/m² to 1, cones alone, at 5 cd/m².
"""

from __future__ import annotations

import math
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

Values = TypeVar("Values", float, NDArray[np.float64], jax.Array)

HALF_CD_M2 = 0.04
"""Where rods and cones share alike (LUI 5.4 = KRI 4.27, after Krawczyk 2005)."""
A, B = 0.7670, 0.3334
"""m = A + B·log10 of the mesopic luminance (CIE 191:2010, 6.1)."""
ROD_EFFICACY = 683 / 1699
"""V'(555 nm) = Km/K'm (CIE 191:2010): what brings scotopic luminance to the cones' scale."""
SCOTOPIC_WEIGHTS = (0.04439683, 1.44198011, 0.97690340)
"""Scotopic luminance of the linear Rec.709 primaries. Their spectra are Mallett & Yuksel's (2019), which add up to D65
as the primaries do; V' is the CIE's of 1951 and 1699 lm/W its peak. All from colour-science; a test computes them."""
WHITE_RATIO = sum(SCOTOPIC_WEIGHTS)
"""Scotopic over photopic luminance of D65: 2.463."""
LARSON = (1.33, 1.68)
"""Factor and offset of Larson's V/Y (Larson 1997; E4)."""
_BISECTIONS = 60


def adaptation_coefficient(photopic_cd_m2: float, scotopic_cd_m2: float) -> float:
    """m in [0, 1] of an eye adapted to these luminances.

    The CIE iterates m and the mesopic luminance from m = 0.5, which for a very red or very blue light need not end (Gao
    2017); here the same two equations are halved in on, so that an answer always comes. Where they have several
    solutions it is one of them.
    """

    def excess(m: float) -> float:
        return _coefficient(mesopic_cd_m2(photopic_cd_m2, scotopic_cd_m2, m)) - m

    low, high = 0.0, 1.0
    if excess(low) <= 0:
        return low
    if excess(high) >= 0:
        return high
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return (low + high) / 2


def mesopic_cd_m2(photopic_cd_m2: float, scotopic_cd_m2: float, m: float) -> float:
    """Mesopic luminance of a light seen by an eye with the adaptation coefficient m (CIE 191:2010, 6.1)."""
    rods = (1 - m) * ROD_EFFICACY
    return (m * photopic_cd_m2 + rods * scotopic_cd_m2) / (m + rods)


def rod_share(photopic_cd_m2: float) -> float:
    """How much of a white light's mesopic luminance comes by the rods, in an eye adapted to so much white (D65).

    With the share s, any light's mesopic luminance over that of white light as bright to cones is (1 − s) + s·(its
    scotopic over its photopic luminance)/WHITE_RATIO: the same blend of cones and rods as CIE 191's.
    """
    m = adaptation_coefficient(photopic_cd_m2, WHITE_RATIO * photopic_cd_m2)
    rods = (1 - m) * ROD_EFFICACY * WHITE_RATIO
    return rods / (m + rods)


def scotopic_luminance(rgb: Float[Array, "*eye 3 y x"]) -> Float[Array, "*eye y x"]:
    """Scotopic luminance of linear Rec.709 RGB in cd/m², as the primaries' spectra have it: linear, exact for D65."""
    red, green, blue = (np.float32(weight) for weight in SCOTOPIC_WEIGHTS)
    return red * rgb[..., 0, :, :] + green * rgb[..., 1, :, :] + blue * rgb[..., 2, :, :]


def larson_ratio(others_per_x: Values) -> Values:
    """V/Y guessed from (Y + Z)/X: 1.33·(1 + (Y + Z)/X) − 1.68 (Larson 1997; KRI prints it upside down, E4)."""
    factor, offset = LARSON
    return factor * (1 + others_per_x) - offset


def _coefficient(mesopic_cd_m2_: float) -> float:
    # 1e-30 stands for black.
    return min(max(A + B * math.log10(max(mesopic_cd_m2_, 1e-30)), 0.0), 1.0)
