"""Light that an eye scatters beyond some degrees: smooth enough for low resolution, wide enough to need true angles.

Each tile's light reaches every other at the exact angle between their directions. Angles and solid angles are those of
the pinhole view, so the veil does not widen towards the edges as one that is shifted over pixels does.

Rounding. Cubic tiles swing by some per mille where a function starts, as a veil does 4.5° from its source: there the
result is cut at 0, so no light is negative. Everywhere else it is linear in the light.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from entoptic.pipeline.effects.glare import veil_tiles
from entoptic.pipeline.effects.glare.kernel import Mixture, Veil
from entoptic.pipeline.frame import View


class Side(NamedTuple):
    """veil_tiles.Axis as arrays for JAX."""

    weights: Float[Array, "point pixel"]
    tiles: Float[Array, "points tiles"]
    """All blocks' points; even tiles, then odd ones."""


class Grid(NamedTuple):
    """A view's tiles."""

    rows: Side
    columns: Side
    solid_angles: Float[Array, "row column"]


def amounts(mixture: Mixture) -> dict[Veil, float]:
    """Share of all light that each of a kernel's veils takes; components with the same veil have one together."""
    result: dict[Veil, float] = {}
    for component, weight in mixture:
        if component.veil is not None and weight * component.veil_share > 0:
            result[component.veil] = result.get(component.veil, 0.0) + weight * component.veil_share
    return result


def veil_change(
    light: Float[Array, "3 y x"], view: View, mixture: Mixture, *, onto: Float[Array, "3 y x"] | None = None
) -> Float[Array, "3 y x"]:
    """What a frame's veil changes: light that arrives less light that has left. In cd/m², 0 for a kernel without veil.

    It is added to `onto` if given. For the first frame of a view or of a veil this builds a matrix, which takes about a
    second.
    """
    shares = amounts(mixture)
    if not shares:
        return jnp.zeros_like(light) if onto is None else onto
    left = jnp.float32(sum(shares.values()))
    return _change(light, points(light, view, shares), grid(view).rows.weights, left, onto)


def points(light: Float[Array, "3 y x"], view: View, shares: dict[Veil, float]) -> Float[Array, "3 row column"]:
    """The veil in cd/m² at a view's low-resolution points; `at_pixels` makes a frame of it."""
    matrices = [matrix(view, veil) for veil in shares]
    weights = jnp.asarray(list(shares.values()), jnp.float32)
    return _points(light, grid(view), matrices, weights)


def at_pixels(
    low: Float[Array, "3 row x"], row_weights: Float[Array, "point pixel"], rows: int
) -> Float[Array, "3 y x"]:
    """A veil at each pixel from `points`, at `rows` rows. To be called within the caller's jitted function."""
    points_ = len(row_weights)
    blocks = low.reshape(3, -1, points_, 1, low.shape[2])
    read = sum(blocks[:, :, k] * row_weights[k][:, None] for k in range(points_))
    # Cubic tiles swing below 0 where a veil starts.
    return jnp.maximum(jnp.asarray(read).reshape(3, -1, low.shape[2])[:, :rows], 0)


@functools.lru_cache(maxsize=16)
def grid(view: View) -> Grid:
    """A view's tiles."""
    rows, columns = veil_tiles.axes(view)
    sides = [
        Side(jnp.asarray(axis.weights), jnp.asarray(axis.tiles.reshape(len(axis.tiles), -1), jnp.float32))
        for axis in (rows, columns)
    ]
    return Grid(sides[0], sides[1], jnp.asarray(veil_tiles.solid_angles(view), jnp.float32))


@functools.lru_cache(maxsize=6)
def matrix(view: View, veil: Veil) -> Float[Array, "4 tile tile"]:
    """What a veil of unit volume carries from tile to tile: 60 MB at most."""
    return jnp.asarray(veil_tiles.carried(view, veil))


@jax.jit
def _points(
    light: Float[Array, "3 y x"],
    tiles: Grid,
    matrices: Sequence[Float[Array, "4 tile tile"]],
    shares: Float[Array, "veil"],
) -> Float[Array, "3 row x"]:
    gathered = _gather(light, tiles)
    _, high, wide = gathered.shape
    # (3, y parity, y, x parity, x) → (parities, tile, channel)
    by_parity = gathered.reshape(3, 2, high // 2, 2, wide // 2).transpose(1, 3, 2, 4, 0).reshape(4, -1, 3)
    arrived = jnp.asarray(sum(share * (carried @ by_parity) for share, carried in zip(shares, matrices, strict=True)))
    spread = arrived.reshape(2, 2, high // 2, wide // 2, 3).transpose(4, 0, 2, 1, 3).reshape(3, high, wide)
    low = tiles.rows.tiles @ (spread @ tiles.columns.tiles.T)
    # All columns at once: rows, which is most of the work, are left to whoever needs them.
    across = low.reshape(3, low.shape[1], -1, len(tiles.columns.weights)) @ tiles.columns.weights
    return across.reshape(3, low.shape[1], -1)[:, :, : light.shape[2]]


def _gather(light: Float[Array, "3 y x"], tiles: Grid) -> Float[Array, "3 tiles tiles"]:
    """Each tile's light times its solid angle."""
    points_y, block_y = tiles.rows.weights.shape
    block_x = tiles.columns.weights.shape[1]
    _, height, width = light.shape
    rest = ((0, 0), (0, -height % block_y), (0, -width % block_x))
    padded = jnp.pad(light, rest) if any(after for _, after in rest) else light
    blocks = padded.reshape(3, -1, block_y, padded.shape[2])
    # A batch of small products, the same weights for each: XLA would transpose the frame for a single one.
    weights = jnp.broadcast_to(tiles.rows.weights, (*blocks.shape[:2], points_y, block_y))
    by_row = jnp.matmul(weights, blocks).reshape(3, -1, padded.shape[2] // block_x, block_x)
    at_points = (by_row @ tiles.columns.weights.T).reshape(3, by_row.shape[1], -1)
    return tiles.rows.tiles.T @ ((at_points * tiles.solid_angles) @ tiles.columns.tiles)


@jax.jit
def _change(
    light: Float[Array, "3 y x"],
    low: Float[Array, "3 row x"],
    row_weights: Float[Array, "point pixel"],
    left: Float[Array, ""],
    onto: Float[Array, "3 y x"] | None,
) -> Float[Array, "3 y x"]:
    change = at_pixels(low, row_weights, light.shape[1]) - left * light
    return change if onto is None else onto + change
