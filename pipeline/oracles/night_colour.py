"""The shift to blue where rods see, as LUI, KRI and BAR have it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline import mesopic
from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.tints import tint, weights
from entoptic.pipeline.oracles.adaptation import luminance, rod_share

Reals = NDArray[np.float64]

TINT = (1.05, 0.97, 1.27)
KRI_TINT = (1.016784, 0.983176, 1.107126)
BLUE_XY = 0.25
RGB_TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126, 0.7152, 0.0722], [0.0193339, 0.1191920, 0.9503041]])
"""ITU-R BT.709, white D65; its second row as everywhere here."""


def shifted(displayed: Reals, scene: Reals, adapted_cd_m2: float, settings: NightColour) -> Reals:
    """A displayed frame by these settings; `scene` is the same in cd/m², for shares of each pixel's own."""
    method = settings.method
    rods: float | Reals
    if settings.per_pixel:
        y = np.maximum(luminance(scene), 0)
        rods = 1 - _cones_bar(y) if method is NightMethod.BAR else 0.04 / (0.04 + y)
    elif settings.mesopic:
        rods = mesopic.rod_share(adapted_cd_m2)
    else:
        rods = 1 - float(_cones_bar(np.array(adapted_cd_m2))) if method is NightMethod.BAR else rod_share(adapted_cd_m2)
    if method is NightMethod.KRI_XY:
        return within_peak(kri_xy(displayed, rods))
    colour = {NightMethod.LUI: TINT, NightMethod.KRI_RGB: KRI_TINT, NightMethod.BAR: (1.0, 1.0, 1.0)}
    tinted = np.array(colour[method]) if method in colour else tint(method, adapted_cd_m2)
    blended = towards(displayed, tinted, rods, weights(method))
    # What is above the peak by less than a thousandth, in bright light, is left to be clipped.
    clipped = not settings.per_pixel and float(np.max(rods)) * (tinted.max() - 1) <= 1e-3
    return blended if clipped else within_peak(blended)


def night_tint(displayed: Reals, adapted_cd_m2: float) -> Reals:
    """LUI 5.18: a displayed frame blended towards tinted grey by the rods' share."""
    return within_peak(towards(displayed, np.array(TINT), rod_share(adapted_cd_m2)))


def kri_xy(displayed: Reals, rods: float | Reals) -> Reals:
    """KRI 4.28: chromaticity blended, luminance kept."""
    xyz = np.einsum("oi,iyx->oyx", RGB_TO_XYZ, displayed)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = xyz[0] / xyz.sum(axis=0), xyz[1] / xyz.sum(axis=0)
        x, y = x * (1 - rods) + BLUE_XY * rods, y * (1 - rods) + BLUE_XY * rods
        blended = np.stack([x / y * xyz[1], xyz[1], (1 - x - y) / y * xyz[1]])
    back = np.einsum("oi,iyx->oyx", np.linalg.inv(RGB_TO_XYZ), blended)
    return np.asarray(np.where(xyz[1] > 0, back, 0))


def _cones_bar(adapted_cd_m2: Reals) -> Reals:
    """σ of BAR 11: colours pale."""
    return np.where(adapted_cd_m2 > 3, 1.0, 0.069 / (0.069 + 1.409 * np.exp(-4.267 * adapted_cd_m2)))


def towards(
    displayed: Reals, tint: Reals, rods: float | Reals, seen_by: tuple[float, float, float] | None = None
) -> Reals:
    """A blend of a frame and of its light in one colour; the light as cones see it, unless weights are given."""
    seen = luminance(displayed) if seen_by is None else np.einsum("c,cyx->yx", np.array(seen_by), displayed)
    return np.asarray(displayed * (1 - rods) + tint[:, None, None] * seen * rods)


def within_peak(rgb: Reals) -> Reals:
    """Where a component is above the peak, mixed with white of the same luminance until none is."""
    y, largest = np.minimum(luminance(rgb), 1), rgb.max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        kept = np.where(largest > 1, (1 - y) / (largest - y), 1)
    return np.asarray(y + kept * (rgb - y))
