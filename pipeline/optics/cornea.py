"""The cornea: its few flat cells between the clear fibrils, which scatter and never move (RIT 3.1)."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Float

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import coverage

CELL_M = 15e-6
"""Diameter of a flat cell (RIT 3.1)."""
STREAM = 1
"""Which random stream is the cornea's, so that no other part changes it."""


def shade(transmittance: Float[np.ndarray, "n n"], dx_m: float, observer: Observer) -> None:
    """Puts the cells before the plane, in place: opaque discs, uniformly over the plane's inscribed disc."""
    x_m, y_m = places_m((observer.seed, STREAM), observer.cornea_cells)
    coverage.shade_discs(transmittance, dx_m, x_m, y_m, np.full(observer.cornea_cells, CELL_M / 2))


@functools.lru_cache(maxsize=4)
def places_m(stream: tuple[int, ...], count: int) -> tuple[Float[np.ndarray, " cell"], Float[np.ndarray, " cell"]]:
    """Places right of and below the axis, uniformly over the plane's inscribed disc, from a random stream."""
    random = np.random.default_rng(stream)
    distance_m = coverage.PLANE_M / 2 * np.sqrt(random.random(count))
    azimuth = random.random(count) * 2 * np.pi
    return distance_m * np.cos(azimuth), distance_m * np.sin(azimuth)
