"""Adaptation to a still frame: the mean under a Gaussian around the gaze, pixel by pixel (LUI §5.1)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.adaptation.settings import Adaptation, Target
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View

if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext

Reals = NDArray[np.float64]

GAZE_SD_DEG = 10.0
"""As the program's own."""
FLOOR_CD_M2 = 1e-6
LIMIT = 30.0
"""Times the geometric mean, for targets that are robust."""


def luminance(rgb: Reals) -> Reals:
    """Of linear Rec.709, (3, y, x)."""
    return np.asarray(np.einsum("c,cyx->yx", np.array(LUMINANCE_WEIGHTS), rgb))


def target_cd_m2(rgb: Reals, view: View, azimuth_deg: float = 0.0, elevation_deg: float = 0.0) -> float:
    """The luminance that an eye with this direction of gaze adapts to by LUI §5.1, in cd/m²."""
    weights = _around_gaze(view, azimuth_deg, elevation_deg, GAZE_SD_DEG)
    return max(float((weights * luminance(rgb)).sum()), FLOOR_CD_M2)


def target_of(rgb: Reals, eye: EyeContext, settings: Adaptation) -> float:
    """The luminance in cd/m² that an eye adapts to, by these settings, from all pixels."""
    around_cd_m2 = eye.frame.all_around_cd_m2
    if settings.target is Target.BAR_SCENE and around_cd_m2 is not None:
        return around_cd_m2
    y = luminance(rgb)
    match settings.target:
        case Target.LUI:
            weights = _around_gaze(eye.view, eye.pose.azimuth_deg, eye.pose.elevation_deg, settings.gaze_sd_deg)
        case Target.BAR_VIEW:
            weights = _around_middle(eye.view)
        case Target.KRI | Target.BAR_SCENE:
            weights = np.full(y.shape, 1 / y.size)
    log_mean = float(np.exp((weights * np.log(y + FLOOR_CD_M2)).sum()))
    if settings.target is Target.KRI:
        return log_mean
    limited = np.minimum(y, LIMIT * log_mean) if settings.robust else y
    return max(float((weights * limited).sum()), FLOOR_CD_M2)


def _around_gaze(view: View, azimuth_deg: float, elevation_deg: float, sd_deg: float) -> Reals:
    """A Gaussian over the pixels, (y, x), that adds up to 1."""
    x_px, y_px = view.pixel_of(azimuth_deg, elevation_deg)
    x_px, y_px = min(max(x_px, 0.0), view.width_px), min(max(y_px, 0.0), view.height_px)
    sd_px = sd_deg * view.ppd_centre
    rows, columns = np.arange(view.height_px) + 0.5, np.arange(view.width_px) + 0.5
    weights = np.exp(-((rows[:, None] - y_px) ** 2 + (columns - x_px) ** 2) / (2 * sd_px**2))
    return np.asarray(weights / weights.sum())


def _around_middle(view: View) -> Reals:
    """BAR 5–6: 1 − 4d², d = 1 at the sides; adds up to 1."""
    y, x = (2 * (np.arange(size) + 0.5) / size - 1 for size in (view.height_px, view.width_px))
    weights = np.maximum(1 - 4 * (y[:, None] ** 2 + x[None, :] ** 2), 0)
    return np.asarray(weights / weights.sum())


def exposure(adapted_cd_m2: float) -> float:
    """The key over the adapted luminance, 1/(cd/m²) (Krawczyk 2005; E2, E15)."""
    return (1.03 - 2 / (2 + math.log10(adapted_cd_m2 + 1))) / adapted_cd_m2


def rod_share(adapted_cd_m2: float) -> float:
    """σ (LUI 5.4)."""
    return 0.04 / (0.04 + adapted_cd_m2)
