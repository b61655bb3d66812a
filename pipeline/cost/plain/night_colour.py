"""The shift to blue where rods see, as LUI, KRI and BAR have it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.cost.plain.adaptation import luminance, rod_share

Reals = NDArray[np.float64]

TINT = (1.05, 0.97, 1.27)
KRI_TINT = (1.016784, 0.983176, 1.107126)
BLUE_XY = 0.25
RGB_TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126, 0.7152, 0.0722], [0.0193339, 0.1191920, 0.9503041]])
"""ITU-R BT.709, white D65; its second row as everywhere here."""


def night_tint(displayed: Reals, adapted_cd_m2: float) -> Reals:
    """LUI 5.18: a displayed frame blended towards tinted grey by the rods' share."""
    return towards(displayed, np.array(TINT), rod_share(adapted_cd_m2))


def kri_rgb(displayed: Reals, adapted_cd_m2: float) -> Reals:
    """KRI 4.29."""
    return towards(displayed, np.array(KRI_TINT), rod_share(adapted_cd_m2))


def kri_xy(displayed: Reals, adapted_cd_m2: float) -> Reals:
    """KRI 4.28: chromaticity blended, luminance kept."""
    rods = rod_share(adapted_cd_m2)
    xyz = np.einsum("oi,iyx->oyx", RGB_TO_XYZ, displayed)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = xyz[0] / xyz.sum(axis=0), xyz[1] / xyz.sum(axis=0)
        x, y = x * (1 - rods) + BLUE_XY * rods, y * (1 - rods) + BLUE_XY * rods
        blended = np.stack([x / y * xyz[1], xyz[1], (1 - x - y) / y * xyz[1]])
    back = np.einsum("oi,iyx->oyx", np.linalg.inv(RGB_TO_XYZ), blended)
    return np.asarray(np.where(xyz[1] > 0, back, 0))


def bar(displayed: Reals, adapted_cd_m2: float) -> Reals:
    """BAR 11–12: colours pale."""
    cones = 1.0 if adapted_cd_m2 > 3 else 0.069 / (0.069 + 1.409 * np.exp(-4.267 * adapted_cd_m2))
    return towards(displayed, np.ones(3), 1 - cones)


def towards(
    displayed: Reals, tint: Reals, rods: float | Reals, seen_by: tuple[float, float, float] | None = None
) -> Reals:
    """A blend of a frame and of its light in one colour; the light as cones see it, unless weights are given."""
    seen = luminance(displayed) if seen_by is None else np.einsum("c,cyx->yx", np.array(seen_by), displayed)
    return np.asarray(displayed * (1 - rods) + tint[:, None, None] * seen * rods)
