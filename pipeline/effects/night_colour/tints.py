"""What a grey looks like to rods, linear Rec.709, and by which weights rods see a colour's light."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.night_colour.settings import NightMethod
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.mesopic import SCOTOPIC_WEIGHTS, WHITE_RATIO
from entoptic.pipeline.primaries import XYZ_TO_RGB

TINT = (1.05, 0.97, 1.27)
"""LUI 5.18."""
KRI_TINT = (1.016784, 0.983176, 1.107126)
"""KRI 4.29."""
BLUE_XY = (0.25, 0.25)
"""The chromaticity towards which KRI 4.28 blends (Jensen et al. 2001)."""
ROD_XY = (0.28, 0.29)
"""What white looks like to rods alone: the mean of paintings that Jensen et al. 2001 looked at (KRI, with 4.27)."""
CONES = (
    (0.17816550, 0.44034866, 0.04007523),
    (0.03454299, 0.27508209, 0.03708498),
    (0.02342778, 0.12119426, 0.89211150),
)
"""Responses of L, M and S cones (rows) to linear Rec.709 primaries: Smith & Pokorny's fundamentals over Mallett &
Yuksel's spectra of the primaries, from colour-science; per unit of luminance, L + M being 1.005 for white."""
CONE_PEAKS = (0.63721, 0.39242, 1.6064)
"""Their largest sensitivities, in the same units (Cao 2008, table 1)."""
ROD_INPUT = (0.2, 0.2, 0.3)
"""How much of a rod's signal each cone pathway takes up: κ as public renderers set Cao's free parameters (Filament)."""
SATURATION = 0.33
"""How soon a cone pathway's gain falls, per troland (Cao 2008)."""


def weights(method: NightMethod) -> tuple[float, float, float]:
    """How much each linear Rec.709 component adds to the light that rods see; white adds up to 1.

    All methods but one let rods see as cones do.
    """
    if method is NightMethod.RODS:
        red, green, blue = SCOTOPIC_WEIGHTS
        return red / WHITE_RATIO, green / WHITE_RATIO, blue / WHITE_RATIO
    return LUMINANCE_WEIGHTS


def tint(method: NightMethod, adapted_cd_m2: float) -> NDArray[np.float64]:
    """A white of luminance 1 as the rods of an eye so adapted see it, linear Rec.709."""
    if method is NightMethod.LUI:
        return np.array(TINT)
    if method is NightMethod.KRI_RGB:
        return np.array(KRI_TINT)
    if method is NightMethod.KRI_XY:
        return _of_xy(BLUE_XY)
    if method is NightMethod.BAR:
        return np.ones(3)
    return _rod_white(adapted_cd_m2)


def _rod_white(adapted_cd_m2: float) -> NDArray[np.float64]:
    """White to rods: their signal adds to M − L, to S and, left at 1 here, to L + M (Kirk & O'Brien 2011).

    Each channel takes it up with the gain g = (1 + 0.33·(q + κ·q_rod)/m)^−½ of its cones (Cao 2008), q in trolands.
    Engineering choice: the strengths of the two chromatic channels are such that g = 1 gives ROD_XY. They come out in
    the direction in which rods were matched by cones (Cao 2005), M over L and S raised.
    """
    cones = np.array(CONES)
    white = cones.sum(1)
    dark = cones @ _of_xy(ROD_XY) - white
    trolands = adapted_cd_m2 * math.pi / 4 * _pupil_diameter_mm(adapted_cd_m2) ** 2
    gain = 1 / np.sqrt(1 + SATURATION * trolands * (white + np.array(ROD_INPUT)) / np.array(CONE_PEAKS))
    # M − L lies between two pathways: their mean gain.
    red_green = (gain[0] + gain[1]) / 2
    seen = white + dark * np.array([red_green, red_green, gain[2]])
    rgb = np.linalg.solve(cones, seen)
    return rgb / (np.array(LUMINANCE_WEIGHTS) @ rgb)


def _pupil_diameter_mm(luminance_cd_m2: float) -> float:
    """Moon & Spencer (SPE 3.1.1): a coarse pupil is enough, as gains fall with its root."""
    return 4.9 - 3 * math.tanh(0.4 * (math.log10(max(luminance_cd_m2, 1e-30)) + 1))


def _of_xy(xy: tuple[float, float]) -> NDArray[np.float64]:
    """Linear Rec.709 of this chromaticity at luminance 1."""
    x, y = xy
    rgb = np.array(XYZ_TO_RGB) @ np.array([x / y, 1, (1 - x - y) / y])
    return rgb / (np.array(LUMINANCE_WEIGHTS) @ rgb)
