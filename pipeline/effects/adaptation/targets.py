"""The luminance that an eye is on its way to, from the means of a frame's tiles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.effects.adaptation.settings import DEFAULT, Adaptation, Target
from entoptic.pipeline.measure import Measurement

FLOOR_CD_M2 = 1e-6
"""Starlight: what an eye is adapted to in front of a black frame; KRI 4.15's ε."""
LIMIT = 30.0
"""Times the geometric mean: no tile counts for more, if robust. Engineering choice, and the ratio to the mean from
which on a measurement calls a tile a light. docs/adaptation.md has what 10, 100 and 1000 do."""

Tiles = NDArray[np.float64]
"""(tile rows, tile columns)"""


def target_cd_m2(
    measurement: Measurement,
    azimuth_deg: float,
    elevation_deg: float,
    settings: Adaptation = DEFAULT,
    all_around_cd_m2: float | None = None,
) -> float:
    """The luminance an eye with this direction of gaze is on its way to; FLOOR_CD_M2 or more.

    A gaze outside the frame takes the part of the frame that is nearest to it; only target `lui` follows the gaze.
    `all_around_cd_m2` is the mean of a whole panorama, each row weighing as much as it covers of the sphere, where
    that is known: `bar-scene` takes it (BAR 3.2).
    """
    if settings.target is Target.BAR_SCENE and all_around_cd_m2 is not None:
        return max(all_around_cd_m2, FLOOR_CD_M2)
    tiles = measurement.tile_mean_cd_m2.astype(np.float64)
    match settings.target:
        case Target.LUI:
            weights = _around_gaze(measurement, azimuth_deg, elevation_deg, settings.gaze_sd_deg)
        case Target.BAR_VIEW:
            weights = _around_middle(measurement)
        case Target.KRI | Target.BAR_SCENE:
            weights = _covered(measurement)
    weights = weights / weights.sum()
    if settings.robust:
        # A lamp on the border of two tiles counts twice: little beside the decades that it does not count.
        tiles = np.minimum(tiles, LIMIT * _log_mean(tiles, weights))
    mean = _log_mean(tiles, weights) if settings.target is Target.KRI else float((weights * tiles).sum())
    return max(mean, FLOOR_CD_M2)


def _log_mean(tiles: Tiles, weights: Tiles) -> float:
    """KRI 4.15, of tiles' means: what varies within a tile is averaged as light."""
    return float(np.exp((weights * np.log(tiles + FLOOR_CD_M2)).sum()))


def _around_gaze(measurement: Measurement, azimuth_deg: float, elevation_deg: float, sd_deg: float) -> Tiles:
    view = measurement.view
    x_px, y_px = view.pixel_of(azimuth_deg, elevation_deg)
    x_px, y_px = min(max(x_px, 0.0), view.width_px), min(max(y_px, 0.0), view.height_px)
    sd_px = sd_deg * view.ppd_centre
    rows, columns = (np.arange(count) + 0.5 for count in measurement.tile_mean_cd_m2.shape)
    along_y, along_x = (
        np.exp(-((middle * measurement.tile_px - at_px) ** 2) / (2 * sd_px**2))
        for middle, at_px in ((rows, y_px), (columns, x_px))
    )
    return np.outer(along_y, along_x)


def _around_middle(measurement: Measurement) -> Tiles:
    """BAR 5–6 at the tiles' middles, times how much of each lies in the frame."""
    view = measurement.view
    y, x = (
        (edges[:-1] + edges[1:]) / side_px - 1
        for edges, side_px in zip(_edges(measurement), (view.height_px, view.width_px), strict=True)
    )
    weights = np.maximum(1 - 4 * (y[:, None] ** 2 + x[None, :] ** 2), 0) * _covered(measurement)
    # Of a frame of one or two tiles a side no middle lies that near the frame's.
    return weights if weights.any() else _covered(measurement)


def _covered(measurement: Measurement) -> Tiles:
    """How much of the frame each tile covers; those at the lower and right edge may be cut."""
    along_y, along_x = _edges(measurement)
    return np.outer(np.diff(along_y), np.diff(along_x))


def _edges(measurement: Measurement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where tiles begin and end, in px from the upper left corner: (tile rows + 1,), (tile columns + 1,)."""
    rows, columns = measurement.tile_mean_cd_m2.shape
    view, tile_px = measurement.view, measurement.tile_px
    return (
        np.minimum(np.arange(rows + 1.0) * tile_px, view.height_px),
        np.minimum(np.arange(columns + 1.0) * tile_px, view.width_px),
    )
