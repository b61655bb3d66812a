"""Reinhard's photographic curve of luminance as KRI 4.18–4.20 has it: exposed by the key, 1 at L_white."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.display_light import seen_peak_cd_m2
from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.tone.filmic import MIDDLE_GREY, REFERENCE_PEAK_CD_M2
from entoptic.pipeline.frame import Display


def coefficients(adapted_cd_m2: float, white: float, display: Display) -> tuple[float, float]:
    """What a luminance in cd/m² is multiplied by to be exposed, and 1/L_white².

    The key is Krawczyk's with the zero of its logarithm mended (E2). On a display brighter than the reference, middle
    grey keeps its luminance, as with ACES.
    """
    bend = 1 / (white * white)
    grey = float(_share(MIDDLE_GREY, bend)) * min(REFERENCE_PEAK_CD_M2 / seen_peak_cd_m2(display), 1)
    # KRI 4.20 solved for L_r: bend·L² + (1 − y)·L − y = 0, in the form that stays exact as bend goes to 0.
    exposed = 2 * grey / (1 - grey + math.sqrt((1 - grey) ** 2 + 4 * grey * bend))
    return exposure(adapted_cd_m2) * exposed / MIDDLE_GREY, bend


def _share(exposed: float, bend: float) -> float:
    """KRI 4.20."""
    return exposed * (1 + exposed * bend) / (1 + exposed)


def gain(y: Float[Array, "eye y x"], scale: Float[Array, "eye 1 1"], bend: Float[Array, "eye 1 1"]) -> Array:
    """The display's share over the scene's luminance, L_d/L; finite at 0."""
    exposed = y * scale
    return scale * (1 + exposed * bend) / (1 + exposed)


def gains(
    low: NDArray[np.float64], high: NDArray[np.float64], scale: float, bend: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the largest gain between two luminances: it goes one way only."""
    ends = [scale * (1 + scale * bend * y) / (1 + scale * y) for y in (low, high)]
    return np.minimum(*ends), np.maximum(*ends)


def steepest(low: NDArray[np.float64], scale: float, bend: float) -> NDArray[np.float64]:
    """The largest slope of the gain from a luminance on: at its low end."""
    return abs(1 - bend) * (scale / (1 + scale * low)) ** 2


def full_cd_m2(scale: float, bend: float) -> float:
    """The luminance from which on the display shows its peak: L_r = L_white."""
    return 1 / (math.sqrt(bend) * scale)
