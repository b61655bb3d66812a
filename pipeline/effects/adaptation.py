"""The luminance an eye is adapted to, over time, and the exposure that follows from it (LUI §5.1)."""

from __future__ import annotations

import math

import numpy as np

from pipeline.measure import Measurement

TAU_ROD_S, TAU_CONE_S = 0.4, 0.1
"""LUI 5.3, after Krawczyk 2005."""
GAZE_SD_DEG = 10.0
"""Standard deviation of the weight around the gaze. Engineering choice: LUI gives none; 10° weighs the macula and its
surround, and lets a lamp in the periphery count little."""
FLOOR_CD_M2 = 1e-6
"""Starlight: what an eye is adapted to in front of a black frame."""


def target_cd_m2(measurement: Measurement, azimuth_deg: float, elevation_deg: float) -> float:
    """The luminance an eye with this direction of gaze is on its way to: the mean under a Gaussian around the gaze.

    A gaze outside the frame takes the part of the frame that is nearest to it.
    """
    view, tile_px = measurement.view, measurement.tile_px
    x_px, y_px = view.pixel_of(azimuth_deg, elevation_deg)
    x_px, y_px = min(max(x_px, 0.0), view.width_px), min(max(y_px, 0.0), view.height_px)
    rows, columns = measurement.tile_mean_cd_m2.shape
    sd_px = GAZE_SD_DEG * view.ppd_centre
    along_y = np.exp(-(((np.arange(rows) + 0.5) * tile_px - y_px) ** 2) / (2 * sd_px**2))
    along_x = np.exp(-(((np.arange(columns) + 0.5) * tile_px - x_px) ** 2) / (2 * sd_px**2))
    weighted = along_y @ measurement.tile_mean_cd_m2.astype(np.float64) @ along_x
    return max(float(weighted / (along_y.sum() * along_x.sum())), FLOOR_CD_M2)


def rod_sensitivity(luminance_cd_m2: float) -> float:
    """σ: 1 in the dark, 0 in the light (LUI 5.4)."""
    return 0.04 / (0.04 + luminance_cd_m2)


def adapt_cd_m2(adapted_cd_m2: float, target: float, dt_s: float) -> float:
    """One step of adaptation towards a target (LUI 5.2): the exact exponential, stable for any dt.

    Time that stands still or goes backwards leaves the state as it is.
    """
    sigma = rod_sensitivity(target)
    tau_s = sigma * TAU_ROD_S + (1 - sigma) * TAU_CONE_S
    return adapted_cd_m2 + (target - adapted_cd_m2) * -math.expm1(-max(dt_s, 0.0) / tau_s)


def exposure(adapted_cd_m2: float) -> float:
    """What a luminance in cd/m² is multiplied by: the key over the adapted luminance (Krawczyk 2005; E2, E15).

    The key falls in the dark: a night looks dim even to an eye that has adapted to it.
    """
    key = 1.03 - 2 / (2 + math.log10(adapted_cd_m2 + 1))
    return key / adapted_cd_m2
