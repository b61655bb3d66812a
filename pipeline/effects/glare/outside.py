"""Far light of lights of their own that stand outside the view, at their true angles."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.kernel import Mixture, Part, far_deg, smooth_step
from entoptic.pipeline.effects.glare.lights import Points, is_on_plane
from entoptic.pipeline.effects.glare.plane import Plane
from entoptic.pipeline.optics import radial, whole

STRIDE = 8
"""Glare of lights far outside the view is computed at every so many cells. Engineering choice: it is smooth there."""
CLOSE_STRIDES = 4
"""Strides from the view up to which a light is not far outside it."""
ANGLES = 400
"""Of the table that gives glare of lights outside the plane, even in the angle's logarithm."""


def from_outside(groups: Sequence[Points], plane: Plane) -> Float[np.ndarray, "3 row column"] | None:
    """Far light that lights outside the plane bring to each of a frame's cells, cd/m²."""
    total = None
    rows, columns = (-(-size // plane.pool) for size in (plane.view.height_px, plane.view.width_px))
    for points in groups:
        outside = ~is_on_plane(points, plane)
        if not outside.any():
            continue
        deg, density = _far_table(points.mixture, plane)
        total = np.zeros((3, rows, columns)) if total is None else total
        ahead, lux = points.towards[outside], points.lux[outside]
        at = _cells(plane, 1)
        nearest = np.degrees(np.arccos(np.clip((ahead @ at[:, :: max(at.shape[1] // 4000, 1)]).max(axis=1), -1, 1)))
        close = nearest < CLOSE_STRIDES * STRIDE * plane.step_deg
        for some, stride in ((close, 1), (~close, STRIDE)):
            if some.any():
                total += _direct(ahead[some], lux[some], plane, stride, deg, density, (rows, columns))
    return total


def _direct(
    ahead: NDArray[np.float64],
    lux: NDArray[np.float64],
    plane: Plane,
    stride: int,
    deg: NDArray[np.float64],
    density: NDArray[np.float64],
    size: tuple[int, int],
) -> NDArray[np.float64]:
    at = _cells(plane, stride)
    low = np.zeros((3, at.shape[1]))
    for direction, amount in zip(ahead, lux, strict=True):
        angle = np.degrees(np.arccos(np.clip(direction @ at, -1, 1)))
        low += amount * np.stack([np.interp(angle, deg, of, right=0.0) for of in density])
    if stride == 1:
        return low.reshape(3, *size)
    places = [_strided(count, stride) for count in size]
    coarse = low.reshape(3, len(places[0]), len(places[1]))
    rows, columns = (
        np.stack([np.interp(np.arange(count), place, unit) for unit in np.eye(len(place))], axis=1)
        for count, place in zip(size, places, strict=True)
    )
    return np.asarray(rows @ coarse @ columns.T)


def _strided(count: int, stride: int) -> NDArray[np.float64]:
    return np.linspace(0, count - 1, -(-count // stride) + 1) if count > 1 else np.zeros(1)


@functools.lru_cache(maxsize=8)
def _cells(plane: Plane, stride: int) -> NDArray[np.float64]:
    """Unit vectors (3, n) of the frame's cells, every so many."""
    view = plane.view
    v, u = (
        ((_strided(-(-size // plane.pool), stride) if stride > 1 else np.arange(-(-size // plane.pool))) + 0.5)
        * plane.pool
        - size / 2
        for size in (view.height_px, view.width_px)
    )
    down, right = np.meshgrid(v / view.focal_px, u / view.focal_px, indexing="ij")
    both = np.stack([right, down, np.ones_like(down)])
    return np.asarray((both / np.linalg.norm(both, axis=0)).reshape(3, -1))


def _far_table(mixture: Mixture, plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Density of far light at angles: (n,) and (3, n), alike in all directions."""
    tables = [
        (part.kept(("table", plane), functools.partial(_table_of, part, plane)), weight) for part, weight in mixture
    ]
    return tables[0][0][0], np.asarray(sum(weight * table[1] for table, weight in tables))


def _table_of(part: Part, plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = far_deg(plane)
    wider = max(1.0, high / whole.VEIL_DEG[0])
    deg = np.concatenate([[0.0], np.geomspace(low, radial.EDGE_DEG, ANGLES)])
    side = plane.step_deg
    reach = whole.kernel_radius_px(1 / side, wider)
    offset = np.arange(-reach, reach + 1) * side
    away = np.hypot(offset[:, None], offset)
    cells = part.cells(1 / side, reach, wider)[:, 0] / np.radians(side) ** 2
    ring = np.rint(away / side * 2).astype(int).ravel()
    count = np.bincount(ring)
    filled = count > 0
    at = np.bincount(ring, away.ravel())[filled] / count[filled]
    means = [np.interp(deg, at, np.bincount(ring, of.ravel())[filled] / count[filled], right=0.0) for of in cells]
    density = np.stack(means)
    if part.veil is not None and part.colour is not None:
        density += part.colour[:, None] * part.veil.density(np.maximum(deg, 1e-3), wider)
    return deg, density * smooth_step(deg, low, high)
