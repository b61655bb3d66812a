"""Detail lost in the dark: LUI's separable fit, and the true two-dimensional filter of the same widths (LUI 5.3).

Lightness is CIELAB's with white at 100 cd/m². A pixel takes over the blurred luminance and keeps its colour as a linear
shift: R, G and B change by what Y changes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.cost.plain.adaptation import luminance

Reals = NDArray[np.float64]

WHITE_CD_M2 = 100.0
KAPPA, EPSILON = 24389 / 27, 216 / 24389
"""CIE 15:2004."""
RADIUS_PX = 3


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
