"""Adaptation to a still frame: the mean under a Gaussian around the gaze, pixel by pixel (LUI 5.1)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View

Reals = NDArray[np.float64]

GAZE_SD_DEG = 10.0
"""As the program's own."""
FLOOR_CD_M2 = 1e-6


def luminance(rgb: Reals) -> Reals:
    """Of linear Rec.709, (3, y, x)."""
    return np.asarray(np.einsum("c,cyx->yx", np.array(LUMINANCE_WEIGHTS), rgb))


def target_cd_m2(rgb: Reals, view: View, azimuth_deg: float = 0.0, elevation_deg: float = 0.0) -> float:
    """The luminance that an eye with this direction of gaze adapts to, in cd/m²."""
    x_px, y_px = view.pixel_of(azimuth_deg, elevation_deg)
    x_px, y_px = min(max(x_px, 0.0), view.width_px), min(max(y_px, 0.0), view.height_px)
    sd_px = GAZE_SD_DEG * view.ppd_centre
    rows, columns = np.arange(view.height_px) + 0.5, np.arange(view.width_px) + 0.5
    along_y = np.exp(-((rows - y_px) ** 2) / (2 * sd_px**2))
    along_x = np.exp(-((columns - x_px) ** 2) / (2 * sd_px**2))
    return max(float(along_y @ luminance(rgb) @ along_x / (along_y.sum() * along_x.sum())), FLOOR_CD_M2)


def exposure(adapted_cd_m2: float) -> float:
    """The key over the adapted luminance, 1/(cd/m²) (Krawczyk 2005; E2, E15)."""
    return (1.03 - 2 / (2 + math.log10(adapted_cd_m2 + 1))) / adapted_cd_m2


def rod_share(adapted_cd_m2: float) -> float:
    """σ (LUI 5.4)."""
    return 0.04 / (0.04 + adapted_cd_m2)


def log_mean_cd_m2(rgb: Reals) -> float:
    """KRI 4.15: the geometric mean of all pixels."""
    return float(np.exp(np.log(luminance(rgb) + FLOOR_CD_M2).mean()))


def mean_cd_m2(rgb: Reals) -> float:
    """BAR's first method: the mean of all pixels."""
    return max(float(luminance(rgb).mean()), FLOOR_CD_M2)


def middle_mean_cd_m2(rgb: Reals) -> float:
    """BAR 5–6: the mean under 1 − 4d² around the middle, d = 1 at the sides."""
    y, x = (2 * (np.arange(size) + 0.5) / size - 1 for size in rgb.shape[1:])
    weights = np.maximum(1 - 4 * (y[:, None] ** 2 + x[None, :] ** 2), 0)
    return max(float((weights * luminance(rgb)).sum() / weights.sum()), FLOOR_CD_M2)
