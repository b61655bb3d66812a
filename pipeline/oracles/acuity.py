"""Detail lost in the dark: LUI's separable fit, and the true two-dimensional filter of the same widths (LUI 5.3).

Lightness is CIELAB's with white at 100 cd/m². A pixel takes over the blurred luminance and keeps its colour as a linear
shift: R, G and B change by what Y changes.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.acuity import larson
from entoptic.pipeline.effects.acuity.settings import Acuity, AcuityMethod
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.oracles.adaptation import luminance

Reals = NDArray[np.float64]

WHITE_CD_M2 = 100.0
KAPPA, EPSILON = 24389 / 27, 216 / 24389
"""CIE 15:2004."""
RADIUS_PX = 3
REACH = 4
"""Radius of the true filter in σ of the darkest pixel: what lies beyond weighs 3e-4 in all."""


def lightness(y_cd_m2: Reals) -> Reals:
    """L*."""
    relative = y_cd_m2 / WHITE_CD_M2
    return np.asarray(np.where(relative > EPSILON, 116 * np.cbrt(relative) - 16, KAPPA * relative))


def luminance_of(lightness_: Reals) -> Reals:
    """The luminance in cd/m² of an L*."""
    return np.asarray(
        WHITE_CD_M2 * np.where(lightness_ > KAPPA * EPSILON, ((lightness_ + 16) / 116) ** 3, lightness_ / KAPPA)
    )


def fit(rgb: Reals) -> Reals:
    """LUI 5.16: σ = max(1 − L*, 0) px, along rows, then along columns with σ from what the rows left."""
    return _with_lightness(rgb, _along(_along(lightness(luminance(rgb)), 1), 0))


def true_filter(rgb: Reals) -> Reals:
    """The same widths in both directions at once: each pixel the mean under its own round Gaussian."""
    values = lightness(luminance(rgb))
    inverse = _inverse(values)
    padded = np.pad(values, RADIUS_PX, mode="edge")
    total, weights = np.zeros_like(values), np.zeros_like(values)
    height, width = values.shape
    for dy in range(-RADIUS_PX, RADIUS_PX + 1):
        for dx in range(-RADIUS_PX, RADIUS_PX + 1):
            weight = np.exp(-(dy * dy + dx * dx) * inverse)
            there = padded[RADIUS_PX + dy : RADIUS_PX + dy + height, RADIUS_PX + dx : RADIUS_PX + dx + width]
            total += weight * there
            weights += weight
    return _with_lightness(rgb, total / weights)


def _inverse(values: Reals) -> Reals:
    """1/(2σ²); where σ is 0 every neighbour's weight underflows."""
    sigma = np.clip(1 - values, 0, 1)
    return np.asarray(1 / np.maximum(2 * sigma * sigma, 1e-4))


def _along(values: Reals, axis: int) -> Reals:
    inverse = _inverse(values)
    pad = [(0, 0), (0, 0)]
    pad[axis] = (RADIUS_PX, RADIUS_PX)
    padded = np.pad(values, pad, mode="edge")
    size = values.shape[axis]
    total, weights = np.zeros_like(values), np.zeros_like(values)
    for k in range(-RADIUS_PX, RADIUS_PX + 1):
        weight = np.exp(-k * k * inverse)
        total += weight * np.take(padded, np.arange(RADIUS_PX + k, RADIUS_PX + k + size), axis)
        weights += weight
    return np.asarray(total / weights)


def _with_lightness(rgb: Reals, blurred: Reals) -> Reals:
    y = luminance(rgb)
    change = np.where(lightness(y) < 1, luminance_of(blurred) - y, 0)
    return np.asarray(np.maximum(rgb + change, 0))


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
