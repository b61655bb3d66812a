"""The true two-dimensional filter, each pixel with its own σ, in float64: the truth for the fast ones. Minutes."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.acuity import larson
from entoptic.pipeline.effects.acuity.cielab import EPSILON, KAPPA, LINEAR_END, WHITE_CD_M2
from entoptic.pipeline.effects.acuity.settings import Acuity, AcuityMethod
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

REACH = 4
"""Radius of the kernel in σ of the darkest pixel: what lies beyond weighs 3e-4 in all."""

Reals = NDArray[np.float64]


def reference_acuity(
    rgb: Float[np.ndarray, "eye 3 y x"], pixels_per_deg: float, settings: Acuity
) -> Float[np.ndarray, "eye 3 y x"]:
    """A frame in cd/m² with its dark parts blurred."""
    rgb = np.asarray(rgb, np.float64)
    y = np.einsum("c,ecyx->eyx", np.asarray(LUMINANCE_WEIGHTS), rgb)
    sharp = lightness(y)
    variance = variance_px2(y, pixels_per_deg, settings)
    blurred = np.stack([filtered(*eye) for eye in zip(sharp, variance, strict=True)])
    change = np.where(variance > 0, luminance_of(blurred) - y, 0)
    return np.asarray(np.maximum(rgb + change[:, None], np.minimum(rgb, 0)))


def variance_px2(y_cd_m2: Reals, pixels_per_deg: float, settings: Acuity) -> Reals:
    """σ² of each pixel's blur by its luminance."""
    if settings.method is AcuityMethod.FIT:
        return np.asarray(np.clip(1 - lightness(y_cd_m2), 0, 1) ** 2)
    return larson.variance_px2(y_cd_m2, pixels_per_deg, settings.display_limit)


def filtered(values: Reals, variance: Reals) -> Reals:
    """Each pixel's mean of those around it under a Gaussian of its own σ², beyond the frame mirrored. (y, x) each.

    In eighths: pixels as far up, down, left, right and across the diagonals have the same weight.
    """
    radius = math.ceil(REACH * math.sqrt(float(variance.max())))
    padded = np.pad(values, radius, mode="symmetric")
    height, width = values.shape
    exponent = -0.5 / np.maximum(variance, 1e-9)
    total, weights = values.copy(), np.ones_like(values)
    for far in range(1, radius + 1):
        for near in range(far + 1):
            places = {(a * s, b * t) for a, b in ((far, near), (near, far)) for s in (1, -1) for t in (1, -1)}
            weight = np.exp(exponent * (far * far + near * near))
            total += weight * sum(
                padded[radius + dy : radius + dy + height, radius + dx : radius + dx + width] for dy, dx in places
            )
            weights += weight * len(places)
    return np.asarray(total / weights)


def lightness(y_cd_m2: Reals) -> Reals:
    """L* of CIELAB."""
    relative = y_cd_m2 / WHITE_CD_M2
    return np.where(relative > EPSILON, 116 * np.cbrt(relative) - 16, KAPPA * relative)


def luminance_of(lightness_: Reals) -> Reals:
    """The luminance in cd/m² of an L*."""
    root = (lightness_ + 16) / 116
    return WHITE_CD_M2 * np.where(lightness_ > LINEAR_END, root * root * root, lightness_ / KAPPA)
