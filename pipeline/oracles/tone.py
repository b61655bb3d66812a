"""To the display's range by the ACES filmic fit, and the sRGB encoding (Narkowicz 2016; IEC 61966-2-1)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

REFERENCE_PEAK_CD_M2, MIDDLE_GREY = 100.0, 0.18


def curve(x: Reals) -> Reals:
    """0 at 0, at most 1."""
    return np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)


def display_scale(peak_cd_m2: float) -> float:
    """What keeps middle grey at its luminance on a display brighter than the reference."""
    y = float(curve(np.array(MIDDLE_GREY))) * min(REFERENCE_PEAK_CD_M2 / peak_cd_m2, 1)
    square, linear = 2.51 - 2.43 * y, 0.03 - 0.59 * y
    return (math.sqrt(linear * linear + 0.56 * y * square) - linear) / (2 * square * MIDDLE_GREY)


def aces(rgb: Reals, exposure: float, peak_cd_m2: float) -> Reals:
    """A frame in cd/m² as the display shows it, linear, 1 = its peak."""
    return curve(np.clip(rgb * (exposure * display_scale(peak_cd_m2)), 0, 1e4))


def encode(linear: Reals, black_share: float = 0.0) -> NDArray[np.uint8]:
    """Code values (y, x, 3) of an sRGB display whose black is this share of its peak."""
    return np.asarray(np.round(srgb(linear, black_share) * 255).astype(np.uint8).transpose(1, 2, 0))


def srgb(linear: Reals, black_share: float = 0.0) -> Reals:
    """The same before rounding, 0 to 1, (3, y, x)."""
    shown = np.clip((linear - black_share) / (1 - black_share), 0, 1)
    return np.asarray(np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055))
