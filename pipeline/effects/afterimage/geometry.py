"""Where a direction falls on the retina of an eye that looks elsewhere, and back.

The retina's map is centred at the fovea, its coordinates are degrees of eccentricity to the right and upwards of the
gaze (azimuthal equidistant). An eye turns by Listing's law: from straight ahead to the gaze about one axis, without
torsion; so a light that is looked at from the side falls where it does on a real retina.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.frame import View

HALF_FIELD_DEG = 75.0
"""Eccentricity that the map reaches along its axes. Engineering choice: beyond it the eye sees motion, no images."""
NODES = 128
"""A frame is sampled at most so often along its longer side, as its measurement is (LUI 5.1)."""
EDGE_SHARE = 0.05
"""So far beyond its edge, in shares of its longer side, a frame goes on as at the edge; then there is no light.

Engineering choice: a few cells, or a wall that fills the frame would bleach less where it ends."""


def cells(cell_deg: float) -> int:
    """Cells along a side of the map; an odd number, the middle one is the fovea's."""
    return 2 * round(HALF_FIELD_DEG / cell_deg) + 1


@functools.lru_cache(maxsize=16)
def node_px(view: View) -> tuple[int, int]:
    """Distance of a frame's nodes downwards and across; each stands in the middle of a rectangle of so many pixels.

    One that leaves no rest, if there is one up to half as large again: a frame of blocks is worked on in one piece.
    """
    least = -(-max(view.width_px, view.height_px) // NODES)
    sizes = view.height_px, view.width_px
    down, across = (
        next((side for side in range(least, least * 3 // 2 + 1) if size % side == 0), least) for size in sizes
    )
    return down, across


def node_counts(view: View) -> tuple[int, int]:
    """Nodes along a frame's height and width."""
    down, across = node_px(view)
    return -(-view.height_px // down), -(-view.width_px // across)


def turn(view: View, gaze_px: tuple[float, float]) -> NDArray[np.float32]:
    """The rotation from an eye's axes, right, up and ahead, to the head's, for an eye that looks at this pixel."""
    right = (gaze_px[0] - view.width_px / 2) / view.focal_px
    up = (view.height_px / 2 - gaze_px[1]) / view.focal_px
    length = math.sqrt(1 + right * right + up * up)
    x, y, z = right / length, up / length, 1 / length
    across = x * y / (1 + z)
    matrix = [[1 - x * x / (1 + z), -across, x], [-across, 1 - y * y / (1 + z), y], [-x, -y, z]]
    return np.array(matrix, np.float32)


@functools.lru_cache(maxsize=4)
def cell_directions(count: int) -> Float[np.ndarray, "3 row column"]:
    """Where each cell of a map looks, in the eye's axes; rows go downwards."""
    deg = np.linspace(-HALF_FIELD_DEG, HALF_FIELD_DEG, count)
    right, up = deg[None, :], -deg[:, None]
    eccentricity = np.hypot(right, up)
    # sin(e)/e, in degrees, is π/180 at the fovea.
    share = np.sinc(eccentricity / 180) * math.radians(1)
    directions = np.stack([right * share, up * share, np.cos(np.radians(eccentricity))])
    return directions.astype(np.float32)


def node_directions(view: View) -> Float[Array, "3 row column"]:
    """Where each node of a frame lies, in the head's axes, unit vectors."""
    rows, columns = node_counts(view)
    down, across = (np.float32(side) for side in node_px(view))
    right = (across * (jnp.arange(columns, dtype=jnp.float32) + 0.5) - view.width_px / 2) / np.float32(view.focal_px)
    up = (view.height_px / 2 - down * (jnp.arange(rows, dtype=jnp.float32) + 0.5)) / np.float32(view.focal_px)
    right, up = jnp.broadcast_arrays(right[None, :], up[:, None])
    ahead = 1 / jnp.sqrt(1 + right * right + up * up)
    return jnp.stack([right * ahead, up * ahead, ahead])


def cell_places(directions: Float[Array, "3 row column"], count: int) -> tuple[Array, Array]:
    """(row, column) on the map, in cells, of directions in the eye's axes; what lies beyond is on its edge."""
    right, up, ahead = directions
    off_axis = jnp.sqrt(right * right + up * up)
    degrees = jnp.degrees(jnp.arctan2(off_axis, ahead)) / jnp.maximum(off_axis, np.float32(1e-9))
    per_cell = np.float32((count - 1) / (2 * HALF_FIELD_DEG))
    middle = np.float32((count - 1) / 2)
    last = np.float32(count - 1)
    return (
        jnp.clip(middle - up * degrees * per_cell, 0, last),
        jnp.clip(middle + right * degrees * per_cell, 0, last),
    )


def node_places(directions: Float[Array, "3 row column"], view: View) -> tuple[Array, Array, Array]:
    """(row, column) in nodes of directions in the head's axes, within the frame, and where there is light at all."""
    right, up, ahead = directions
    depth = jnp.maximum(ahead, np.float32(1e-3))
    x = view.width_px / 2 + np.float32(view.focal_px) * right / depth
    y = view.height_px / 2 - np.float32(view.focal_px) * up / depth
    edge = EDGE_SHARE * max(view.width_px, view.height_px)
    lit = (ahead > 1e-3) & (x > -edge) & (x < view.width_px + edge) & (y > -edge) & (y < view.height_px + edge)
    down, across = node_px(view)
    rows, columns = node_counts(view)
    return (
        jnp.clip(y / np.float32(down) - 0.5, 0, rows - 1),
        jnp.clip(x / np.float32(across) - 0.5, 0, columns - 1),
        lit,
    )


@jax.jit
def sample(map_: Float[Array, "c row column"], row: Array, column: Array) -> Float[Array, "c *place"]:
    """A map between its entries, bilinear; places lie within it."""
    rows, columns = map_.shape[1:]
    flat = map_.reshape(map_.shape[0], -1)
    top, left = (jnp.minimum(jnp.floor(place), last - 1) for place, last in ((row, rows), (column, columns)))
    down, across = row - top, column - left
    first = top.astype(jnp.int32) * columns + left.astype(jnp.int32)
    # On the last row or column the next one counts for nothing.
    right, below = jnp.where(left < columns - 1, 1, 0), jnp.where(top < rows - 1, columns, 0)
    upper = flat[:, first] * (1 - across) + flat[:, first + right] * across
    lower = flat[:, first + below] * (1 - across) + flat[:, first + below + right] * across
    return upper * (1 - down) + lower * down
