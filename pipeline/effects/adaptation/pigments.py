"""What strong light bleaches, and what an eye loses by it until the pigments are back: half an hour.

Pattanaik 2000, eq. 7: dB/dt = (1 − B)/τ − G·B/k, where B is the share of pigment left, G the light and k = τ times the
light that leaves half of it. Stepped by its exact solution: Euler's, which a common tool has, oscillates where
G·dt/k > 2 (for rods and 24 frames a second from 768 cd/m² on) and ends in NaN.

Two sets of constants. Pattanaik's, after Hunt, count light in cd/m² and let rods "bleach" by half at 0.04 cd/m²: the
factor stands for all that silences rods in the light. Threshold is 1/B times as high. Measured bleaching is weaker and
counts in trolands, so the pupil matters; but the threshold's logarithm rises with what is bleached.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from entoptic.pipeline.effects.adaptation.settings import Bleaching
from entoptic.pipeline.threshold import cone_threshold_cd_m2, rod_threshold_cd_m2, threshold_cd_m2

TAU_S = 110.0, 400.0
"""Of the return of the cones' and the rods' pigment (Pattanaik 2000; Rushton)."""
HALF_CD_M2 = 2e6, 0.04
"""Luminance that leaves half (Pattanaik 2000, eq. 6: k = 2.2e8 and 16 cd/m²·s)."""
HALF_TD = 10**4.3, 10**4.4
"""Retinal illuminance that leaves half: photopic trolands for the cones (Rushton & Henry 1968), scotopic ones for the
rods (CVRL)."""
SCOTOPIC_PER_PHOTOPIC = 2.57
"""Larson 1997 of D65 white: 1.33·(1 + (Y + Z)/X) − 1.68."""
LOG10_RISE = 3.0, 20.0
"""By how much the logarithm of the cones' and the rods' threshold rises where all is bleached (Rushton 1965)."""
PUPIL_MM = 4.0
"""Where nobody says. Engineering choice: the middle of what light makes of it."""
DARK_CD_M2 = threshold_cd_m2(0.0)
"""The least that an eye sees."""


@dataclasses.dataclass(frozen=True)
class Pigments:
    """Share of the pigments that is not bleached, 0 to 1."""

    cones: float = 1.0
    rods: float = 1.0


UNBLEACHED = Pigments()


class Sensitivity(NamedTuple):
    """What is left of each kind's sensitivity in the dark, 0 to 1."""

    cones: float
    rods: float


def settled(luminance_cd_m2: float, kind: Bleaching, pupil_diameter_mm: float = PUPIL_MM) -> Pigments:
    """The pigments of an eye that has looked at this luminance for long; all there if bleaching is off."""
    cones, rods = _light(luminance_cd_m2, kind, pupil_diameter_mm)
    return Pigments(1 / (1 + cones), 1 / (1 + rods))


def step_pigments(
    pigments: Pigments, luminance_cd_m2: float, dt_s: float, kind: Bleaching, pupil_diameter_mm: float = PUPIL_MM
) -> Pigments:
    """The pigments after dt under this luminance: exact for any dt. At dt 0, below it or no number as they were."""
    if not dt_s > 0:
        return pigments
    light, towards = _light(luminance_cd_m2, kind, pupil_diameter_mm), settled(luminance_cd_m2, kind, pupil_diameter_mm)
    left_cones, left_rods = (math.exp(-dt_s * (1 + light[k]) / TAU_S[k]) for k in range(2))
    return Pigments(
        towards.cones + (pigments.cones - towards.cones) * left_cones,
        towards.rods + (pigments.rods - towards.rods) * left_rods,
    )


def sensitivity(pigments: Pigments, kind: Bleaching) -> Sensitivity:
    """What bleaching leaves of the sensitivity in the dark: 1 where all pigment is there."""
    match kind:
        case Bleaching.OFF:
            return Sensitivity(1.0, 1.0)
        case Bleaching.PATTANAIK:
            return Sensitivity(pigments.cones, pigments.rods)
        case Bleaching.RUSHTON:
            cones, rods = LOG10_RISE
            return Sensitivity(10 ** (-cones * (1 - pigments.cones)), 10 ** (-rods * (1 - pigments.rods)))


def threshold_in_the_dark_cd_m2(pigments: Pigments, kind: Bleaching) -> float:
    """The least that an eye with such pigments sees: by its cones or its rods, whichever see more."""
    left = sensitivity(pigments, kind)
    cones, rods = cone_threshold_cd_m2(0.0), rod_threshold_cd_m2(0.0)
    # No sensitivity left at all: the largest number that a float32 holds stands for never.
    return min(cones / max(left.cones, 1e-38), rods / max(left.rods, 1e-38))


def equivalent_cd_m2(pigments: Pigments, kind: Bleaching) -> float:
    """The luminance that would lift the threshold as much as bleaching does: 0 where all pigment is there.

    So a bleached eye in the dark sees as one that looks at this light (Crawford's equivalent background). Below
    1e-4 cd/m² the threshold is flat and names no luminance: there only the part of it counts that exceeds the least.
    """
    threshold = threshold_in_the_dark_cd_m2(pigments, kind)
    if threshold <= DARK_CD_M2:
        return 0.0
    return _seen_at_cd_m2(threshold) * (1 - DARK_CD_M2 / threshold)


def _light(luminance_cd_m2: float, kind: Bleaching, pupil_diameter_mm: float) -> tuple[float, float]:
    """The light on cones and rods, as multiples of what leaves half of the pigment."""
    match kind:
        case Bleaching.OFF:
            return 0.0, 0.0
        case Bleaching.PATTANAIK:
            return luminance_cd_m2 / HALF_CD_M2[0], luminance_cd_m2 / HALF_CD_M2[1]
        case Bleaching.RUSHTON:
            trolands = luminance_cd_m2 * math.pi / 4 * pupil_diameter_mm**2
            return trolands / HALF_TD[0], trolands * SCOTOPIC_PER_PHOTOPIC / HALF_TD[1]


def _seen_at_cd_m2(threshold: float) -> float:
    """The luminance of which this is the threshold, found by halving: BAR 4 rises with it, but for 0.7 % and 2.7 % at
    the joints of the fits, where any of the two will do.
    """
    low, high = -6.0, 12.0
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if threshold_cd_m2(10**middle) < threshold else (low, middle)
    return 10 ** ((low + high) / 2)
